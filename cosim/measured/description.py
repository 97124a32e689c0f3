"""What a measured file holds: the device, the columns, their units and scales (CONTRACT.md, "Measured data")."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from attrs import field, frozen

from cosim.errors import InputError, Problem, did_you_mean
from cosim.measured import units
from cosim.measured.columns import LISTS, ROLES, ColumnNames, frozen_map, read_columns
from cosim.measured.device import DEVICES, AxisDevice, Device, PhantomDevice, RobotDevice
from cosim.measured.fields import FieldReader, is_number, unknown_names
from cosim.measured.gear import Gear, read_gear
from cosim.measured.mounted import TEMPERATURE, Mounted, read_motor, read_mounted
from cosim.measured.servo import Servo, read_servo
from cosim.opening import read_toml

KEYS = (
    "device",
    "configuration",
    "parameters",
    "declared_pi",
    "joint",
    "urdf",
    "joints",
    "base",
    "tip",
    "gravity",
    "torque_held",
    "coulomb_velocity",
    "columns",
    "units",
    "scale",
    "motor",
    "gear",
    "servo",
    "mounted",
)
Value = TypeVar("Value")


@frozen
class RecordingDescription:
    """Device, columns, units and scales of a measured file; the default is that of a plain PHANToM recording."""

    device: Device = field(factory=PhantomDevice)
    columns: ColumnNames = field(factory=ColumnNames)
    units: Mapping[str, tuple[str, ...]] = field(factory=dict, converter=frozen_map)  # role -> unit per column
    scale: Mapping[str, tuple[float, ...]] = field(factory=dict, converter=frozen_map)  # role -> factor per column
    torque_held: bool = False  # tau is a command that is held from its stamp to the next
    coulomb_velocity: float = 0.0  # speed over which the sign of dq is known to be smooth; 0: not known
    back_emf: float = 0.0  # V s/rad, of a torque that is given as a voltage or a duty cycle
    supply: float = 0.0  # V, of a duty cycle; 0: not known, or in a column
    gear: Gear = field(factory=Gear)
    servo: Servo | None = None  # makes tau of q_ref and q
    mounted: Mounted = field(factory=Mounted)  # in all runs
    mounted_in: Mapping[str, Mounted] = field(factory=dict, converter=frozen_map)  # run -> what was on it
    source: str = ""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints in words."""
        return self.device.joints

    @property
    def prismatic(self) -> bool:
        """Whether q is a length [m] and tau a force [N]."""
        unit = self.units.get("q", ("rad",))[0]
        return units.FACTORS.get(unit, ("rad", 1.0))[0] == "m" or self.units.get("tau", ("N.m",))[0] == "N"

    @property
    def si(self) -> Mapping[str, str]:
        """SI unit of each role after reading."""
        return units.LENGTH if self.prismatic else units.ANGLE

    @property
    def loaded(self) -> bool:
        """Whether it says what was mounted, in some run at least."""
        columns = self.columns
        runs = any(one.any for one in self.mounted_in.values())
        return bool(self.mounted.any or runs or columns.mass or columns.inertia)

    @property
    def warm(self) -> bool:
        """Whether it says how warm the joint was, in some run at least."""
        every = (self.mounted, *self.mounted_in.values())
        return any(one.temperature is not None for one in every) and TEMPERATURE not in self.columns.other

    @property
    def other(self) -> Mapping[str, str]:
        """Further signals of the runs with their units, a temperature that was given for a run among them."""
        return {**self.columns.other, TEMPERATURE: "degC"} if self.warm else self.columns.other

    @property
    def torque_unit(self) -> str:
        """The unit of tau after reading: that of `si`, or A, V, duty or counts where no factor to it is known."""
        if self.servo and self.servo.gain is None:
            return self.si["q"]
        unit = self.units.get("tau", ("",))[0]
        if unit not in units.ELECTRICAL or "tau" in self.scale:
            return self.si["tau"]
        known = units.ELECTRICAL[unit][0]
        return "V" if known == "duty" and (self.columns.supply or self.supply) else known

    def factor(self, role: str, column: int) -> float:
        """Factor from the file's number to SI at the joint: unit times scale times gear."""
        unit = _of(self.units.get(role, ()), column, "")
        electrical = units.ELECTRICAL.get(unit, ("", 1.0)) if role == "tau" and role not in self.scale else ("", 1.0)
        factor = units.FACTORS.get(unit, electrical)[1] * _of(self.scale.get(role, ()), column, 1.0)
        if role in ("q", "dq", "ddq", "q_ref"):
            return factor * self.gear.of_position
        return factor * self.gear.of_torque if role == "tau" and self.torque_unit == self.si["tau"] else factor

    @property
    def back_emf_at_joint(self) -> float:
        """Unit of tau per speed of the joint that the motor's back-EMF takes from its voltage."""
        gear = self.gear.of_torque
        known = self.scale["tau"][0] * gear if "tau" in self.scale else 1.0
        return self.back_emf * gear * known


def _of(values: tuple[Value, ...], column: int, default: Value) -> Value:
    return values[min(column, len(values) - 1)] if values else default


def load_description(path: Path | str) -> RecordingDescription:
    """Read a description file; every problem is collected. Raises InputError."""
    return parse_description(read_toml(Path(path), "a description file"), str(path))


def parse_description(table: Mapping[str, Any], source: str) -> RecordingDescription:
    """The description that a TOML table holds. Raises InputError with all problems."""
    problems: list[Problem] = []
    fields = FieldReader(table, source, problems)
    unknown_names(table, KEYS, source, "key", problems)
    word = fields.choice("device", tuple(kind.word for kind in DEVICES), PhantomDevice.word)
    devices = {kind.word: kind.read(fields) for kind in DEVICES}  # keys of other devices are checked as well
    servo = read_servo(table.get("servo"), source, problems)
    columns = read_columns(table.get("columns"), source, problems, servo is not None)
    motor = read_motor(table.get("motor", {}), source, problems)
    mounted, mounted_in = read_mounted(table.get("mounted", {}), source, problems)
    result = RecordingDescription(
        device=devices[word],
        columns=columns,
        units=_units(table, columns, source, problems),
        scale=_scales(table, columns, source, problems),
        torque_held=fields.boolean("torque_held"),
        coulomb_velocity=fields.speed("coulomb_velocity"),
        back_emf=motor.get("back_emf", 0.0),
        supply=motor.get("supply", 0.0),
        gear=read_gear(table.get("gear", {}), source, problems),
        servo=servo,
        mounted=mounted,
        mounted_in=mounted_in,
        source=source,
    )
    problems += result.device.problems(columns, fields) + _unit_problems(result) + _mixed(result)
    problems += _without_torques(result) + _for_axis(result)
    if problems:
        raise InputError(problems)
    return result


def _mixed(description: RecordingDescription) -> list[Problem]:
    """Joints whose torques are in units that cannot stand beside each other in one model."""
    given = set(description.units.get("tau", ()))
    electrical = {units.ELECTRICAL[unit][0] for unit in given if unit in units.ELECTRICAL}
    if "tau" in description.scale or not electrical or (len(electrical) == 1 and not given - set(units.ELECTRICAL)):
        return []
    where = f"{description.source}: [units].tau"
    return [Problem(where, "one unit for all joints, or a [scale].tau", ", ".join(sorted(given)))]


def _without_torques(description: RecordingDescription) -> list[Problem]:
    """Joints of one arm have masses in common, so that their torques have to be in one unit of torque."""
    if not isinstance(description.device, RobotDevice) or "tau" in description.scale:
        return []
    unknown = [unit for unit in description.units.get("tau", ()) if unit in units.ELECTRICAL]
    expected, advice = "torques, since joints of one arm share their masses", "give [scale].tau, one factor a joint"
    where = f"{description.source}: [units].tau"
    return [Problem(where, expected, ", ".join(unknown), advice)] if unknown else []


def _for_axis(description: RecordingDescription) -> list[Problem]:
    """What is mounted, and a servo, enter the model of an axis alone."""
    if isinstance(description.device, AxisDevice):
        return []
    given = {"mounted": description.loaded, "servo": description.servo is not None}
    got, expected = f"device {description.device.word!r}", f"device {AxisDevice.word!r}, where it enters the model"
    return [Problem(f"{description.source}: [{key}]", expected, got) for key, there in given.items() if there]


def _units(
    table: Mapping[str, Any], columns: ColumnNames, source: str, problems: list[Problem]
) -> dict[str, tuple[str, ...]]:
    """The [units] table as role -> units."""
    found: dict[str, tuple[str, ...]] = {}
    for role, values in _per_column(table, "units", source, problems).items():
        if all(isinstance(value, str) for value in values) and _counted(role, values, columns):
            found[role] = tuple(map(units.spelled, values))
        else:
            problems.append(_misfit(f"{source}: [units].{role}", "unit", role, values, columns))
    return found


def _scales(
    table: Mapping[str, Any], columns: ColumnNames, source: str, problems: list[Problem]
) -> dict[str, tuple[float, ...]]:
    """The [scale] table as role -> factors."""
    found: dict[str, tuple[float, ...]] = {}
    for role, values in _per_column(table, "scale", source, problems).items():
        if all(map(is_number, values)) and _counted(role, values, columns):
            found[role] = tuple(map(float, values))
        else:
            problems.append(_misfit(f"{source}: [scale].{role}", "number", role, values, columns))
    return found


def _per_column(table: Mapping[str, Any], key: str, source: str, problems: list[Problem]) -> dict[str, list[Any]]:
    """The values that [units] or [scale] gives for each known role, one for all of its columns or one each."""
    section = table.get(key, {})
    if not isinstance(section, Mapping):
        problems.append(Problem(f"{source}: [{key}]", "a table", repr(section)))
        return {}
    unknown_names(section, ROLES, f"{source}: [{key}]", "role", problems)
    return {role: value if isinstance(value, list) else [value] for role, value in section.items() if role in ROLES}


def _counted(role: str, values: list[Any], columns: ColumnNames) -> bool:
    return len(values) in (1, _count(role, columns))


def _count(role: str, columns: ColumnNames) -> int:
    return len(columns.of_role(role)) if role in LISTS else 1


def _misfit(where: str, noun: str, role: str, values: list[Any], columns: ColumnNames) -> Problem:
    got = values[0] if len(values) == 1 else values
    return Problem(where, f"one {noun}, or one for each of the {_count(role, columns)} columns", repr(got))


def _unit_problems(description: RecordingDescription) -> list[Problem]:
    problems = []
    for role, names in description.units.items():
        where = f"{description.source}: [units].{role}"
        for unit in names:
            if unit in units.NEED_SCALE:
                if role not in description.scale and role != "tau":
                    problems.append(
                        Problem(where, "a unit with a factor", f"{unit!r}", f"give [scale].{role}, SI per {unit}")
                    )
            elif unit not in units.FACTORS:
                advice = did_you_mean(unit, (*units.FACTORS, *units.NEED_SCALE))
                problems.append(Problem(where, "a known unit", repr(unit), advice))
            elif units.FACTORS[unit][0] not in units.ALLOWED.get(role, {units.FACTORS[unit][0]}):
                problems.append(Problem(where, f"a unit of {' or '.join(sorted(units.ALLOWED[role]))}", repr(unit)))
    return problems
