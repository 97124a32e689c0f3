"""Machines drawn at random: an axis, a PHANToM, serial chains of three and six joints, and how each is described."""

from dataclasses import dataclass

import numpy as np

from tests.support.laboratory_a.arms import G, ParallelArm, SerialChain, SingleAxisArm

SEGMENTS = (
    np.array([2.832787775, 1.1318928125, -0.3912006625, 0.91229875, 2.426395625, 0.931885625, -16.2980397, -73.7552097])
    * 1e-3
)


@dataclass(frozen=True)
class DrawnMachine:
    """description: axis, columns, rigid, phantom fit, phantom declared. f: range of the motion's frequency in Hz."""

    arm: object
    rotor: np.ndarray
    centre: np.ndarray
    reach: np.ndarray
    f: tuple[float, float]
    h: float
    description: str
    longest: float
    lever: float


def own_axis(rng, description, hangs, h=0.5e-3):
    link = np.exp(rng.uniform(np.log(0.01), np.log(2.0)))
    length = rng.uniform(0.15, 0.6)
    moment = link / (length * rng.uniform(0.8, 1.2))
    arm = SingleAxisArm(
        link, moment, length, (G, 0.0) if hangs else (0.0, 0.0), hangs, rng.uniform(-0.3, 0.3) if hangs else 0.0
    )
    rotor = np.array([link * rng.uniform(0.1, 0.8)])
    centre = np.array([rng.uniform(-0.4, 0.4) if hangs else rng.uniform(-1, 1)])
    reach = np.array([rng.uniform(0.4, 1.6)])
    return DrawnMachine(arm, rotor, centre, reach, (0.2, 1.2), h, description, 150.0 if h > 4e-4 else 25.0, length)


def phantom(rng, description, h=0.5e-3):
    p = SEGMENTS * rng.uniform(0.93, 1.07, 8)
    rotor = 0.15 * p[[0, 4, 5]]
    p[[0, 4, 5]] -= rotor
    arm = ParallelArm(p[:, None], np.array([0.0, 1.0, 0.0])[:, None])
    centre = np.array([rng.uniform(-0.2, 0.2), 0.4, 0.5])
    return DrawnMachine(
        arm, rotor, centre, np.array([0.6, 0.35, 0.4]), (0.4, 1.2), h, description, 60.0 if h > 4e-4 else 20.0, 0.2
    )


def turned(angle):
    """A rotation about x."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def chain(rng, n, description):
    """A vertical axis, a shoulder and an elbow that lie; where there are six, a wrist of three."""
    quarter = np.pi / 2
    turn = np.stack([turned(x) for x in (0, quarter, 0, quarter, -quarter, quarter)[:n]])
    lengths = rng.uniform([0.1, 0.02, 0.25, 0.05, 0.15, 0.05], [0.3, 0.1, 0.45, 0.15, 0.3, 0.1])[:n]
    along = np.eye(3)[[2, 0, 0, 0, 2, 1]][:n]
    offset = along * lengths[:, None]
    tip = np.array([0.3, 0.0, 0.0]) if n == 3 else np.array([0.0, 0.0, 0.12])
    masses = (np.array([6.0, 4.0, 2.5, 1.2, 0.8, 0.5])[:n] * rng.uniform(0.7, 1.3, n))[:, None]
    reach = np.vstack([offset[1:], tip])
    centres = reach * rng.uniform(0.3, 0.6, (n, 1)) + rng.normal(size=(n, 3)) * 0.015
    radii = 0.03 + 0.3 * np.linalg.norm(reach, axis=1)
    inertias = []
    for c, m, r in zip(centres, masses[:, 0], radii):
        bars = rng.uniform(0.3, 0.6, 3) * m * r**2
        inertias.append(np.diag(bars) + m * (c @ c * np.eye(3) - np.outer(c, c)))
    inertias = np.stack(inertias).transpose(1, 2, 0)[..., None]
    arm = SerialChain(
        turn, offset, masses, (centres * masses).T[..., None], inertias, tip, np.array([0, 0, -G])[:, None]
    )
    centre = np.array([0.0, -0.5, 0.9, 0.0, 0.6, 0.0])[:n] + rng.uniform(-0.2, 0.2, n)
    own = np.diag(arm.mass_and_bias(centre[:, None], np.zeros((n, 1)))[0][..., 0])
    rotor = np.maximum(own * rng.uniform(0.3, 0.8, n), 0.03)
    return DrawnMachine(arm, rotor, centre, rng.uniform(0.3, 0.7, n), (0.2, 0.6), 1e-3, description, 18.0, 0.4)
