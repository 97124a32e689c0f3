"""The table of a sweep (`sweep.h5`) and its `summary.json`."""

from collections import Counter

import numpy as np

from cosim.results.provenance import command_line, versions
from cosim.results.summary import number
from cosim.sweeps.campaign import Campaign, Curve, settings
from cosim.sweeps.points import replay
from cosim.sweeps.shares import shares
from cosim.sweeps.spec import Axis, MonteCarlo


def columns(campaign: Campaign) -> dict[str, list[float | str]]:
    """One row a point, in the order in which points were first asked for: axes, outcome, growth rate, evidence, replay,
    ...
    """
    points, findings = campaign.points, campaign.findings
    table: dict[str, list[float | str]] = {
        axis.name: [p.entries[k] for p in points] for k, axis in enumerate(campaign.sweep.axes)
    }
    table |= {
        "outcome": [f.outcome for f in findings],
        "growth_rate": [f.growth_rate for f in findings],
        "growth_rate_low": [f.low for f in findings],
        "growth_rate_high": [f.high for f in findings],
        "evidence": [f.evidence for f in findings],
    }
    for name in dict.fromkeys(name for f in findings for name in f.numbers):
        table[name] = [f.numbers.get(name, np.nan) for f in findings]
    table["message"] = [f.message for f in findings]
    table["replay"] = [replay(campaign.sweep, p) for p in points]
    return table


def units(campaign: Campaign) -> dict[str, str]:
    """Units of the columns."""
    known = {
        "growth_rate": "1/s",
        "growth_rate_low": "1/s",
        "growth_rate_high": "1/s",
        "tracking_rmse": "m",
        "simulated_time": "s",
    }
    return {axis.name: axis.unit for axis in campaign.sweep.axes if axis.unit} | known


def summary(campaign: Campaign) -> dict[str, object]:
    """The content of summary.json: `boundary`, `points`, `audit`, `executor` of the contract, and more."""
    lines = [line for curve in campaign.curves for line in joined(curve)]
    labels = [curve.label for curve in campaign.curves for _ in joined(curve)]
    outcomes = Counter(f.outcome for f in campaign.findings)
    return {
        "sweep": settings(campaign.sweep),
        "points": len(campaign.points),
        "outcomes": dict(sorted(outcomes.items())),
        "evidence": dict(sorted(Counter(f.evidence for f in campaign.findings).items())),
        "boundary": [[list(vertex) for vertex in line] for line in lines],
        "boundary_axes": [axis.name for axis in axes_of(campaign)],
        "boundary_labels": labels,
        "audit": _audit(campaign),
        "shares": _shares(campaign),
        "executor": campaign.executor,
        "kernel_replay": kernel_replay(campaign),
        "known_before": campaign.known_before,
        "wall_time": campaign.wall_time,
        "warnings": list(campaign.warnings),
        "versions": versions(),
        "command": command_line(),
    }


def kernel_replay(campaign: Campaign) -> dict[str, object] | None:
    """How many of the batch kernel's points the FMUs ran too, and the largest relative difference; None without one."""
    found = [f.numbers["kernel_difference"] for f in campaign.findings if "kernel_difference" in f.numbers]
    return {"points": len(found), "largest_relative_difference": number(max(found))} if found else None


def axes_of(campaign: Campaign) -> tuple[Axis, ...]:
    """Axes of the boundary's vertices: the two traced ones, or the last other axis and the traced one."""
    sweep = campaign.sweep
    if len(sweep.traced) == 1:
        return (*sweep.enumerated[-1:], *sweep.traced)
    return sweep.traced


def joined(curve: Curve) -> list[list[tuple[float | str, ...]]]:
    """Lines of a curve with vertices (x, y); a boundary along one axis gives single vertices with the entry of the last
    other axis.
    """
    if curve.lines and len(curve.lines[0][0]) == 1:
        return [[(*[entry for _, entry in curve.others[-1:]], vertex[0]) for vertex in line] for line in curve.lines]
    return [list(line) for line in curve.lines]


def _audit(campaign: Campaign) -> list[dict[str, object]]:
    return [
        {
            "curve": c.label,
            "points": c.audit.points,
            "wrong": c.audit.wrong,
            "rounds": c.audit.rounds,
            "missed_area_bound": c.audit.bound,
            "level": c.audit.level,
            "surprises": len(c.audit.surprises),
        }
        for c in campaign.curves
        if c.audit is not None
    ]


def _shares(campaign: Campaign) -> list[dict[str, object]]:
    if not isinstance(campaign.sweep.design, MonteCarlo):
        return []
    return [
        {
            "label": s.label,
            "stable": s.stable,
            "decided": s.decided,
            "undecided": s.undecided,
            "share": None if s.value is None else number(s.value),
            "interval": [s.low, s.high],
        }
        for s in shares(campaign, campaign.sweep.design.level)
    ]
