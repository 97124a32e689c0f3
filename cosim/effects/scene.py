"""What an effect may look at: the motion, and the model as it stands."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from functools import cached_property
from typing import final

import numpy as np
from attrs import field, frozen

from cosim.effects.motion import Motion, Slopes
from cosim.effects.moving_arm import MovingArm
from cosim.measured.device import Device, G

EDGE = 3.5  # widths of the first filter: the start of a run that it distorts
SLIDING = 0.9  # mean sign of the speed around a start, above which the joint moves


@final
@frozen(eq=False)
class Scene:
    """The motion, n rows and nj joints, with the model as it stands.

    sign (n, nj): smooth sign of dq by the friction law in use; rigid, friction, prediction (n, nj): torques of the
    rigid body, of friction and of the whole model [N.m]; viscous, coulomb (nj,). rigid_slopes(j): derivatives of the
    rigid torque by q_j, dq_j, ddq_j; None where the device has no equations of motion. pi: parameters of an arm, None
    for other devices; declared: whether they are trusted rather than fitted. gravity [m/s^2] is negative for an arm
    that hangs upside down. skew [s]: how late the recorded torque was taken to act because of sampling. units: of
    further recorded signals. laws: the friction laws of `sign`.
    """

    motion: Motion
    device: Device
    sign: np.ndarray
    rigid: np.ndarray
    friction: np.ndarray
    prediction: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    rigid_slopes: Callable[[int], Slopes] | None = None
    arm: MovingArm | None = None
    pi: np.ndarray | None = None
    declared: bool = False
    gravity: float = G
    skew: float = 0.0
    units: Mapping[str, str] = field(factory=dict)
    laws: Hashable = ()

    @property
    def joints(self) -> int:
        """Number of joints nj."""
        return self.motion.joints

    @property
    def whole_arm(self) -> tuple[tuple[int, ...], ...]:
        """The one set of joints of an effect on the whole arm; empty where the device is no arm."""
        return () if self.arm is None else (tuple(range(self.joints)),)

    def speed_range(self, joint: int) -> tuple[float, float]:
        """Speeds [rad/s] between which the joint mostly moves: 5th and 99th percentile of |dq|."""
        low, high = np.percentile(np.abs(self.motion.dq[:, joint]), (5, 99))
        return float(low), float(high)

    def angle_range(self, joint: int) -> float:
        """Width [rad] of the travelled range, 1st to 99th percentile."""
        low, high = np.percentile(self.motion.q[:, joint], (1, 99))
        return float(high - low)

    def joint(self, joint: int) -> SceneJoint:
        """The equations of motion along the movement of one joint (from 0)."""
        return self._joints[joint]

    @cached_property
    def _joints(self) -> tuple[SceneJoint, ...]:
        return tuple(SceneJoint(self, joint) for joint in range(self.joints))


@final
@frozen(eq=False)
class SceneJoint:
    """The equations of motion along the movement of one joint; each part is computed once for a scene."""

    scene: Scene
    number: int

    @cached_property
    def slopes(self) -> Slopes:
        """Derivatives of the rigid torque by q, dq and ddq of the joint, each joint -> (n,)."""
        assert self.scene.rigid_slopes is not None, "effects ask whether there are equations of motion"
        return self.scene.rigid_slopes(self.number)

    @cached_property
    def usual_inertia(self) -> float:
        """The median [kg.m^2] over fitted rows of the joint's own inertia."""
        own = self.slopes[2][self.number]
        return max(float(np.median(own[~self.scene.motion.test])), 1e-12)

    @cached_property
    def inertia(self) -> np.ndarray:
        """The joint's own inertia (n,) [kg.m^2] along the motion, at least a tenth of its median."""
        return np.maximum(self.slopes[2][self.number], 0.1 * self.usual_inertia)

    @cached_property
    def starts(self) -> tuple[LinkStart, ...]:
        """Where a simulation of the link starts in each run: after the rows that the filter's edge distorts."""
        scene, joint, m = self.scene, self.number, self.scene.motion
        reach = int(np.ceil(EDGE * m.widths.first / m.step))
        seen = np.stack((m.tau[:, joint] - scene.friction[:, joint], m.ddq[:, joint]), axis=1)
        rate, starts = m.rate(seen), []
        for a, b in m.bounds:
            row = min(a + reach, b - 1)
            slides = abs(scene.sign[a : row + reach, joint].mean()) > SLIDING
            (torque, acceleration) = np.stack((seen[row], rate[row]), axis=1)
            starts.append(LinkStart(row, MovingStart(torque, acceleration)) if slides else LinkStart(a))
        return tuple(starts)


@frozen(eq=False)
class MovingStart:
    """At the start of a run in motion, the torque that motor and friction leave, and the acceleration: each (2,), value
    and rate.
    """

    torque: np.ndarray
    acceleration: np.ndarray


@frozen(eq=False)
class LinkStart:
    """The row at which a simulation of a link starts; `moving` is None where the joint stands there."""

    row: int
    moving: MovingStart | None = None

    def state(self, spring: tuple[float, float, float], motor: float, resting: float) -> tuple[float, float]:
        """Twist and its rate. spring: stiffness k, damping c, gap; motor: its inertia J; resting: the link's torque.

        In motion the spring transmits k t + c t' = torque - J ddq. At rest it carries the link's own torque.
        """
        stiffness, damping, gap = spring
        if self.moving is None:
            value, rate = resting, 0.0
        else:
            value, rate = self.moving.torque - motor * self.moving.acceleration
        return (value - damping / stiffness * rate) / stiffness + float(np.copysign(gap / 2, value)), rate / stiffness
