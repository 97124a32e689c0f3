"""Regressor columns Y of tau = Y params, with both sides through the same low-pass filter.

    F{tau} = F{dP/dt} - F{R} + F{V'} + F{friction},   P = dT/d(dq), R = dT/dq

F{dP/dt} is the filter's own derivative of the momentum columns P (total derivatives, Taati Eqs. 13-14), so no
acceleration is formed. residual = measured - predicted.
"""

import numpy as np
from attrs import evolve, frozen

from cosim.arm import dynamics
from cosim.measured.device import G
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


@frozen
class Actuator:
    """How tau of an axis is given: its unit, the back-EMF [V s/rad] in it, whether it is a torque in N.m or N, and
    whether a servo's dead band is to be found.
    """

    unit: str = "N.m"
    back_emf: float = 0.0
    known: bool = True
    dead_band: bool = False


def axis(
    motion: FilteredMotion, low_pass: LowPass, gravity: bool, actuator: Actuator = Actuator(), velocity: float = 0.0
) -> RegressorColumns:
    """One joint: inertia ddq + viscous dq + coulomb sgn(dq) + offset (+ gravity_sin sin q + gravity_cos cos q).

    What was mounted is known torque, (m l^2 + I) ddq + m l g sin(q - angle), gravity where it belongs to the model. It
    is taken from a torque, and is a column `load` beside a current or a voltage, whose coefficient is the inverse of
    the torque constant. A back-EMF is taken from a voltage: U - ke dq. A servo's dead band d that is not known is a
    column: its output is e - d sgn(e) on the rows that are kept.
    """
    q, dq, step = motion.q, motion.dq, motion.step
    plain = [dq, dynamics.direction(dq, velocity), np.ones_like(dq)]
    plain += [np.sin(q), np.cos(q)] if gravity else []
    acceleration, speed, *rest = (low_pass.rate(dq, step), *(low_pass.low(column, step) for column in plain))
    columns = [acceleration, speed, *rest]
    names = ["inertia", "viscous", "coulomb", "offset", *(("gravity_sin", "gravity_cos") if gravity else ())]
    units = [_of_unit(unit, actuator.unit) for unit in ("s2", "s", "", "", "", "")[: len(names)]]
    tau = low_pass.low(motion.tau, step)
    if actuator.back_emf:
        tau = tau - actuator.back_emf * speed
    if motion.run.load is not None and actuator.known:
        tau = tau - _load(motion, low_pass, gravity)
    elif motion.run.load is not None:
        columns, names = [*columns, _load(motion, low_pass, gravity)], [*names, "load"]
        units.append(f"{actuator.unit}/(N.m)")
    if actuator.dead_band:
        assert motion.run.servo is not None, "the run of a servo says what its dead band takes"
        columns, names = [*columns, low_pass.low(motion.run.servo, step)], [*names, "dead_band"]
        units.append("rad")
    y = np.concatenate(columns, axis=1)[:, None, :]
    return RegressorColumns(y, tau, tuple(map(Label, names)), tuple(units))


def _load(motion: FilteredMotion, low_pass: LowPass, gravity: bool) -> np.ndarray:
    """Filtered torque (n, 1) of what was mounted; its inertia is constant within a run."""
    assert motion.run.load is not None, "the caller has seen that something is mounted"
    inertia, cosine, sine = (column[:, None] for column in motion.run.load.T)
    torque = low_pass.rate(inertia * motion.dq, motion.step)
    if gravity:
        torque = torque + low_pass.low(G * (cosine * np.sin(motion.q) - sine * np.cos(motion.q)), motion.step)
    return torque


SI_UNITS = {
    "N.m": {"s2": "kg.m2", "s": "N.m.s/rad", "": "N.m"},
    "N": {"s2": "kg", "s": "N.s/m", "": "N"},
}


def _of_unit(rate: str, unit: str) -> str:
    """Unit of a coefficient of q differentiated: `rate` is s2 for ddq, s for dq, empty for q itself."""
    if unit in SI_UNITS:
        return SI_UNITS[unit][rate]
    return f"{unit}.{rate}/rad" if rate else unit


def in_unit(columns: RegressorColumns, unit: str) -> RegressorColumns:
    """Columns of torques in N.m as those of torques in another unit: their parameters carry it."""
    rates = {text: rate for rate, text in SI_UNITS["N.m"].items()}
    return evolve(columns, units=tuple(_of_unit(rates[text], unit) for text in columns.units))


def given(
    motion: FilteredMotion, low_pass: LowPass, names: tuple[str, ...], velocity: float = 0.0, unit: str = "N.m"
) -> RegressorColumns:
    """Given inertial and gravity columns of one joint beside viscous, Coulomb friction and offset.

    A given rigid torque is one column `rigid` where there are no regressor columns, and left out where there are.
    """
    run, step, dq = motion.run, motion.step, motion.dq
    rigid = run.regressor
    if rigid is None:
        assert run.rigid is not None, "a description of the device names the regressor columns or a rigid torque"
        rigid, names = run.rigid[:, None], ("rigid",)
    y = np.concatenate([rigid, dq, dynamics.direction(dq, velocity), np.ones_like(dq)], axis=1)
    units = ("",) * len(names) + tuple(_of_unit(rate, unit) for rate in ("s", "", ""))
    return RegressorColumns(
        low_pass.low(y, step)[:, None, :],
        low_pass.low(motion.tau, step),
        tuple(map(Label, (*names, "viscous", "coulomb", "offset"))),
        units,
    )
