"""Serial arms whose numbers are published: names that a component of model SerialArm may have as `parameter_set`."""

from collections.abc import Callable, Mapping

import numpy as np

from cosim.arm.serial import JointKind, SerialModel, turn
from cosim.arm.serial_table import arm_values
from cosim.errors import InputError, Problem, did_you_mean

_RIGHT = 0.5 * np.pi

PANDA_FRAMES = (
    (0.0, 0.0, 0.333),
    (0.0, -_RIGHT, 0.0),
    (0.0, _RIGHT, 0.316),
    (0.0825, _RIGHT, 0.0),
    (-0.0825, -_RIGHT, 0.384),
    (0.0, _RIGHT, 0.0),
    (0.088, _RIGHT, 0.0),
)
"""Craig's Denavit-Hartenberg rows (a [m], alpha [rad], d [m]) of the Franka Emika Panda: its maker's manual."""
PANDA_FLANGE = 0.107
"""Distance of the flange from the last joint along its axis [m], likewise."""
PANDA_LIMITS = (
    (-2.8973, 2.8973, 87.0, 2.1750),
    (-1.7628, 1.7628, 87.0, 2.1750),
    (-2.8973, 2.8973, 87.0, 2.1750),
    (-3.0718, -0.0698, 87.0, 2.1750),
    (-2.8973, 2.8973, 12.0, 2.6100),
    (-0.0175, 3.7525, 12.0, 2.6100),
    (-2.8973, 2.8973, 12.0, 2.6100),
)
"""Lower, upper [rad], torque [N m], speed [rad/s] of its joints, likewise."""
PANDA_LINKS = (
    (4.970684, 3.875e-3, 2.081e-3, -4.762e-2, 7.0337e-1, -1.3900e-4, 6.7720e-3, 7.0661e-1, 1.9169e-2, 9.1170e-3),
    (0.646926, -3.141e-3, -2.872e-2, 3.495e-3, 7.9620e-3, -3.9250e-3, 1.0254e-2, 2.8110e-2, 7.0400e-4, 2.5995e-2),
    (3.228604, 2.7518e-2, 3.9252e-2, -6.6502e-2, 3.7242e-2, -4.7610e-3, -1.1396e-2, 3.6155e-2, -1.2805e-2, 1.0830e-2),
    (3.587895, -5.317e-2, 1.04419e-1, 2.7454e-2, 2.5853e-2, 7.7960e-3, -1.3320e-3, 1.9552e-2, 8.6410e-3, 2.8323e-2),
    (1.225946, -1.1953e-2, 4.1065e-2, -3.8437e-2, 3.5549e-2, -2.1170e-3, -4.0370e-3, 2.9474e-2, 2.2900e-4, 8.6270e-3),
    (1.666555, 6.0149e-2, -1.4117e-2, -1.0517e-2, 1.9640e-3, 1.0900e-4, -1.1580e-3, 4.3540e-3, 3.4100e-4, 5.4330e-3),
    (0.735522, 1.0517e-2, -4.252e-3, 6.1597e-2, 1.2516e-2, -4.2800e-4, -1.1960e-3, 1.0027e-2, -7.4100e-4, 4.8150e-3),
)
"""Mass [kg], centre x, y, z [m], inertia xx, xy, xz, yy, yz, zz [kg m^2] about the centre, in the joints' frames: C.
Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano, A. De Luca, Dynamic Identification of the Franka Emika Panda Robot With
Retrieval of Feasible Parameters Using Penalty-Based Optimization, IEEE RA-L 4(4), 2019. Base parameters are identified;
how they are shared out among the links is one feasible choice (the height of link 1's centre, on the vertical axis of
joint 1, means nothing).
"""
PANDA_ROTORS = (0.605721456, 0.605721456, 0.462474144, 0.462474144, 0.205544064, 0.205544064, 0.205544064)
"""Inertia of the rotors seen at the joints [kg m^2], as the maker gave them for the FR3, the Panda's successor (in the
documentation of Drake's Panda).
"""
PANDA_READY = (0.0, -0.25 * np.pi, 0.0, -0.75 * np.pi, 0.0, _RIGHT, 0.25 * np.pi)
"""Pose [rad] that its maker's examples start from."""


def panda() -> SerialModel:
    """Franka Emika Panda, seven joints, without hand; friction is left out, which no table of it gives as Coulomb's and
    viscous.
    """
    links, limits = np.array(PANDA_LINKS), np.array(PANDA_LIMITS).T
    count = len(links)
    return SerialModel(
        "panda",
        [f"panda_joint{i + 1}" for i in range(count)],
        [JointKind.REVOLUTE] * count,
        rotation=[turn((alpha, 0.0, 0.0)) for _, alpha, _ in PANDA_FRAMES],
        origin=[(a, -d * np.sin(alpha), d * np.cos(alpha)) for a, alpha, d in PANDA_FRAMES],
        axis=np.tile((0.0, 0.0, 1.0), (count, 1)),
        mass=links[:, 0],
        centre=links[:, 1:4],
        inertia=links[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 3, 3),
        lower=limits[0],
        upper=limits[1],
        effort=limits[2],
        speed=limits[3],
        viscous=np.zeros(count),
        coulomb=np.zeros(count),
        armature=PANDA_ROTORS,
        tip=(0.0, 0.0, PANDA_FLANGE),
    )


_ARMS: Mapping[str, Callable[[], SerialModel]] = {"panda": panda}


def published_arm(name: str) -> dict[str, float | list[float]]:
    """Start values of the FMU SerialArm for a published arm. Raises InputError for a name that is not known."""
    if name not in _ARMS:
        raise InputError(
            Problem("parameter set", f"of a SerialArm: {', '.join(_ARMS)}", repr(name), did_you_mean(name, _ARMS))
        )
    return arm_values(_ARMS[name]())
