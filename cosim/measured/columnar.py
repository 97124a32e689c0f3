"""Parquet and Feather (Arrow IPC) to columns: names from the schema, values of a column when it is asked for."""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np

from cosim.errors import InputError, Problem
from cosim.measured.arrow import arrow_values
from cosim.measured.content import ARROW
from cosim.measured.table import WIDEST, LazyColumns, RawTable, elements, short_names

Load = Callable[[], object]  # an arrow ChunkedArray


def read_columnar(path: Path, kind: str) -> RawTable:
    """A Parquet or Feather file. Raises InputError where it is none; a column that is not used is not read."""
    from pyarrow import ArrowException

    try:
        source = _Feather(path) if kind == ARROW else _Parquet(path)
        if source.rows == 0:
            raise InputError(Problem(str(path), "rows of data", "a header only"))
        return _table(path, source)
    except (ArrowException, OSError, ValueError) as error:
        raise InputError(Problem(str(path), f"a {kind} file", _first_line(error))) from None


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:300]


class _Parquet:
    """Columns of a Parquet file by position."""

    def __init__(self, path: Path) -> None:
        from pyarrow.parquet import ParquetFile

        self._path = path
        with ParquetFile(path) as file:
            self.schema, self.rows = file.schema_arrow, file.metadata.num_rows

    def column(self, k: int):
        """All rows of column k."""
        from pyarrow.parquet import ParquetFile

        with ParquetFile(self._path) as file:
            return self._picked(file.read(columns=[self.schema.names[k]]), k)

    def beginning(self, k: int):
        """The first rows of column k."""
        from pyarrow import Table
        from pyarrow.parquet import ParquetFile

        with ParquetFile(self._path) as file:
            batch = next(file.iter_batches(64, columns=[self.schema.names[k]]))
            return self._picked(Table.from_batches([batch]), k)

    def _picked(self, table, k: int):
        same = self.schema.names[:k].count(self.schema.names[k])
        return table.column([i for i, name in enumerate(table.schema.names) if name == self.schema.names[k]][same])


class _Feather:
    """Columns of a Feather file (Arrow IPC, or version 1) by position; uncompressed ones stay on the disk."""

    def __init__(self, path: Path) -> None:
        from pyarrow import feather

        self._table = feather.read_table(path, memory_map=True)
        self.schema, self.rows = self._table.schema, self._table.num_rows

    def column(self, k: int):
        """All rows of column k."""
        return self._table.column(k)

    def beginning(self, k: int):
        """The first rows of column k."""
        return self._table.column(k).slice(0, 64)


def _table(path: Path, source) -> RawTable:
    readers: dict[str, Callable[[], np.ndarray]] = {}
    unread: dict[str, str] = {}
    said: dict[str, str] = {}
    nested: list[str] = []
    names = source.schema.names
    for k, column in enumerate(source.schema):
        name = f"{column.name} (column {k + 1})" if names.count(column.name) > 1 else column.name.strip()
        found = list(_flat(path, name, column.type, _Column(source, k)))
        for flat, read in found:
            if isinstance(read, str):
                unread[flat] = read
            else:
                readers[flat] = read
        nested += [flat for flat, read in found if flat != name and not isinstance(read, str)]
        said |= _unit(name, column.metadata)
    twice = {
        name: tuple(n for n in readers if n.startswith(f"{name} (column ")) for name in names if names.count(name) > 1
    }
    return RawTable(path, LazyColumns(readers), units=said, short=short_names(nested) | twice, unread=unread)


class _Column:
    """One top column: its rows, and its first rows to see how wide a list is."""

    def __init__(self, source, k: int) -> None:
        self.all = lambda: source.column(k)
        self.beginning = lambda: source.beginning(k)

    def field(self, k: int) -> "_Column":
        """The same for field k of a struct."""
        inner = _Column.__new__(_Column)
        inner.all = lambda: self.all().flatten()[k]
        inner.beginning = lambda: self.beginning().flatten()[k]
        return inner


def _unit(name: str, metadata) -> dict[str, str]:
    found = next((metadata[key] for key in (b"unit", b"units") if metadata and key in metadata), b"")
    return {name: found.decode("utf-8", "replace")} if found else {}


def _flat(path: Path, name: str, kind, column: _Column) -> Iterator[tuple[str, Callable[[], np.ndarray] | str]]:
    """Columns of one type: fields of structs as `a.b`, elements of lists as `a[1]`; a text where it is not read."""
    from pyarrow import types

    if types.is_struct(kind):
        for k, inner in enumerate(kind):
            yield from _flat(path, f"{name}.{inner.name}", inner.type, column.field(k))
    elif types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        yield from _vector(path, name, kind, column)
    elif types.is_nested(kind) or types.is_binary(kind) or types.is_large_binary(kind):
        yield name, f"{kind} holds no numbers"
    else:
        yield name, lambda: _told(path, name, lambda: arrow_values(column.all()))


def _told(path: Path, name: str, read: Callable[[], np.ndarray]) -> np.ndarray:
    """A column that cannot be read is named."""
    from pyarrow import ArrowException

    try:
        return read()
    except (ArrowException, OSError) as error:
        raise InputError(Problem(f"{path}: column {name!r}", "a column that can be read", _first_line(error))) from None


def _vector(path: Path, name: str, kind, column: _Column) -> Iterator[tuple[str, Callable[[], np.ndarray] | str]]:
    """A list in every row, as one column an element; rows with fewer elements are NaN there."""
    from pyarrow import types

    inner = kind.value_type
    if not (types.is_integer(inner) or types.is_floating(inner) or types.is_boolean(inner)):
        yield name, f"lists of {inner} hold no numbers"
        return
    fixed = kind.list_size if types.is_fixed_size_list(kind) else _width(column.beginning())
    if fixed > WIDEST:
        yield name, f"lists of {fixed} elements are wider than {WIDEST}"
        return
    width = fixed if types.is_fixed_size_list(kind) else _width(column.all())

    @cache
    def matrix() -> np.ndarray:
        return _told(path, name, lambda: _matrix(column.all(), width))

    for k, element in enumerate(elements(name, width)):
        yield element, lambda k=k: matrix()[:, k]


def _lengths(column) -> np.ndarray:
    """Elements in each row of a list column; none where it is null."""
    from pyarrow import types

    parts = [np.zeros(0, int)]
    for chunk in column.chunks:
        if types.is_fixed_size_list(chunk.type):
            parts.append(np.where(chunk.is_null().to_numpy(zero_copy_only=False), 0, chunk.type.list_size))
        else:
            parts.append(chunk.value_lengths().fill_null(0).to_numpy())
    return np.concatenate(parts)


def _width(column) -> int:
    return int(_lengths(column).max(initial=0))


def _matrix(column, width: int) -> np.ndarray:
    """Rows of a list column as (n, width), column by column in memory."""
    from pyarrow import chunked_array

    lengths = _lengths(column)
    flat = chunked_array([chunk.flatten() for chunk in column.chunks], column.type.value_type)
    matrix = np.full((len(lengths), width), np.nan, order="F")
    matrix[np.arange(width) < lengths[:, None]] = np.asarray(arrow_values(flat), float)
    return matrix
