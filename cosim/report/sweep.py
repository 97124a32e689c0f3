"""Report of a sweep: stability map with theory curves, evidence, shares, audit, and every point with its replay
command.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from cosim.analysis.evidence import StabilityEvidence
from cosim.errors import InputError, Problem
from cosim.report.canvas import (
    BLACK,
    BLUE,
    COLOURS,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    Axes,
    FigureBase,
    MplFigure,
    figure,
    to_svg,
)
from cosim.report.html import Code, Figure, Report, Section, Table
from cosim.results.provenance import command_line, versions
from cosim.sweeps.campaign import Campaign, Curve
from cosim.sweeps.curves import theory_curves
from cosim.sweeps.points import Point, PointResult, replay
from cosim.sweeps.shares import shares
from cosim.sweeps.spec import Axis, MonteCarlo
from cosim.sweeps.table import settings

# One colour and one shape an outcome: readable without colours, and by every kind of colour vision.
_MARKS = {
    "converged": (BLUE, "o"),
    "growing": (ORANGE, "^"),
    "diverged": (ORANGE, "X"),
    "limit_cycle": (PURPLE, "D"),
    "bounded": (SKY, "s"),
    "limit_hit": (PURPLE, "v"),
    "domain_exit": (PURPLE, "P"),
    "inconclusive": (GREY, "*"),
    "failed": (BLACK, "x"),
}
_THEORY = {
    "delay_sum": ("delay-sum condition", "-"),
    "sallam_eq10": ("Sallam Eq. 10 (not sufficient)", ":"),
    "closed_form": ("exact spectrum", "--"),
    "spectrum": ("exact spectrum at the start pose", "--"),
}
_ROWS = 400


def sweep_report(campaign: Campaign) -> Report:
    """The report of a sweep that was carried out."""
    sections = [
        *_maps(campaign),
        *_crossings(campaign),
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
    return Report(campaign.sweep.title or campaign.sweep.name, _verdict(campaign), sections, facts)


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
    return f"{campaign.sweep.description}\n\n{said}".strip()


# --- maps -------------------------------------------------------------------------------------------------------------


def _maps(campaign: Campaign) -> list[Section]:
    """One map for every curve over two traced axes; for other designs one of the first two numeric axes."""
    sweep = campaign.sweep
    if len(sweep.traced) == 2:
        figures = [_map(campaign, curve, *sweep.traced) for curve in campaign.curves[:12]]
        return [Section("Stability map", _READING, figures=figures)]
    numeric = [axis for axis in sweep.axes if axis.numeric]
    if sweep.traced or len(numeric) < 2:
        return []
    return [
        Section(
            "Stability map",
            "All points, seen along the first two numeric axes.",
            figures=[_map(campaign, None, *numeric[:2])],
        )
    ]


_READING = (
    "Circles: small disturbances die out. Triangles: they grow. The black "
    "line is the boundary found by simulation; theory curves "
    "lie over it (delay-sum condition: 4 B_l B_r > (T_l + T_r)² K_l K_r). Points crowd where the boundary is."
)


def _map(campaign: Campaign, curve: Curve | None, x: Axis, y: Axis) -> Figure:
    sweep = campaign.sweep
    title = curve.label if curve and curve.label else sweep.title
    return Figure(to_svg(_map_figure(campaign, curve, x, y)), f"{title}: {len(_on_map(campaign, curve))} points")


def plain_figure(campaign: Campaign) -> MplFigure:
    """The figure of a sweep in one: the first map, or the crossings along its traced axis.

    Raises InputError for a sweep that has neither.
    """
    sweep = campaign.sweep
    numeric = [axis for axis in sweep.axes if axis.numeric]
    if len(sweep.traced) == 2:
        return _map_figure(campaign, campaign.curves[0] if campaign.curves else None, *sweep.traced)
    if len(sweep.traced) == 1 and sweep.enumerated:
        return _crossing_figure(campaign, sweep.traced[0], sweep.enumerated[-1])
    if len(numeric) >= 2:
        return _map_figure(campaign, None, *numeric[:2])
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


def _map_figure(campaign: Campaign, curve: Curve | None, x: Axis, y: Axis) -> MplFigure:
    names, chosen = [axis.name for axis in campaign.sweep.axes], _on_map(campaign, curve)
    fig, axes = figure(1, 1, width=7.6, height=5.0)
    plot = axes[0, 0]
    _scatter(plot, [(p.entries[names.index(x.name)], p.entries[names.index(y.name)], f.outcome) for p, f in chosen])
    for k, line in enumerate(curve.lines if curve else ()):
        plot.plot(*np.array(line).T, color=BLACK, linewidth=1.6, label=None if k else "boundary by simulation")
    for k, (name, points) in enumerate(_theory(campaign, curve, x, y).items()):
        label, style = _THEORY[name]
        if points:
            plot.plot(*np.array(points).T, style, color=COLOURS[(2 * k + 2) % len(COLOURS)], linewidth=1.8, label=label)
    _framed(plot, x, y)
    _legend(fig)
    return fig


def _theory(campaign: Campaign, curve: Curve | None, x: Axis, y: Axis) -> dict[str, list[tuple[float, float]]]:
    if curve is None:
        return {}
    entries = {
        axis.name: next(e for e in axis.steps() if getattr(e, "label", e) == dict(curve.others)[axis.name])
        for axis in campaign.sweep.enumerated
    }
    return theory_curves(campaign.sweep, campaign.task, x, y, entries)


def _scatter(plot: Axes, marks: Sequence[tuple[float | str, float | str, str]]) -> None:
    for outcome in dict.fromkeys(o for _, _, o in marks):
        colour, shape = _MARKS[outcome]
        places = np.array([(a, b) for a, b, o in marks if o == outcome])
        plot.plot(
            *places.T, shape, color=colour, markersize=4, linestyle="none", alpha=0.8, label=outcome.replace("_", " ")
        )


def _legend(fig: FigureBase) -> None:
    """What is drawn, in rows below the plot, which keeps its width."""
    fig.legend(loc="outside lower center", ncols=3, frameon=False)


def _framed(plot: Axes, x: Axis, y: Axis) -> None:
    plot.set(xlabel=_label(x), ylabel=_label(y), xlim=(x.low, x.high), ylim=(y.low, y.high))
    plot.set_xscale(x.scale.value)
    plot.set_yscale(y.scale.value)


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
    figures = []
    if last is not None:
        figures = [Figure(to_svg(_crossing_figure(campaign, axis, last)), f"Boundary along {axis.name}")]
    return [Section("Boundary", "Where the growth rate of small disturbances changes its sign.", [table], figures)]


def _crossing_figure(campaign: Campaign, axis: Axis, last: Axis) -> MplFigure:
    fig, axes = figure(1, 1, width=7.6, height=4.2)
    _crossing_plot(axes[0, 0], campaign, axis, last)
    return fig


def _crossing_plot(plot: Axes, campaign: Campaign, axis: Axis, last: Axis) -> None:
    groups: dict[str, list[tuple[float | str, float]]] = {}
    for curve in campaign.curves:
        prefix = ", ".join(str(entry) for _, entry in curve.others[:-1])
        groups.setdefault(prefix, []).extend((curve.others[-1][1], line[0][0]) for line in curve.lines)
    names = [c.label for c in last.choices]
    joined = not names and all(len(curve.lines) == 1 for curve in campaign.curves)
    for k, (prefix, pairs) in enumerate(groups.items()):
        places = [names.index(a) if isinstance(a, str) else a for a, _ in pairs]
        plot.plot(
            places,
            [b for _, b in pairs],
            "o-" if joined else "o",
            color=COLOURS[k % len(COLOURS)],
            label=prefix or None,
        )
    if names:
        plot.set_xticks(range(len(names)), names)
    elif last.scale.value == "log":
        plot.set_xscale("log")
    plot.set(xlabel=_label(last), ylabel=_label(axis))
    if len(groups) > 1:
        _legend(plot.figure)


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
        for n, (p, f) in enumerate(zip(campaign.points, campaign.findings), 1)
    ]
    more = "" if len(rows) <= _ROWS else f" The first {_ROWS} of {len(rows)}; all of them are in sweep.h5."
    return Section(
        "Points",
        "Every point with the command that runs it as one co-simulation (a click chooses the whole line)." + more,
        [Table(["no.", *names, "outcome", "growth rate [1/s]", "evidence", "replay"], rows[:_ROWS])],
    )
