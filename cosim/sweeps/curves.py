"""Theory curves over a traced map: largest delay or gain by each condition, from the scenario's own linearisation."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from cosim.analysis.assessment import coupling
from cosim.analysis.criteria import delay_sum, sallam_eq10
from cosim.analysis.delay_verdict import linear_verdict
from cosim.analysis.examination import examine
from cosim.analysis.linear_fmu import channel_bounds
from cosim.analysis.linearisation import linearise
from cosim.analysis.spectrum import abscissa
from cosim.analysis.undelayed import undelayed
from cosim.sweeps.evaluate import setup
from cosim.sweeps.points import point
from cosim.sweeps.pool import Task
from cosim.sweeps.spec import LAW_CURVES, Axis, Entry, Sweep

SAMPLES, LAW_SAMPLES = 33, 7
"""Even steps of x: of a condition, and of the verdict for any delay law, which takes half a minute each."""


def theory_curves(
    sweep: Sweep, task: Task, x: Axis, y: Axis, others: Mapping[str, Entry]
) -> dict[str, list[tuple[float, float]]]:
    """For every curve of the sweep its points (x, y): the zero of each condition along y, at even steps of x.

    Works for conditions whose sign changes once along y; where it does not change, the curve has no point there.
    """
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in sweep.curves}
    for share in np.linspace(0.0, 1.0, SAMPLES):
        at_x = x.number(float(share))
        for name in (name for name in sweep.curves if name not in LAW_CURVES):
            fixed = {x.name: at_x} | dict(others)
            place = _zero(lambda s, n=name, at=fixed: _margin(n, task, sweep, {y.name: y.number(s)} | at))
            if place is not None:
                found[name].append((at_x, y.number(place)))
    for share in np.linspace(0.0, 1.0, LAW_SAMPLES if set(LAW_CURVES) & set(sweep.curves) else 0):
        at_x = x.number(float(share))
        for name, place in _law_places(sweep, task, y, {x.name: at_x} | dict(others)).items():
            found.setdefault(name, []).append((at_x, y.number(place)))
    return {name: found[name] for name in sweep.curves}


def _law_places(sweep: Sweep, task: Task, y: Axis, fixed: Mapping[str, Entry]) -> dict[str, float]:
    """Shares of y at which the longest delay is what a certificate covers, and what a law destroys.

    The verdict is that of the loop, in which the delays are the only unknown; y has to change nothing else.
    """

    def longest(share: float) -> float:
        entries = {y.name: y.number(share)} | dict(fixed)
        one = setup(task, point(sweep.axes, [entries[axis.name] for axis in sweep.axes]))
        return max((bounds[2] for bounds in channel_bounds(one.wiring).values()), default=np.nan)

    if not all(path.partition(".")[2].startswith("delay") for path in y.paths):
        return {}
    entries = {y.name: y.number(0.0)} | dict(fixed)
    one = setup(task, point(sweep.axes, [entries[axis.name] for axis in sweep.axes]))
    verdict = linear_verdict(one.scenario, one.system)
    if verdict is None:
        return {}
    proven = min((c.max_delay for c in verdict.certificates), default=None)
    limits = {"any_law": proven, "destroying_law": verdict.destroyer and verdict.destroyer.max_delay}
    places = {n: _zero(lambda s, at=limit: longest(s) - at) for n, limit in limits.items() if limit is not None}
    return {name: place for name, place in places.items() if place is not None}


def _margin(name: str, task: Task, sweep: Sweep, entries: Mapping[str, Entry]) -> float:
    """Negative where the condition holds."""
    place = point(sweep.axes, [entries[axis.name] for axis in sweep.axes])
    one = setup(task, place)
    wiring = one.wiring
    if name in ("delay_sum", "sallam_eq10"):
        found, delays = (
            undelayed(wiring, partial(examine, wiring, one.system)).coupling,
            [b[2] for b in channel_bounds(wiring).values()],
        )
        pair = found.pair
        if pair is None or len(delays) != 2 or (name == "delay_sum" and found.broken):
            return np.nan
        there, back = delays
        criterion = (delay_sum if name == "delay_sum" else sallam_eq10)(coupling(pair), there, back)
        used = 0.5 * (there + back) if name == "delay_sum" else float(np.hypot(there, back)) / np.sqrt(2.0)
        return used - criterion.max_delay
    loop = linearise(one.scenario, one.system)
    return np.nan if loop.unseen else abscissa(loop.system())


def _zero(function: Callable[[float], float], tolerance: float = 1e-4) -> float | None:
    """Where a function changes sign on [0, 1], by Brent's method; None where both ends have the same sign."""
    from scipy.optimize import brentq

    low, high = function(0.0), function(1.0)
    if not (np.isfinite(low) and np.isfinite(high)) or (low > 0) == (high > 0):
        return None
    found: Any = brentq(function, 0.0, 1.0, xtol=tolerance)
    return float(found)
