"""What a recording was made on: a PHANToM, a single axis, one joint whose regressor columns are given, a robot.

A new kind of device is a new class here, added to `DEVICES`. What other packages make of a device stands in one place
each, chosen by its class: its linear model in `cosim.identification.linear_model`, its equations of motion in
`cosim.closure.model.rigid_body`, its arm in `cosim.effects.moving_arm`, its FMU in `cosim.closure.drive`.
"""

import math
from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar, final

from attrs import frozen

from cosim.arm.robot import Robot, read_robot
from cosim.arm.serial import SerialModel
from cosim.errors import InputError, Problem
from cosim.measured.columns import ColumnNames
from cosim.measured.fields import FieldReader
from cosim.measured.label import Label

CONFIGURATIONS = ("UR", "GCW", "FS", "USD", "USD+GCW", "piecewise", "segment")
G = 9.81  # m/s^2
PHANTOM_PARAMETERS = 8


@frozen
class SignalLimit:
    """The largest size that a signal of a device can have; a larger one has another unit than the description says."""

    role: str
    largest: float
    expected: str
    advice: str


class Device(ABC):
    """One kind of device with its settings. Subclasses are final and frozen."""

    word: ClassVar[str]  # in description files and results
    recorded_columns: ClassVar[bool] = False
    """Whether the columns of its model were recorded. They are not smooth like columns that are formed from smoothed
    motion, and belong to the velocity that was recorded with them."""

    @property
    def gravity(self) -> float:
        """Gravity [m/s^2] along the base's downward direction; negative for an arm that hangs upside down."""
        return G

    @property
    @abstractmethod
    def joints(self) -> tuple[str, ...]:
        """Names of the joints in words."""

    @abstractmethod
    def label(self, name: str, joint: int) -> Label:
        """The parameter `name` of a joint, counted from 0, as this device's linear model calls it."""

    @classmethod
    @abstractmethod
    def read(cls, fields: FieldReader) -> "Device":
        """The device with the settings of a description."""

    def limits(self) -> tuple[SignalLimit, ...]:
        """Sizes that its signals cannot exceed."""
        return ()

    def problems(self, columns: ColumnNames, fields: FieldReader) -> list[Problem]:
        """What is missing from, or contradictory in, a description of this device."""
        return [*self._miscounted(columns, fields), *self._declared(fields)]

    def _miscounted(self, columns: ColumnNames, fields: FieldReader) -> list[Problem]:
        expected = f"{len(self.joints)} column(s) for device {self.word!r}"
        given = fields.table.get("columns")
        missing = {"q", "tau"} - set(given) if isinstance(given, dict) else set()  # told by themselves
        return [
            Problem(f"{fields.source}: [columns].{role}", expected, str(len(names)))
            for role in ("q", "tau", "dq", "ddq", "q_ref")
            if (names := columns.of_role(role)) and len(names) != len(self.joints) and role not in missing
        ]

    def _declared(self, fields: FieldReader) -> list[Problem]:
        if fields.table.get("parameters") != "declared":
            return []
        return [
            Problem(
                f"{fields.source}: parameters",
                f"'fit', for device {PhantomDevice.word!r} also 'declared'",
                f"'declared' for {self.word!r}",
                f"a rigid torque that is trusted goes into [columns] rigid of device {RegressorDevice.word!r}",
            )
        ]


@final
@frozen
class PhantomDevice(Device):
    """A PHANToM with three joints. declared_pi: the eight parameters where they are trusted, empty where fitted."""

    word: ClassVar[str] = "phantom"
    configuration: str = "UR"
    declared_pi: tuple[float, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        return ("joint 1", "joint 2", "joint 3")

    @property
    def gravity(self) -> float:
        return -G if self.configuration.startswith("USD") else G

    def label(self, name: str, joint: int) -> Label:
        return Label.of_joint(name, joint)

    @classmethod
    def read(cls, fields: FieldReader) -> "PhantomDevice":
        configuration = fields.choice("configuration", CONFIGURATIONS, "UR")
        declared = fields.choice("parameters", ("fit", "declared"), "fit") == "declared"
        pi = fields.numbers("declared_pi")
        if pi and len(pi) != PHANTOM_PARAMETERS:
            fields.problems.append(Problem(f"{fields.source}: declared_pi", "8 numbers", str(len(pi))))
        return cls(configuration, pi if declared else ())

    def limits(self) -> tuple[SignalLimit, ...]:
        """A joint cannot leave +-pi. The device peaks at 8.5 N on 0.4 m (PHYSICS.md 1), far below 10 N m."""
        angle = SignalLimit(
            "q", 2 * math.pi, "rad, within the PHANToM's +-3", 'if they are degrees, say [units] q = "deg"'
        )
        torque = SignalLimit(
            "tau",
            10.0,
            "N m, a PHANToM gives less than 2",
            'if they are mN m, say [units] tau = "mN.m"; amplifier commands need a [scale]',
        )
        return angle, torque

    def _declared(self, fields: FieldReader) -> list[Problem]:
        if fields.table.get("parameters") == "declared" and "declared_pi" not in fields.table:
            return [Problem(f"{fields.source}: declared_pi", "the 8 trusted parameters", "nothing")]
        return []


@frozen
class OneJoint(Device):
    """A device with one joint, whose parameters need no number. `joint`: its name in words."""

    joint: str = ""

    @property
    def joints(self) -> tuple[str, ...]:
        return (self.joint or "joint",)

    def label(self, name: str, joint: int) -> Label:
        return Label(name)


@final
@frozen
class AxisDevice(OneJoint):
    """One joint: inertia, friction, offset; a pendulum also has gravity, a sin q + b cos q."""

    word: ClassVar[str] = "axis"
    pendulum: bool = False

    @classmethod
    def read(cls, fields: FieldReader) -> "AxisDevice":
        return cls(fields.text("joint"), fields.boolean("gravity"))


@final
@frozen
class RegressorDevice(OneJoint):
    """One joint with recorded inertial and gravity columns, tau = y params + friction, or a recorded rigid torque."""

    word: ClassVar[str] = "regressor"
    recorded_columns: ClassVar[bool] = True

    @classmethod
    def read(cls, fields: FieldReader) -> "RegressorDevice":
        return cls(fields.text("joint"))

    def problems(self, columns: ColumnNames, fields: FieldReader) -> list[Problem]:
        found = super().problems(columns, fields)
        if columns.regressor or columns.rigid:
            return found
        where = f"{fields.source}: [columns].regressor"
        return [*found, Problem(where, "the regressor columns or a rigid torque", "neither")]


@final
@frozen
class RobotDevice(Device):
    """An arm from its URDF, all joints from base to tip together: inertias, friction, rotors, offsets."""

    word: ClassVar[str] = "robot"
    found: Robot | None = None
    named: tuple[str, ...] = ()

    @property
    def arm(self) -> SerialModel:
        """The table of its joints."""
        assert self.found is not None, "a description without a URDF has been refused"
        return self.found.arm.model

    @property
    def joints(self) -> tuple[str, ...]:
        return self.arm.joints if self.found else self.named

    def label(self, name: str, joint: int) -> Label:
        return Label.of_joint(name, joint)

    @classmethod
    def read(cls, fields: FieldReader) -> "RobotDevice":
        """urdf: a file beside the description, of which base and tip may be named; joints: in the columns' order."""
        urdf, joints = fields.text("urdf"), fields.texts("joints")
        if not urdf or fields.table.get("device") != cls.word:
            return cls(None, joints)
        names = {key: fields.text(key) or None for key in ("base", "tip")}
        try:
            return cls(read_robot(Path(fields.source).parent / urdf, names["base"], names["tip"]), joints)
        except InputError as error:
            fields.problems.extend(error.problems)
            return cls(None, joints)

    def problems(self, columns: ColumnNames, fields: FieldReader) -> list[Problem]:
        if self.found is None:
            if fields.text("urdf"):
                return []  # the URDF has said what is wrong with it
            return [Problem(f"{fields.source}: urdf", f"the URDF of device {self.word!r}", "nothing")]
        arm, found = self.arm, super().problems(columns, fields)
        if self.named and self.named != arm.joints:
            expected = f"the joints from {self.found.arm.chain.base} to {self.found.arm.chain.tip}, in their order: "
            got, advice = ", ".join(self.named), "name the ends of the arm with base and tip"
            found.append(Problem(f"{fields.source}: joints", expected + ", ".join(arm.joints), got, advice))
        if arm.sliding.any():
            slides = ", ".join(name for name, slide in zip(arm.joints, arm.sliding, strict=True) if slide)
            found.append(Problem(f"{fields.source}: urdf", "joints that turn", f"slides: {slides}", "lock them"))
        return found


DEVICES: tuple[type[Device], ...] = (PhantomDevice, AxisDevice, RegressorDevice, RobotDevice)
