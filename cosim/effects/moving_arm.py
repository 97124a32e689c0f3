"""Arms whose geometry is known, for effects that need it: the tip, a mass at it, a tilt of the base.

`arm_geometry` chooses by the class of the device; a new kind of arm registers its geometry here.
"""

from abc import ABC, abstractmethod
from functools import cached_property, singledispatch
from typing import final

import numpy as np
from attrs import evolve, frozen

from cosim.arm import serial_dynamics
from cosim.arm.dynamics import inverse_dynamics
from cosim.arm.identified import identified_arm
from cosim.arm.kinematics import L1, L2, forward, jacobian
from cosim.arm.segments import point_mass_pi
from cosim.arm.serial import SerialModel
from cosim.arm.serial_kinematics import tip_jacobian, tip_position
from cosim.effects.motion import Columns, Motion
from cosim.measured.device import Device, PhantomDevice, RobotDevice

UNBALANCED = 1e-3  # N m, of the largest gravity moment: below it the arm is balanced
UPRIGHT = 1e-9  # rad, between an axis and the vertical: rounding of a URDF's frames
POSES = 100  # inside the limits, at which gravity is looked at


class ArmGeometry(ABC):
    """Kinematics of an arm and torques that follow from its geometry. Subclasses are final and frozen."""

    @abstractmethod
    def tip(self, q: np.ndarray) -> np.ndarray:
        """Position (n, 3) [m] of the tip."""

    @abstractmethod
    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian (n, 3, nj) [m/rad] of the tip."""

    @abstractmethod
    def payload_torque(self, motion: Motion, gravity: float) -> np.ndarray:
        """Torque (n, nj) [N.m/kg] that a point mass at the tip needs; gravity [m/s^2]."""

    @abstractmethod
    def tilt_torque(self, q: np.ndarray, pi: np.ndarray) -> Columns:
        """Torque [N.m/rad] of gravity tilted about two axes, joint -> (n, 2), with the arm's parameters pi."""

    @abstractmethod
    def balanced(self, pi: np.ndarray) -> bool:
        """Whether gravity has no moment on any joint."""

    @abstractmethod
    def idle(self, joint: int) -> bool:
        """Whether nothing in the equations of motion depends on the angle of a joint (from 0)."""


@final
@frozen
class PhantomGeometry(ArmGeometry):
    """The PHANToM (PHYSICS.md 1)."""

    def tip(self, q: np.ndarray) -> np.ndarray:
        return forward(q)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        return jacobian(q)

    def payload_torque(self, motion: Motion, gravity: float) -> np.ndarray:
        return inverse_dynamics(point_mass_pi(1.0, L1, L2, gravity), motion.q, motion.dq, motion.ddq)

    def tilt_torque(self, q: np.ndarray, pi: np.ndarray) -> Columns:
        p7, p8 = pi[6:]
        (s1, s2, s3), (c1, c2, c3) = np.sin(q.T), np.cos(q.T)
        reach = p7 * c2 + p8 * s3
        return {
            0: np.stack((c1 * reach, -s1 * reach), axis=1),
            1: np.stack((-p7 * s1 * s2, -p7 * c1 * s2), axis=1),
            2: np.stack((p8 * s1 * c3, p8 * c1 * c3), axis=1),
        }

    def balanced(self, pi: np.ndarray) -> bool:
        return bool(np.abs(pi[6:]).max() <= UNBALANCED)

    def idle(self, joint: int) -> bool:
        return joint == 0


@final
@frozen(eq=False)
class SerialGeometry(ArmGeometry):
    """An arm from its URDF; pi are its base parameters."""

    arm: SerialModel

    def tip(self, q: np.ndarray) -> np.ndarray:
        return tip_position(self.arm, q)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        return tip_jacobian(self.arm, q)

    def payload_torque(self, motion: Motion, gravity: float) -> np.ndarray:
        n, last = self.arm.count, np.arange(self.arm.count) == self.arm.count - 1
        mass, centre = last.astype(float), np.outer(last, self.arm.tip)
        only = evolve(self.arm, mass=mass, centre=centre, inertia=np.zeros((n, 3, 3)), armature=np.zeros(n))
        return serial_dynamics.inverse_dynamics(only, motion.q, motion.dq, motion.ddq)

    def tilt_torque(self, q: np.ndarray, pi: np.ndarray) -> Columns:
        """Gravity turned about the base's y and its x axis to first order, as the FMU's `base_tilt` turns it."""
        whole, g = identified_arm(self.arm, pi), self.arm.gravity
        turned = [(g[2], 0.0, -g[0]), (0.0, g[2], -g[1])]
        parts = [serial_dynamics.gravity_torque(evolve(whole, gravity=np.array(pull)), q) for pull in turned]
        return {j: np.stack([part[:, j] for part in parts], axis=1) for j in range(self.arm.count)}

    def balanced(self, pi: np.ndarray) -> bool:
        weight = serial_dynamics.gravity_torque(identified_arm(self.arm, pi), self.arm.poses(POSES, 1))
        return bool(np.abs(weight).max() <= UNBALANCED)

    def idle(self, joint: int) -> bool:
        """Of the first joint, where it slides or turns about the vertical: nothing is there that it moves towards."""
        axis = self.arm.rotation[0] @ self.arm.axis[0]
        upright = np.linalg.norm(np.cross(axis, self.arm.gravity)) <= UPRIGHT * np.linalg.norm(self.arm.gravity)
        return joint == 0 and bool(upright or self.arm.sliding[0])


@final
@frozen(eq=False)
class MovingArm:
    """An arm along one motion. Where its tip goes is computed once."""

    geometry: ArmGeometry
    motion: Motion

    @cached_property
    def tip(self) -> np.ndarray:
        """Position (n, 3) [m] of the tip."""
        return self.geometry.tip(self.motion.q)

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Jacobian (n, 3, nj) [m/rad] of the tip."""
        return self.geometry.jacobian(self.motion.q)


@singledispatch
def arm_geometry(device: Device) -> ArmGeometry | None:
    """The geometry of a device that is an arm, None for others."""
    return None


@arm_geometry.register
def _(device: PhantomDevice) -> ArmGeometry | None:
    return PhantomGeometry()


@arm_geometry.register
def _(device: RobotDevice) -> ArmGeometry | None:
    return SerialGeometry(device.arm)


def moving_arm(device: Device, motion: Motion) -> MovingArm | None:
    """The arm of a device along a motion; None where the device is no arm."""
    geometry = arm_geometry(device)
    return geometry and MovingArm(geometry, motion)
