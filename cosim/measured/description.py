"""What a measured file holds: the device, the columns, their units and scales (CONTRACT.md, "Measured data")."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from attrs import field, frozen

from cosim.errors import InputError, Problem, did_you_mean
from cosim.measured import units
from cosim.measured.columns import LISTS, ROLES, ColumnNames, frozen_map, read_columns
from cosim.measured.device import DEVICES, Device, PhantomDevice
from cosim.measured.fields import FieldReader, is_number, unknown_names

KEYS = (
    "device",
    "configuration",
    "parameters",
    "declared_pi",
    "joint",
    "gravity",
    "torque_held",
    "coulomb_velocity",
    "columns",
    "units",
    "scale",
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

    def factor(self, role: str, column: int) -> float:
        """Factor from the file's number to SI: unit times scale."""
        unit = _of(self.units.get(role, ()), column, "")
        return units.FACTORS.get(unit, ("", 1.0))[1] * _of(self.scale.get(role, ()), column, 1.0)


def _of(values: tuple[Value, ...], column: int, default: Value) -> Value:
    return values[min(column, len(values) - 1)] if values else default


def load_description(path: Path | str) -> RecordingDescription:
    """Read a description file; every problem is collected. Raises InputError."""
    path = Path(path)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(Problem(str(path), "a description file", "no such file")) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(Problem(str(path), "a TOML file", f"text that does not parse: {error}")) from None
    return parse_description(table, str(path))


def parse_description(table: Mapping[str, Any], source: str) -> RecordingDescription:
    """The description that a TOML table holds. Raises InputError with all problems."""
    problems: list[Problem] = []
    fields = FieldReader(table, source, problems)
    unknown_names(table, KEYS, source, "key", problems)
    word = fields.choice("device", tuple(kind.word for kind in DEVICES), PhantomDevice.word)
    devices = {kind.word: kind.read(fields) for kind in DEVICES}  # keys of other devices are checked as well
    columns = read_columns(table.get("columns"), source, problems)
    result = RecordingDescription(
        device=devices[word],
        columns=columns,
        units=_units(table, columns, source, problems),
        scale=_scales(table, columns, source, problems),
        torque_held=fields.boolean("torque_held"),
        coulomb_velocity=fields.speed("coulomb_velocity"),
        source=source,
    )
    problems += result.device.problems(columns, fields) + _unit_problems(result)
    if problems:
        raise InputError(problems)
    return result


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
                if role not in description.scale:
                    problems.append(
                        Problem(where, "a unit with a factor", f"{unit!r}", f"give [scale].{role}, SI per {unit}")
                    )
            elif unit not in units.FACTORS:
                advice = did_you_mean(unit, (*units.FACTORS, *units.NEED_SCALE))
                problems.append(Problem(where, "a known unit", repr(unit), advice))
            elif units.FACTORS[unit][0] not in units.ALLOWED.get(role, {units.FACTORS[unit][0]}):
                problems.append(Problem(where, f"a unit of {' or '.join(sorted(units.ALLOWED[role]))}", repr(unit)))
    return problems
