"""Conditions on gains and delays for P-like teleoperation, each with what it assumes and what it guarantees.

Control law: f_l = K_l (x_r(t - T_rl) - x_l) - B_l dx_l and mirrored; T_lr, T_rl are the delays local to remote and
back [s]. `damping` below always means the effective one: the controller's B plus the least viscosity of the plant
(see `damping.py`).
"""

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike


def _array(values: ArrayLike) -> np.ndarray:
    return np.atleast_1d(np.asarray(values, float))


@frozen
class Coupling:
    """Gains of both sides, one entry an axis: stiffness [N/m] and effective damping [N s/m] (or N m/rad, N m s/rad)."""

    stiffness_l: np.ndarray = field(converter=_array)
    stiffness_r: np.ndarray = field(converter=_array)
    damping_l: np.ndarray = field(converter=_array)
    damping_r: np.ndarray = field(converter=_array)


@frozen
class Criterion:
    """What a condition says: whether it holds at the given delays, and the largest equal delay each way [s] that it
    allows.
    """

    holds: bool
    max_delay: float
    sufficient: bool
    guarantees: str


def delay_sum(coupling: Coupling, delay_lr: float, delay_rl: float) -> Criterion:
    """4 B_l B_r > (T_l + T_r)^2 K_l K_r on every axis: sufficient for every mass and every delay law below the bounds.

    Lyapunov-Krasovskii (Nuno et al. 2009 with both integral terms bounded by Young's inequality; PHYSICS.md 3).
    Assumes: T_lr, T_rl upper bounds of delays that may vary in any way; diagonal gains; gravity compensated; operator
    and environment passive; velocities damped by at least B everywhere in the workspace. Tight over masses: for m ->
    infinity the constant-delay boundary falls to it. Negative damping on either side: no guarantee, max_delay 0.
    """
    allowed = _largest_sum(coupling)
    return Criterion(
        bool(delay_lr + delay_rl < allowed), allowed / 2.0, True, "every mass, every delay law below the bounds"
    )


def sallam_eq10(coupling: Coupling, delay_lr: float, delay_rl: float) -> Criterion:
    """4 B_m B_s > (T_m^2 + T_s^2) K_m K_s, Sallam Eq. 10 as printed: NOT sufficient.

    T_m^2 + T_s^2 stands where the proof gives (T_m + T_s)^2, weaker by sqrt 2 for equal delays. Counterexample: m = 1
    kg, K = 0.25 N/m, B = 0.09 N s/m, T = 0.45 s satisfies it and grows at +0.0101 1/s. Kept to compare with the
    paper.
    """
    allowed = _largest_sum(coupling)
    holds = np.hypot(delay_lr, delay_rl) < allowed
    return Criterion(
        bool(holds), float(allowed / np.sqrt(2.0)), False, "nothing: the printed condition is not sufficient"
    )


def _largest_sum(coupling: Coupling) -> float:
    """min over axes of 2 sqrt(B_l B_r / (K_l K_r)) [s]; 0 where an effective damping is not positive."""
    if min(coupling.damping_l.min(), coupling.damping_r.min()) <= 0.0:
        return 0.0
    stiffness = coupling.stiffness_l * coupling.stiffness_r
    with np.errstate(divide="ignore"):
        return float(np.min(2.0 * np.sqrt(coupling.damping_l * coupling.damping_r / stiffness)))


def closed_form(mass: float, stiffness: float, damping: float) -> float:
    """Largest constant delay each way [s] of the symmetric one-axis loop: necessary and sufficient.

    (m s^2 + B s + K)^2 = K^2 exp(-s (T_l + T_r)). With mu = m K / B^2: stable for every delay if mu <= 1/2, else up
    to T* = (B/K) mu arccos(1 - 1/mu) / sqrt(2 mu - 1) (PHYSICS.md 3). Assumes equal sides, constant delay, one axis,
    no sampling, free motion; `mass` [kg] at the tip. A damping <= 0 gives 0.
    """
    if damping <= 0.0:
        return 0.0
    mu = mass * stiffness / damping**2
    if mu <= 0.5:
        return np.inf
    angle = 2.0 * np.arcsin(np.sqrt(0.5 / mu))  # = arccos(1 - 1/mu) without its cancellation at large mu
    return float(damping / stiffness * mu * angle / np.sqrt(2.0 * mu - 1.0))
