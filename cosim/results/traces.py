"""Signals over time to be compared: of a run of ours, or of a file that another tool has written."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from attrs import field, frozen

from cosim.engine.master import Result
from cosim.errors import InputError, Problem
from cosim.measured import units as known_units
from cosim.measured.layout import unit_in
from cosim.measured.reader import read_table
from cosim.signals import plain_unit

_NUMBER = " [1]"
"""What a plain number has in place of a unit, in our own tables."""
_TIMES = ("time", "Time", "t", "time_s", "timestamp")


@frozen(eq=False)
class Traces:
    """Signals (n,) over time (n,) [s] with their units, "" where none is known; what the reader of them was told."""

    name: str
    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    notes: tuple[str, ...] = field(default=(), converter=tuple)

    @classmethod
    def of(cls, name: str, result: Result) -> "Traces":
        """Those of a run."""
        return cls(name, result.time, result.signals, result.units)


def read_traces(path: Path) -> Traces:
    """The signals of a file of another tool: CSV, Parquet, MAT and what else `cosim.read` reads.

    Its time column is called time or t, or is the first one. A unit stands in the name, `x [mm]`, or beside it.
    Raises InputError.
    """
    table = read_table(path)
    columns = list(table.columns)
    bare = {column: unit_in(column)[0].removesuffix(_NUMBER) for column in columns}
    clock = next((c for name in _TIMES for c in columns if bare[c] == name), columns[0] if columns else None)
    if clock is None or len(columns) < 2:
        raise InputError(Problem(str(path), "a time column and signals", f"{len(columns)} columns"))
    units = {column: table.units.get(column) or unit_in(column)[1] for column in columns}
    time, notes = _numbers(table.columns[clock]), list(table.warnings)
    if time is None or not np.isfinite(time).all() or (np.diff(time) < 0).any():
        raise InputError(Problem(f"{path}: {clock}", "finite numbers in rising order", "others"))
    time = time * _factor(units[clock], "s", str(path))
    signals: dict[str, np.ndarray] = {}
    for column in columns:
        values = _numbers(table.columns[column]) if column != clock else None
        if values is not None and len(values) == len(time):
            signals[bare[column]] = values
        elif column != clock:
            notes.append(f"{path.name}: {column} is left out: no numbers over {clock}")
    named = {bare[column]: units[column] for column in columns if bare[column] in signals}
    return Traces(path.stem, time, signals, named, notes)


def _numbers(values: np.ndarray) -> np.ndarray | None:
    array = np.asarray(values)
    return array.astype(float) if array.dtype.kind in "fiub" else None


def _factor(unit: str, wanted: str, where: str) -> float:
    """The factor from one unit to another. Raises InputError where they measure different things."""
    if not unit or not wanted or plain_unit(unit) == plain_unit(wanted):
        return 1.0
    (base, one), (other, two) = (known_units.FACTORS.get(u, (u, 1.0)) for u in (unit, wanted))
    if plain_unit(base) != plain_unit(other):
        raise InputError(Problem(where, f"the unit {wanted}", unit, "signals of different units are not compared"))
    return one / two


@frozen(eq=False)
class MatchedSignal:
    """A signal of a reference and the one of another set that is compared with it, in the unit of the reference."""

    name: str
    theirs: str
    reference: np.ndarray
    values: np.ndarray
    unit: str


def matched(reference: Traces, other: Traces) -> tuple[list[MatchedSignal], list[str]]:
    """Signals of the same name, or of the one name that ends in it (`model.root.arm_l.x[1]`); and notes on the rest.

    Raises InputError where no signal is in both, or units do not fit.
    """
    found, notes, missing = [], [], []
    for name, values in reference.signals.items():
        theirs = _called(name, other)
        if theirs is None:
            missing.append(name)
            continue
        ours, unit = reference.units.get(name, ""), other.units.get(theirs, "")
        factor = _factor(unit, ours, f"{other.name}: {theirs}")
        if factor != 1.0:
            notes.append(f"{theirs} of {other.name} converted from {unit} to {ours}")
        found.append(
            MatchedSignal(
                name, theirs, values, other.signals[theirs] * factor if factor != 1.0 else other.signals[theirs], ours
            )
        )
    if not found:
        some = ", ".join(list(other.signals)[:5])
        raise InputError(
            Problem(other.name, f"signals of {reference.name}, such as {missing[0] if missing else '-'}", some)
        )
    taken = {match.theirs for match in found}
    notes += _told(missing, f"only in {reference.name}") + _told(
        [n for n in other.signals if n not in taken], f"only in {other.name}"
    )
    return found, notes


def _called(name: str, other: Traces) -> str | None:
    if name in other.signals:
        return name
    ending = [n for n in other.signals if n.endswith(f".{name}")]
    return ending[0] if len(ending) == 1 else None


def _told(names: list[str], what: str) -> list[str]:
    return (
        [f"{what}: {', '.join(names[:12])}{f' and {len(names) - 12} more' if len(names) > 12 else ''}"] if names else []
    )
