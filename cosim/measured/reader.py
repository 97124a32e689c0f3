"""Measured files to plain columns: CSV, Parquet, MAT and our own result.h5."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from attrs import frozen

from cosim.errors import InputError, Problem, did_you_mean
from cosim.measured.description import RecordingDescription

if TYPE_CHECKING:
    from pyarrow import ChunkedArray, Table

SUFFIXES = (".csv", ".txt", ".tsv", ".parquet", ".mat", ".h5", ".hdf5")


@frozen(eq=False)
class RawTable:
    """Columns of one file as they stand: numbers (n,) float64 or labels (n,) str."""

    path: Path
    columns: Mapping[str, np.ndarray]
    warnings: tuple[str, ...] = ()


def read_table(path: Path | str) -> RawTable:
    """All columns of a file. Raises InputError with the file's name where it cannot be read."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(Problem(str(path), f"a file of {', '.join(SUFFIXES)}", repr(path.suffix)))
    if not path.is_file():
        near = did_you_mean(path.name, [p.name for p in path.parent.glob("*")]) if path.parent.is_dir() else ""
        raise InputError(Problem(str(path), "a file", "nothing there", near))
    if path.stat().st_size == 0:
        raise InputError(Problem(str(path), "data", "an empty file"))
    kind = path.suffix.lower()
    if kind == ".parquet":
        return _parquet(path)
    if kind == ".mat":
        return _mat(path)
    return _result(path) if kind in (".h5", ".hdf5") else _csv(path)


def needed(table: RawTable, description: RecordingDescription) -> dict[str, np.ndarray]:
    """The columns that the description names, numbers as float64. Raises InputError with every problem."""
    wanted, problems, found = description.columns, [], {}
    missing = [name for name in (*wanted.numeric(), *wanted.labels()) if name not in table.columns]
    if missing:
        raise InputError(_missing(table, missing))
    for name in wanted.labels():
        found[name] = table.columns[name].astype(str)
    for name in wanted.numeric():
        found[name] = _numbers(table, name, problems)
    if problems:
        raise InputError(problems)
    return found


def _missing(table: RawTable, names: list[str]) -> Problem:
    near = [text for name in names if (text := did_you_mean(name, table.columns))]
    advice = f"the file has: {', '.join(list(table.columns)[:24])}" if len(near) < len(names) else "; ".join(near)
    beside = sorted(p.name for p in table.path.parent.glob("*.toml") if p.stem != table.path.stem)
    if beside and not table.path.with_suffix(".toml").exists():
        advice += f"; is its description one of {', '.join(beside[:4])}? (--description)"
    return Problem(f"{table.path}", f"the columns {', '.join(names)}", "a file without them", advice)


def _numbers(table: RawTable, name: str, problems: list[Problem]) -> np.ndarray:
    """Column as float64; text that is no number is named with its row (counted from 1 below the header)."""
    column = table.columns[name]
    if column.dtype.kind == "f":
        return column
    values = np.empty(len(column))
    for row, text in enumerate(column):
        try:
            values[row] = float(text) if text.strip() else np.nan
        except ValueError:
            advice = "a decimal comma? write a point" if "," in text else "remove the row or leave the cell empty"
            problems.append(
                Problem(f"{table.path}: column {name!r}, row {row + 1}", "a number", repr(str(text)), advice)
            )
            return values
    return values


def _csv(path: Path) -> RawTable:
    from pyarrow import ArrowException, csv

    delimiter, skipped, warnings = _layout(path)
    try:
        read = csv.read_csv(
            path,
            read_options=csv.ReadOptions(skip_rows=skipped),
            parse_options=csv.ParseOptions(delimiter=delimiter, ignore_empty_lines=True),
            convert_options=csv.ConvertOptions(strings_can_be_null=True),
        )
    except ArrowException as error:
        raise InputError(Problem(str(path), "a table of equal rows", str(error).splitlines()[0])) from None
    return _from_arrow(path, read, warnings)


def _layout(path: Path) -> tuple[str, int, tuple[str, ...]]:
    """Delimiter and the number of comment lines above the header."""
    with path.open(encoding="utf-8", errors="replace") as lines:
        head = [line for line, _ in zip(lines, range(50), strict=False)]
    skipped = next((row for row, line in enumerate(head) if line.strip() and line[0] not in "#%"), len(head))
    header = head[skipped] if skipped < len(head) else ""
    delimiter = max(",;\t", key=header.count)
    cells = [cell.strip() for cell in header.split(delimiter)]
    if all(_is_number(cell) for cell in cells if cell):
        raise InputError(
            Problem(f"{path}: line {skipped + 1}", "names of the columns", header.strip()[:60], "add a header line")
        )
    notes = [f"{path.name}: {skipped} comment lines above the header skipped"] if skipped else []
    return delimiter, skipped, tuple(notes)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _parquet(path: Path) -> RawTable:
    from pyarrow import ArrowException, parquet

    try:
        return _from_arrow(path, parquet.read_table(path), ())
    except (ArrowException, OSError) as error:
        raise InputError(Problem(str(path), "a Parquet file", str(error).splitlines()[0])) from None


def _from_arrow(path: Path, table: Table, warnings: tuple[str, ...]) -> RawTable:
    names = [name.strip().lstrip("\ufeff") for name in table.column_names]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(Problem(str(path), "each column once", f"twice: {', '.join(twice)}"))
    if table.num_rows == 0:
        raise InputError(Problem(str(path), "rows of data", "a header only"))
    return RawTable(path, {name: _array(column) for name, column in zip(names, table.columns, strict=True)}, warnings)


def _array(column: ChunkedArray) -> np.ndarray:
    """Arrow column to float64 (empty cell: NaN) or, where it is no number, to str."""
    from pyarrow import float64, types

    if types.is_boolean(column.type) or types.is_integer(column.type) or types.is_floating(column.type):
        return column.cast(float64()).to_numpy().astype(float)
    if types.is_null(column.type):
        return np.full(len(column), np.nan)
    return np.array(["" if value is None else str(value) for value in column.to_pylist()])


def _mat(path: Path) -> RawTable:
    from scipy.io import loadmat

    try:
        variables = loadmat(path, squeeze_me=True, chars_as_strings=True)
    except NotImplementedError:
        raise InputError(Problem(str(path), "a MAT file up to version 7", "version 7.3", "save it with -v7")) from None
    except Exception as error:  # noqa: BLE001 - scipy raises many kinds for a damaged file
        raise InputError(Problem(str(path), "a MAT file", f"{type(error).__name__}: {error}")) from None
    columns: dict[str, np.ndarray] = {}
    for name, value in variables.items():
        if not name.startswith("__"):
            _flatten(name, np.asarray(value), columns)
    lengths = {len(column) for column in columns.values()}
    rows = max(lengths, default=0)
    return RawTable(path, {name: column for name, column in columns.items() if len(column) == rows})


def _flatten(name: str, value: np.ndarray, columns: dict[str, np.ndarray]) -> None:
    """A MATLAB variable as columns: struct fields by their own names, (n, k) matrices as name1 .. namek."""
    if value.dtype.names:
        for key in value.dtype.names:
            _flatten(key, np.asarray(value[key].item() if value.ndim == 0 else value[key]), columns)
    elif value.ndim == 1 and value.dtype.kind in "fiub":
        columns[name] = value.astype(float)
    elif value.ndim == 1 and value.dtype.kind in "UO":
        columns[name] = value.astype(str)
    elif value.ndim == 2 and value.dtype.kind in "fiub":
        tall = value if value.shape[0] >= value.shape[1] else value.T
        for column in range(tall.shape[1]):
            columns[f"{name}{column + 1}"] = tall[:, column].astype(float)


def _result(path: Path) -> RawTable:
    """A result.h5 of this project (layout: cosim.results.files): its signals under their own names."""
    import json

    import h5py

    columns: dict[str, np.ndarray] = {}
    try:
        with h5py.File(path, "r") as file:

            def collect(place: str, data: h5py.Group | h5py.Dataset) -> None:
                if isinstance(data, h5py.Dataset):
                    component, _, _ = place.partition("/")
                    names = json.loads(str(data.attrs["elements"]))
                    columns.update(
                        {f"{component}.{name}": np.asarray(data[:, k], float) for k, name in enumerate(names)}
                    )

            columns["time"] = np.asarray(file["time"], float)
            signals = file["signals"]
            if isinstance(signals, h5py.Group):
                signals.visititems(collect)
            order = json.loads(str(file.attrs["signals"]))
    except (OSError, KeyError) as error:
        raise InputError(Problem(str(path), "a result.h5 of `cosim run`", str(error))) from None
    return RawTable(path, {name: columns[name] for name in ("time", *order)})
