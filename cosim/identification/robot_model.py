"""The linear model of a robot arm: all joints at once, in base parameters, with friction and offset of every joint.

    F{tau} = F{dP/dt} - F{R} + F{N} + F{friction}       as for the PHANToM (see `regressor`), P = dT/d(dq), R = dT/dq

P is the part of the regressor that is linear in ddq, at ddq = dq; R follows from C dq = dP/dt - R at ddq = 0, where
dP/dt is a derivative along the motion.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import final

import numpy as np
from attrs import frozen

from cosim.arm.base_parameters import (
    BaseParameters,
    all_parameters,
    base_columns,
    base_mass_matrix,
    base_parameters,
    parameter_names,
)
from cosim.arm.serial_dynamics import link_parameters
from cosim.identification.consistent import BodyPrior, consistent_fit
from cosim.identification.linear_model import FRICTION, LinearModel, PublishedParameters
from cosim.identification.regressor import RegressorColumns, friction_columns
from cosim.measured.device import RobotDevice
from cosim.measured.filtering import FilteredMotion, LowPass
from cosim.measured.label import Label

_UNITS = {"m": "kg", "mx": "kg.m", "my": "kg.m", "mz": "kg.m"}
_ALONG = 1e-5  # s: P is followed so long to either side; q moves by 1e-5 rad, whose square is 1e-10
_POSES = 200  # at which M must be positive definite


@final
@frozen
class RobotModel(LinearModel):
    """Base parameters, then viscous, Coulomb friction and offset of each joint."""

    device: RobotDevice

    @cached_property
    def base(self) -> BaseParameters:
        """Which parameters torques can show."""
        return base_parameters(self.device.arm)

    @cached_property
    def base_labels(self) -> tuple[Label, ...]:
        """Names of the base parameters: of the column that stands for its group."""
        names = parameter_names(self.device.arm)
        return tuple(self.device.label(*names[k]) for k in self.base.kept)

    def columns(self, motion: FilteredMotion, low_pass: LowPass, velocity: float = 0.0) -> RegressorColumns:
        q, dq, step, n = motion.q, motion.dq, motion.step, self.device.arm.count
        still = np.zeros_like(q)
        gravity = self._columns(q, still, still)
        momentum = self._columns(q, still, dq) - gravity
        moved = [self._momentum(q + way * _ALONG * dq, dq) for way in (1.0, -1.0)]
        slope = (moved[0] - moved[1]) / (2 * _ALONG) - (self._columns(q, dq, still) - gravity)
        inertial = low_pass.rate(momentum, step) - low_pass.low(slope - gravity, step)
        offset = np.broadcast_to(np.eye(n), (*q.shape, n))
        friction = np.concatenate([friction_columns(dq, velocity), offset], axis=2)
        y = np.concatenate([inertial, low_pass.low(friction, step)], axis=2)
        labels = [self.device.label(name, j) for name in ("viscous", "coulomb", "offset") for j in range(n)]
        units = [_UNITS.get(label.name, "kg.m2") for label in self.base_labels]
        units += ["N.m.s/rad"] * n + ["N.m"] * (2 * n)
        tau = low_pass.low(motion.tau, step)
        return RegressorColumns(y, tau, (*self.base_labels, *labels), tuple(units))

    def _columns(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        return base_columns(self.device.arm, self.base, q, dq, ddq)

    def _momentum(self, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        still = np.zeros_like(q)
        return self._columns(q, still, dq) - self._columns(q, still, still)

    def indefinite(self, labels: Sequence[Label], params: np.ndarray) -> str:
        """The least eigenvalue of M(q) at random poses inside the limits decides."""
        values = dict(zip(labels, params.tolist(), strict=True))
        base = np.array([values.get(label, 0.0) for label in self.base_labels])
        q = self.device.arm.poses(_POSES, 1)
        lowest = np.linalg.eigvalsh(base_mass_matrix(self.device.arm, self.base, base, q))[:, 0]
        if (lowest > 0).all():
            return ""
        share = 100 * float((lowest <= 0).mean())
        return (
            f"the mass matrix is not positive definite in {share:.3g} % of {_POSES} random poses (smallest eigenvalue "
            f"{lowest.min():.2e} kg m^2): guard simulations, or use --physical"
        )

    def consistent(self, labels: Sequence[Label], triangle: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Pseudo-inertias positive definite, with the URDF's values as a prior; friction dissipates."""
        rows = [self.base_labels.index(label) for label in labels if label in self.base_labels]
        others = [label for label in labels if label not in self.base_labels]
        floors = [0.0 if label.name in FRICTION else None for label in others]
        prior = BodyPrior(link_parameters(self.device.arm), self.device.arm.armature)
        return consistent_fit(triangle, target, self.base.grouping[rows], prior, floors)

    def of_joint(self, joint: int) -> tuple[Label, ...]:
        names = ("rotor", "viscous", "coulomb", "offset")
        return tuple(self.device.label(name, joint) for name in names)

    def published(self) -> PublishedParameters:
        """The URDF's, grouped as the base parameters are."""
        return PublishedParameters("URDF", self.base.of(all_parameters(self.device.arm)))

    def frictionless(self) -> np.ndarray:
        return self.published().values

    def grouped(self) -> Mapping[str, str]:
        """What else each base parameter holds: {name: "+ 1 Iyy[3] - 0.316 my[3]"}."""
        names = [str(self.device.label(*name)) for name in parameter_names(self.device.arm)]
        found = {}
        for row, k in zip(self.base.grouping, self.base.kept, strict=True):
            parts = [
                f"{'-' if row[j] < 0 else '+'} {abs(row[j]):.6g} {names[j]}" for j in np.flatnonzero(row) if j != k
            ]
            if parts:
                found[names[k]] = " ".join(parts)
        return found
