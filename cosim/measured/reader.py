"""One door for measured files of every kind: the file's columns, and those that a description or a scenario names."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.errors import InputError, Problem
from cosim.measured import content, units
from cosim.measured.alignment import aligned
from cosim.measured.pairs import with_joined_stamps
from cosim.measured.stamps import StampUnit, check_step, origin, seconds, typical_step
from cosim.measured.table import RawTable

if TYPE_CHECKING:
    from cosim.measured.description import RecordingDescription

Note = Callable[[str], None]


def read_table(path: Path | str) -> RawTable:
    """All columns of a file, by its content and then its suffix. Raises InputError where it cannot be read."""
    path = Path(path)
    kind = content.kind_of(path)
    table = with_joined_stamps(_reader(kind)(path))
    if not len(table.columns):
        held = "; ".join(f"{thing}: {why}" for thing, why in table.unread.items())
        raise InputError(Problem(str(path), "columns of numbers", f"{content.article(kind)} file without any", held))
    return table


def _reader(kind: str) -> Callable[[Path], RawTable]:
    """The reader of a kind of file, imported when it is needed."""
    if kind == content.TEXT:
        from cosim.measured.text import read_text

        return read_text
    if kind in (content.PARQUET, content.ARROW):
        from cosim.measured.columnar import read_columnar

        return lambda path: read_columnar(path, kind)
    if kind == content.MATLAB:
        from cosim.measured.matlab import read_matlab

        return read_matlab
    if kind == content.HDF5:
        from cosim.measured.hdf5 import read_hdf5

        return read_hdf5
    if kind == content.NPZ:
        from cosim.measured.npz import read_npz

        return read_npz
    if kind == content.MDF:
        from cosim.measured.mdf import read_mdf

        return read_mdf
    from cosim.measured.ros import read_ros

    return lambda path: read_ros(path, kind)


def needed(table: RawTable, description: "RecordingDescription", note: Note) -> dict[str, np.ndarray]:
    """The columns that the description names: time in seconds, numbers as float64, labels as text.

    A signal whose own unit the file names and the description does not is converted to SI, and told.
    Raises InputError with every problem.
    """
    names = description.columns
    time = _time_column(table, names.time, names.q)
    wanted = {name: name for name in (*names.labels(), *names.numeric()) if name != names.time} | {names.time: time}
    unit = StampUnit(_first(description.units.get("time")), scale=_first(description.scale.get("time"), 1.0))
    found = columns(table, wanted, names.time, unit, note)
    check_step(found[names.time], table.columns[table.find(time)], f"{table.path.name}: {time}")
    for name in names.labels():
        found[name] = found[name].astype(str)
    problems: list[Problem] = []
    for name in names.numeric():
        if name != names.time:
            found[name] = _numbers(table, name, found[name], problems)
    found |= _in_si(table, description, found, problems, note)
    if problems:
        raise InputError(problems)
    return found


def signals(path: Path, time: str, names: Sequence[str], note: Note) -> tuple[np.ndarray, np.ndarray]:
    """Time (n,) [s] and the named columns (n, k) of a file, as a scenario plays them. Raises InputError."""
    table = read_table(path)
    for told in table.warnings:
        note(told)
    found = columns(table, {name: name for name in (time, *names)}, time, StampUnit(), note)
    problems: list[Problem] = []
    numbers = [_numbers(table, name, found[name], problems) for name in names]
    if problems:
        raise InputError(problems)
    return found[time], np.column_stack(numbers)


def columns(
    table: RawTable, wanted: Mapping[str, str], time: str, unit: StampUnit, note: Note
) -> dict[str, np.ndarray]:
    """Columns by the names that they were asked by, all on the stamps of `time`, which becomes seconds."""
    whole = _found(table, wanted)
    unit = StampUnit(unit.described, _told_unit(table, whole[time]), unit.scale)
    raw = table.columns[whole[time]]
    where = f"{table.path.name}: {whole[time]}"
    stamps = seconds(raw, unit, where, note)
    result = {}
    for name, column in whole.items():
        if name == time:
            result[name] = stamps
        elif _clock(table, column) == _clock(table, whole[time]):
            result[name] = table.columns[column]
        else:
            result[name] = _on_stamps(table, column, stamps, raw, note)
    _same_length(table, result, whole, time)
    return result


def _found(table: RawTable, wanted: Mapping[str, str]) -> dict[str, str]:
    """The whole name of each column; all that are missing are one problem."""
    problems, missing, whole = [], [], {}
    for asked, name in wanted.items():
        try:
            whole[asked] = table.find(name)
        except InputError as error:
            if name in table.short:
                problems += error.problems
            else:
                missing.append(name)
    problems += [table.missing(missing)] if missing else []
    if problems:
        raise InputError(problems)
    return whole


def _time_column(table: RawTable, time: str, q: Sequence[str]) -> str:
    """The time column; where none or several have its name, the stamps of the first position where it has its own."""
    first = (q[0],) if q and q[0] in table.columns else table.short.get(q[0], ()) if q else ()
    if time in table.columns or len(table.short.get(time, ())) == 1 or len(first) != 1:
        return time
    return table.clocks.get(first[0], time)


def _clock(table: RawTable, column: str) -> str:
    return table.clocks.get(column, "")


def _told_unit(table: RawTable, column: str) -> str:
    unit = units.spelled(table.units.get(column, ""))
    return unit if units.FACTORS.get(unit, ("", 0))[0] == "s" else ""


def _on_stamps(table: RawTable, column: str, stamps: np.ndarray, raw: np.ndarray, note: Note) -> np.ndarray:
    """A column of another topic, read at the stamps of the time column."""
    clock = table.clocks.get(column)
    if clock is None:
        return table.columns[column]
    own = table.columns[clock]
    told = StampUnit(told=_told_unit(table, clock))
    times = seconds(own, told, f"{table.path.name}: {clock}", lambda _: None, start=origin(raw))
    ours, theirs = typical_step(stamps), typical_step(times)
    rates = f"{1 / theirs:.6g} Hz to {1 / ours:.6g} Hz" if ours and theirs else "its own stamps"
    note(
        f"{table.path.name}: {column} brought from {rates} by linear interpolation between its stamps, without a filter"
    )
    return aligned(table.columns[column], times, stamps)


def _same_length(table: RawTable, found: Mapping[str, np.ndarray], whole: Mapping[str, str], time: str) -> None:
    rows = len(found[time])
    other = [f"{whole[name]} {len(values)}" for name, values in found.items() if len(values) != rows]
    if other:
        expected = f"{rows} rows, as {whole[time]} has"
        advice = "columns of one recording have one length; name those that belong together"
        raise InputError(Problem(str(table.path), expected, ", ".join(other), advice))


def _numbers(table: RawTable, name: str, column: np.ndarray, problems: list[Problem]) -> np.ndarray:
    """Column as float64; text that is no number is named with its row (counted from 1 below the header)."""
    if column.dtype.kind in "fiub":
        return np.asarray(column, float)
    where = f"{table.path}: column {name!r}"
    if column.dtype.kind in "Mm":
        problems.append(Problem(where, "numbers", "dates", "only the time column may hold dates"))
        return np.empty(len(column))
    values = np.empty(len(column))
    for row, text in enumerate(column.tolist()):
        try:
            values[row] = float(text) if text.strip() else np.nan
        except ValueError:
            advice = "a decimal comma? write a point" if "," in text else "remove the row or leave the cell empty"
            if text.lstrip().startswith("["):
                advice = "a list in one cell: write a column for each of its elements"
            problems.append(Problem(f"{where}, row {row + 1}", "a number", repr(str(text)), advice))
            return values
    return values


def _in_si(
    table: RawTable,
    description: "RecordingDescription",
    found: Mapping[str, np.ndarray],
    problems: list[Problem],
    note: Note,
) -> dict[str, np.ndarray]:
    """Signals whose unit the file names and the description leaves open, in the SI unit of their role."""
    result = {}
    for role in ("q", "tau", "dq", "ddq", "q_ref", "force"):
        if role in description.units:
            continue
        wanted = description.si.get(role, "N" if role == "force" else "")
        for name in getattr(description.columns, role):
            unit = units.spelled(table.units.get(table.find(name), ""))
            si, factor = units.FACTORS.get(unit, ("", 1.0))
            if unit == wanted or not units.known(unit):
                continue
            if role in description.scale:
                note(f"{table.path.name}: {name} in {unit}, as the file says: [scale] {role} alone is applied")
                continue
            if si != wanted:
                advice = f'say [units] {role} = "{unit}"' + ("" if si else f" and [scale] {role}")
                problems.append(
                    Problem(f"{table.path}: column {name!r}", wanted, f"{unit!r}, as the file says", advice)
                )
                continue
            note(f"{table.path.name}: {name} in {unit}, as the file says: converted to {wanted}")
            result[name] = found[name] * factor
    return result


def _first(values: Sequence[Any] | None, default: Any = "") -> Any:
    return values[0] if values else default
