"""One axis of two arms as a sampled loop, written from its masses and gains alone."""

import numpy as np
from attrs import frozen

from cosim.analysis.sampled_loop import SampledLoop
from cosim.errors import InputError, Problem


@frozen
class TipSide:
    """One side of one axis: mass [kg] at the tip, gains of its controller and of what it touches.

    f = stiffness (x_other(t - d) - x) - damping dx - ground_stiffness x - ground_damping dx; the last two stand for a
    hand on this side, or for a wall as long as the tip stays in contact. N/m and N s/m.
    """

    mass: float
    stiffness: float
    damping: float
    ground_stiffness: float = 0.0
    ground_damping: float = 0.0

    def __attrs_post_init__(self) -> None:
        values = (self.mass, self.stiffness, self.damping, self.ground_stiffness, self.ground_damping)
        if not (all(np.isfinite(values)) and self.mass > 0.0):
            raise InputError(Problem("side of an axis", "finite numbers and a mass > 0 kg", f"mass {self.mass} kg"))


def axis_loop(local: TipSide, remote: TipSide, step: float) -> SampledLoop:
    """One axis of both arms, forces computed at each communication point and held over the step [s].

    Channel 0 carries the local tip to the remote side, channel 1 the remote tip to the local side. With m v' = f held:
    x+ = x + H v + H^2/(2 m) f and v+ = v + H/m f, exactly. A free pair is written in the distance of its tips and both
    velocities (a common displacement changes nothing); a pair on a hand or a wall in both positions and velocities.
    """
    sides = (local, remote)
    force = np.zeros((2, 4))  # rows: local, remote; columns: x_l, x_r, v_l, v_r
    for k, side in enumerate(sides):
        force[k, k] = -side.stiffness - side.ground_stiffness
        force[k, 1 - k] = side.stiffness
        force[k, 2 + k] = -side.damping - side.ground_damping
    drive = np.array([[0.0, local.stiffness], [remote.stiffness, 0.0]])
    return _held(force, drive, np.array([side.mass for side in sides]), step)


def difference_loop(side: TipSide, step: float) -> SampledLoop:
    """The distance e of the tips of two equal sides with the same delay both ways: one channel.

    m e'' = -K e(t - d) - (K + K_ground) e - (B + B_ground) e'. The sum of the tips is a loop of its own.
    """
    force = np.array([[-2.0 * side.stiffness - side.ground_stiffness, -side.damping - side.ground_damping]])
    return _held(force, np.array([[-side.stiffness]]), np.array([side.mass]), step)


def _held(force: np.ndarray, drive: np.ndarray, mass: np.ndarray, step: float) -> SampledLoop:
    """Masses under f = force (x, v) + drive w held over a step; a displacement that no force sees is left out."""
    p = len(mass)
    kick = np.vstack([np.diag(step**2 / (2.0 * mass)), np.diag(step / mass)])
    free = np.block([[np.eye(p), step * np.eye(p)], [np.zeros((p, p)), np.eye(p)]])
    transition, push = free + kick @ force, kick @ drive
    moved = np.hstack([np.zeros((p, p)), step * np.eye(p)]) + kick[:p] @ force
    if p == 2 and not np.any(force[:, :p].sum(axis=1)):
        shorten = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
        lengthen = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        transition, push, moved = shorten @ transition @ lengthen, shorten @ push, moved @ lengthen
    return SampledLoop(transition, push, moved, kick[:p] @ drive, step)
