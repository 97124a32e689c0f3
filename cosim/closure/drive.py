"""The FMU that stands for a device, in a replay, in the FMU with the effect and in effects.toml.

`drive_of` chooses by the class of the device; a new kind registers its drive here.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import singledispatch
from typing import ClassVar, final

import numpy as np
from attrs import frozen

from cosim.measured.device import AxisDevice, Device, PhantomDevice
from cosim.measured.label import Label

StartValue = float | list[float]
StartValues = dict[str, StartValue]
"""Start values of an FMU: a scalar, or a list for an array."""
STEPS = 2, 1000  # internal steps of the drives: unless set, and at most


class Drive(ABC):
    """How one FMU names the variables of a device. Subclasses are final and frozen."""

    model: ClassVar[str]

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
        """Inertias (nj,) [kg.m^2] of the joints for given start values, large rather than small."""


@final
@frozen
class ArmDrive(Drive):
    """PhantomArm: three joints, arrays of parameters."""

    model: ClassVar[str] = "PhantomArm"
    WIDTHS: ClassVar[Mapping[str, int]] = {
        "pi": 8,
        "coupling_viscous": 6,
        "coupling_coulomb": 6,
        "coupling_velocity": 6,
        "coupling_stiffness": 6,
        "base_tilt": 2,
    }

    def variable(self, name: str, joint: int) -> str:
        return f"{name}[{joint + 1}]"

    def start_values(self, parameters: Mapping[Label, float]) -> StartValues:
        rows: dict[str, list[float]] = {}
        out: StartValues = {}
        for label, value in parameters.items():
            if label.index is not None:
                out[label.name] = row = rows.setdefault(label.name, [0.0] * self.WIDTHS.get(label.name, 3))
                row[label.index - 1] = value
            elif label.name.isidentifier():
                out[label.name] = value
        return out | _of_every_joint(rows)

    def start_of(self, q: np.ndarray, dq: np.ndarray) -> StartValues:
        return {"q_start": q.tolist(), "dq_start": dq.tolist()}

    def inertia(self, values: Mapping[str, StartValue]) -> np.ndarray:
        pi = np.asarray(values["pi"], float)
        return np.abs(np.array([pi[0] + abs(pi[1]) + abs(pi[2]) + abs(pi[3]), pi[4], pi[5]]))


def _of_every_joint(rows: Mapping[str, list[float]]) -> StartValues:
    """Widths and orders of effects must not be zero: a joint without the effect gets the width of the joint with it."""
    out: StartValues = {}
    for name in ("stribeck_velocity", "hysteresis_length", "ripple_order"):
        if name in rows:
            out[name] = [value if value > 0 else max(rows[name]) for value in rows[name]]
    if "stribeck_exponent" in rows:
        out["stribeck_exponent"] = [value or 2.0 for value in rows["stribeck_exponent"]]
    return out


@final
@frozen
class JointDrive(Drive):
    """AxisDrive: one joint, scalar parameters."""

    model: ClassVar[str] = "AxisDrive"

    def variable(self, name: str, joint: int) -> str:
        return name

    def start_values(self, parameters: Mapping[Label, float]) -> StartValues:
        return {
            label.name: value
            for label, value in parameters.items()
            if label.index is not None or label.name.isidentifier()
        }

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
