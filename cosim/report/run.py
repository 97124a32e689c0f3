"""Figures and report of one run: tracking, forces, delays, tip path, wiring."""

from collections.abc import Sequence

import numpy as np
from attrs import evolve

from cosim.engine.master import Result
from cosim.engine.outcome import Outcome
from cosim.engine.table import SignalColumns, stacked
from cosim.errors import InputError, Problem, did_you_mean
from cosim.report.applications import application_sections
from cosim.report.html import Drawing, Report, Section, Table, cell
from cosim.report.motion import playback
from cosim.report.plots import COLOURS, TIME, Colour, Figure, Mark, Plot, PlotAxis, Series, curves
from cosim.report.wiring import block_diagram, milliseconds
from cosim.results.measures import energies
from cosim.results.provenance import provenance
from cosim.results.summary import Judged, limit_time, simulated_time
from cosim.results.tips import FacingTips, facing_tips
from cosim.signals import grouped, stem
from cosim.wiring import direction_table, vector_starts

_MEMORY = 256 << 20
"""Bytes of a run's table that its report reads; of a larger one it takes every so many rows."""
_GOOD = {Outcome.CONVERGED}
_BAD = {Outcome.GROWING, Outcome.DIVERGED, Outcome.DOMAIN_EXIT, Outcome.FAILED}


def run_report(judged: Judged) -> Report:
    """The report of a run; one that is too long for memory is shown by every so many of its rows."""
    judged = evolve(judged, result=_shown(judged.result))
    result = judged.result
    sections = [
        _found(judged),
        _motion(judged),
        *application_sections(result),
        _tracking(result),
        _ports(judged),
        _forces(result),
        _delays(result),
        _others(result),
        _messages(result),
        _scenario(result),
        _wiring(judged),
        _components(judged),
    ]
    mood = "good" if judged.outcome in _GOOD else "bad" if judged.outcome in _BAD else "neutral"
    return Report(
        f"{result.scenario.name}: {judged.outcome.value.replace('_', ' ')}",
        _verdict(judged),
        [s for s in sections if s is not None],
        provenance(result),
        mood,
        source="result.h5",
    )


def _shown(result: Result) -> Result:
    if not isinstance(result.signals, SignalColumns) or not result.signals.rows.on_disk:
        return result
    names = list(result.signals)
    every = 8 * len(result.time) * len(names) // _MEMORY + 1
    values = np.ascontiguousarray(stacked(result.signals, names, every).T)
    return evolve(result, time=result.time[::every], signals=dict(zip(names, values)))


# --- words and tables
# ------------------------------------------------------------------------------------------------------


def _verdict(judged: Judged) -> str:
    words = f"{judged.outcome.value.replace('_', ' ').capitalize()}: {judged.outcome.advice}."
    details = [judged.result.message] if judged.result.message else []
    if judged.growth_rate is not None:
        details.append(f"Small disturbances change at {judged.growth_rate:+.4g} 1/s{_interval(judged)}.")
    if judged.tracking is not None:
        details.append(f"The tips were {judged.tracking.total * 1e3:.3g} mm apart (RMS).")
    if judged.result.scenario.changed:
        details.append(f"This run is {judged.result.scenario.name} {judged.result.scenario.changed}.")
    return words + "\n\n" + " ".join(details)


def _interval(judged: Judged) -> str:
    return "" if judged.interval is None else f" (95 %: {judged.interval[0]:+.4g} to {judged.interval[1]:+.4g})"


def _found(judged: Judged) -> Section:
    """What was found, as a table."""
    result, experiment = judged.result, judged.result.scenario.experiment
    simulated = simulated_time(result)
    rows = [
        ("outcome", judged.outcome.value),
        ("growth rate of small disturbances [1/s]", judged.growth_rate),
        ("its 95 % interval [1/s]", judged.interval),
        *_tracking_rows(judged),
        (
            "simulated time [s]",
            f"{simulated:g}" + (f" of {experiment.stop:g}" if result.stopped_at is not None else ""),
        ),
        ("computed in [s]", f"{result.wall_time:.2f} ({simulated / max(result.wall_time, 1e-9):.0f} times real time)"),
        ("communication step", f"{experiment.step * 1e3:g} ms"),
        ("algorithm", f"{experiment.algorithm.value}, {experiment.extrapolation.value} inputs"),
        ("motor limit first reached [s]", limit_time(result)),
        ("effects added", ", ".join(result.scenario.effects) or None),
    ]
    return Section(
        "What was found",
        tables=[Table(("", ""), [(name, cell(value)) for name, value in rows if value is not None])],
    )


def _scenario(result: Result) -> Section | None:
    """What the scenario's file says of itself: after what was found, since a changed value may have made it untrue."""
    scenario = result.scenario
    if not (scenario.title or scenario.description):
        return None
    changed = f" This run was {scenario.changed}, which they do not tell of." if scenario.changed else ""
    text = f"The words of its file.{changed}\n\n{scenario.title}"
    return Section("The scenario", f"{text}\n\n{scenario.description}".strip())


def _messages(result: Result) -> Section | None:
    """What FMUs said, each message once."""
    if not result.messages:
        return None
    rows = [(m.component, m.level, m.text, str(m.count), f"{m.time:g}") for m in result.messages]
    table = Table(("component", "level", "message", "times", "first at [s]"), rows)
    return Section("Messages of the FMUs", "Messages that differ in numbers only are counted as one.", [table])


def _tracking_rows(judged: Judged) -> list[tuple[str, object]]:
    if judged.tracking is None:
        return []
    axes = ", ".join(f"{name} {value * 1e3:.4g}" for name, value in zip("xyz", judged.tracking.axes))
    return [("tracking, RMS of |x_l − x_r| [mm]", f"{judged.tracking.total * 1e3:.4g} ({axes})")]


def _wiring(judged: Judged) -> Section:
    wiring = judged.wiring
    hops = [
        (
            str(h.connection.source),
            str(h.connection.target),
            h.size,
            h.unit,
            "line" if h.linear else "hold",
            milliseconds(h.age) if h.age else "0",
        )
        for h in wiring.hops
    ]
    ways = [(what, way, milliseconds(age) if age else "0") for what, way, age in direction_table(wiring)]
    tables = [
        Table(
            ("from", "to", "elements", "unit", "input", "age"),
            hops,
            "Connections. The age is the mean time by which the stepping makes a signal older (negative: newer).",
        )
    ]
    if ways:
        tables.insert(
            0,
            Table(
                ("direction", "way", "added delay"),
                ways,
                "Delay that the co-simulation itself adds, without the channels' own.",
            ),
        )
    text = f"Order of stepping: {' → '.join(wiring.order)}."
    if wiring.notes:
        text += "\n\n" + "; ".join(wiring.notes) + "."
    caption = "Block diagram. Numbers at the wires: delay added by the stepping."
    return Section("Wiring", text, tables, [Drawing(block_diagram(wiring), caption)])


def _components(judged: Judged) -> Section:
    rows = []
    for name, starts in judged.wiring.starts.items():
        description = judged.wiring.descriptions[name]
        for key, values in vector_starts(starts).items():
            variable = description.variables[description.elements(key)[0]]
            shown = (
                variable.item(values[0])
                if variable.items
                else values[0]
                if len(values) == 1
                else [f"{v:.6g}" for v in values]
            )
            rows.append(
                (
                    name,
                    description.model,
                    key,
                    shown if isinstance(shown, (list, str)) else f"{shown:.6g}",
                    variable.unit.name,
                )
            )
    fmus = [(f.component, f.model, f.fmi, f.sha256[:16]) for f in judged.result.fmus]
    return Section(
        "Components",
        "",
        [
            Table(
                ("component", "model", "parameter", "value", "unit"),
                rows,
                "Parameters that the scenario sets; the others have the start values of their FMU.",
            ),
            Table(("component", "model", "FMI", "SHA-256 begins"), fmus, "FMUs"),
        ],
    )


# --- figures
# ------------------------------------------------------------------------------------------------------------


def _motion(judged: Judged) -> Section | None:
    found = playback(judged.result, judged.wiring)
    return None if found is None else Section("The arms in motion", "", figures=[found])


def _tracking(result: Result) -> Section | None:
    tips = facing_tips(result)
    return None if tips is None else Section("Tracking", "", figures=[_tips(result, tips), _paths(result, tips)])


def overview(result: Result) -> Figure:
    """The figure of a run in one: tips of both arms and their distance; else its first recorded signals.

    Raises InputError where nothing was recorded.
    """
    if (tips := facing_tips(result)) is not None:
        return _tips(result, tips)
    if not result.signals:
        raise InputError(Problem("plot", "a run with recorded signals", "one without"))
    return stack(result, list(grouped(result.signals)))


def _arms(result: Result) -> tuple[str, str]:
    """The local and the remote arm of a run that has both."""
    arms = result.scenario.arms
    assert arms is not None
    return arms


def _named(result: Result, tips: FacingTips) -> dict[str, np.ndarray]:
    """Tips (n, 3) [mm] of both arms by name, the local one's mapped where the arms' frames or sizes differ."""
    local, remote = _arms(result)
    return {f"{local}, mapped" if tips.mapped else local: 1e3 * tips.local, remote: 1e3 * tips.remote}


def _tips(result: Result, tips: FacingTips) -> Figure:
    named = _named(result, tips)
    plots = [
        Plot(
            curves(result.time, {arm: x[:, i] for arm, x in named.items()}, dashed=[_arms(result)[1]]),
            TIME,
            PlotAxis(f"{name} [mm]"),
            link="time",
        )
        for i, name in enumerate("xyz")
    ]
    apart = {"distance": 1e3 * np.linalg.norm(tips.apart, axis=1)}
    plots.append(Plot(curves(result.time, apart, [Colour.INK]), TIME, PlotAxis("|x_l − x_r| [mm]"), link="time"))
    frame = ", in the remote arm's frame: where the local one asks it to be" if tips.mapped else ""
    text = f"Tip positions of the local and the remote arm{frame}, and the distance between them."
    return Figure(plots, text, name="tips")


def _paths(result: Result, found: FacingTips) -> Figure:
    plots, tips = [], _named(result, found)
    for a, b in ((0, 1), (2, 1), (0, 2)):
        series = []
        for (arm, x), colour, dash in zip(tips.items(), COLOURS, ((), (6, 3))):
            series.append(Series(arm, x[:, a], x[:, b], colour, dash=dash))
            series.append(Series("", x[:1, a], x[:1, b], colour, Mark.POINTS, size=7.0))
        axes = PlotAxis(f"{'xyz'[a]} [mm]"), PlotAxis(f"{'xyz'[b]} [mm]")
        plots.append(Plot(series, *axes, height=250, equal=True))
    return Figure(plots, "Paths of the tips; a dot is a start.", columns=3, name="paths")


def _vectors(result: Result, unit: str, skip: tuple[str, ...] = ()) -> list[str]:
    """Stems of signals with a unit that are not zero throughout."""
    groups = grouped(name for name in result.signals if result.units[name] == unit)
    return [
        name
        for name, elements in groups.items()
        if name.partition(".")[2] not in skip and any(np.any(result.signals[e] != 0.0) for e in elements)
    ]


def _ports(judged: Judged) -> Section | None:
    """The measures of the run, and the energies at the ports over time."""
    if not judged.measures:
        return None
    rows = [(m.meaning, m.value, m.unit.replace(".", "·")) for m in judged.measures.values()]
    found = energies(judged.result, judged.wiring)
    series = curves(judged.result.time, found, dashed=["environment"])
    plot = Plot(series, TIME, PlotAxis("energy [J]"), link="time")
    figure = Figure(
        [plot], "Energy put into the arms by hand and environment, and taken from them by the coupling.", name="energy"
    )
    text = "A passive coupling never gives back more than it was given and had stored at the start."
    return Section("Ports", text, [Table(("", "", "unit"), rows, digits=4)], [figure] if found else [])


def _forces(result: Result) -> Section | None:
    figures = []
    for unit, what in (("N", "Forces"), ("N.m", "Torques")):
        names = _vectors(result, unit)
        if names:
            figures.append(stack(result, names, f"{what}, one curve per axis.", what.lower()))
    return Section("Forces", "", figures=figures) if figures else None


_AGES = {
    "age": ("age of what is received", Colour.GREEN),
    "delay_now": ("delay of the law", Colour.GREY),
}


def _delays(result: Result) -> Section | None:
    names = [n for n in _vectors(result, "s") if stem(n).rpartition(".")[2] in _AGES]
    if not names:
        return None
    plots = []
    for channel in dict.fromkeys(name.partition(".")[0] for name in names):
        kinds = [kind for kind in _AGES if f"{channel}.{kind}" in result.signals]
        values = {_AGES[kind][0]: result.signals[f"{channel}.{kind}"] for kind in kinds}
        series = curves(result.time, values, [_AGES[kind][1] for kind in kinds])
        plots.append(Plot(series, TIME, PlotAxis("delay [s]"), title=channel, link="time"))
    return Section("Delays", "", figures=[Figure(plots, "Delays of the channels.", name="delays")])


def _others(result: Result) -> Section | None:
    names = [name for unit in ("rad",) for name in _vectors(result, unit) if name.rpartition(".")[2] == "q"]
    if not names:
        return None
    absolute = any(c.model == "PhantomArm" for c in result.scenario.components.values())
    what = "Joint angles (q2 and q3 of a PHANToM are absolute)." if absolute else "Joint angles."
    return Section("Joints", "", figures=[stack(result, names, what, "joints")])


def chosen(result: Result, names: Sequence[str], together: bool = False) -> Figure:
    """The figure of signals by their names, each in a plot of its own or all in one; without names the overview.

    Raises InputError with every name that was not recorded, and for signals of different units in one plot.
    """
    if not names:
        return overview(result)
    known = [*grouped(result.signals), *result.signals]
    problems = [
        Problem("signal", "a recorded signal", repr(name), did_you_mean(name, known) or "see `cosim show`")
        for name in names
        if name not in known
    ]
    if problems:
        raise InputError(problems)
    units = {name: result.units[name if name in result.units else grouped(result.signals)[name][0]] for name in names}
    if together and len(set(units.values())) > 1:
        told = ", ".join(f"{name} [{unit}]" for name, unit in units.items())
        raise InputError(Problem("--together", "signals of one unit", told))
    labels = {name: f"[{unit.replace('.', '·')}]" for name, unit in units.items()}
    lines = {name: result.vector(name) for name in names}
    if together:
        every = {f"{n}[{k}]" if v.shape[1] > 1 else n: c for n, v in lines.items() for k, c in enumerate(v.T, 1)}
        return Figure([Plot(curves(result.time, every), TIME, PlotAxis(labels[names[0]]), link="time", height=200)])
    plots = []
    for name, values in lines.items():
        each = {str(k) if values.shape[1] > 1 else "": column for k, column in enumerate(values.T, 1)}
        plots.append(Plot(curves(result.time, each), TIME, PlotAxis(f"{name} {labels[name]}"), link="time"))
    return Figure(plots)


def stack(result: Result, names: list[str], caption: str = "", file: str = "signals") -> Figure:
    """One plot a signal, of at most eight, its elements as curves."""
    groups, plots = grouped(result.signals), []
    for name in names[:8]:
        values, unit = result.vector(name), result.units[groups[name][0]]
        labels = "xyz" if unit == "N" and values.shape[1] == 3 else [str(k + 1) for k in range(values.shape[1])]
        series = curves(result.time, dict(zip(labels, values.T)))
        plots.append(Plot(series, TIME, PlotAxis(f"[{unit.replace('.', '·')}]"), name, link="time"))
    return Figure(plots, caption, name=file)
