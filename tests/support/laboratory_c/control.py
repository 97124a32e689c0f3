"""A cascade as in servo drives: a loop of position about a loop of speed with integral action, on counted places."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tests.support.laboratory_c.arrays import Array
from tests.support.laboratory_c.machines import Machine


@dataclass
class Cascade:
    """torque = kv (speed wanted - speed seen) + integral + share of the known feedforward, cut at `limit`."""

    inertia: tuple[float, ...]
    """Of the joints about their middle [kg m^2 or kg]."""
    count: tuple[float, ...]
    """Step of the encoder [rad or m]."""
    band: float
    """Of the speed loop [rad/s]."""
    position: float
    """Of the position loop [1/s]."""
    share: float
    """Of inertia and gravity that is fed forward."""
    current: float
    """Time constant of the current loop [s]; what it does is in the torque that the drive reports."""
    machine: Machine
    limit: tuple[float, ...]
    smoothing: float = 0.25
    """Share of a new difference of places in the speed that is seen."""
    reference: Array = field(default_factory=lambda: np.zeros((1, 1)))

    def reset(self, reference: Array, period: float) -> None:
        self.period = period
        self.reference = reference
        self.rate = np.gradient(reference, period, axis=0)
        self.second = np.gradient(self.rate, period, axis=0)
        n = reference.shape[1]
        self.last = reference[0].tolist()
        self.speed, self.integral = [0.0] * n, [0.0] * n

    def first(self, machine: Machine, q: Sequence[float]) -> list[float]:
        """Torque with which a run begins: it holds the weight."""
        held = machine.bias(q, [0.0] * len(q))
        self.integral = [(1 - self.share) * x for x in held]
        return held

    def update(self, k: int, q: Sequence[float]) -> list[float]:
        ref, rate, second = self.reference[k].tolist(), self.rate[k].tolist(), self.second[k].tolist()
        weight = self.machine.bias(ref, [0.0] * len(ref))
        out = []
        for j, inertia in enumerate(self.inertia):
            seen = round(q[j] / self.count[j]) * self.count[j]
            self.speed[j] += self.smoothing * ((seen - self.last[j]) / self.period - self.speed[j])
            self.last[j] = seen
            error = rate[j] + self.position * (ref[j] - seen) - self.speed[j]
            torque = inertia * self.band * error + self.integral[j] + self.share * (inertia * second[j] + weight[j])
            out.append(max(-self.limit[j], min(self.limit[j], torque)))
            if abs(torque) < self.limit[j]:
                self.integral[j] += inertia * self.band * 0.15 * self.band * error * self.period
        return out
