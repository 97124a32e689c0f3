"""What a form is drawn for: the scales of the plain experiment on the joint that it befalls."""

from dataclasses import dataclass

import numpy as np

from tests.support.laboratory_c.arrays import Array
from tests.support.laboratory_c.machines import Machine


@dataclass(frozen=True)
class JointScales:
    """Scales of one joint in one experiment, and the dice."""

    rng: np.random.Generator
    machine: Machine
    joint: int
    q: Array
    """(rows, n) of the plain experiment, as are v and torque."""
    v: Array
    torque: Array
    dry: float
    viscous: float
    inertia: float
    """Rotor and rigid body about the joint [kg m^2 or kg]."""
    duration: float
    """Of all runs together [s]."""

    @property
    def speed(self) -> float:
        return float(np.sqrt(np.mean(self.v[:, self.joint] ** 2)))

    @property
    def load(self) -> float:
        return float(np.sqrt(np.mean(self.torque[:, self.joint] ** 2)))

    @property
    def most_load(self) -> float:
        return float(np.abs(self.torque[:, self.joint]).max())

    @property
    def range(self) -> tuple[float, float]:
        return float(self.q[:, self.joint].min()), float(self.q[:, self.joint].max())

    @property
    def span(self) -> float:
        low, high = self.range
        return high - low

    @property
    def other(self) -> int | None:
        """A neighbour, where there is one."""
        n = self.q.shape[1]
        return None if n == 1 else (self.joint - 1 if self.joint else 1)

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def factor(self, low: float, high: float) -> float:
        """Uniform in its logarithm."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def sign(self) -> float:
        return float(self.rng.choice([-1.0, 1.0]))

    def place(self, low: float, high: float) -> float:
        """A place of the joint at a share of its range."""
        least, most = self.range
        return least + self.between(low, high) * (most - least)
