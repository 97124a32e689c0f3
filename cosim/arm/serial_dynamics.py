"""Equations of motion of a serial arm in the base frame, by Jacobians.

    M(q) ddq + C(q, dq) dq + N(q) + friction = tau + J^T f,    M = sum_i Jv_i^T m_i Jv_i + Jw_i^T I_i Jw_i + armature

Each link's Newton and Euler equations are projected on the joints (Kane; Siciliano et al., Robotics, 2009, 7.1). The
FMU SerialArm finds the same numbers by recursion in the links' frames: neither is generated from the other.
`q`, `dq`, `ddq`, `tau` (..., n), `f` (..., 3) [N] on the tip, base frame; leading axes broadcast.
"""

import numpy as np
from attrs import frozen

from cosim.arm.serial import SerialModel
from cosim.arm.serial_kinematics import LinkFrames, apply, frames, in_base, point_jacobians, skew, tip_jacobian

COULOMB_VELOCITY = 0.01
"""Regularisation [rad/s] of the sign of a velocity: the default of the FMU SerialArm."""

LINK_PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Parameters of one link in the frame of its joint: mass, first moment, inertia about the frame's origin (pinocchio's
order).
"""


@frozen(eq=False)
class LinkMotion:
    """Turning and acceleration of the links, base frame (..., n, 3): w [rad/s], dw, and a [m/s^2] of the frames'
    origins less gravity.
    """

    w: np.ndarray
    dw: np.ndarray
    a: np.ndarray


def link_motion(model: SerialModel, at: LinkFrames, dq: np.ndarray, ddq: np.ndarray) -> LinkMotion:
    """From the base outwards: what turns adds its spin, what slides its speed and the Coriolis acceleration 2 w x axis
    dq.
    """
    shape = np.broadcast_shapes(at.origin.shape[:-2], dq.shape[:-1], ddq.shape[:-1])
    w, dw, before = np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros((*shape, 3))
    a = np.broadcast_to(-model.gravity, (*shape, 3))
    turns, accelerations, origins = [], [], []
    for i, slides in enumerate(model.sliding):
        axis, origin = at.axis[..., i, :], at.origin[..., i, :]
        speed, gain = axis * dq[..., i, None], axis * ddq[..., i, None]
        arm = origin - before
        a = a + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
        if slides:
            a = a + gain + 2 * np.cross(w, speed)
        else:
            dw = dw + gain + np.cross(w, speed)
            w = w + speed
        before = origin
        turns.append(w)
        accelerations.append(dw)
        origins.append(a)
    return LinkMotion(*(np.stack(rows, axis=-2) for rows in (turns, accelerations, origins)))


def mass_matrix(model: SerialModel, q: np.ndarray) -> np.ndarray:
    """M(q) (..., n, n) [kg m^2], rotors included."""
    at = frames(model, q)
    linear, angular = point_jacobians(model, at, in_base(at, model.centre))
    inertia = at.rotation @ model.inertia @ np.swapaxes(at.rotation, -1, -2)
    moving = np.einsum("...iak,i,...ial->...kl", linear, model.mass, linear)
    return moving + np.einsum("...iak,...iab,...ibl->...kl", angular, inertia, angular) + np.diag(model.armature)


def inverse_dynamics(model: SerialModel, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """M ddq + C dq + N (..., n) [N m]: the torque of the frictionless arm in free motion."""
    q, dq, ddq = (np.asarray(v, dtype=float) for v in (q, dq, ddq))
    at = frames(model, q)
    motion = link_motion(model, at, dq, ddq)
    centres = in_base(at, model.centre)
    arms = centres - at.origin
    inertia = at.rotation @ model.inertia @ np.swapaxes(at.rotation, -1, -2)
    a = motion.a + np.cross(motion.dw, arms) + np.cross(motion.w, np.cross(motion.w, arms))
    force = model.mass[:, None] * a
    couple = apply(inertia, motion.dw) + np.cross(motion.w, apply(inertia, motion.w))
    linear, angular = point_jacobians(model, at, centres)
    torque = np.einsum("...iak,...ia->...k", linear, force) + np.einsum("...iak,...ia->...k", angular, couple)
    return torque + model.armature * ddq


def bias_torque(model: SerialModel, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """C dq + N (..., n) [N m]."""
    return inverse_dynamics(model, q, dq, np.zeros_like(np.asarray(dq, dtype=float)))


def gravity_torque(model: SerialModel, q: np.ndarray) -> np.ndarray:
    """N(q) (..., n) [N m], the torque that holds the arm against gravity."""
    return bias_torque(model, q, np.zeros_like(np.asarray(q, dtype=float)))


def link_parameters(model: SerialModel) -> np.ndarray:
    """params (10 n,): LINK_PARAMETERS of link 1, then of link 2, ..."""
    rows = []
    for mass, centre, inertia in zip(model.mass, model.centre, model.inertia, strict=True):
        about = inertia + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        xx, xy, yy, xz, yz, zz = about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
        rows.append([mass, *(mass * centre), xx, xy, yy, xz, yz, zz])
    return np.concatenate(rows)


def regressor(model: SerialModel, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Y (..., n, 10 n) with Y params = M ddq + C dq + N, rotors left out; params as in `link_parameters`.

    A link's force is m a + ([dw] + [w][w]) h and its couple about the frame's origin h x a + I dw + w x I w, in its
    frame.
    """
    q, dq, ddq = (np.asarray(v, dtype=float) for v in (q, dq, ddq))
    at = frames(model, q)
    motion = link_motion(model, at, dq, ddq)
    back = np.swapaxes(at.rotation, -1, -2)
    w, dw, a = (apply(back, v) for v in (motion.w, motion.dw, motion.a))
    turning = skew(w)
    wrench = np.zeros((*a.shape[:-1], 6, 10))  # of each link by its own parameters: force, then couple
    wrench[..., :3, 0], wrench[..., :3, 1:4] = a, skew(dw) + turning @ turning
    wrench[..., 3:, 1:4], wrench[..., 3:, 4:] = -skew(a), _spread(dw) + turning @ _spread(w)
    moving = np.concatenate([back @ part for part in point_jacobians(model, at, at.origin)], axis=-2)
    columns = np.swapaxes(moving, -1, -2) @ wrench  # (..., link, joint, 10)
    return np.swapaxes(columns, -3, -2).reshape(*columns.shape[:-3], model.count, 10 * model.count)


def _spread(w: np.ndarray) -> np.ndarray:
    """L(w) (..., 3, 6) with L(w) (Ixx, Ixy, Iyy, Ixz, Iyz, Izz) = I w."""
    x, y, z = np.moveaxis(w, -1, 0)
    o = np.zeros_like(x)
    rows = [[x, y, o, z, o, o], [o, x, y, o, z, o], [o, o, o, x, y, z]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def friction_torque(model: SerialModel, dq: np.ndarray, velocity: float = COULOMB_VELOCITY) -> np.ndarray:
    """Viscous and Coulomb friction (..., n) [N m], the sign smoothed over `velocity` [rad/s]."""
    dq = np.asarray(dq, dtype=float)
    return model.viscous * dq + model.coulomb * dq / np.sqrt(dq**2 + velocity**2)


def forward_dynamics(
    model: SerialModel, q: np.ndarray, dq: np.ndarray, tau: np.ndarray, f: np.ndarray | None = None
) -> np.ndarray:
    """ddq = M^-1 (tau + J^T f - C dq - N - friction) (..., n) [rad/s^2]; f: none by default."""
    torque = np.asarray(tau, dtype=float) - bias_torque(model, q, dq) - friction_torque(model, dq)
    if f is not None:
        torque = torque + np.einsum("...ai,...a->...i", tip_jacobian(model, q), np.asarray(f, dtype=float))
    return np.linalg.solve(mass_matrix(model, q), torque[..., None])[..., 0]


def kinetic_energy(model: SerialModel, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """dq^T M dq / 2 (...) [J]."""
    dq = np.asarray(dq, dtype=float)
    return 0.5 * np.einsum("...k,...kl,...l->...", dq, mass_matrix(model, q), dq)


def potential_energy(model: SerialModel, q: np.ndarray) -> np.ndarray:
    """-sum m_i g . c_i (...) [J], with N its gradient."""
    return -np.einsum("i,...ia,a->...", model.mass, in_base(frames(model, q), model.centre), model.gravity)


def total_energy(model: SerialModel, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """Kinetic and potential energy (...) [J]."""
    return kinetic_energy(model, q, dq) + potential_energy(model, q)
