"""Report of a sweep: stability map with theory curves, evidence, shares, audit, and every point with its replay
command.
"""

from collections import Counter

import numpy as np

from cosim.analysis.evidence import StabilityEvidence
from cosim.errors import InputError, Problem
from cosim.report.html import Code, Report, Section, Table
from cosim.report.plots import COLOURS, Colour, Figure, Mark, Plot, PlotAxis, Series
from cosim.results.provenance import command_line, versions
from cosim.scenario import load_scenario
from cosim.scenario.writing import toml_value
from cosim.sweeps.campaign import Campaign, Curve
from cosim.sweeps.curves import theory_curves
from cosim.sweeps.points import Point, PointResult, replay
from cosim.sweeps.shares import shares
from cosim.sweeps.spec import Axis, MonteCarlo, Scale
from cosim.sweeps.table import settings

# One colour and one shape an outcome: readable without colours, and by every kind of colour vision.
MARKS = {
    "converged": (Colour.BLUE, "o"),
    "growing": (Colour.ORANGE, "^"),
    "diverged": (Colour.ORANGE, "X"),
    "limit_cycle": (Colour.PURPLE, "D"),
    "bounded": (Colour.SKY, "s"),
    "limit_hit": (Colour.PURPLE, "v"),
    "domain_exit": (Colour.PURPLE, "P"),
    "inconclusive": (Colour.GREY, "*"),
    "failed": (Colour.INK, "x"),
}
_THEORY: dict[str, tuple[str, tuple[float, ...], str]] = {
    "delay_sum": ("delay-sum condition", (), "4 B_l B_r > (T_l + T_r)² K_l K_r, sufficient"),
    "sallam_eq10": ("Sallam Eq. 10", (1.5, 3), "as printed; it is not sufficient"),
    "closed_form": ("exact spectrum", (7, 3), "of the linear loop, by its closed form"),
    "any_law": ("safe for every delay law", (), "a certificate for the loop at rest proves it up to there"),
    "destroying_law": ("some delay law destroys", (2, 2), "a law up to there makes the linear loop grow"),
    "spectrum": ("exact spectrum at the start pose", (7, 3), "of the loop linearised there, constant delay"),
}
_ROWS = 400


def sweep_report(campaign: Campaign) -> Report:
    """The report of a sweep that was carried out."""
    sections = [
        *_maps(campaign),
        *_crossings(campaign),
        *_described(campaign),
        *_shares(campaign),
        _evidence(campaign),
        *_audits(campaign),
        _points(campaign),
    ]
    facts = {
        "sweep": settings(campaign.sweep),
        "executor": campaign.executor,
        "versions": versions(),
        "command": command_line(),
    }
    return Report(f"Sweep {campaign.sweep.name}", _verdict(campaign), sections, facts, source="sweep.h5")


def _verdict(campaign: Campaign) -> str:
    outcomes = Counter(f.outcome for f in campaign.findings)
    parts = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in outcomes.most_common())
    said = f"{len(campaign.points)} points: {parts}."
    bounds = [c.audit for c in campaign.curves if c.audit is not None and c.audit.points]
    if bounds:
        said += (
            f" With {100 * bounds[0].level:g} % confidence less than "
            f"{100 * max(a.bound for a in bounds):.2g} % of the area of any map is wrong."
        )
    effects = f" With the effects of {campaign.sweep.effects} in every point." if campaign.sweep.effects else ""
    values = ", ".join(f"{path} = {toml_value(value)}" for path, value in campaign.sweep.changes.items())
    return said + effects + (f" With {values} in every point, unlike its file." if values else "")


def _described(campaign: Campaign) -> list[Section]:
    """What the sweep's file says of itself, and the effects that every point has."""
    sweep = campaign.sweep
    words = [sweep.title, sweep.description]
    said = "\n\n".join(["The words of its file.", *words]) if any(words) else ""
    tables = []
    if sweep.effects:
        names = load_scenario(campaign.task.scenario, effects=campaign.task.effects).effects
        tables = [Table(("effects file", "effects in every point"), [(sweep.effects, ", ".join(names))])]
    return [Section("The sweep", said, tables)] if said or tables else []


# --- maps -------------------------------------------------------------------------------------------------------------


def _maps(campaign: Campaign) -> list[Section]:
    """One map for every curve over two traced axes; for other designs one of the first two numeric axes."""
    sweep = campaign.sweep
    if len(sweep.traced) == 2:
        figures = [_map(campaign, curve, *sweep.traced) for curve in campaign.curves[:12]]
        return [Section("Stability map", _reading(figures), figures=figures)]
    numeric = [axis for axis in sweep.axes if axis.numeric]
    if sweep.traced or len(numeric) < 2:
        return []
    figures = [_map(campaign, None, *numeric[:2])]
    words = f"All points, seen along the first two numeric axes.\n\n{_reading(figures)}"
    return [Section("Stability map", words, figures=figures)]


def _reading(figures: list[Figure]) -> str:
    """How to read the maps: only of what is on them."""
    shown = {series.name for figure in figures for plot in figure.plots for series in plot.series}
    words = [text for outcome, text in _MEANING.items() if outcome.replace("_", " ") in shown]
    if _BOUNDARY in shown:
        words.append("The dark line is the boundary found by simulation; points crowd where it is")
    words += [f"{name[0].upper()}{name[1:]}: {what}" for name, _, what in _THEORY.values() if name in shown]
    return f"{'. '.join(words)}. A point tells its evidence, and a click copies the command that runs it again."


_BOUNDARY = "boundary by simulation"
_MEANING = {
    "converged": "Circles: small disturbances die out",
    "growing": "Triangles: they grow",
    "bounded": "Squares: the motion stays bounded",
    "limit_cycle": "Diamonds: they end in a cycle",
}


def _map(campaign: Campaign, curve: Curve | None, x: Axis, y: Axis) -> Figure:
    sweep = campaign.sweep
    title = curve.label if curve and curve.label else sweep.title
    chosen = _on_map(campaign, curve)
    series = [*_points_of(campaign, chosen, x, y)]
    for k, line in enumerate(curve.lines if curve else ()):
        a, b = np.array(line).T
        series.append(Series("" if k else _BOUNDARY, a, b, Colour.INK, size=2.2))
    for k, (name, places) in enumerate(_theory(campaign, curve, x, y).items()):
        if places:
            label, dash, _ = _THEORY[name]
            a, b = np.array(places).T
            series.append(Series(label, a, b, COLOURS[(2 * k + 2) % len(COLOURS)], dash=dash, size=2.2))
    plot = Plot(series, _plot_axis(x), _plot_axis(y), height=460)
    return Figure([plot], f"{title}: {len(chosen)} points".removeprefix(": "), name="map")


def overview(campaign: Campaign) -> Figure:
    """The figure of a sweep in one: the first map, or the crossings along its traced axis.

    Raises InputError for a sweep that has neither.
    """
    sweep = campaign.sweep
    numeric = [axis for axis in sweep.axes if axis.numeric]
    if len(sweep.traced) == 2:
        return _map(campaign, campaign.curves[0] if campaign.curves else None, *sweep.traced)
    if len(sweep.traced) == 1 and sweep.enumerated:
        return _crossing_figure(campaign, sweep.traced[0], sweep.enumerated[-1])
    if len(numeric) >= 2:
        return _map(campaign, None, *numeric[:2])
    raise InputError(Problem("plot", "a sweep with two numeric axes, or a traced one", "another", "use to_dataframe()"))


def _on_map(campaign: Campaign, curve: Curve | None) -> list[tuple[Point, PointResult]]:
    """The points that a curve's map shows."""
    names = [axis.name for axis in campaign.sweep.axes]
    others = dict(curve.others) if curve else {}
    return [
        (p, f)
        for p, f in zip(campaign.points, campaign.findings)
        if all(p.entries[names.index(name)] == entry for name, entry in others.items())
    ]


def _points_of(campaign: Campaign, chosen: list[tuple[Point, PointResult]], x: Axis, y: Axis) -> list[Series]:
    """A cloud an outcome; each point tells its growth rate and evidence, and the command that runs it again."""
    names = [axis.name for axis in campaign.sweep.axes]
    columns = names.index(x.name), names.index(y.name)
    clouds = []
    for outcome in dict.fromkeys(f.outcome for _, f in chosen):
        colour, symbol = MARKS[outcome]
        here = [(p, f) for p, f in chosen if f.outcome == outcome]
        a, b = np.array([[float(p.entries[k]) for k in columns] for p, _ in here]).T
        notes, commands = [_note(f) for _, f in here], [replay(campaign.sweep, p) for p, _ in here]
        name = outcome.replace("_", " ")
        clouds.append(Series(name, a, b, colour, Mark.POINTS, symbol=symbol, size=8.0, notes=notes, commands=commands))
    return clouds


def _note(found: PointResult) -> str:
    rate = f"growth rate {found.growth_rate:+.4g} 1/s; " if np.isfinite(found.growth_rate) else ""
    known = {e.value: e.meaning for e in StabilityEvidence}
    return f"{rate}evidence: {known.get(found.evidence, found.evidence)}{f'; {found.message}' if found.message else ''}"


def _theory(campaign: Campaign, curve: Curve | None, x: Axis, y: Axis) -> dict[str, list[tuple[float, float]]]:
    if curve is None:
        return {}
    entries = {
        axis.name: next(e for e in axis.steps() if getattr(e, "label", e) == dict(curve.others)[axis.name])
        for axis in campaign.sweep.enumerated
    }
    return theory_curves(campaign.sweep, campaign.task, x, y, entries)


def _plot_axis(axis: Axis) -> PlotAxis:
    if not axis.numeric:
        return PlotAxis(_label(axis), names=[c.label for c in axis.choices])
    return PlotAxis(_label(axis), (axis.low, axis.high), log=axis.scale is Scale.LOG)


def _label(axis: Axis) -> str:
    return f"{axis.name} [{axis.unit}]" if axis.unit else axis.name


# --- a boundary along one axis ----------------------------------------------------------------------------------------


def _crossings(campaign: Campaign) -> list[Section]:
    sweep = campaign.sweep
    if len(sweep.traced) != 1:
        return []
    axis, last = sweep.traced[0], sweep.enumerated[-1] if sweep.enumerated else None
    rows = [
        [c.label or "-", ", ".join(f"{line[0][0]:.6g}" for line in c.lines) or f"none in [{axis.low:g}, {axis.high:g}]"]
        for c in campaign.curves
    ]
    table = Table([", ".join(a.name for a in sweep.enumerated) or "-", f"boundary {_label(axis)}"], rows)
    figures = [] if last is None else [_crossing_figure(campaign, axis, last)]
    return [Section("Boundary", "Where the growth rate of small disturbances changes its sign.", [table], figures)]


def _crossing_figure(campaign: Campaign, axis: Axis, last: Axis) -> Figure:
    groups: dict[str, list[tuple[float | str, float]]] = {}
    for curve in campaign.curves:
        prefix = ", ".join(str(entry) for _, entry in curve.others[:-1])
        groups.setdefault(prefix, []).extend((curve.others[-1][1], line[0][0]) for line in curve.lines)
    names = [c.label for c in last.choices]
    joined = not names and all(len(curve.lines) == 1 for curve in campaign.curves)
    series = []
    for k, (prefix, pairs) in enumerate(groups.items()):
        x = np.array([names.index(a) if isinstance(a, str) else a for a, _ in pairs], dtype=float)
        y, colour = np.array([b for _, b in pairs]), COLOURS[k % len(COLOURS)]
        series += [Series("", x, y, colour)] if joined else []
        series.append(Series(prefix, x, y, colour, Mark.POINTS, size=6.0))
    along = PlotAxis(_label(last), log=last.scale is Scale.LOG, names=names)
    return Figure(
        [Plot(series, along, PlotAxis(_label(axis)), height=320)], f"Boundary along {axis.name}", name="boundary"
    )


# --- tables -----------------------------------------------------------------------------------------------------------


def _shares(campaign: Campaign) -> list[Section]:
    design = campaign.sweep.design
    if not isinstance(design, MonteCarlo):
        return []
    rows = [
        [s.label, s.stable, s.decided, s.undecided, s.value, f"{s.low:.3f} to {s.high:.3f}"]
        for s in shares(campaign, design.level)
    ]
    head = ["points", "stable", "decided", "undecided", "share stable", f"{100 * design.level:g} % interval"]
    return [
        Section(
            "Share of stable points", "Clopper-Pearson intervals; undecided points are left out.", [Table(head, rows)]
        )
    ]


def _evidence(campaign: Campaign) -> Section:
    counts = Counter(f.evidence for f in campaign.findings)
    rows = [[e.value, counts[e.value], e.meaning] for e in StabilityEvidence if counts[e.value]]
    return Section(
        "Strongest evidence",
        "For each point the strongest statement that holds.",
        [Table(["evidence", "points", "what it says"], rows)],
    )


def _audits(campaign: Campaign) -> list[Section]:
    rows = [
        [
            c.label or "-",
            c.audit.points,
            c.audit.wrong,
            c.audit.rounds,
            len(c.audit.surprises),
            f"{100 * c.audit.bound:.3g} %",
        ]
        for c in campaign.curves
        if c.audit is not None and c.audit.points
    ]
    if not rows:
        return []
    text = (
        "Random places, evaluated after the boundary was traced. Where one "
        "contradicts the map the boundary is refined there and the "
        "audit begins again with new places; the bound comes from the last round."
    )
    return [
        Section(
            "Audit",
            text,
            [
                Table(
                    ["map", "places a round", "wrong in the last", "rounds", "found and traced", "missed area below"],
                    rows,
                )
            ],
        )
    ]


def _points(campaign: Campaign) -> Section:
    names = [_label(axis) for axis in campaign.sweep.axes]
    rows = [
        [
            n,
            *p.entries,
            f.outcome,
            f.growth_rate if np.isfinite(f.growth_rate) else None,
            f.evidence,
            Code(replay(campaign.sweep, p)),
        ]
        for n, (p, f) in enumerate(zip(campaign.points[:_ROWS], campaign.findings), 1)
    ]
    count = len(campaign.points)
    more = "" if count <= _ROWS else f" The first {_ROWS} of {count}; all of them are in sweep.h5."
    return Section(
        "Points",
        "Every point with the command that runs it as one co-simulation (a click chooses the whole line)." + more,
        [Table(["no.", *names, "outcome", "growth rate [1/s]", "evidence", "replay"], rows)],
    )
