"""HDF5 to columns by paths: our own result.h5, files of laboratories, and MAT 7.3, which is HDF5 in MATLAB's way."""

import json
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import InputError, Problem
from cosim.measured.arrays import array_columns, plain
from cosim.measured.table import LazyColumns, RawTable, short_names

Reader = Callable[[], np.ndarray]
MOST_CELLS = 256  # cells of a cell array that are looked into; longer ones are lists of words
OBJECT = (
    "a {kind}, which only MATLAB opens: there, writetable(x, 'x.csv') of a table, writetimetable(x, 'x.csv') of a "
    "timetable, or save -v7 of its columns as arrays"
)


def read_hdf5(path: Path) -> RawTable:
    """An HDF5 file by the paths of its arrays, `/robot/q[1]`. Raises InputError."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            if "signals" in file.attrs and "time" in file and "signals" in file:
                return _result(path, file)
            return _matlab(path, file) if _is_matlab(file) else _paths(path, file)
    except (OSError, KeyError, RuntimeError, ValueError, TypeError) as error:
        raise InputError(Problem(str(path), "an HDF5 file", str(error)[:300])) from None


def _result(path: Path, file) -> RawTable:
    """A result.h5 of this project (layout: cosim.results.files): its signals under their own names."""
    readers = {"time": _dataset(path, "time")}
    for component, variables in file["signals"].items():
        for data in variables.values():
            names, read = json.loads(data.attrs["elements"]), cache(_dataset(path, data.name))
            if data.shape[1:] != (len(names),):
                raise KeyError(f"{data.name}: {len(names)} names for columns of shape {data.shape}")
            for k, name in enumerate(names):
                readers[f"{component}.{name}"] = lambda read=read, k=k: np.asarray(read()[:, k], float)
    order = json.loads(file.attrs["signals"])
    return RawTable(path, LazyColumns({name: readers[name] for name in ("time", *order)}))


def _dataset(path: Path, name: str) -> Reader:
    """Reads one array when it is asked for."""

    def read() -> np.ndarray:
        import h5py

        try:
            with h5py.File(path, "r") as file:
                thing: Any = file[name]
                return np.asarray(thing[()])
        except (OSError, KeyError, RuntimeError) as error:
            raise InputError(Problem(f"{path}: {name}", "an array that can be read", str(error)[:300])) from None

    return read


def _paths(path: Path, file) -> RawTable:
    """Arrays anywhere in the file, by their paths; fields of a table as `path.field`."""
    import h5py

    readers: dict[str, Reader] = {}
    said: dict[str, str] = {}

    def visit(name: str, thing) -> None:
        if not isinstance(thing, h5py.Dataset) or thing.shape is None:
            return
        read = _dataset(path, f"/{name}")
        for column, values in _array(f"/{name}", thing, read):
            readers[column] = values
            unit = thing.attrs.get("units", thing.attrs.get("unit", ""))
            said.update({column: _text(unit)} if _text(unit) else {})

    file.visititems(visit)
    return RawTable(path, LazyColumns(readers), units=said, short=short_names(readers))


def _array(name: str, thing, read: Reader) -> Iterator[tuple[str, Reader]]:
    if not thing.dtype.names:
        yield from array_columns(name, thing.shape, read)
        return
    for field in thing.dtype.names:
        inner = thing.dtype[field]
        shape = (*thing.shape, *(inner.shape or ()))
        yield from array_columns(f"{name}.{field}", shape, lambda field=field: read()[field])


def _text(value) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value if isinstance(value, str) else ""


def _class(thing) -> str:
    return _text(bytes(thing.attrs["MATLAB_class"])) if "MATLAB_class" in thing.attrs else ""


def _is_matlab(file) -> bool:
    return any("MATLAB_class" in thing.attrs for name, thing in file.items() if not name.startswith("#"))


def _matlab(path: Path, file) -> RawTable:
    """MAT 7.3: structs as groups, matrices transposed, text as codes, cells and struct arrays as references."""
    readers: dict[str, Reader] = {}
    unread: dict[str, str] = {}
    for name, thing in file.items():
        if not name.startswith("#"):
            _variable(path, file, name, thing, readers, unread)
    return RawTable(path, LazyColumns(readers), short=short_names(readers), unread=unread)


def _variable(path: Path, file, name: str, thing, readers: dict[str, Reader], unread: dict[str, str]) -> None:
    """Columns of one MATLAB variable, into `readers`; what only MATLAB reads, into `unread`."""
    import h5py

    kind = _class(thing)
    if "MATLAB_object_decode" in thing.attrs:
        unread[name] = OBJECT.format(kind=kind or "object")
    elif isinstance(thing, h5py.Group):
        for field, inner in thing.items():
            if _class(inner) or isinstance(inner, h5py.Group):
                _variable(path, file, f"{name}.{field}", inner, readers, unread)
            elif inner.dtype.kind == "O":
                for k, reference in enumerate(_references(inner)):
                    _variable(path, file, f"{name}({k + 1}).{field}", file[reference], readers, unread)
    elif "MATLAB_empty" in thing.attrs:
        return
    elif kind == "cell":
        _cell(path, file, name, thing, readers, unread)
    elif kind == "char":
        if len(thing.shape) == 2 and thing.shape[1] > 1:
            codes = _dataset(path, thing.name)
            readers[name] = lambda: _lines(codes().T)
    else:
        read = _dataset(path, thing.name)
        readers |= dict(array_columns(name, thing.shape[::-1], lambda: read().T))


def _references(thing) -> list[Any]:
    """References of a cell or struct array in MATLAB's order."""
    return list(thing[()].T.flatten(order="F")) if thing.ndim else []


def _cell(path: Path, file, name: str, thing, readers: dict[str, Reader], unread: dict[str, str]) -> None:
    references = _references(thing)
    if references and all(_class(file[ref]) == "char" for ref in references[:MOST_CELLS]):
        places = [file[ref].name for ref in references]
        readers[name] = lambda: _words(path, places)
    elif len(references) <= MOST_CELLS:
        for k, reference in enumerate(references):
            _variable(path, file, f"{name}{{{k + 1}}}", file[reference], readers, unread)
    else:
        unread[name] = f"a cell array of {len(references)} cells: save it as arrays"


def _lines(codes: np.ndarray) -> np.ndarray:
    return plain(np.array(["".join(map(chr, row)).rstrip() for row in codes.tolist()]))


def _words(path: Path, places: list[str]) -> np.ndarray:
    import h5py

    with h5py.File(path, "r") as file:
        things: list[Any] = [file[place] for place in places]
        return np.array(["".join(map(chr, thing[()].flatten().tolist())) for thing in things])
