"""A serial arm as a table of its joints: the numbers that a URDF has, off-chain parts folded in, as numpy arrays.

The FMU SerialArm holds the same table; the equations stand in C (fmu_src/SerialArm) and, written otherwise, in
`serial_kinematics` and `serial_dynamics`.
"""

from collections.abc import Sequence
from enum import Enum

import numpy as np
from attrs import field, frozen

MOST_JOINTS = 12
"""Room in the FMU SerialArm."""


class JointKind(str, Enum):
    """How a joint moves. Continuous is revolute without limits."""

    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"


def _fixed(values) -> np.ndarray:
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array


@frozen(eq=False)
class SerialModel:
    """An arm of n joints. Row i belongs to joint i and to the link that it moves, both in the frame of that joint.

    rotation (n, 3, 3), origin (n, 3) [m]: the joint's frame at q = 0 in the frame of the link before it (of the base);
    axis (n, 3): unit vectors; mass (n,) [kg], centre (n, 3) [m], inertia (n, 3, 3) [kg m^2] about the centre of mass;
    lower, upper (n,) [rad or m], infinite where there are none; effort (n,) [N m or N], speed (n,) [rad/s or m/s],
    infinite likewise; viscous, coulomb (n,); armature (n,) [kg m^2], what rotors add to the diagonal of M;
    gravity (3,) [m/s^2] in the base frame; tip (3,) [m] in the frame of the last joint.
    """

    name: str
    joints: tuple[str, ...] = field(converter=tuple)
    kinds: tuple[JointKind, ...] = field(converter=tuple)
    rotation: np.ndarray = field(converter=_fixed)
    origin: np.ndarray = field(converter=_fixed)
    axis: np.ndarray = field(converter=_fixed)
    mass: np.ndarray = field(converter=_fixed)
    centre: np.ndarray = field(converter=_fixed)
    inertia: np.ndarray = field(converter=_fixed)
    lower: np.ndarray = field(converter=_fixed)
    upper: np.ndarray = field(converter=_fixed)
    effort: np.ndarray = field(converter=_fixed)
    speed: np.ndarray = field(converter=_fixed)
    viscous: np.ndarray = field(converter=_fixed)
    coulomb: np.ndarray = field(converter=_fixed)
    armature: np.ndarray = field(converter=_fixed)
    tip: np.ndarray = field(converter=_fixed)
    gravity: np.ndarray = field(converter=_fixed, factory=lambda: np.array([0.0, 0.0, -9.81]))

    @property
    def count(self) -> int:
        """How many joints move."""
        return len(self.joints)

    @property
    def sliding(self) -> np.ndarray:
        """(n,) True at prismatic joints."""
        return np.array([kind is JointKind.PRISMATIC for kind in self.kinds])

    @property
    def limited(self) -> np.ndarray:
        """(n,) True where the joint has limits on both sides."""
        return np.isfinite(self.lower) & np.isfinite(self.upper)

    def poses(self, count: int, seed: int) -> np.ndarray:
        """Random q (count, n) inside the limits; where there are none, a whole turn (within 1 m for a slide)."""
        wide = np.where(self.sliding, 1.0, np.pi)
        low, high = np.where(self.limited, self.lower, -wide), np.where(self.limited, self.upper, wide)
        return np.random.default_rng(seed).uniform(low, high, (count, self.count))


def turn(rpy: Sequence[float] | np.ndarray) -> np.ndarray:
    """R = Rz(yaw) Ry(pitch) Rx(roll) (3, 3), URDF's convention."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def roll_pitch_yaw(rotation: np.ndarray) -> np.ndarray:
    """(roll, pitch, yaw) (3,) [rad] whose `turn` is the rotation.

    Yaw is found first and taken out, so that R comes back to rounding also where the pitch is a right angle and yaw and
    roll are not told apart.
    """
    r = np.asarray(rotation, dtype=float)
    yaw = np.arctan2(r[1, 0], r[0, 0])
    s, c = np.sin(yaw), np.cos(yaw)
    return np.array(
        [
            np.arctan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1]),
            np.arctan2(-r[2, 0], c * r[0, 0] + s * r[1, 0]),
            yaw,
        ]
    )
