"""A torque over a joint's position without a name, in the form that the FMU of the joint carries.

tau += g(q) + c(q) s(dq),   g and c smooth through KNOTS values at equal distances over the fitted range
"""

from typing import final

import numpy as np
from attrs import frozen

from cosim.effects import Effect, EffectEstimate, Scene
from cosim.effects.motion import Columns, Joints, Theta
from cosim.measured import Label

KNOTS = 10  # NAMELESS_KNOTS in C


def knot_weights(q: np.ndarray, low: float, high: float) -> np.ndarray:
    """Weights (n, KNOTS) of the values at the knots: cubic Hermite pieces, slopes by central differences, none at both
    ends (Catmull and Rom 1974); beyond the ends those of the end.
    """
    last = KNOTS - 1
    place = np.clip((q - low) / (high - low) * last, 0, last)
    first = np.minimum(place.astype(int), last - 1)
    t = (place - first)[:, None]
    knot = np.arange(KNOTS)
    at, after = (knot == first[:, None]).astype(float), (knot == first[:, None] + 1).astype(float)
    values = np.eye(KNOTS)
    slopes = np.asarray(np.gradient(values, axis=0))
    slopes[[0, -1]] = 0.0
    rest = 1 - t
    by_value = rest**2 * (1 + 2 * t) * at + t**2 * (1 + 2 * rest) * after
    by_slope = rest**2 * t * at - t**2 * rest * after
    return by_value @ values + by_slope @ slopes


@final
@frozen
class PositionTable(Effect):
    """Values at knots from `low` to `high` [rad or m] of a torque and of a Coulomb level."""

    low: float
    high: float
    name = "unknown"
    nameless = True
    signals: tuple[str, ...] = ("q", "dq")

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        j = joints[0]
        weights = knot_weights(scene.motion.q[:, j], self.low, self.high)
        return {j: np.concatenate((weights, weights * scene.sign[:, [j]]), axis=1)}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        names = ("nameless_torque", "nameless_friction")
        return tuple(Label(name, k + 1) for name in names for k in range(KNOTS))

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        ends = {Label("nameless_from"): self.low, Label("nameless_to"): self.high}
        values = zip(self.labels(estimate.joints, ()), map(float, estimate.beta), strict=True)
        return ends | dict(values)
