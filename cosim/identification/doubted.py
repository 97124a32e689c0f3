"""What doubts about a recording make of intervals: what they can change enters them, or they are withheld.

Most doubts are mended when a recording is read, or their rows are left out. For the others the parameters are fitted a
second time as if the doubt were true. Where it is a matter of degree (a lag, a drift, noise) the interval holds both
values. Where it is one of two things (radians or degrees), parameters that come out alike keep their intervals and the
others have none.
"""

from collections.abc import Mapping

import numpy as np
from attrs import evolve, field, frozen

from cosim.identification.fit import Fit
from cosim.identification.linear_model import FRICTION
from cosim.identification.smeared import smeared
from cosim.measured.label import Label
from cosim.measured.notes import Disposition, Doubt, Rescaled
from cosim.measured.plausibility import KELVINS
from cosim.measured.recording import Recording, Run

SURE = 4.0  # standard deviations of a lag that is told: 6e-5
REPLICATES = 4
"""Recordings with noise added. Their mean is known to half (1 / sqrt(4)) of what noise of q scatters an estimate by,
which is a part of the interval's own half-width of 1.96 standard deviations: to a quarter of that at most.
"""


@frozen(eq=False)
class Doubted:
    """Half-widths (p,) of the base parameters with what doubts add, labels without an interval with the kinds of the
    doubts that withhold them, and doubts that showed in the fit.
    """

    half_width: np.ndarray
    withheld: Mapping[Label, tuple[str, ...]] = field(factory=dict)
    doubts: tuple[Doubt, ...] = ()


def doubted(fit: Fit) -> Doubted:
    """What is left of the doubts about a fit's recording."""
    lag, late = _late(fit)
    bend, bent = _bent(fit)
    turn, turned = smeared(fit)
    clipped = any(run.clipped is not None for run in fit.recording.runs)
    uneven = any(doubt.kind == "uneven stamps" for doubt in fit.recording.doubts)
    parts = [lag, bend, turn, _warmer(fit), _paced(fit), _noise(fit) if clipped or uneven else np.zeros(len(lag))]
    half = _repeats(fit) * fit.spread.half_width + np.sum(parts, axis=0)
    kinds: dict[Label, tuple[str, ...]] = {}
    for doubt in fit.recording.doubts:
        if doubt.done is Disposition.WITHHELD:
            kinds |= {label: (*kinds.get(label, ()), doubt.kind) for label in _touched(fit, doubt.otherwise)}
    if clipped and not fit.method.reversals.heed_clipping:
        kinds |= {label: (*kinds.get(label, ()), "clipped") for label in fit.stack.labels}
    unique = {label: tuple(dict.fromkeys(names)) for label, names in kinds.items()}
    return Doubted(half, unique, late + bent + turned)


def _late(fit: Fit) -> tuple[np.ndarray, tuple[Doubt, ...]]:
    """What a lag between tau and q changes in the parameters (p,), and the doubt where it is told.

    A torque that is late or filtered is tau + a dtau/dt + b d2tau/dt2 + ... of what is recorded, exactly so for a
    filter of second order; the columns of both derivatives are fitted beside the others, for each joint.
    """
    shift, std, step = _shift(fit)
    filtered = any(doubt.kind == "filtered" for doubt in fit.recording.doubts)
    change = np.zeros(len(fit.params))
    if not filtered and abs(shift) < SURE * std:
        return change, ()
    joints = np.eye(fit.stack.tau.shape[1])
    columns = [rate[:, :, None] * joints for rate in (fit.stack.tau_rate, fit.stack.tau_bend)]
    change = np.abs(fit.beside(np.concatenate(columns, axis=2)).params[: len(change)] - fit.free)
    if not filtered and not (change > fit.spread.half_width).any():
        return np.zeros(len(change)), ()
    return change, (_lag(shift, std, step),) if abs(shift) >= SURE * std else ()


def _shift(fit: Fit) -> tuple[float, float, float]:
    """By how many samples tau is early, its standard deviation, and the step [s]: tau(t + d) = tau + d dtau/dt, a
    column fitted beside the others.
    """
    step = max(run.step for run in fit.recording.runs)
    params, std = fit.one_beside(fit.stack.tau_rate * step)
    return float(params[-1]), std, step


def _lag(shift: float, std: float, step: float) -> Doubt:
    advice = "a command that is held until the next sample is half a sample early: say torque_held = true"
    way = "early"
    if shift < 0:
        way, advice = "late", "a filter on one side, or stamps taken at another time"
    text = (
        f"tau is {way} against q by {abs(shift):.2g} samples ({abs(shift) * step * 1e3:.2g} ms, +-{2 * std:.1g} "
        f"samples): {advice}; a lag or delay of the actuator looks the same (close-loop tells). The intervals hold "
        "what a lag changes"
    )
    return Doubt.of("lag", text)


def _bent(fit: Fit) -> tuple[np.ndarray, tuple[Doubt, ...]]:
    """What a torque that is recorded too small or too large where it is large changes in the parameters (p,), and the
    doubt where it is told: the column tau^3, the first odd term of any such law, is fitted beside the others.
    """
    nothing = np.zeros(len(fit.params)), ()
    size = np.abs(fit.stack.tau).max(axis=0)
    size[size == 0] = 1.0
    params, std = fit.one_beside(fit.stack.tau**3 / size**2)
    share, change = -float(params[-1]), np.abs(params[:-1] - fit.free)
    if abs(share) < SURE * std or not (change > fit.spread.half_width).any():
        return nothing
    way = "small" if share > 0 else "large"
    text = (
        f"tau is too {way} where it is large, by {100 * abs(share):.2g} % (+-{200 * std:.1g} %) at its largest against "
        "the model: an amplifier near its limit, or an effect that the model lacks (close-loop tells). The intervals "
        "hold what a bent torque changes"
    )
    return change, (Doubt.of("bent", text),)


def _warmer(fit: Fit) -> np.ndarray:
    """What friction that changes with a recorded temperature changes in the parameters (p,), over its range."""
    change = np.zeros(len(fit.params))
    if not any(doubt.kind == "temperature" for doubt in fit.recording.doubts):
        return change
    friction = [k for k, label in enumerate(fit.base.labels) if label.name in FRICTION]
    for name, unit in fit.recording.description.other.items():
        if unit in KELVINS:
            warmth = np.nan_to_num(_at_rows(fit, name))  # 0, the mean, for runs whose temperature is not known
            found = fit.beside(fit.base.y[:, :, friction] * warmth[:, None, None]).params
            change += np.abs(found[: len(change)] - fit.free)
            change[friction] += np.abs(found[len(change) :]) * np.abs(warmth).max()
    return change


def _at_rows(fit: Fit, name: str) -> np.ndarray:
    """A signal (n,) at the rows of the stack, less its mean over the fitted ones."""
    rows = np.empty(len(fit.stack.time))
    for number, run in enumerate(fit.recording.runs):
        mine = fit.stack.run == number
        rows[mine] = np.interp(fit.stack.time[mine], run.time, run.other[name])
    return rows - np.nanmean(rows[fit.stack.fit.any(axis=1)])


def _paced(fit: Fit) -> np.ndarray:
    """What clocks that run as fast or slow as they were set change in the parameters (p,)."""
    if all(run.pace == 1 for run in fit.recording.runs):
        return np.zeros(len(fit.params))
    return np.abs(fit.otherwise(fit.recording.paced()) - fit.free)


def _noise(fit: Fit) -> np.ndarray:
    """What the noise of q in the columns makes of the parameters (p,), by adding as much again (SIMEX, Cook and
    Stefanski 1994): errors in variables make inertias too small where few fast rows are left, or where splines through
    uneven stamps enlarge the noise.
    """
    rng = np.random.default_rng(0)
    found = [fit.otherwise(_noisier(fit.recording, rng)) for _ in range(REPLICATES)]
    change = np.abs(np.mean(found, axis=0) - fit.free)
    return np.where(np.isfinite(change), change, np.inf)


def _noisier(recording: Recording, rng: np.random.Generator) -> Recording:
    return evolve(recording, runs=tuple(_with_noise(run, rng) for run in recording.runs))


def _with_noise(run: Run, rng: np.random.Generator) -> Run:
    """A run with noise added to q as large as its own: fourth differences hold that and next to no motion."""
    size = np.sqrt(np.mean(np.diff(run.q, 4, axis=0) ** 2, axis=0) / 70)  # 70 = 1 + 16 + 36 + 16 + 1
    return evolve(run, q=run.q + size * rng.normal(size=run.q.shape))


def _repeats(fit: Fit) -> float:
    """Factor of the widths where rows stand twice in a recording: they tell nothing new."""
    rows = sum(len(run) for run in fit.recording.runs)
    twice = sum(doubt.count for doubt in fit.recording.doubts if doubt.kind == "repeats")
    return float(np.sqrt(rows / max(rows - twice, 1)))


def _touched(fit: Fit, otherwise: Rescaled | None) -> tuple[Label, ...]:
    """Parameters that come out differently if the recording is what the doubt says; all where that is not known."""
    if otherwise is None:
        return fit.stack.labels
    other = fit.otherwise(fit.recording.rescaled(otherwise))
    alike = np.abs(other - fit.free) <= fit.spread.half_width
    same = {label for label, kept in zip(fit.base.labels, alike.tolist(), strict=True) if kept}
    return tuple(label for label in fit.stack.labels if label not in same)
