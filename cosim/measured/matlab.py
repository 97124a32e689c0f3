"""MAT files up to version 7 to columns: structs and cells by qualified names; 7.3 is HDF5."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import InputError, Problem
from cosim.measured.arrays import Reader, array_columns, plain
from cosim.measured.hdf5 import MOST_CELLS, OBJECT, read_hdf5
from cosim.measured.table import LazyColumns, RawTable, short_names


def read_matlab(path: Path) -> RawTable:
    """A MAT file, 4 to 7.3: `ur_a.q`, `runs{1}.q`, `runs(2).q`, `q[3]`. Raises InputError."""
    from scipy.io import loadmat

    with path.open("rb") as file:
        head = file.read(520)
    if b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:520]):
        return read_hdf5(path)
    try:
        variables = loadmat(path, squeeze_me=True, chars_as_strings=True)
    except Exception as error:  # noqa: BLE001 - scipy raises many kinds for a damaged file
        got = f"{type(error).__name__}: {str(error)[:200]}"
        raise InputError(Problem(str(path), "a MAT file", got, "is it damaged, or a text table?")) from None
    readers, unread = {}, {}
    for name, value in variables.items():
        if not name.startswith("__"):
            for column, read in _columns(name, np.asarray(value)):
                (unread if isinstance(read, str) else readers)[column] = read
    return RawTable(path, LazyColumns(readers), short=short_names(readers), unread=unread)


def _columns(name: str, value: np.ndarray) -> Iterator[tuple[str, Reader | str]]:
    """Columns of a variable; a text in place of the reader where only MATLAB reads it."""
    from scipy.io.matlab import MatlabFunction, MatlabOpaque

    if isinstance(value, MatlabOpaque) or set(value.dtype.names or ()) == {"s0", "s1", "s2", "arr"}:
        yield _opaque(name, value)
    elif isinstance(value, MatlabFunction):
        yield name, "a function: save its values"
    elif value.dtype.names:
        for where, record in _items(name, value, "({})"):
            for key in value.dtype.names:
                yield from _columns(f"{where}.{key}", np.asarray(record[key]))
    elif value.dtype.kind == "O":
        yield from _cell(name, value)
    elif value.dtype.kind in "US":
        if value.ndim == 1:
            yield name, lambda: plain(value)
    elif value.dtype.kind in "fiub":
        yield from array_columns(name, value.shape, lambda: value)


def _items(name: str, value: np.ndarray, index: str) -> Iterator[tuple[str, Any]]:
    """Elements of an array with MATLAB's linear index; a single one has none."""
    if value.ndim == 0:
        yield name, value[()]
        return
    for k, item in enumerate(value.flatten(order="F")):
        yield name + index.format(k + 1), item


def _cell(name: str, value: np.ndarray) -> Iterator[tuple[str, Reader | str]]:
    words = value.ndim == 1 and value.size and all(isinstance(item, str) for item in value)
    if words:
        yield name, lambda: plain(value)
    elif value.size > MOST_CELLS:
        yield name, f"a cell array of {value.size} cells: save it as arrays"
    else:
        for where, item in _items(name, value, "{{{}}}"):
            yield from _columns(where, np.asarray(item))


def _opaque(name: str, value: np.ndarray) -> tuple[str, str]:
    """The name and class of an object of MATLAB; scipy files all of them under `None`."""
    record = value.reshape(-1)[0]
    own, kind = (_word(record[key]) for key in ("s0", "s2"))
    return own or name, OBJECT.format(kind=kind or "object")


def _word(value) -> str:
    text = np.asarray(value).reshape(-1)[0] if np.asarray(value).size else ""
    return text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
