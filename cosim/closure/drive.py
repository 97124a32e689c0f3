"""The FMU that stands for a device, in a replay, in the FMU with the effect and in effects.toml.

`drive_of` chooses by the class of the device; a new kind registers its drive here.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from functools import singledispatch
from typing import ClassVar, final

import numpy as np
from attrs import evolve, frozen

from cosim.arm.base_parameters import base_parameters, parameter_names
from cosim.arm.identified import identified_arm
from cosim.arm.serial import SerialModel
from cosim.arm.serial_dynamics import mass_matrix
from cosim.arm.serial_table import arm_values
from cosim.effects.surroundings import pair_of
from cosim.measured.device import AxisDevice, Device, PhantomDevice, RobotDevice
from cosim.measured.label import Label

StartValue = float | list[float]
StartValues = dict[str, StartValue]
"""Start values of an FMU: a scalar, or a list for an array."""
COUPLING = ("coupling_viscous", "coupling_coulomb", "coupling_velocity", "coupling_stiffness")
POSES = 100  # inside the limits, at which the inertia of an arm is looked at
STEPS = 2, 1000  # internal steps of the drives: unless set, and at most


class Drive(ABC):
    """How one FMU names the variables of a device. Subclasses are final and frozen."""

    model: ClassVar[str]

    @property
    def joints(self) -> int | None:
        """How many joints a table of joints is cut to; None where the FMU has none."""
        return None

    @property
    def fixed(self) -> StartValues:
        """Start values that decide which FMU it is."""
        return {} if self.joints is None else {"joints": self.joints}

    def lacks(self, parameters: Iterable[Label]) -> str:
        """Why not all parameters have a place in the FMU; empty where they have."""
        return ""

    @abstractmethod
    def variable(self, name: str, joint: int) -> str:
        """The FMU's variable of a joint, counted from 0."""

    @abstractmethod
    def start_values(self, parameters: Mapping[Label, float]) -> StartValues:
        """Start values of parameters. Those that are no variable of an FMU are left out."""

    @abstractmethod
    def start_of(self, q: np.ndarray, dq: np.ndarray) -> StartValues:
        """Start values of a motion that begins at q with the velocity dq, both (nj,)."""

    @abstractmethod
    def inertia(self, values: Mapping[str, StartValue]) -> np.ndarray:
        """Inertias (nj,) [kg.m^2] of the joints for given start values, that a guiding PD counts on."""


@final
@frozen
class ArmDrive(Drive):
    """PhantomArm: three joints, arrays of parameters."""

    model: ClassVar[str] = "PhantomArm"
    WIDTHS: ClassVar[Mapping[str, int]] = {"pi": 8, "base_tilt": 2, **dict.fromkeys(COUPLING, 6)}

    def variable(self, name: str, joint: int) -> str:
        return f"{name}[{joint + 1}]"

    def start_values(self, parameters: Mapping[Label, float]) -> StartValues:
        return _in_rows(parameters, 3, self.WIDTHS)

    def start_of(self, q: np.ndarray, dq: np.ndarray) -> StartValues:
        return {"q_start": q.tolist(), "dq_start": dq.tolist()}

    def inertia(self, values: Mapping[str, StartValue]) -> np.ndarray:
        pi = np.asarray(values["pi"], float)
        return np.abs(np.array([pi[0] + abs(pi[1]) + abs(pi[2]) + abs(pi[3]), pi[4], pi[5]]))


@final
@frozen(eq=False)
class SerialDrive(Drive):
    """SerialArm: an arm from its URDF, whose table takes the identified base parameters."""

    model: ClassVar[str] = "SerialArm"
    WIDTHS: ClassVar[Mapping[str, int]] = {"base_tilt": 2, "contact_normal": 3}
    arm: SerialModel

    @property
    def joints(self) -> int:
        return self.arm.count

    def variable(self, name: str, joint: int) -> str:
        return f"{name}[{joint + 1}]"

    def start_values(self, parameters: Mapping[Label, float]) -> StartValues:
        """The table too where all base parameters are given. Motors have no limit but one that was found."""
        names = parameter_names(self.arm)
        base = [Label.of_joint(*names[k]) for k in base_parameters(self.arm).kept]
        rest, table = {label: value for label, value in parameters.items() if label not in base}, StartValues()
        if all(label in parameters for label in base):
            table = arm_values(identified_arm(self.arm, np.array([parameters[label] for label in base])))
            del table["torque_saturation"]
        return table | _in_rows(self._in_places(rest), self.arm.count, self.WIDTHS)

    def _in_places(self, parameters: Mapping[Label, float]) -> dict[Label, float]:
        """Couplings by the FMU's places for them, each with the joints that it is between, instead of by pairs."""
        pairs = _pairs(parameters)[: self.arm.count]
        out = {label: value for label, value in parameters.items() if not _is_coupling(label)}
        for place, pair in enumerate(pairs, 1):
            on, other = pair_of(self.arm.count, pair)
            out |= {Label("coupling_on", place): on + 1, Label("coupling_from", place): other + 1}
            own = {name: parameters.get(Label(name, pair)) for name in COUPLING}
            out |= {Label(name, place): value for name, value in own.items() if value is not None}
        return out

    def lacks(self, parameters: Iterable[Label]) -> str:
        room, wanted = self.arm.count, len(_pairs(parameters))
        if wanted <= room:
            return ""
        return f"the FMU has room for {room} couplings between joints, not for {wanted}: it lacks the last"

    def start_of(self, q: np.ndarray, dq: np.ndarray) -> StartValues:
        return {"q_start": q.tolist(), "dq_start": dq.tolist()}

    def inertia(self, values: Mapping[str, StartValue]) -> np.ndarray:
        """Of a joint whose neighbours are free to give way, at the pose where it is least: gains for a larger one would
        shake it there.
        """
        columns = {name: np.asarray(values[name], float) for name in arm_values(self.arm) if name in values}
        tensor = [[columns[f"inertia_{''.join(sorted(a + b))}"] for b in "xyz"] for a in "xyz"]
        arm = evolve(
            self.arm,
            mass=columns["mass"],
            centre=np.stack([columns[f"centre_{a}"] for a in "xyz"], axis=1),
            inertia=np.moveaxis(np.array(tensor), 2, 0),
            armature=columns["rotor_inertia"],
        )
        alone = np.diagonal(np.linalg.inv(mass_matrix(arm, arm.poses(POSES, 1))), axis1=1, axis2=2)
        return 1 / np.abs(alone).max(axis=0)


def _is_coupling(label: Label) -> bool:
    return label.name.startswith("coupling_") and label.index is not None


def _pairs(parameters: Iterable[Label]) -> list[int]:
    """Numbers of the couplings that parameters belong to, each once."""
    return list(dict.fromkeys(label.index for label in parameters if _is_coupling(label) and label.index is not None))


def _in_rows(parameters: Mapping[Label, float], joints: int, widths: Mapping[str, int]) -> StartValues:
    """Arrays of an arm's FMU, as long as it has joints unless `widths` says so."""
    rows: dict[str, list[float]] = {}
    out: StartValues = {}
    for label, value in parameters.items():
        if label.index is not None:
            out[label.name] = row = rows.setdefault(label.name, [type(value)(0)] * widths.get(label.name, joints))
            row[label.index - 1] = value
        elif label.name.isidentifier():
            out[label.name] = value
    return out | _of_every_joint(rows)


def _of_every_joint(rows: Mapping[str, list[float]]) -> StartValues:
    """Widths and orders of effects must not be zero: a joint without the effect gets the width of the joint with it."""
    out: StartValues = {}
    for name in ("stribeck_velocity", "hysteresis_length", "ripple_order"):
        if name in rows:
            out[name] = [value if value > 0 else max(rows[name]) for value in rows[name]]
    if "stop_side" in rows:
        out["stop_side"] = [value or 1.0 for value in rows["stop_side"]]
    if "stribeck_exponent" in rows:
        out["stribeck_exponent"] = [value or 2.0 for value in rows["stribeck_exponent"]]
    return out


@final
@frozen
class JointDrive(Drive):
    """AxisDrive: one joint, scalar parameters but for the knots of a torque without a name."""

    model: ClassVar[str] = "AxisDrive"
    WIDTHS: ClassVar[Mapping[str, int]] = dict.fromkeys(("nameless_torque", "nameless_friction"), 10)

    def variable(self, name: str, joint: int) -> str:
        return name

    def start_values(self, parameters: Mapping[Label, float]) -> StartValues:
        rows = {label: value for label, value in parameters.items() if label.name in self.WIDTHS}
        return {
            label.name: value
            for label, value in parameters.items()
            if label not in rows and (label.index is not None or label.name.isidentifier())
        } | _in_rows(rows, 1, self.WIDTHS)

    def start_of(self, q: np.ndarray, dq: np.ndarray) -> StartValues:
        return {"q_start": float(q[0]), "dq_start": float(dq[0])}

    def inertia(self, values: Mapping[str, StartValue]) -> np.ndarray:
        return np.atleast_1d(np.asarray(values["inertia"], float))


@singledispatch
def drive_of(device: Device) -> Drive | None:
    """The FMU that stands for a device; None where there is none."""
    return None


@drive_of.register
def _(device: PhantomDevice) -> Drive | None:
    return ArmDrive()


@drive_of.register
def _(device: AxisDevice) -> Drive | None:
    return JointDrive()


@drive_of.register
def _(device: RobotDevice) -> Drive | None:
    return SerialDrive(device.arm)


def effects_drive(device: Device) -> Drive:
    """The FMU in whose parameters effects of a device are written: its own, or PhantomArm where it has none."""
    return drive_of(device) or ArmDrive()


def stepped(values: Mapping[str, StartValue], step: float) -> StartValues:
    """The values with as many internal steps of a communication step [s] as `joint_check_step` (fmu_src/shared/joint.h)
    advises.
    """
    names = ("actuator_lag", "joint_compliance", "motor_inertia", "joint_damping")
    steps = float(STEPS[0])
    for lag, compliance, inertia, damping in zip(
        *np.broadcast_arrays(*(np.atleast_1d(values.get(n, 0.0)) for n in names)), strict=True
    ):
        if lag > 0:
            steps = max(steps, np.ceil(step / lag) + 1)
        if compliance > 0 and inertia > 0:
            steps = max(steps, np.ceil(step * (1 / np.sqrt(compliance * inertia) + damping / inertia)))
    return {**values, "internal_steps": int(min(steps, STEPS[1]))} if steps > STEPS[0] else dict(values)
