"""The rigid body of each kind of device along a motion: its regression columns and, where there are, its equations.

`rigid_body` chooses by the class of the device; a new kind registers its rigid body here.
"""

from collections.abc import Callable
from functools import partial, singledispatch

import numpy as np
from attrs import frozen

from cosim.arm.base_parameters import base_columns, base_parameters, parameter_names
from cosim.arm.dynamics import regressor
from cosim.closure.model.motion import SmoothedMotion
from cosim.measured.columns import ColumnNames
from cosim.measured.device import AxisDevice, Device, PhantomDevice, RegressorDevice, RobotDevice
from cosim.measured.label import Label

Equations = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""q, dq, ddq (n, nj) -> columns (n, nj, p) of the rigid body."""


@frozen(eq=False)
class RigidBody:
    """Columns (n, nj, p) with the labels of their parameters, and `known` (n, nj), a torque that is taken as given.

    equations: the columns at other motions, with all parameters; None where they are only known along this one.
    declared: parameters that are trusted, in `known` already; None where they are fitted. recorded: number of leading
    columns that were recorded rather than formed.
    """

    labels: tuple[Label, ...]
    columns: np.ndarray
    known: np.ndarray
    equations: Equations | None = None
    declared: np.ndarray | None = None
    recorded: int = 0

    @property
    def trusted(self) -> bool:
        """Whether the rigid body's torque is given rather than fitted."""
        return self.declared is not None or bool(self.recorded == 0 and self.equations is None and self.known.any())

    def parameters(self, beta: np.ndarray) -> np.ndarray:
        """All parameters of the equations: the declared ones, or the leading ones of the coefficients beta (k,)."""
        return beta[: len(self.labels)] if self.declared is None else self.declared


@singledispatch
def rigid_body(device: Device, motion: SmoothedMotion, columns: ColumnNames) -> RigidBody:
    """The rigid body of a device along a motion; columns: names in the recording."""
    raise NotImplementedError(f"no rigid body of device {device.word!r}")


@rigid_body.register
def _(device: PhantomDevice, motion: SmoothedMotion, columns: ColumnNames) -> RigidBody:
    full = regressor(motion.q, motion.dq, motion.ddq)
    if not device.declared_pi:
        return RigidBody(tuple(Label("pi", k + 1) for k in range(8)), full, np.zeros_like(motion.q), regressor)
    pi = np.array(device.declared_pi)
    return RigidBody((), full[..., :0], full @ pi, regressor, pi)


@rigid_body.register
def _(device: AxisDevice, motion: SmoothedMotion, columns: ColumnNames) -> RigidBody:
    def equations(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        parts = (ddq, np.ones_like(q), *((np.sin(q), np.cos(q)) if device.pendulum else ()))
        return np.stack(parts, axis=2)

    names = ("inertia", "torque_offset", *(("gravity_sin", "gravity_cos") if device.pendulum else ()))
    full = equations(motion.q, motion.dq, motion.ddq)
    return RigidBody(tuple(map(Label, names)), full, np.zeros_like(motion.q), equations)


@rigid_body.register
def _(device: RegressorDevice, motion: SmoothedMotion, columns: ColumnNames) -> RigidBody:
    """Recorded columns, with the joint's own inertia where they lack it, as columns of links often lack the rotor."""
    n = len(motion.time)
    given = np.zeros((n, 0)) if motion.regressor is None else motion.regressor
    known = np.zeros((n, 1)) if motion.rigid is None else motion.rigid[:, None]
    labels, full = tuple(map(Label, columns.regressor)), given
    if _independent(motion.ddq, given):
        labels, full = (*labels, Label("inertia")), np.concatenate([given, motion.ddq], axis=1)
    return RigidBody(labels, full[:, None, :], known, recorded=given.shape[1])


@rigid_body.register
def _(device: RobotDevice, motion: SmoothedMotion, columns: ColumnNames) -> RigidBody:
    """Base parameters of all joints together, rotors among them."""
    base = base_parameters(device.arm)
    equations = partial(base_columns, device.arm, base)
    names = parameter_names(device.arm)
    labels = tuple(device.label(*names[k]) for k in base.kept)
    full = equations(motion.q, motion.dq, motion.ddq)
    return RigidBody(labels, full, np.zeros_like(motion.q), equations)


def _independent(column: np.ndarray, columns: np.ndarray) -> bool:
    """Whether less than 99 % of a column (n, 1) lies within the others."""
    if columns.shape[1] == 0:
        return True
    left = column - columns @ np.linalg.lstsq(columns, column, rcond=1e-8)[0]
    return float((left**2).sum()) > 0.01 * float((column**2).sum())
