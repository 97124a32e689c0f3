"""Which part of the dynamics a motion's torque comes from: Taati 4.1, Figs. 10 and 11."""

from typing import Any

import numpy as np
from attrs import cmp_using, field, frozen

from cosim.arm.dynamics import coriolis_matrix, direction, gravity_torque, mass_matrix
from cosim.arm.parameters import ParameterSet
from cosim.arm.workspace import LINKED, Workspace

TERMS = ("inertial", "Coriolis and centrifugal", "gravity", "viscous friction", "Coulomb friction")


def _array() -> Any:
    return field(eq=cmp_using(np.array_equal))


@frozen
class ArmMotion:
    """A motion of the joints: time (n,) [s], q, dq, ddq (n, 3) [rad, rad/s, rad/s^2]."""

    time: np.ndarray = _array()
    q: np.ndarray = _array()
    dq: np.ndarray = _array()
    ddq: np.ndarray = _array()


@frozen
class Waves:
    """Sums of sinusoids: frequency [rad/s], amplitude [rad], phase [rad], each (joints, waves), about `centre`
    (joints,).
    """

    centre: np.ndarray = _array()
    frequency: np.ndarray = _array()
    amplitude: np.ndarray = _array()
    phase: np.ndarray = _array()

    def motion(self, time: np.ndarray) -> ArmMotion:
        """The motion at `time` (n,) [s] with its exact derivatives."""
        angle = time[:, None, None] * self.frequency + self.phase
        sine, cosine = self.amplitude * np.sin(angle), self.amplitude * np.cos(angle)
        q = self.centre + sine.sum(axis=-1)
        return ArmMotion(time, q, (self.frequency * cosine).sum(axis=-1), -(self.frequency**2 * sine).sum(axis=-1))

    def scaled(self, factors: np.ndarray) -> "Waves":
        """The same waves with each joint's amplitudes times a factor (joints,)."""
        return Waves(self.centre, self.frequency, self.amplitude * factors[:, None], self.phase)


CENTRE = (0.0, 0.35, 0.45)
"""A pose [rad] well inside box and linkage."""


def random_motion(seed: int = 1, duration: float = 40.0, peak: float = 3.5, workspace: Workspace = LINKED) -> ArmMotion:
    """Free motion like the one of Taati 4.1: ten sinusoids of 0.11 to 5 rad/s a joint, no joint faster than `peak`
    [rad/s].

    Joint 1 reaches `peak`; joints 2 and 3 are made as fast as the linkage lets them be, with one common factor.
    """
    rng, time = np.random.default_rng(seed), np.arange(0.0, duration, 0.01)
    frequency = np.sort(rng.uniform(0.11, 5.0, (3, 10)), axis=-1)
    frequency[:, -1] = 5.0
    waves = Waves(
        np.array(CENTRE),
        frequency,
        rng.uniform(0.2, 1.0, (3, 10)) * frequency / 5.0,
        rng.uniform(0, 2 * np.pi, (3, 10)),
    )
    fastest = np.abs(waves.motion(time).dq).max(axis=0)
    waves = waves.scaled(peak / fastest)
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = (low + high) / 2
        inside = workspace.contains(waves.scaled(np.array([1.0, middle, middle])).motion(time).q).all()
        low, high = (middle, high) if inside else (low, middle)
    return waves.scaled(np.array([1.0, low, low])).motion(time)


def sampled_motion(time: np.ndarray, q: np.ndarray, dq: np.ndarray) -> ArmMotion:
    """A recorded or simulated motion: ddq by second-order differences of dq (n, 3), so dq has to be smooth."""
    return ArmMotion(time, q, dq, np.gradient(dq, time, axis=0, edge_order=2))


@frozen
class Dissection:
    """The torque of a motion by origin: `torque` (5, n, 3) [N m] in the order of TERMS, at `time` (n,) [s]."""

    name: str
    time: np.ndarray = _array()
    torque: np.ndarray = _array()

    @property
    def rms(self) -> np.ndarray:
        """Root mean square of each term (5, 3) [N m]."""
        return np.sqrt(np.mean(self.torque**2, axis=1))

    @property
    def share(self) -> np.ndarray:
        """Mean absolute value of each term over the sum of all five (5, 3); each joint's column adds to 1."""
        size = np.mean(np.abs(self.torque), axis=1)
        return size / size.sum(axis=0)


def dissect(params: ParameterSet, motion: ArmMotion) -> Dissection:
    """The five terms of M ddq + C dq + N + viscous + Coulomb along a motion (free: no tip force); Coulomb with
    sgn(dq).
    """
    q, dq, ddq = motion.q, motion.dq, motion.ddq
    inertial = np.einsum("nij,nj->ni", mass_matrix(params.pi, q), ddq)
    coriolis = np.einsum("nij,nj->ni", coriolis_matrix(params.pi, q, dq), dq)
    viscous, coulomb = params.viscous * dq, params.coulomb * direction(dq, 0.0)
    return Dissection(
        params.name, motion.time, np.stack([inertial, coriolis, gravity_torque(params.pi, q), viscous, coulomb])
    )
