"""The regression problem of a recording: what is predicted, the columns of the complete model, the rows that count."""

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from attrs import field, frozen

from cosim.closure.model.motion import FitRows, SmoothedMotion
from cosim.closure.model.rigid_body import RigidBody, rigid_body
from cosim.effects.moving_arm import MovingArm, moving_arm
from cosim.measured import Device, Label, Recording

STEP = 1e-4  # rad, rad/s of the finite differences
FEW_BLOCKS = 10  # fitted blocks for each recorded column, below which there are too many columns
ColumnSlopes = Mapping[int, tuple[np.ndarray, np.ndarray]]
"""How a rigid body's columns change with one joint: each joint -> numbers (k,) of the columns that change and their
derivatives (n, k)."""


@frozen(eq=False)
class Setting:
    """Fixed parts of the problem.

    motion and body hold n rows at the full rate. Filtered and on m thinned rows: y, the torque that is to be explained,
    its slope, viscous, given, which is what is known of the torque (J, m), and linear (J, m, p), the columns of the
    body. use (J, m): rows to fit and judge on.
    """

    device: Device
    motion: SmoothedMotion
    rows: FitRows
    body: RigidBody
    linear: np.ndarray
    viscous: np.ndarray
    given: np.ndarray
    y: np.ndarray
    slope: np.ndarray
    use: np.ndarray
    units: Mapping[str, str]
    _slopes: dict[int, tuple[ColumnSlopes, ColumnSlopes, ColumnSlopes]] = field(factory=dict, init=False, repr=False)

    @property
    def joints(self) -> int:
        """Number of joints J."""
        return self.motion.joints

    @property
    def labels(self) -> tuple[Label, ...]:
        """Labels (p,) of the rigid body's fitted parameters."""
        return self.body.labels

    @property
    def shrunk(self) -> int:
        """Number of leading columns that are too many for the fitted blocks and get a penalty: recorded ones only."""
        recorded = self.body.recorded
        return recorded if self.rows.train_blocks < FEW_BLOCKS * recorded else 0

    @cached_property
    def arm(self) -> MovingArm | None:
        """The arm along the motion, where the device is one."""
        return moving_arm(self.device, self.motion)

    def slopes(self, joint: int) -> tuple[ColumnSlopes, ColumnSlopes, ColumnSlopes]:
        """Derivatives of the body's columns by q, dq and ddq of a joint, computed once: central differences, but for
        ddq, in which columns are linear.
        """
        if joint not in self._slopes:
            self._slopes[joint] = (self._slope(joint, 0), self._slope(joint, 1), self._slope(joint, 2))
        return self._slopes[joint]

    def _slope(self, joint: int, place: int) -> ColumnSlopes:
        unit = np.eye(self.joints)[joint]
        if place == 2:
            change = self._moved(2, unit) - self._unmoved
        else:
            change = (self._moved(place, STEP * unit) - self._moved(place, -STEP * unit)) / (2 * STEP)
        used = [np.flatnonzero(np.abs(change[:, j]).max(axis=0)) for j in range(self.joints)]
        return {j: (k, np.ascontiguousarray(change[:, j, k])) for j, k in enumerate(used) if len(k)}

    @cached_property
    def _unmoved(self) -> np.ndarray:
        return self._moved(2, np.zeros(self.joints))

    def _moved(self, place: int, by: np.ndarray) -> np.ndarray:
        """The body's columns with q, dq or ddq (place 0, 1, 2) moved."""
        equations, states = self.body.equations, (self.motion.q, self.motion.dq, self.motion.ddq)
        assert equations is not None, "only a body with equations of motion is differentiated"
        q, dq, ddq = (x + by * (k == place) for k, x in enumerate(states))
        return equations(q, dq, ddq)


def formulate(recording: Recording, motion: SmoothedMotion, rows: FitRows) -> Setting:
    """The regression problem of the recording's device."""
    device, columns = recording.device, recording.description.columns
    body = rigid_body(device, motion, columns)
    sharp = device.recorded_columns
    given = rows.filtered(body.known, sharp).T
    return Setting(
        device=device,
        motion=motion,
        rows=rows,
        body=body,
        linear=np.stack([rows.filtered(body.columns[:, j], sharp) for j in range(motion.joints)]),
        viscous=rows.filtered(motion.dq, False).T,
        given=given,
        y=rows.filtered(motion.tau, False).T - given,
        slope=rows.filtered(motion.rate(motion.tau), False).T,
        use=rows.moving.T.copy(),
        units=columns.other,
    )
