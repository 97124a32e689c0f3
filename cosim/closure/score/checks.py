"""Absolute checks, before "complete" and before "sure": residual against the sensors' noise, single moments, rows
that a hypothesis erases, motion in one direction only.
"""

from collections.abc import Iterator

import numpy as np
from attrs import frozen

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.model import Model, friction_laws, with_friction
from cosim.closure.score.compare import preferred
from cosim.closure.score.floor import from_sensors
from cosim.effects.actuator import Erasing
from cosim.effects.constants import EVENT, HALF, NOISE, SAME, SIZE, SMALL
from cosim.effects.motion import Joints

MOST_EVENTS = 5  # that are told


@frozen
class ClosureEvent:
    """A moment of a run that holds much of what is left on a joint (0-based); time [s]."""

    time: float
    run: str
    joint: int
    kind: str


def _rms(x: np.ndarray, use: np.ndarray) -> np.ndarray:
    return np.sqrt(np.where(use, x**2, 0).sum(axis=-1) / np.maximum(use.sum(axis=-1), 1))


def incomplete(model: Model) -> dict[int, str]:
    """Joints (0-based) whose model is incomplete whatever explains it, and why: the residual is far larger than the
    noise of the sensors, or far larger on reported rows than on fitted ones, as where only these cross a gap. Not where
    a friction law that the fitted rows cannot tell from the model's leaves no more: its form near rest is open then.
    """
    if (noise := from_sensors(model)) is None:
        return {}
    fitted = model.setting.use & ~model.setting.rows.test
    left = _rms(model.residual, fitted & (model.kept > HALF))
    torque = _rms(model.setting.y + model.setting.given, fitted)
    out = {}
    for j in range(model.setting.joints):
        if left[j] ** 2 > NOISE * noise[j] ** 2 and left[j] > SMALL * torque[j]:
            out[j] = f"it leaves {left[j] / max(noise[j], 1e-300):.3g} times the noise of its sensors"
        elif times := _surprise(model, j, noise[j]):
            out[j] = f"it leaves {times:.3g} times as much on reported rows as fitted ones let expect"
    return out


def surprising(model: Model) -> set[int]:
    """Joints (0-based) of which reported rows leave more than fitted ones let expect."""
    noise = from_sensors(model)
    return set() if noise is None else {j for j in range(model.setting.joints) if _surprise(model, j, noise[j])}


def _surprise(model: Model, joint: int, noise: float) -> float:
    """`_reported`, zero where it is not so with a friction law that fitted rows cannot tell from the model's."""
    times = _reported(model, joint, noise)
    return times if times and all(_reported(m, joint, noise) for m in _alike(model, joint)) else 0.0


def _reported(model: Model, joint: int, noise: float) -> float:
    """How many times as much is left on reported rows as fitted ones, the noise and the coefficients' own uncertainty
    let expect, zero where no more than may be; without moments and spikes, which lie on either side by chance.
    """
    setting, test = model.setting, model.setting.rows.test
    usual = setting.use[joint] & (model.kept[joint] > HALF)
    usual[np.r_[_moments(model, joint), _spikes(model, joint)]] = False
    fitted, held = (_rms(model.residual[joint], usual & rows) for rows in (~test, test))
    torque = _rms(setting.y[joint] + setting.given[joint], setting.use[joint] & test)
    x = model.unweighted[joint, usual & test]
    predicted = np.sqrt(np.einsum("mp,pq,mq->m", x, model.fit.cov, x).clip(0).mean()) if len(x) else 0.0
    times = held / max(np.hypot(max(fitted, noise), predicted), 1e-300)
    return float(times) if times**2 > NOISE and held > SIZE * torque else 0.0


def _alike(model: Model, joint: int) -> Iterator[Model]:
    """The model with each friction law of a joint that blocks left out do not tell from its own."""
    others = (with_friction(model, joint, law) for law in friction_laws(model, joint))
    return (other for other in others if preferred(model, other) <= SAME)


def events(model: Model) -> tuple[ClosureEvent, ...]:
    """Moments that hold half of what is left on a joint in few rows: lost counts, a collision, a dropout."""
    m, rows, out = model.setting.motion, model.setting.rows, []
    for j in range(model.setting.joints):
        few = _moments(model, j)
        if not len(few):
            continue
        place = rows.index[few]
        apart = np.flatnonzero(np.diff(place) > 8 * m.widths.total / m.step) + 1
        groups = sorted(np.split(place, apart), key=len, reverse=True)[:MOST_EVENTS]
        for group in groups:
            at = int(np.median(group))
            share = f"{100 * len(few) / model.setting.use[j].sum():.2g} % of the rows hold half of what is left"
            kind = f"{share}: lost counts, a collision or a dropout"
            out.append(ClosureEvent(float(m.time[at]), m.names[m.run[at]], j, kind))
    return tuple(sorted(out, key=lambda e: (e.joint, e.time)))


def _moments(model: Model, joint: int) -> np.ndarray:
    """The fewest rows that hold half of what is left on a joint, in order of time; empty where they are not few."""
    return np.sort(next(_concentrated(model, joint), np.empty(0, int)))


def _spikes(model: Model, joint: int) -> np.ndarray:
    """Rows that hold half of what is left on a joint, and half of what these leave, as long as they are few: those no
    longer than the filter, as a single sample is behind it.
    """
    few = np.sort([np.empty(0, int), *_concentrated(model, joint)][-1])
    widths, time = model.setting.motion.widths, model.setting.rows.index * model.setting.motion.step
    groups = np.split(few, np.flatnonzero(np.diff(time[few]) > 2 * widths.total) + 1)
    return np.concatenate([few[:0], *(g for g in groups if len(g) and np.ptp(time[g]) <= 2 * widths.support)])


def _concentrated(model: Model, joint: int) -> Iterator[np.ndarray]:
    """The fewest rows that hold half of what is left on a joint, three quarters, and so on, as long as they are few."""
    use = np.flatnonzero(model.setting.use[joint])
    square = model.residual[joint, use] ** 2
    order, few = np.argsort(-square), 0
    held = np.r_[0.0, np.cumsum(square[order])]
    while few < (count := int(np.searchsorted(held, HALF * (held[few] + held[-1])))) <= EVENT * len(use):
        few = count
        yield use[order[:few]]


def doubt_of(model: Model, choice: ChosenEffect, joints: Joints) -> str:
    """Why a name cannot be sure whatever it explains; empty where it can."""
    for j in joints:
        use = model.setting.use[j] & ~model.setting.rows.test
        erased = float(1 - model.kept[j][use].mean()) if use.any() else 0.0
        if isinstance(choice.effect, Erasing) and erased > SMALL:
            return f"{100 * erased:.0f} % of the rows are erased and cannot contradict it (a smaller command)"
        if one_way(model, j):
            return f"joint {j + 1} moves in one direction only (motion in the other)"
    return ""


def one_way(model: Model, joint: int) -> bool:
    """Whether the fitted rows in motion show one direction of a joint only."""
    rows, m = model.setting.rows, model.setting.motion
    use = model.setting.use[joint] & ~rows.test
    forward = float((m.dq[rows.index[use], joint] > 0).mean()) if use.any() else HALF
    return min(forward, 1 - forward) < EVENT


def unseparated(model: Model) -> list[str]:
    """What the motion cannot separate, in words."""
    m = model.setting.motion
    out = [
        f"joint {j + 1} moves in one direction only: its Coulomb friction is not told from an offset, nor a curve over "
        "its speed from one over the direction"
        for j in model.active
        if one_way(model, j)
    ]
    fitted = len(np.unique(m.run[~m.test]))
    if fitted > 1:
        out.append(f"{fitted} runs are fitted: what changes from run to run is not told from a function of time")
    return out
