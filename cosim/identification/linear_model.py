"""The linear model of each kind of device: its columns, what makes its parameters physical, what is known of them.
`cosim.identification.models` chooses by the class of the device.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, final

import numpy as np
from attrs import frozen

from cosim.arm.parameters import parameter_set
from cosim.arm.workspace import LINKED, definiteness
from cosim.identification.regressor import Actuator, RegressorColumns, axis, given, in_unit, phantom
from cosim.measured.device import AxisDevice, Device, PhantomDevice, RegressorDevice
from cosim.measured.filtering import FilteredMotion, LowPass
from cosim.measured.label import Label

FRICTION = ("viscous", "coulomb")
SMALLEST = 1e-6  # kg m^2 (kg), of an inertia that --physical allows
SMALLEST_YAW = 2e-5  # kg m^2, of M11 anywhere in the workspace


@frozen(eq=False)
class PhysicalLimits:
    """Conditions that physical parameters meet: rows (c, p) params >= bounds (c,), and margin(params) >= 0."""

    rows: np.ndarray
    bounds: np.ndarray
    margin: Callable[[np.ndarray], float] | None = None


@frozen(eq=False)
class PublishedParameters:
    """Parameters that are known beforehand, to be set beside the identified ones: a title and values (p',)."""

    title: str
    values: np.ndarray


@frozen
class LinearModel(ABC):
    """tau = Y params of one kind of device. Subclasses are final and frozen."""

    inertias: ClassVar[tuple[str, ...]] = ("inertia",)
    """Parameters that have to be positive by themselves."""

    device: Device

    @abstractmethod
    def columns(self, motion: FilteredMotion, low_pass: LowPass, velocity: float = 0.0) -> RegressorColumns:
        """The filtered linear model of one run; the sign of dq is smoothed over `velocity` [rad/s], 0 is sgn(dq)."""

    def limits(self, labels: Sequence[Label]) -> PhysicalLimits:
        """Friction dissipates and inertias are positive."""
        floor = {k: 0.0 for k, label in enumerate(labels) if label.name in FRICTION}
        floor |= {k: SMALLEST for k, label in enumerate(labels) if label.name in self.inertias}
        return PhysicalLimits(np.eye(len(labels))[list(floor)], np.array(list(floor.values())))

    def consistent(self, labels: Sequence[Label], triangle: np.ndarray, target: np.ndarray) -> np.ndarray | None:
        """Parameters (p,) that bodies can have, of the weighted equations triangle (p, p) params = target (p,).

        None where `limits` says all that is asked of them.
        """
        return None

    def indefinite(self, labels: Sequence[Label], params: np.ndarray) -> str:
        """Why the mass matrix of these parameters (p,) is not positive definite; empty where it is."""
        inertia = Label("inertia")
        if inertia not in labels or params[labels.index(inertia)] > 0:
            return ""
        return "the inertia is not positive"

    def of_joint(self, joint: int) -> tuple[Label, ...]:
        """Parameters that only the motion of one joint (from 0) shows."""
        return (Label("inertia"), *(self.device.label(name, joint) for name in FRICTION))

    def usual_size(self, label: Label) -> float:
        """The usual size of a parameter: one whose interval is wider was not determined. Infinite where unknown."""
        return np.inf

    def declared(self) -> np.ndarray:
        """Leading parameters that the description declares (p',); none where they are fitted."""
        return np.zeros(0)

    def published(self) -> PublishedParameters | None:
        """Parameters to set beside the identified ones."""
        return None

    def frictionless(self) -> np.ndarray | None:
        """Parameters of the rigid body (p',) from another source, for the figures of torque; None where none is."""
        return None

    def grouped(self) -> Mapping[str, str]:
        """{parameter: what else it holds, in words}; empty where each stands for itself."""
        return {}


@final
@frozen
class PhantomModel(LinearModel):
    """The fourteen parameters of the PHANToM (Taati Eq. 13)."""

    inertias: ClassVar[tuple[str, ...]] = ("d5", "d6")
    OWN: ClassVar[tuple[tuple[str, ...], ...]] = (("d1", "d2", "d3"), ("d5",), ("d6",))
    USUAL: ClassVar[dict[str, float]] = (  # from Taati Table 1
        {f"d{k}": 1e-3 for k in range(1, 7)}
        | {"g7": 0.05, "g8": 0.05}
        | {"viscous": 1e-3, "coulomb": 0.01, "slow": 0.01}
    )
    device: PhantomDevice
    unit: str = "N.m"

    def columns(self, motion: FilteredMotion, low_pass: LowPass, velocity: float = 0.0) -> RegressorColumns:
        return in_unit(phantom(motion, low_pass, velocity), self.unit)

    def limits(self, labels: Sequence[Label]) -> PhysicalLimits:
        """Also M > 0: M11 on a grid of the workspace, and p5 p6 >= (p4/2 s)^2 for the block of joints 2 and 3."""
        plain = super().limits(labels)
        grid = _yaw_inertia_on_grid(len(labels))
        return PhysicalLimits(
            np.concatenate([plain.rows, grid]),
            np.concatenate([plain.bounds, np.full(len(grid), SMALLEST_YAW)]),
            _block_margin,
        )

    def indefinite(self, labels: Sequence[Label], params: np.ndarray) -> str:
        """The least eigenvalue of M(q) over the workspace decides."""
        found = definiteness(params[:8])
        if found.positive:
            return ""
        return (
            f"the mass matrix is not positive definite over the workspace (smallest eigenvalue "
            f"{found.smallest_eigenvalue:.2e} kg m^2; in {100 * found.negative_share:.3g} % of it): "
            "guard simulations, or use --physical"
        )

    def of_joint(self, joint: int) -> tuple[Label, ...]:
        friction = (self.device.label(name, joint) for name in FRICTION)
        return (*map(Label, self.OWN[joint]), *friction)

    def usual_size(self, label: Label) -> float:
        return self.USUAL[label.name]

    def declared(self) -> np.ndarray:
        return np.array(self.device.declared_pi)

    def published(self) -> PublishedParameters:
        if self.device.declared_pi:
            return PublishedParameters("declared", self.declared())
        name = self.device.configuration
        return PublishedParameters(f"set {name}", parameter_set(name).vector)

    def frictionless(self) -> np.ndarray:
        return parameter_set("piecewise").pi


@final
@frozen
class AxisModel(LinearModel):
    """One joint with inertia, friction, offset and, for a pendulum, gravity."""

    device: AxisDevice
    actuator: Actuator

    def columns(self, motion: FilteredMotion, low_pass: LowPass, velocity: float = 0.0) -> RegressorColumns:
        return axis(motion, low_pass, self.device.pendulum, self.actuator, velocity)


@final
@frozen
class GivenModel(LinearModel):
    """One joint with recorded columns, called by their names in the file."""

    device: RegressorDevice
    names: tuple[str, ...]
    unit: str = "N.m"

    def columns(self, motion: FilteredMotion, low_pass: LowPass, velocity: float = 0.0) -> RegressorColumns:
        return given(motion, low_pass, self.names, velocity, self.unit)


def _yaw_inertia_on_grid(count: int) -> np.ndarray:
    """Rows (c, count) with M11 = rows @ params on a grid of the workspace."""
    poses = LINKED.clip(
        np.stack(np.meshgrid(0.0, np.linspace(-1.01, 2.01, 22), np.linspace(-0.45, 2.93, 22)), -1).reshape(-1, 3)
    )
    _, q2, q3 = np.unique(poses.round(6), axis=0).T
    grid = np.zeros((len(q2), count))
    grid[:, :4] = np.stack([np.ones_like(q2), np.cos(2 * q2), np.cos(2 * q3), np.cos(q2) * np.sin(q3)], axis=1)
    return grid


def _block_margin(params: np.ndarray) -> float:
    """sqrt(p5 p6) - |p4| s / 2 in units of 1e-3; the linear limits see to the signs of p5 and p6."""
    sine = max(abs(np.sin(LINKED.linkage_low)), abs(np.sin(LINKED.linkage_high)))
    return 1e3 * (np.sqrt(max(params[4] * params[5], 0.0)) - 0.5 * np.abs(params[3]) * sine - 1e-6)
