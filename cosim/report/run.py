"""Figures and report of one run: tracking, forces, delays, tip path, wiring."""

import numpy as np
from attrs import evolve

from cosim.engine.master import Result
from cosim.engine.outcome import Outcome
from cosim.engine.table import SignalColumns, stacked
from cosim.errors import InputError, Problem
from cosim.report.applications import application_sections
from cosim.report.canvas import (
    BLACK,
    BLUE,
    COLOURS,
    GREEN,
    GREY,
    ORANGE,
    Axes,
    MplFigure,
    figure,
    label_of,
    plain_texts,
    to_svg,
)
from cosim.report.html import Figure, Report, Section, Table, cell
from cosim.report.wiring import block_diagram, milliseconds
from cosim.results.provenance import provenance
from cosim.results.summary import Judged, limit_time, simulated_time
from cosim.signals import grouped, stem
from cosim.wiring import direction_table, vector_starts

_POINTS = 4000
_GOOD = {Outcome.CONVERGED}
_BAD = {Outcome.GROWING, Outcome.DIVERGED, Outcome.DOMAIN_EXIT, Outcome.FAILED}


def run_report(judged: Judged) -> Report:
    """The report of a run; one that is too long for memory is shown by some ten thousand of its rows."""
    judged = evolve(judged, result=_shown(judged.result))
    result = judged.result
    sections = [
        _found(judged),
        *application_sections(result),
        _tracking(result),
        _forces(result),
        _delays(result),
        _others(result),
        _messages(result),
        _wiring(judged),
        _components(judged),
    ]
    mood = "good" if judged.outcome in _GOOD else "bad" if judged.outcome in _BAD else "neutral"
    return Report(
        result.scenario.title or result.scenario.name,
        _verdict(judged),
        [s for s in sections if s is not None],
        provenance(result),
        mood,
    )


def _shown(result: Result) -> Result:
    if not isinstance(result.signals, SignalColumns) or not result.signals.rows.on_disk:
        return result
    every, names = len(result.time) // 20_000 + 1, list(result.signals)
    values = stacked(result.signals, names, every)
    return evolve(result, time=result.time[::every], signals=dict(zip(names, values.T)))


# --- words and tables
# ------------------------------------------------------------------------------------------------------


def _verdict(judged: Judged) -> str:
    words = f"{judged.outcome.value.replace('_', ' ').capitalize()}: {judged.outcome.advice}."
    details = [judged.result.message] if judged.result.message else []
    if judged.growth_rate is not None:
        details.append(f"Small disturbances change at {judged.growth_rate:+.4g} 1/s{_interval(judged)}.")
    if judged.tracking is not None:
        details.append(f"The tips were {judged.tracking.total * 1e3:.3g} mm apart (RMS).")
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
    text = result.scenario.description
    return Section(
        "What was found",
        text,
        tables=[Table(("", ""), [(name, cell(value)) for name, value in rows if value is not None])],
    )


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
    return Section("Wiring", text, tables, [Figure(block_diagram(wiring), caption)])


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


def _thin(result: Result) -> np.ndarray:
    """Indices of at most 4000 rows, evenly spread."""
    step = max(1, len(result.time) // _POINTS)
    return np.arange(0, len(result.time), step)


def _tracking(result: Result) -> Section | None:
    if result.scenario.arms is None or not all(f"{arm}.x[1]" in result.signals for arm in result.scenario.arms):
        return None
    figures = [
        Figure(to_svg(_tips(result)), "Tip positions of the local and the remote arm, and the distance between them."),
        Figure(_path(result), "Path of the tips; the dot is the start."),
    ]
    return Section("Tracking", "", figures=figures)


def plain_figure(result: Result) -> MplFigure:
    """The figure of a run in one: tips of both arms and their distance; else its first recorded signals.

    Raises InputError where nothing was recorded.
    """
    arms = result.scenario.arms
    if arms is not None and all(f"{arm}.x[1]" in result.signals for arm in arms):
        fig = _tips(result)
        plain_texts(fig)
        return fig
    if not result.signals:
        raise InputError(Problem("plot", "a run with recorded signals", "one without"))
    fig = _stack(result, list(grouped(result.signals)))
    plain_texts(fig)
    return fig


def _tips(result: Result) -> MplFigure:
    rows, (local, remote) = _thin(result), _arms(result)
    time, x_l, x_r = result.time[rows], result.vector(f"{local}.x")[rows], result.vector(f"{remote}.x")[rows]
    fig, axes = figure(4, 1, 9.5, 7.2)
    for axis, (plot, name) in enumerate(zip(axes[:3, 0], "xyz")):
        plot.plot(time, x_l[:, axis] * 1e3, color=BLUE, label=label_of(local))
        plot.plot(time, x_r[:, axis] * 1e3, color=ORANGE, linestyle=(0, (4, 2)), label=label_of(remote))
        plot.set_ylabel(f"{name} [mm]")
    _legend(axes[0, 0], 2)
    axes[3, 0].plot(time, np.linalg.norm(x_l - x_r, axis=1) * 1e3, color=BLACK)
    axes[3, 0].set_ylabel("|x_l − x_r| [mm]")
    _share_time(axes[:, 0])
    return fig


def _arms(result: Result) -> tuple[str, str]:
    """The local and the remote arm of a run that has both."""
    arms = result.scenario.arms
    assert arms is not None
    return arms


def _path(result: Result) -> str:
    rows, (local, remote) = _thin(result), _arms(result)
    fig, axes = figure(1, 3, 9.5, 3.1)
    for plot, (a, b) in zip(axes[0], ((0, 1), (2, 1), (0, 2))):
        for arm, colour, style in ((local, BLUE, "-"), (remote, ORANGE, (0, (4, 2)))):
            x = result.vector(f"{arm}.x")[rows] * 1e3
            plot.plot(x[:, a], x[:, b], color=colour, linestyle=style, label=label_of(arm))
            plot.plot(x[:1, a], x[:1, b], "o", color=colour, markersize=4)
        plot.set_xlabel(f"{'xyz'[a]} [mm]")
        plot.set_ylabel(f"{'xyz'[b]} [mm]")
        plot.set_aspect("equal", adjustable="datalim")
    axes[0, 0].legend(loc="best")
    return to_svg(fig)


def _vectors(result: Result, unit: str, skip: tuple[str, ...] = ()) -> list[str]:
    """Stems of signals with a unit that are not zero throughout."""
    groups = grouped(name for name in result.signals if result.units[name] == unit)
    return [
        name
        for name, elements in groups.items()
        if name.partition(".")[2] not in skip and any(np.any(result.signals[e] != 0.0) for e in elements)
    ]


def _forces(result: Result) -> Section | None:
    figures = []
    for unit, what in (("N", "Forces"), ("N.m", "Torques")):
        names = _vectors(result, unit)
        if names:
            figures.append(Figure(to_svg(_stack(result, names)), f"{what}, one curve per axis."))
    return Section("Forces", "", figures=figures) if figures else None


def _delays(result: Result) -> Section | None:
    names = [n for n in _vectors(result, "s") if stem(n).rpartition(".")[2] in ("delay_now", "age")]
    if not names:
        return None
    rows = _thin(result)
    channels = list(dict.fromkeys(name.partition(".")[0] for name in names))
    fig, axes = figure(len(channels), 1, 9.5, 0.6 + 1.7 * len(channels))
    for plot, channel in zip(axes[:, 0], channels):
        for name, colour, label in (("age", GREEN, "age of what is received"), ("delay_now", GREY, "delay of the law")):
            if f"{channel}.{name}" in result.signals:
                values = result.signals[f"{channel}.{name}"][rows]
                plot.plot(
                    result.time[rows],
                    values,
                    color=colour,
                    label=label,
                    linewidth=1.0,
                    zorder=2 if name == "age" else 3,
                )
        plot.set_ylabel(f"{channel} [s]")
    _legend(axes[0, 0], 2)
    _share_time(axes[:, 0])
    return Section("Delays", "", figures=[Figure(to_svg(fig), "Delays of the channels.")])


def _others(result: Result) -> Section | None:
    names = [name for unit in ("rad",) for name in _vectors(result, unit) if name.rpartition(".")[2] == "q"]
    if not names:
        return None
    return Section("Joints", "", figures=[Figure(to_svg(_stack(result, names)), "Joint angles (q2 and q3 absolute).")])


def _stack(result: Result, names: list[str]) -> MplFigure:
    """One panel per signal, its elements as curves."""
    groups, names, rows = grouped(result.signals), names[:8], _thin(result)
    fig, axes = figure(len(names), 1, 9.5, 0.6 + 1.45 * len(names))
    for plot, name in zip(axes[:, 0], names):
        values, unit = result.vector(name)[rows], result.units[groups[name][0]]
        for column in range(values.shape[1]):
            label = "xyz"[column] if unit == "N" and values.shape[1] == 3 else str(column + 1)
            plot.plot(result.time[rows], values[:, column], color=COLOURS[column % len(COLOURS)], label=label)
        plot.set_title(name)
        plot.set_ylabel(unit.replace(".", "·"))
    if len(groups[names[0]]) > 1:
        _legend(axes[0, 0], 3)
    _share_time(axes[:, 0])
    return fig


def _legend(plot: Axes, columns: int) -> None:
    """A legend above the panel, at its right end."""
    plot.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1, ncols=columns)


def _share_time(axes: np.ndarray) -> None:
    for plot in axes:
        plot.margins(x=0.01)
    for plot in axes[:-1]:
        plot.tick_params(labelbottom=False)
    axes[-1].set_xlabel("time [s]")
