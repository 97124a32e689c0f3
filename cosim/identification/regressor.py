"""Regressor columns Y of tau = Y params, with both sides through the same low-pass filter.

    F{tau} = F{dP/dt} - F{R} + F{V'} + F{friction},   P = dT/d(dq), R = dT/dq

F{dP/dt} is the filter's own derivative of the momentum columns P (total derivatives, Taati Eqs. 13-14), so no
acceleration is formed. residual = measured - predicted.
"""

import numpy as np
from attrs import frozen

from cosim.arm import dynamics
from cosim.measured.filtering import FilteredMotion, LowPass
from cosim.measured.label import Label

PHANTOM_LABELS = tuple(map(Label, ("d1", "d2", "d3", "d4", "d5", "d6", "g7", "g8")))
PHANTOM_UNITS = ("kg.m2",) * 6 + ("N.m",) * 2


@frozen(eq=False)
class RegressorColumns:
    """Filtered linear model of one run: y (n, nj, p), tau (n, nj), with labels and units of the p parameters."""

    y: np.ndarray
    tau: np.ndarray
    labels: tuple[Label, ...]
    units: tuple[str, ...]


def momentum(q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """Columns of P = M(q) dq, (n, 3, 8): the part of Y that is linear in ddq, at ddq = dq."""
    still = np.zeros_like(dq)
    return dynamics.regressor(q, still, dq) - dynamics.regressor(q, still, still)


def kinetic_slope(q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """Columns of R = dT/dq, (n, 3, 8), T = (M11 dq1^2 + p5 dq2^2 + p6 dq3^2 - p4 sin(q2 - q3) dq2 dq3) / 2."""
    (_, s2, s3), (_, c2, c3) = np.sin(q).T, np.cos(q).T
    dq1, dq2, dq3 = dq.T
    cross = 0.5 * np.cos(q[:, 1] - q[:, 2]) * dq2 * dq3
    slope = np.zeros((len(q), 3, 8))
    slope[:, 1, 1] = -np.sin(2 * q[:, 1]) * dq1**2
    slope[:, 1, 3] = -0.5 * s2 * s3 * dq1**2 - cross
    slope[:, 2, 2] = -np.sin(2 * q[:, 2]) * dq1**2
    slope[:, 2, 3] = 0.5 * c2 * c3 * dq1**2 + cross
    return slope


def gravity_columns(q: np.ndarray) -> np.ndarray:
    """Columns of N(q), (n, 3, 8)."""
    still = np.zeros_like(q)
    return dynamics.regressor(q, still, still)


def friction_columns(dq: np.ndarray, velocity: float) -> np.ndarray:
    """Viscous and Coulomb columns (n, nj, 2 nj), Taati Eq. 8; the sign is smoothed over `velocity`, 0 is sgn(dq)."""
    joints = np.eye(dq.shape[1])
    return np.concatenate([dq[:, :, None] * joints, dynamics.direction(dq, velocity)[:, :, None] * joints], axis=2)


def slow_columns(dq: np.ndarray, slowest: np.ndarray) -> np.ndarray:
    """Columns sgn(dq) (slowest / dq)^2 (n, nj, nj), 1 at the slowest row in use.

    Friction whose sign is smoothed over v, dq / sqrt(dq^2 + v^2) = sgn(dq) (1 - v^2 / (2 dq^2) + ...), shows this term
    also on the rows that are kept. Its coefficient is -coulomb v^2 / (2 slowest^2).
    """
    tail = np.sign(dq) * slowest**2 / np.maximum(dq**2, slowest**2)
    return tail[:, :, None] * np.eye(dq.shape[1])


def phantom(motion: FilteredMotion, low_pass: LowPass, velocity: float = 0.0) -> RegressorColumns:
    """The 14 parameters of the arm, Taati Eq. 13, with the sign of Eq. 4 put right (PHYSICS.md 2)."""
    q, dq, step = motion.q, motion.dq, motion.step
    inertial = low_pass.rate(momentum(q, dq), step) - low_pass.low(kinetic_slope(q, dq), step)
    rest = low_pass.low(np.concatenate([gravity_columns(q), friction_columns(dq, velocity)], axis=2), step)
    y = np.concatenate([inertial + rest[:, :, :8], rest[:, :, 8:]], axis=2)
    labels = (*PHANTOM_LABELS, *(Label("viscous", j) for j in (1, 2, 3)), *(Label("coulomb", j) for j in (1, 2, 3)))
    return RegressorColumns(
        y, low_pass.low(motion.tau, step), labels, (*PHANTOM_UNITS, *("N.m.s/rad",) * 3, *("N.m",) * 3)
    )


def axis(
    motion: FilteredMotion, low_pass: LowPass, gravity: bool, prismatic: bool, velocity: float = 0.0
) -> RegressorColumns:
    """One joint: inertia ddq + viscous dq + coulomb sgn(dq) + offset (+ gravity_sin sin q + gravity_cos cos q)."""
    q, dq, step = motion.q, motion.dq, motion.step
    plain = [dq, dynamics.direction(dq, velocity), np.ones_like(dq)]
    plain += [np.sin(q), np.cos(q)] if gravity else []
    y = np.concatenate([low_pass.rate(dq, step), *(low_pass.low(column, step) for column in plain)], axis=1)[:, None, :]
    names = ("inertia", "viscous", "coulomb", "offset", *(("gravity_sin", "gravity_cos") if gravity else ()))
    labels = tuple(map(Label, names))
    turning = ("kg.m2", "N.m.s/rad", "N.m", "N.m", "N.m", "N.m")
    units = ("kg", "N.s/m", "N", "N") if prismatic else turning[: len(labels)]
    return RegressorColumns(y, low_pass.low(motion.tau, step), labels, units[: len(labels)])


def given(motion: FilteredMotion, low_pass: LowPass, names: tuple[str, ...], velocity: float = 0.0) -> RegressorColumns:
    """Given inertial and gravity columns of one joint beside viscous, Coulomb friction and offset.

    A given rigid torque is one column `rigid` where there are no regressor columns, and left out where there are.
    """
    run, step, dq = motion.run, motion.step, motion.dq
    rigid = run.regressor
    if rigid is None:
        assert run.rigid is not None, "a description of the device names the regressor columns or a rigid torque"
        rigid, names = run.rigid[:, None], ("rigid",)
    y = np.concatenate([rigid, dq, dynamics.direction(dq, velocity), np.ones_like(dq)], axis=1)
    units = ("",) * len(names) + ("N.m.s/rad", "N.m", "N.m")
    return RegressorColumns(
        low_pass.low(y, step)[:, None, :],
        low_pass.low(motion.tau, step),
        tuple(map(Label, (*names, "viscous", "coulomb", "offset"))),
        units,
    )
