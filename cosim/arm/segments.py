"""The moving parts of the PHANToM and the linear map from their masses and inertias to the eight parameters.

Four bodies and the base (Sallam Fig. 3 and Table II, after Cavusoglu and Feygin's memo M01/15):

    BE   upper arm with its motor, turns with q2, its centre at l5 along the upper arm
    C    rod parallel to the upper arm, turns with q2, its centre at l1/2 along the upper arm and l3 along the forearm
    A    forearm, turns with q3, its centre at l1 along the upper arm and l2/2 along the forearm
    DF   drive link of the forearm with its motor, turns with q3, its centre at -l6 along the forearm
    G    what turns with q1 only

Body axes at q = 0: x the pitch axis, y up, z radial. I_a and I_c about the centres, I_be and I_df about the shoulder.
"""

import numpy as np
from attrs import field, frozen

from cosim.arm.kinematics import L1, L2

G = 9.81
"""Gravity [m/s^2]."""


@frozen
class Segment:
    """One rigid body: mass [kg] and moments of inertia [kg m^2] about its body axes."""

    mass: float
    xx: float
    yy: float
    zz: float


@frozen
class Segments:
    """The bodies of one arm with the lengths of PHYSICS.md 1 [m]; `base_yy` [kg m^2] turns with q1 only."""

    a: Segment = field(default=Segment(0.0202, 0.4864e-4, 0.001843e-4, 0.4864e-4))
    c: Segment = field(default=Segment(0.0249, 0.959e-4, 0.959e-4, 0.0051e-4))
    be: Segment = field(default=Segment(0.2359, 11.09e-4, 10.06e-4, 0.591e-4))
    df: Segment = field(default=Segment(0.1906, 7.11e-4, 0.629e-4, 6.246e-4))
    base_yy: float = 11.87e-4
    l3: float = 0.0325
    l5: float = -0.0368
    l6: float = 0.0527


PRINTED_BASE_YY = 0.629e-4
"""What Sallam Table II prints for I_base_yy: a copy of I_df_yy (MISPRINTS.md)."""


def segment_pi(segments: Segments = Segments(), gravity: float = G) -> np.ndarray:
    """pi (8,) of an arm made of `segments`: Taati Eq. 5 with its misprints put right (PHYSICS.md 1)."""
    a, c, be, df = segments.a, segments.c, segments.be, segments.df
    l3, l5, l6 = segments.l3, segments.l5, segments.l6
    yaw = a.yy + a.zz + 2 * segments.base_yy + be.yy + be.zz + c.yy + c.zz + df.yy + df.zz
    return np.array(
        [
            yaw / 2 + (4 * L1**2 * a.mass + L2**2 * a.mass + L1**2 * c.mass + 4 * l3**2 * c.mass) / 8,
            (be.yy - be.zz + c.yy - c.zz) / 2 + L1**2 * (4 * a.mass + c.mass) / 8,
            (a.yy - a.zz + df.yy - df.zz) / 2 - (L2**2 * a.mass + 4 * l3**2 * c.mass) / 8,
            L1 * (L2 * a.mass + l3 * c.mass),
            be.xx + c.xx + L1**2 * a.mass + L1**2 * c.mass / 4,
            a.xx + df.xx + L2**2 * a.mass / 4 + l3**2 * c.mass,
            gravity / 2 * (2 * L1 * a.mass + 2 * l5 * be.mass + L1 * c.mass),
            gravity / 2 * (L2 * a.mass + 2 * l3 * c.mass - 2 * l6 * df.mass),
        ]
    )


def point_mass_pi(mass: float, along_upper: float, along_fore: float, gravity: float = G) -> np.ndarray:
    """What a point mass [kg] adds to pi (8,) when it sits `along_upper` and `along_fore` [m] from the shoulder.

    Its radial distance is a cos q2 + b sin q3 and its height a sin q2 - b cos q3; its kinetic and potential energy
    expand to (a^2 + b^2)/2, a^2/2, -b^2/2, 2 a b, a^2, b^2 times the mass, and a, b times the weight. Taati Eqs.
    16-17 are the last two. `gravity` is negative for an arm that hangs upside down.
    """
    a, b = along_upper, along_fore
    inertial = np.array([(a**2 + b**2) / 2, a**2 / 2, -(b**2) / 2, 2 * a * b, a**2, b**2])
    return mass * np.concatenate([inertial, gravity * np.array([a, b])])
