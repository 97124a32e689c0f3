"""Equations of motion of the PHANToM, linear in the papers' eight parameters.

    M(q) ddq + C(q, dq) dq + N(q) + friction = tau + J^T f            (PHYSICS.md 1; Taati Eq. 2 with Eq. 4 put right)

`pi` (..., 8) = (d1 .. d6 [kg m^2], g7, g8 [N m]); `q`, `dq`, `ddq`, `tau` (..., 3); `f` (..., 3) [N] is the force of
the outside world on the tip, base frame. Leading axes broadcast. True for rigid links and for every pi, also for one
that no arm can have; `forward_dynamics` needs M to be regular.
"""

import numpy as np

from cosim.arm.kinematics import jacobian, matrix
from cosim.arm.parameters import ParameterSet

COULOMB_VELOCITY = 0.01
"""Regularisation [rad/s] of the sign of a velocity: the default of the FMU PhantomArm."""


def _columns(pi: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(np.moveaxis(np.asarray(pi), -1, 0))


def yaw_inertia(pi: np.ndarray, q: np.ndarray) -> np.ndarray:
    """M11 = p1 + p2 cos 2q2 + p3 cos 2q3 + p4 cos q2 sin q3 [kg m^2], (...)."""
    p1, p2, p3, p4, *_ = _columns(pi)
    q2, q3 = np.asarray(q)[..., 1], np.asarray(q)[..., 2]
    return p1 + p2 * np.cos(2 * q2) + p3 * np.cos(2 * q3) + p4 * np.cos(q2) * np.sin(q3)


def yaw_inertia_slopes(pi: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """D2 = dM11/dq2 and D3 = dM11/dq3 [kg m^2/rad], each (...)."""
    _, p2, p3, p4, *_ = _columns(pi)
    q2, q3 = np.asarray(q)[..., 1], np.asarray(q)[..., 2]
    slope2 = -2 * p2 * np.sin(2 * q2) - p4 * np.sin(q2) * np.sin(q3)
    slope3 = -2 * p3 * np.sin(2 * q3) + p4 * np.cos(q2) * np.cos(q3)
    return slope2, slope3


def mass_matrix(pi: np.ndarray, q: np.ndarray) -> np.ndarray:
    """M(q) (..., 3, 3) [kg m^2]: joint 1 apart, joints 2 and 3 coupled by M23 = -p4/2 sin(q2 - q3)."""
    _, _, _, p4, p5, p6, *_ = _columns(pi)
    q = np.asarray(q)
    m23 = -0.5 * p4 * np.sin(q[..., 1] - q[..., 2])
    return matrix([yaw_inertia(pi, q), 0.0, 0.0], [0.0, p5, m23], [0.0, m23, p6])


def coriolis_matrix(pi: np.ndarray, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """C(q, dq) (..., 3, 3) [kg m^2/s] from Christoffel symbols, so dM/dt = C + C^T; C32 has a minus (MISPRINTS.md)."""
    p4 = _columns(pi)[3]
    q = np.asarray(q)
    w1, w2, w3 = np.moveaxis(np.asarray(dq), -1, 0)
    slope2, slope3 = yaw_inertia_slopes(pi, q)
    k = 0.5 * p4 * np.cos(q[..., 1] - q[..., 2])
    return matrix(
        [0.5 * (slope2 * w2 + slope3 * w3), 0.5 * slope2 * w1, 0.5 * slope3 * w1],
        [-0.5 * slope2 * w1, 0.0, k * w3],
        [-0.5 * slope3 * w1, -k * w2, 0.0],
    )


def gravity_torque(pi: np.ndarray, q: np.ndarray) -> np.ndarray:
    """N(q) = (0, p7 cos q2, p8 sin q3) (..., 3) [N m], the torque that holds the arm against gravity."""
    *_, p7, p8 = _columns(pi)
    q = np.asarray(q)
    return matrix([0.0, p7 * np.cos(q[..., 1]), p8 * np.sin(q[..., 2])])[..., 0, :]


def direction(dq: np.ndarray, velocity: float = COULOMB_VELOCITY) -> np.ndarray:
    """Smooth sign of a velocity, dq / sqrt(dq^2 + v^2) (...); v = 0 gives sgn(dq) of Taati Eq. 6."""
    dq = np.asarray(dq)
    return np.sign(dq) if velocity == 0 else dq / np.sqrt(dq**2 + velocity**2)


def friction_torque(params: ParameterSet, dq: np.ndarray, velocity: float = COULOMB_VELOCITY) -> np.ndarray:
    """Viscous and Coulomb friction (..., 3) [N m], Taati Eq. 6, with a sign smoothed over `velocity` [rad/s]."""
    return params.viscous * np.asarray(dq) + params.coulomb * direction(dq, velocity)


def inverse_dynamics(pi: np.ndarray, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """M ddq + C dq + N (..., 3) [N m]: the torque of the frictionless arm in free motion."""
    acceleration = np.einsum("...ij,...j->...i", mass_matrix(pi, q), np.asarray(ddq))
    velocity = np.einsum("...ij,...j->...i", coriolis_matrix(pi, q, dq), np.asarray(dq))
    return acceleration + velocity + gravity_torque(pi, q)


def regressor(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Y (..., 3, 8) with Y pi = M ddq + C dq + N: Taati Eq. 4 with the sign of dq2^2 in row 3 put right
    (MISPRINTS.md).
    """
    q = np.asarray(q)
    (_, s2, s3), (_, c2, c3) = np.moveaxis(np.sin(q), -1, 0), np.moveaxis(np.cos(q), -1, 0)
    (w1, w2, w3), (a1, a2, a3) = np.moveaxis(np.asarray(dq), -1, 0), np.moveaxis(np.asarray(ddq), -1, 0)
    sin2, cos2, sin3, cos3 = np.sin(2 * q[..., 1]), np.cos(2 * q[..., 1]), np.sin(2 * q[..., 2]), np.cos(2 * q[..., 2])
    s23, c23 = np.sin(q[..., 1] - q[..., 2]), np.cos(q[..., 1] - q[..., 2])
    yaw4 = a1 * c2 * s3 - w1 * w2 * s2 * s3 + w1 * w3 * c2 * c3
    upper4 = -0.5 * a3 * s23 + 0.5 * w1**2 * s2 * s3 + 0.5 * w3**2 * c23
    fore4 = -0.5 * a2 * s23 - 0.5 * w1**2 * c2 * c3 - 0.5 * w2**2 * c23
    return matrix(
        [a1, a1 * cos2 - 2 * w1 * w2 * sin2, a1 * cos3 - 2 * w1 * w3 * sin3, yaw4, 0.0, 0.0, 0.0, 0.0],
        [0.0, w1**2 * sin2, 0.0, upper4, a2, 0.0, c2, 0.0],
        [0.0, 0.0, w1**2 * sin3, fore4, 0.0, a3, 0.0, s3],
    )


def friction_regressor(dq: np.ndarray, velocity: float = COULOMB_VELOCITY) -> np.ndarray:
    """Y_f (..., 3, 6), Taati Eq. 8: columns viscous 1..3, Coulomb 1..3; `velocity` = 0 is the paper's sgn."""
    dq = np.asarray(dq)
    viscous, coulomb = dq[..., :, None] * np.eye(3), direction(dq, velocity)[..., :, None] * np.eye(3)
    return np.concatenate([viscous, coulomb], axis=-1)


def full_regressor(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, velocity: float = COULOMB_VELOCITY) -> np.ndarray:
    """(Y, Y_f) (..., 3, 14), Taati Eq. 11: the parameters are then `ParameterSet.vector`."""
    return np.concatenate([regressor(q, dq, ddq), friction_regressor(dq, velocity)], axis=-1)


def kinetic_energy(pi: np.ndarray, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """T = dq^T M dq / 2 (...) [J]."""
    dq = np.asarray(dq)
    return 0.5 * np.einsum("...i,...ij,...j->...", dq, mass_matrix(pi, q), dq)


def potential_energy(pi: np.ndarray, q: np.ndarray) -> np.ndarray:
    """V = p7 sin q2 - p8 cos q3 (...) [J], with N = dV/dq."""
    *_, p7, p8 = _columns(pi)
    q = np.asarray(q)
    return p7 * np.sin(q[..., 1]) - p8 * np.cos(q[..., 2])


def total_energy(pi: np.ndarray, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """T + V (...) [J]."""
    return kinetic_energy(pi, q, dq) + potential_energy(pi, q)


def solve_mass(pi: np.ndarray, q: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """M^-1 torque (..., 3) [rad/s^2] by the block structure of M; infinite or NaN where M is singular."""
    *_, p5, p6, _, _ = _columns(pi)
    q, torque = np.asarray(q), np.asarray(torque)
    m23 = -0.5 * _columns(pi)[3] * np.sin(q[..., 1] - q[..., 2])
    determinant = p5 * p6 - m23**2
    t1, t2, t3 = np.moveaxis(torque, -1, 0)
    upper, fore = (p6 * t2 - m23 * t3) / determinant, (p5 * t3 - m23 * t2) / determinant
    return matrix([t1 / yaw_inertia(pi, q), upper, fore])[..., 0, :]


def forward_dynamics(
    params: ParameterSet,
    q: np.ndarray,
    dq: np.ndarray,
    tau: np.ndarray,
    f: np.ndarray,
    velocity: float = COULOMB_VELOCITY,
) -> np.ndarray:
    """ddq = M^-1 (tau + J^T f - C dq - N - friction) (..., 3) [rad/s^2].

    Meaningless where M is not positive definite, which identified parameter sets reach: ask `cosim.arm.workspace`
    first.
    """
    q, dq = np.asarray(q), np.asarray(dq)
    outside = np.einsum("...ji,...j->...i", jacobian(q), np.asarray(f))
    bias = np.einsum("...ij,...j->...i", coriolis_matrix(params.pi, q, dq), dq) + gravity_torque(params.pi, q)
    return solve_mass(params.pi, q, np.asarray(tau) + outside - bias - friction_torque(params, dq, velocity))


def tip_inertia(pi: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Inverse of the tip's mass matrix, J M^-1 J^T (..., 3, 3) [1/kg]."""
    jac = jacobian(q)
    return jac @ np.linalg.inv(mass_matrix(pi, q)) @ np.swapaxes(jac, -1, -2)


def tip_mass(pi: np.ndarray, q: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Mass felt when the tip is pushed along the unit vector `n` (..., 3): 1 / (n^T J M^-1 J^T n) (...) [kg]."""
    n = np.asarray(n, dtype=float)
    return 1 / np.einsum("...i,...ij,...j->...", n, tip_inertia(pi, q), n)


def heaviest_direction(pi: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest tip mass (...) [kg] over all directions and its unit vector (..., 3), base frame.

    Infinite at a singularity of J; not a maximum where M is not positive definite.
    """
    values, vectors = np.linalg.eigh(tip_inertia(pi, q))
    with np.errstate(divide="ignore"):
        return 1 / values[..., 0], vectors[..., :, 0]
