"""The ordinary model that every student fits first: rigid body, one level of dry friction, one viscous coefficient."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr
from scipy.signal import butter, sosfiltfilt

from tests.support.laboratory_b.plant import ExactTrace, LabExperiment, Pendulum

Array = np.ndarray


@dataclass(frozen=True)
class NominalModel:
    """What the description of a recording offers for the rigid part of the described joint.

    `kept` are base columns of the inertial parameters (arms); `given` is the factor of a rigid torque that is
    told (0: none), and `beside` says whether a column of that torque is fitted beside it.
    """

    experiment: LabExperiment
    kept: tuple[int, ...] = ()
    given: float = 0.0
    beside: bool = False

    def rigid(self, q: Array, dq: Array, ddq: Array) -> Array:
        """True rigid torque with the rotor [N m] (arms)."""
        arm, j = self.experiment.body, self.experiment.joint
        return arm.columns(j, q, dq, ddq) @ arm.parameters() + arm.links[j].rotor * ddq[:, j]

    def parts(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
        """The told torque (rows,) and the columns of the rigid part (rows, n)."""
        body, j = self.experiment.body, self.experiment.joint
        told = np.zeros(len(q))
        if isinstance(body, Pendulum):
            columns = [ddq[:, 0], np.ones(len(q))] + ([np.sin(q[:, 0]), np.cos(q[:, 0])] if body.weight else [])
            return told, np.column_stack(columns)
        if self.kept:
            return told, with_rotor(body.columns(j, q, dq, ddq), ddq[:, j])[:, list(self.kept)]
        rigid = self.rigid(q, dq, ddq)
        return self.given * rigid, rigid[:, None] if self.beside else np.zeros((len(q), 0))

    def moving(self, dq: Array) -> Array:
        """Rows above half a percent of the top speed; below it dry friction may be anything up to its level."""
        speed = np.abs(dq[:, self.experiment.joint])
        return speed > 0.005 * speed.max()

    def table(self, q: Array, dq: Array, ddq: Array, tau: Array) -> Array:
        """Columns of the fit (rigid, viscous, dry) and, last, the torque without what is told."""
        told, columns = self.parts(q, dq, ddq)
        v = dq[:, self.experiment.joint]
        return np.column_stack([columns, v, np.sign(v), tau - told])


def least_squares(table: Array) -> tuple[Array, Array]:
    """Residual and parameters of the last column by the others."""
    a, y = table[:, :-1], table[:, -1]
    scale = np.linalg.norm(a, axis=0) + 1e-300
    parameters = np.linalg.lstsq(a / scale, y, rcond=None)[0] / scale
    return y - a @ parameters, parameters


def with_rotor(columns: Array, ddq: Array) -> Array:
    return np.column_stack([columns, ddq])


def base_columns(experiment: LabExperiment, trace: ExactTrace) -> tuple[int, ...]:
    """Columns that this motion tells apart and that leave less than a thousandth of the rigid torque."""
    arm, j = experiment.body, experiment.joint
    thin = trace.thinned(max(1, len(trace.t) // 1500))
    y = with_rotor(arm.columns(j, thin.q, thin.dq, thin.ddq), thin.ddq[:, j])
    rigid = y @ np.append(arm.parameters(), arm.links[j].rotor)
    size = np.linalg.norm(y, axis=0)
    alive = np.flatnonzero(size > 1e-9 * size.max())
    _, r, order = qr(y[:, alive] / size[alive], mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(r))
    for least in 10.0 ** -np.arange(1.0, 9.0, 0.5):
        kept = alive[order[: max(1, int(np.sum(diagonal > least * diagonal[0])))]]
        left = rigid - y[:, kept] @ np.linalg.lstsq(y[:, kept], rigid, rcond=None)[0]
        if rms(left) < 1e-3 * rms(rigid):
            break
    return tuple(int(k) for k in np.sort(kept))


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def settled(run: Array, step: float) -> Array:
    """Rows at least a quarter of a second from the ends of their run, where a low pass both ways has settled."""
    margin = max(3, int(0.25 / step))
    edges = np.flatnonzero(np.diff(run)) + 1
    rows = np.ones(run.size, bool)
    for edge in (0, *edges.tolist(), run.size):
        rows[max(edge - margin, 0) : edge + margin] = False
    return rows


def exact_rms(model: NominalModel, trace: ExactTrace, cutoff: float) -> float:
    """What the ordinary model leaves of the noiseless signals below the student's cutoff [Hz]; [N m].

    Columns and torque pass the same low pass, so a gear that rattles far above it does not bias the fit.
    """
    step = model.experiment.step
    table = model.table(trace.q, trace.dq, trace.ddq, trace.command[:, model.experiment.joint])
    sos = butter(2, cutoff, fs=1 / step, output="sos")
    for run in np.unique(trace.run):
        rows = trace.run == run
        table[rows] = sosfiltfilt(sos, table[rows], axis=0, padlen=min(int(0.2 / step), rows.sum() - 1))
    every = max(1, int(0.004 / step))
    use = model.moving(trace.dq) & settled(trace.run, step)
    residual, _ = least_squares(table[use][::every])
    return rms(residual)
