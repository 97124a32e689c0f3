"""Is the loop stable at this point? Judged from twin runs, never from a bound on the motion.

`twin` makes the second run's scenario: same forcing, same delays, a slightly different start. `judge` compares the
two results.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np
from attrs import frozen

from cosim.analysis.growth import Growth, growth, usable
from cosim.engine.master import Result
from cosim.engine.outcome import Outcome
from cosim.engine.table import stacked

_STATE = re.compile(r"^(?P<arm>[^.]+)\.(?P<kind>d?q)(\[(?P<joint>\d+)\])?$")
_DIRECTION = (1.0, 0.8, 0.6)
PERTURBATION = 1e-6
"""Size of the difference of the starts [rad/s]: 1e6 above round-off and far below any nonlinearity of the arm (1
rad).
"""
_ROUND_OFF = 1e-12
_CEILING = 1e-2
ENDED = (Outcome.DOMAIN_EXIT, Outcome.DIVERGED, Outcome.LIMIT_HIT, Outcome.FAILED)


@frozen
class GrowthVerdict:
    """Outcome with growth rate [1/s], its 95 % interval, the window [s] used, and how it was found."""

    outcome: Outcome
    growth_rate: float
    interval: tuple[float, float]
    window: tuple[float, float] = (np.nan, np.nan)
    estimator: str = ""
    frequency: float = np.nan


def perturbation(arms: Mapping[str, int], size: float = PERTURBATION) -> dict[str, float]:
    """Changes of the start values that make the twin: {"arm_l.dq_start[1]": 1e-6, ...} [rad/s] to be added.

    `arms` names the arms with their numbers of joints. Velocities only, so that the past x(t < 0) = x(0) stays the
    same; opposite signs on the two sides, so that equal arms receive no common momentum and the neutral motion (both
    displaced together) stays at rest.
    """
    changes = {}
    for number, (arm, joints) in enumerate(arms.items()):
        sign = size if number % 2 == 0 else -size
        for joint in range(joints):
            name = f"{arm}.dq_start[{joint + 1}]" if joints > 1 else f"{arm}.dq_start"
            changes[name] = sign * _DIRECTION[joint % 3]
    return changes


def judge(result: Result, twin: Result) -> GrowthVerdict:
    """Verdict on a run and its twin (results of the master: `outcome`, `time` (n,) [s], `signals`).

    The difference of the joint rates of all arms is followed, rates because the loop is neutral against a common
    displacement. Left out: the round-off floor (1e-12 of the motion's size), differences above 1e-2 rad/s (no longer
    small), saturated moments.
    """
    count = min(len(result.time), len(twin.time))
    time, motion = np.asarray(result.time, float), _matrix(result.signals, ("dq", "q"))
    channels = len(_names(result.signals, "dq"))
    rates, angles = motion[:, :channels], motion[:count, channels:]
    difference = _matrix(twin.signals, ("dq",))[:count] - rates[:count]
    size = np.max(np.abs(angles), initial=0.0) + np.max(np.abs(rates[:count]), initial=0.0)
    count = _unsaturated(result.signals, twin.signals, count)
    norm = np.sqrt(np.einsum("ij,ij->i", difference[:count], difference[:count]))
    part = usable(np.where(np.isfinite(norm), norm, np.inf), _ROUND_OFF * max(size, 1e-3), _CEILING)
    found = growth(time[:count][part], difference[part])
    return _verdict(result, rates, found)


def _verdict(result: Result, rates: np.ndarray, found: Growth | None) -> GrowthVerdict:
    if found is None:
        return GrowthVerdict(_ended(result) or Outcome.INCONCLUSIVE, np.nan, (np.nan, np.nan))
    outcome = _ended(result) or outcome_of(found, result, rates)
    return GrowthVerdict(outcome, found.rate, (found.low, found.high), found.window, found.estimator, found.frequency)


def _ended(result: Result) -> Outcome | None:
    """How the run itself ended, where that says more than the growth rate."""
    return result.outcome if result.outcome in ENDED else None


def outcome_of(found: Growth, result: Result, rates: np.ndarray) -> Outcome:
    """Sign of the growth rate, if its interval leaves zero; else what the motion itself shows. rates: all dq (n,
    channels).
    """
    if self_sustained(result, rates):
        return Outcome.LIMIT_CYCLE
    if found.low > 0.0:
        return Outcome.GROWING
    if found.high < 0.0:
        return Outcome.CONVERGED
    # The interval holds zero: it says "neutral" only if it excludes a change by 20 % within the window.
    narrow = found.half_width * (found.window[1] - found.window[0]) < 0.2
    return Outcome.BOUNDED if narrow else Outcome.INCONCLUSIVE


def self_sustained(result: Result, rates: np.ndarray) -> bool:
    """True where the motion has settled on an oscillation of its own: a limit cycle.

    In the last third of the run the operator's force is constant, the RMS of the joint rates stays the same within 3
    % from each ninth of the run to the next, above a thousandth of its maximum, and it had grown to there (by 10 %)
    before. A linear loop near its boundary keeps the size it was given, or goes on growing.
    """
    count = len(rates)
    if count < 90 or rates.size == 0:
        return False
    squares = np.einsum("ij,ij->i", rates, rates) / rates.shape[1]
    levels = np.sqrt([part.mean() for part in np.array_split(squares, 9)])
    peak, settled = np.max(np.abs(rates)), levels[6:].mean()
    steady = levels[6:].min() > 1e-3 * peak and peak > 1e-4 and np.ptp(levels[6:]) < 0.03 * settled
    grown = settled > 1.1 * levels[2:6].min()
    return bool(steady and grown) and not _forced(result.signals, slice(2 * count // 3, count))


def _forced(signals: Mapping[str, np.ndarray], late: slice) -> bool:
    forces = [values[late] for name, values in signals.items() if re.match(r"^operator\.f(\[\d\])?$", name)]
    return any(np.ptp(force) > 0 for force in forces)


def _names(signals: Mapping[str, np.ndarray], kind: str) -> list[str]:
    """Names of all `q` or `dq` of all arms."""
    return sorted(n for n in signals if f".{kind}" in n and (match := _STATE.match(n)) and match["kind"] == kind)


def _matrix(signals: Mapping[str, np.ndarray], kinds: Sequence[str]) -> np.ndarray:
    """All `q` or `dq` of all arms as columns, shape (n, channels); read in one go."""
    names = [name for kind in kinds for name in _names(signals, kind)]
    return stacked(signals, names) if names else np.zeros((0, 0))


def _unsaturated(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], count: int) -> int:
    """Number of samples before an actuator first saturates in either run."""
    for signals in (one, other):
        for name in (name for name in signals if name.endswith(".saturated")):
            hit = np.flatnonzero(np.asarray(signals[name][:count]) > 0.5)
            count = min(count, int(hit[0])) if hit.size else count
    return count
