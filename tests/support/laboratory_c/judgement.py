"""What the student's best complete model leaves, and what of it something adds.

`shows` = RMS that it adds to what a fit of rigid body, dry and viscous friction leaves of exact signals, over the RMS
that this fit leaves of the logged signals of the same experiment without it (the noise floor); all below one cutoff,
rows about standstill left out.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter1d
from scipy.signal import butter, sosfiltfilt

from tests.support.laboratory_c.arrays import Array, Mask
from tests.support.laboratory_c.setup import ExperimentPlan


@dataclass(frozen=True)
class Signals:
    """Rows of one run at the logger's rate: (rows, n) each; `t` (rows,) [s]."""

    t: Array
    q: Array
    v: Array
    a: Array
    torque: Array


@dataclass(frozen=True)
class FitTable:
    """Rows of joints beneath each other: `fixed` (rows, p) beside `torque` (rows,), weighted; `joint` names each."""

    fixed: Array
    torque: Array
    joint: Array

    def residual(self, more: Array | None = None) -> Array:
        """What least squares leave, with further columns (rows, m)."""
        columns = self.fixed if more is None else np.column_stack([self.fixed, more])
        scale = np.sqrt(np.mean(columns**2, axis=0))
        used = columns[:, scale > 0] / scale[scale > 0]
        found = np.linalg.lstsq(used, self.torque, rcond=1e-10)[0]
        return np.asarray(self.torque - used @ found, dtype=np.float64)

    def coefficients(self) -> Array:
        """In the units of the weighted torque: weights act on columns and torque alike."""
        return np.asarray(np.linalg.lstsq(self.fixed, self.torque, rcond=1e-10)[0], dtype=np.float64)


def cutoff(experiment: ExperimentPlan) -> float:
    """The student's low pass [Hz]."""
    return min(0.2 * experiment.rate, 25.0)


def low_pass(experiment: ExperimentPlan, x: Array, corner: float | None = None) -> Array:
    """Butterworth of second order, both ways."""
    corner = corner or cutoff(experiment)
    return np.asarray(sosfiltfilt(butter(2, corner / (experiment.rate / 2), output="sos"), x, axis=0))


def joint_columns(experiment: ExperimentPlan, j: int, s: Signals) -> Array:
    """Rigid columns of joint j as they are offered to a fit: base columns, or none beside a told torque."""
    machine = experiment.body.machine
    if experiment.told == "rigid":
        return np.zeros((len(s.t), 0))
    columns = machine.columns(j, s.q, s.v, s.a)
    if experiment.body.word == "inverted pendulum":
        q = s.q[:, 0]
        return np.column_stack([s.a[:, 0], np.sin(q), np.cos(q), np.ones(len(q))])
    return columns


def told_torque(experiment: ExperimentPlan, j: int, s: Signals) -> Array:
    """The rigid torque that is given away; zero where columns are fitted."""
    if experiment.told != "rigid":
        return np.zeros(len(s.t))
    machine = experiment.body.machine
    return machine.columns(j, s.q, s.v, s.a) @ machine.parameters(j)


def table(experiment: ExperimentPlan, runs: list[Signals], weights: Array | None = None) -> FitTable:
    """Rows of all runs, low-passed, those about standstill left out."""
    blocks = [_run_table(experiment, s, slowest(experiment, runs)) for s in runs]
    fixed, torque, joint = (np.concatenate([b[k] for b in blocks]) for k in range(3))
    if weights is not None:
        w = weights[joint.astype(int)]
        fixed, torque = fixed * w[:, None], torque * w
    return FitTable(fixed, torque, joint)


def slowest(experiment: ExperimentPlan, runs: list[Signals]) -> Array:
    """(n,): below this speed a row stands still."""
    speeds = np.concatenate([s.v for s in runs])
    return 0.03 * np.sqrt(np.mean(speeds**2, axis=0))


def stride(experiment: ExperimentPlan) -> int:
    """Rows of the logger for one of the thinned table."""
    return max(1, int(experiment.rate / (5 * cutoff(experiment))))


def kept(experiment: ExperimentPlan, s: Signals, j: int, slow: Array) -> Mask:
    """Which rows of joint j move one way, half a period of the cutoff before and after too."""
    v = s.v[:, j]
    reach = 2 * int(0.5 * experiment.rate / cutoff(experiment)) + 1
    moving = (np.abs(v) > slow[j]) & (v * np.append(v[1:], v[-1]) > 0)
    moving = minimum_filter1d(moving.astype(float), reach) > 0
    edge = int(experiment.rate / cutoff(experiment))
    moving[:edge] = moving[len(moving) - edge :] = False
    return moving


def rows(experiment: ExperimentPlan, s: Signals, j: int) -> tuple[Array, Array]:
    """Columns of joint j with viscous and dry friction, (rows, p), and the torque that is told beside them."""
    columns = spread(experiment, j, joint_columns(experiment, j, s))
    many = s.q.shape[1] if experiment.told == "robot" else 1
    friction = np.zeros((len(s.t), 2 * many))
    at = 2 * j if many > 1 else 0
    friction[:, at], friction[:, at + 1] = s.v[:, j], np.sign(s.v[:, j])
    return np.column_stack([columns, friction]), told_torque(experiment, j, s)


def _run_table(experiment: ExperimentPlan, s: Signals, slow: Array) -> tuple[Array, Array, Array]:
    joints = range(s.q.shape[1]) if experiment.told == "robot" else [experiment.joint]
    every = stride(experiment)
    fixed, torques, names = [], [], []
    for j in joints:
        columns, given = rows(experiment, s, j)
        both = low_pass(experiment, np.column_stack([columns, s.torque[:, j] - given]))
        both = both[kept(experiment, s, j, slow)][::every]
        fixed.append(both[:, :-1])
        torques.append(both[:, -1])
        names.append(np.full(len(both), j))
    return np.concatenate(fixed), np.concatenate(torques), np.concatenate(names)


def spread(experiment: ExperimentPlan, j: int, columns: Array) -> Array:
    """A robot's joints share their links' parameters and have a rotor each: room for every joint's rotor."""
    if experiment.told != "robot":
        return columns
    n = len(experiment.body.rooms)
    rotors = np.zeros((len(columns), n - 1))
    if j:
        rotors[:, j - 1], columns = columns[:, 0], columns[:, 1:]
    return np.column_stack([rotors, columns])


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def left(experiment: ExperimentPlan, runs: list[Signals], weights: Array | None = None) -> Array:
    """(n,): RMS that the fit leaves of every joint (NaN where a joint is not described), in its torque's unit."""
    told = table(experiment, runs, weights)
    residual = told.residual()
    n = len(experiment.body.rooms)
    found = np.full(n, np.nan)
    for j in range(n):
        if np.any(told.joint == j):
            found[j] = rms(residual[told.joint == j]) / (1.0 if weights is None else weights[j])
    return found
