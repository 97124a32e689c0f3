"""Which column of a measured file holds what: the [columns] table of a description."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TypeVar

from attrs import field, frozen

from cosim.errors import Problem
from cosim.measured.fields import unknown_names
from cosim.measured.mounted import RECORDED

SINGLE = ("time", "run", "split", "rigid", "supply", *RECORDED)
LISTS = ("q", "tau", "dq", "ddq", "q_ref", "force", "regressor")
ROLES = (*SINGLE, *LISTS, "other")
Value = TypeVar("Value")


def frozen_map(values: Mapping[str, Value]) -> Mapping[str, Value]:
    """A copy that nothing can change."""
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
    supply: str = ""
    mass: str = ""
    length: str = ""
    inertia: str = ""
    angle: str = ""
    other: Mapping[str, str] = field(factory=dict, converter=frozen_map)  # name -> unit

    def of_role(self, role: str) -> tuple[str, ...]:
        """The columns of one of the `LISTS`."""
        return getattr(self, role)

    def single(self, role: str) -> str:
        """The column of one of the `SINGLE` roles; empty where there is none."""
        return getattr(self, role)

    def numeric(self) -> tuple[str, ...]:
        """Every column that must hold numbers."""
        names = [name for role in LISTS for name in self.of_role(role)]
        single = [name for role in SINGLE if role not in ("time", "run", "split") and (name := self.single(role))]
        return (self.time, *names, *self.other, *single)

    def labels(self) -> tuple[str, ...]:
        """The columns that hold labels: run and split."""
        return tuple(name for name in (self.run, self.split) if name)


def read_columns(table: object, source: str, problems: list[Problem], servo: bool = False) -> ColumnNames:
    """The [columns] table; without one the names of a plain PHANToM recording. What is wrong is appended.

    servo: tau is made of q_ref and q.
    """
    if table is None:
        return ColumnNames()
    where = f"{source}: [columns]"
    if not isinstance(table, Mapping):
        problems.append(Problem(where, "a table", repr(table)))
        return ColumnNames()
    unknown_names(table, ROLES, where, "role", problems)
    single = {role: _name(table[role], f"{where}.{role}", problems) for role in SINGLE if role in table}
    lists = {role: _names(table[role], f"{where}.{role}", problems) for role in LISTS if role in table}
    needed = ("q", "q_ref") if servo else ("q", "tau")
    problems += [
        Problem(f"{where}.{role}", "the names of the columns", "nothing") for role in needed if role not in table
    ]
    if servo and "tau" in table:
        advice = "leave [servo] or tau out"
        problems.append(Problem(f"{where}.tau", "none beside [servo], which makes it", repr(table["tau"]), advice))
    plain = ColumnNames()
    return ColumnNames(
        time=single.get("time", plain.time),
        run=single.get("run", ""),
        split=single.get("split", ""),
        rigid=single.get("rigid", ""),
        supply=single.get("supply", ""),
        mass=single.get("mass", ""),
        length=single.get("length", ""),
        inertia=single.get("inertia", ""),
        angle=single.get("angle", ""),
        q=lists.get("q", plain.q),
        tau=() if servo else lists.get("tau", plain.tau),
        dq=lists.get("dq", ()),
        ddq=lists.get("ddq", ()),
        q_ref=lists.get("q_ref", ()),
        force=lists.get("force", ()),
        regressor=lists.get("regressor", ()),
        other=_units(table.get("other", {}), f"{where}.other", problems),
    )


def _units(table: object, where: str, problems: list[Problem]) -> Mapping[str, str]:
    if isinstance(table, Mapping) and all(isinstance(unit, str) for unit in table.values()):
        return table
    problems.append(Problem(where, "a table name = unit", repr(table)))
    return {}


def _name(value: object, where: str, problems: list[Problem]) -> str:
    if not isinstance(value, str) or not value:
        problems.append(Problem(where, "the name of one column", repr(value)))
        return ""
    return value


def _names(value: object, where: str, problems: list[Problem]) -> tuple[str, ...]:
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        problems.append(Problem(where, "a list of column names", repr(value)))
        return ()
    return tuple(names)
