"""What a measured file holds: the device, the columns, their units and scales (CONTRACT.md, "Measured data")."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from attrs import field, frozen

from cosim.errors import InputError, Problem, did_you_mean
from cosim.measured import units

DEVICES = ("phantom", "axis", "regressor")
CONFIGURATIONS = ("UR", "GCW", "FS", "USD", "USD+GCW", "piecewise", "segment")
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
SINGLE = ("time", "run", "split", "rigid")
LISTS = ("q", "tau", "dq", "ddq", "q_ref", "force", "regressor")
ROLES = (*SINGLE, *LISTS, "other")


def _frozen_map(values: Mapping) -> Mapping:
    return MappingProxyType(dict(values))


@frozen
class ColumnNames:
    """Names of the columns in the file; empty where the file has none."""

    time: str = "time"
    q: tuple[str, ...] = ("q1", "q2", "q3")
    tau: tuple[str, ...] = ("tau1", "tau2", "tau3")
    dq: tuple[str, ...] = ()
    ddq: tuple[str, ...] = ()
    q_ref: tuple[str, ...] = ()
    force: tuple[str, ...] = ()
    regressor: tuple[str, ...] = ()
    rigid: str = ""
    run: str = ""
    split: str = ""
    other: Mapping[str, str] = field(factory=dict, converter=_frozen_map)  # name -> unit

    def numeric(self) -> tuple[str, ...]:
        """Every column that must hold numbers."""
        lists = (self.q, self.tau, self.dq, self.ddq, self.q_ref, self.force, self.regressor, tuple(self.other))
        return (self.time, *(name for names in lists for name in names), *((self.rigid,) if self.rigid else ()))

    def labels(self) -> tuple[str, ...]:
        """The columns that hold labels: run and split."""
        return tuple(name for name in (self.run, self.split) if name)


@frozen
class RecordingDescription:
    """Device, columns, units and scales of a measured file; the default is that of a plain PHANToM recording."""

    device: str = "phantom"
    columns: ColumnNames = field(factory=ColumnNames)
    units: Mapping[str, tuple[str, ...]] = field(factory=dict, converter=_frozen_map)  # role -> unit per column
    scale: Mapping[str, tuple[float, ...]] = field(factory=dict, converter=_frozen_map)  # role -> factor per column
    configuration: str = "UR"
    parameters: str = "fit"  # "fit" | "declared"
    declared_pi: tuple[float, ...] = ()
    joint: str = ""
    gravity: bool = False
    torque_held: bool = False  # tau is a command that is held from its stamp to the next
    coulomb_velocity: float = 0.0  # speed over which the sign of dq is known to be smooth; 0: not known
    source: str = ""

    @property
    def joints(self) -> tuple[str, ...]:
        """Labels of the joints."""
        if self.device == "phantom":
            return ("joint 1", "joint 2", "joint 3")
        return (self.joint or "joint",)

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


def _of(values: tuple, column: int, default):
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


def parse_description(table: Mapping, source: str) -> RecordingDescription:
    """The description that a TOML table holds. Raises InputError with all problems."""
    problems: list[Problem] = []
    _unknown(table, KEYS, source, "key", problems)
    device = _choice(table, "device", DEVICES, "phantom", source, problems)
    columns = _columns(table.get("columns"), source, problems)
    result = RecordingDescription(
        device=device,
        columns=columns,
        units=_per_column(table, "units", columns, str, source, problems),
        scale=_per_column(table, "scale", columns, float, source, problems),
        configuration=_choice(table, "configuration", CONFIGURATIONS, "UR", source, problems),
        parameters=_choice(table, "parameters", ("fit", "declared"), "fit", source, problems),
        declared_pi=_numbers(table.get("declared_pi", ()), f"{source}: declared_pi", problems),
        joint=str(table.get("joint", "")),
        gravity=_boolean(table, "gravity", source, problems),
        torque_held=_boolean(table, "torque_held", source, problems),
        coulomb_velocity=_speed(table, source, problems),
        source=source,
    )
    problems += _inconsistencies(result, table)
    if problems:
        raise InputError(problems)
    return result


def _unknown(table: Mapping, known: tuple[str, ...], where: str, noun: str, problems: list[Problem]) -> None:
    for key in table:
        if key not in known:
            advice = did_you_mean(key, known) or f"known: {', '.join(known)}"
            problems.append(Problem(f"{where}: {key}", f"a known {noun}", repr(key), advice))


def _choice(table: Mapping, key: str, allowed: tuple, default: str, source: str, problems: list[Problem]) -> str:
    value = table.get(key, default)
    if value not in allowed:
        advice = did_you_mean(str(value), allowed)
        problems.append(Problem(f"{source}: {key}", f"one of {', '.join(allowed)}", repr(value), advice))
        return default
    return value


def _boolean(table: Mapping, key: str, source: str, problems: list[Problem]) -> bool:
    value = table.get(key, False)
    if not isinstance(value, bool):
        problems.append(Problem(f"{source}: {key}", "true or false", repr(value)))
    return bool(value)


def _speed(table: Mapping, source: str, problems: list[Problem]) -> float:
    value = table.get("coulomb_velocity", 0.0)
    if not _is_number(value) or value < 0:
        problems.append(Problem(f"{source}: coulomb_velocity", "a speed, 0 or more", repr(value)))
        return 0.0
    return float(value)


def _numbers(values, where: str, problems: list[Problem]) -> tuple[float, ...]:
    if not isinstance(values, list | tuple) or not all(_is_number(value) for value in values):
        problems.append(Problem(where, "a list of numbers", repr(values)))
        return ()
    return tuple(float(value) for value in values)


def _is_number(value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value == value and abs(value) < 1e300


def _columns(table, source: str, problems: list[Problem]) -> ColumnNames:
    """The [columns] table; without one the plain PHANToM names."""
    if table is None:
        return ColumnNames()
    where = f"{source}: [columns]"
    _unknown(table, ROLES, where, "role", problems)
    single = {role: _name(table[role], f"{where}.{role}", problems) for role in SINGLE if role in table}
    lists = {role: _names(table[role], f"{where}.{role}", problems) for role in LISTS if role in table}
    for role in ("q", "tau"):
        if role not in table:
            problems.append(Problem(f"{where}.{role}", "the names of the columns", "nothing"))
    other = table.get("other", {})
    if not isinstance(other, Mapping) or not all(isinstance(unit, str) for unit in other.values()):
        problems.append(Problem(f"{where}.other", "a table name = unit", repr(other)))
        other = {}
    return ColumnNames(**single, **lists, other=other)


def _name(value, where: str, problems: list[Problem]) -> str:
    if not isinstance(value, str) or not value:
        problems.append(Problem(where, "the name of one column", repr(value)))
        return ""
    return value


def _names(value, where: str, problems: list[Problem]) -> tuple[str, ...]:
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        problems.append(Problem(where, "a list of column names", repr(value)))
        return ()
    return tuple(names)


def _per_column(table: Mapping, key: str, columns: ColumnNames, kind, source: str, problems: list[Problem]) -> dict:
    """The [units] or [scale] table as role -> tuple, one value for all columns of the role or one each."""
    found: dict[str, tuple] = {}
    section = table.get(key, {})
    if not isinstance(section, Mapping):
        problems.append(Problem(f"{source}: [{key}]", "a table", repr(section)))
        return found
    _unknown(section, ROLES, f"{source}: [{key}]", "role", problems)
    for role, value in section.items():
        values = value if isinstance(value, list) else [value]
        good = all(isinstance(v, str) if kind is str else _is_number(v) for v in values)
        names = getattr(columns, role, ()) if role in LISTS else (role,)
        if not good or len(values) not in (1, len(names)):
            expected = f"one {'unit' if kind is str else 'number'}, or one for each of the {len(names)} columns"
            problems.append(Problem(f"{source}: [{key}].{role}", expected, repr(value)))
        elif role in ROLES:
            found[role] = tuple(units.spelled(v) if kind is str else float(v) for v in values)
    return found


def _inconsistencies(description: RecordingDescription, table: Mapping) -> list[Problem]:
    """What single keys cannot show: counts of columns, units without a scale, declared parameters."""
    source, columns = description.source, description.columns
    wanted = 3 if description.device == "phantom" else 1
    problems = [
        Problem(f"{source}: [columns].{role}", f"{wanted} column(s) for device {description.device!r}", str(len(names)))
        for role, names in (
            ("q", columns.q),
            ("tau", columns.tau),
            ("dq", columns.dq),
            ("ddq", columns.ddq),
            ("q_ref", columns.q_ref),
        )
        if names and len(names) != wanted
    ]
    if description.device == "regressor" and not (columns.regressor or columns.rigid):
        problems.append(Problem(f"{source}: [columns].regressor", "the regressor columns or a rigid torque", "neither"))
    if description.parameters == "declared" and description.device != "phantom":
        problems.append(
            Problem(
                f"{source}: parameters",
                "'fit', for device 'phantom' also 'declared'",
                f"'declared' for {description.device!r}",
                "a rigid torque that is trusted goes into [columns] rigid of device 'regressor'",
            )
        )
    if description.parameters == "declared" and description.device == "phantom" and "declared_pi" not in table:
        problems.append(Problem(f"{source}: declared_pi", "the 8 trusted parameters", "nothing"))
    if description.declared_pi and len(description.declared_pi) != 8:
        problems.append(Problem(f"{source}: declared_pi", "8 numbers", str(len(description.declared_pi))))
    return problems + _unit_problems(description)


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
