"""NPZ and NPY of numpy to columns."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cosim.errors import InputError, Problem
from cosim.measured.arrays import Reader, array_columns
from cosim.measured.table import LazyColumns, RawTable, short_names


def read_npz(path: Path) -> RawTable:
    """Arrays of an NPZ file by their names, or the fields of a structured NPY. Raises InputError."""
    with path.open("rb") as file:
        if file.read(6) == b"\x93NUMPY":
            return _single(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            names = archive.files
    except (OSError, ValueError, EOFError) as error:
        raise InputError(Problem(str(path), "an NPZ file", str(error)[:200])) from None
    readers: dict[str, Reader] = {}
    unread: dict[str, str] = {}
    for name in names:
        try:
            readers |= dict(_columns(name, _shape(path, name), lambda name=name: _array(path, name)))
        except (OSError, ValueError, EOFError) as error:
            unread[name] = f"not readable ({str(error)[:80]}): save it as an array of numbers"
    return RawTable(path, LazyColumns(readers), short=short_names(readers), unread=unread)


def _single(path: Path) -> RawTable:
    try:
        array = np.load(path, allow_pickle=False, mmap_mode="r")
    except (OSError, ValueError, EOFError) as error:
        raise InputError(Problem(str(path), "an NPY file", str(error)[:200])) from None
    readers = dict(_columns(path.stem, array, lambda: array))
    return RawTable(path, LazyColumns(readers), short=short_names(readers))


def _array(path: Path, name: str) -> np.ndarray:
    try:
        with np.load(path, allow_pickle=False) as file:
            return file[name]
    except (OSError, ValueError, EOFError, KeyError) as error:
        raise InputError(Problem(f"{path}: {name}", "an array that can be read", str(error)[:200])) from None


def _shape(path: Path, name: str) -> np.ndarray:
    """An array without data that has the shape and type of the one in the archive."""
    from zipfile import ZipFile

    with ZipFile(path) as archive, archive.open(f"{name}.npy") as file:
        version = np.lib.format.read_magic(file)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = header(file)
    if kind.hasobject:
        raise ValueError("an array of Python objects")
    return np.broadcast_to(np.zeros((), kind), shape)


def _columns(name: str, like: np.ndarray, read: Reader) -> Iterator[tuple[str, Reader]]:
    if not like.dtype.names:
        yield from array_columns(name, like.shape, read)
        return
    for field in like.dtype.names:
        yield from array_columns(f"{name}.{field}", like[field].shape, lambda field=field: read()[field])
