"""HDF5 to columns by paths: our own result.h5, files of laboratories, and MAT 7.3, which is HDF5 in MATLAB's way.

The library runs apart (see cosim.apart): it lists the arrays of the file once, and reads one when it is asked for.
"""

import json
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from attrs import asdict, frozen

from cosim.apart import UnreadableError, read_apart
from cosim.errors import InputError, Problem
from cosim.measured.arrays import array_columns, plain
from cosim.measured.table import LazyColumns, RawTable, short_names

Reader = Callable[[], np.ndarray]
MOST_CELLS = 256  # cells of a cell array that are looked into; longer ones are lists of words
OBJECT = (
    "a {kind}, which only MATLAB opens: there, writetable(x, 'x.csv') of a table, writetimetable(x, 'x.csv') of a "
    "timetable, or save -v7 of its columns as arrays"
)


@frozen
class _Stored:
    """An array of the file that holds columns: where it lies (words: a place for each), which field of a compound, its
    shape as columns see it, transposed where MATLAB wrote it; text as codes of its letters.
    """

    places: tuple[str, ...]
    shape: tuple[int, ...] = ()
    field: str = ""
    transposed: bool = False
    letters: bool = False


@frozen
class _Listing:
    """Columns of the file before they are read: arrays by name, units, what is not read and why; of a result the names
    of the columns of its arrays, and their order.
    """

    arrays: dict[str, _Stored]
    units: dict[str, str]
    unread: dict[str, str]
    names: dict[str, tuple[str, ...]]
    order: tuple[str, ...] | None = None


def read_hdf5(path: Path) -> RawTable:
    """An HDF5 file by the paths of its arrays, `/robot/q[1]`. Raises InputError."""
    import h5py  # noqa: F401 - here, so that not every child imports it

    try:
        found = read_apart(lambda: asdict(_listed(path)), path)
    except UnreadableError as error:
        raise InputError(Problem(str(path), "an HDF5 file", str(error), _ADVICE)) from None
    arrays = {name: _Stored(**stored) for name, stored in found["arrays"].items()}
    if found["order"] is not None:
        return RawTable(path, LazyColumns(_signals(path, arrays, found["names"], found["order"])))
    readers: dict[str, Reader] = {}
    units: dict[str, str] = {}
    for name, stored in arrays.items():
        columns = dict(_columns(path, name, stored))
        readers |= columns
        unit = str(found["units"].get(name, ""))
        units |= dict.fromkeys(columns, unit) if unit else {}
    return RawTable(path, LazyColumns(readers), units=units, short=short_names(readers), unread=found["unread"])


_ADVICE = "write it again, or save the columns as text"


def _columns(path: Path, name: str, stored: _Stored) -> Iterator[tuple[str, Reader]]:
    read = partial(_array, path, stored)
    if stored.letters:
        yield name, read
    else:
        yield from array_columns(name, stored.shape, read)


def _signals(
    path: Path, arrays: dict[str, _Stored], names: dict[str, tuple[str, ...]], order: tuple[str, ...]
) -> dict[str, Reader]:
    """Columns of a result.h5 of this project (layout: cosim.results.files), under their own names."""
    readers: dict[str, Reader] = {"time": partial(_array, path, arrays["time"])}
    for place, columns in names.items():
        read = cache(partial(_array, path, arrays[place]))
        for k, name in enumerate(columns):
            readers[name] = lambda read=read, k=k: np.asarray(read()[:, k], float)
    return {name: readers[name] for name in ("time", *order)}


def _array(path: Path, stored: _Stored) -> np.ndarray:
    """One array, read when it is asked for."""
    try:
        return read_apart(lambda: _read(path, stored), path)
    except UnreadableError as error:
        where = f"{path}: {stored.places[0]}"
        raise InputError(Problem(where, "an array that can be read", str(error), _ADVICE)) from None


# --- apart ------------------------------------------------------------------------------------------------------------


def _read(path: Path, stored: _Stored) -> np.ndarray:
    import h5py

    with h5py.File(path, "r") as file:
        things: list[Any] = [file[place] for place in stored.places]
        if len(things) != 1 or (stored.letters and not stored.transposed):
            return np.array(["".join(map(chr, thing[()].flatten().tolist())) for thing in things])
        values = np.asarray(things[0][stored.field] if stored.field else things[0][()])
    values = values.T if stored.transposed else values
    if stored.letters:
        return plain(np.array(["".join(map(chr, row)).rstrip() for row in values.tolist()]))
    return values if values.dtype.kind in "biufcSUMm" else plain(values).reshape(values.shape)


def _listed(path: Path) -> _Listing:
    import h5py

    with h5py.File(path, "r") as file:
        if "signals" in file.attrs and "time" in file and "signals" in file:
            return _result(file)
        return _matlab(file) if _is_matlab(file) else _paths(file)


def _result(file) -> _Listing:
    arrays = {"time": _Stored(("time",))}
    names: dict[str, tuple[str, ...]] = {}
    for component, variables in file["signals"].items():
        for data in variables.values():
            elements = json.loads(data.attrs["elements"])
            if data.shape[1:] != (len(elements),):
                raise KeyError(f"{data.name}: {len(elements)} names for columns of shape {data.shape}")
            arrays[data.name] = _Stored((data.name,))
            names[data.name] = tuple(f"{component}.{element}" for element in elements)
    order = tuple(json.loads(file.attrs["signals"]))
    missing = set(order) - {name for columns in names.values() for name in columns}
    if missing:
        raise KeyError(f"no array for {min(missing)}")
    return _Listing(arrays, {}, {}, names, order)


def _paths(file) -> _Listing:
    """Arrays anywhere in the file, by their paths; fields of a table as `path.field`."""
    import h5py

    arrays: dict[str, _Stored] = {}
    said: dict[str, str] = {}

    def visit(name: str, thing) -> None:
        if not isinstance(thing, h5py.Dataset) or thing.shape is None:
            return
        unit = _text(thing.attrs.get("units", thing.attrs.get("unit", "")))
        for column, stored in _fields(f"/{name}", thing):
            arrays[column], said[column] = stored, unit

    file.visititems(visit)
    return _Listing(arrays, said, {}, {})


def _fields(name: str, thing) -> Iterator[tuple[str, _Stored]]:
    if not thing.dtype.names:
        yield name, _Stored((name,), thing.shape)
        return
    for field in thing.dtype.names:
        yield f"{name}.{field}", _Stored((name,), (*thing.shape, *(thing.dtype[field].shape or ())), field)


def _text(value) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value if isinstance(value, str) else ""


def _class(thing) -> str:
    return _text(bytes(thing.attrs["MATLAB_class"])) if "MATLAB_class" in thing.attrs else ""


def _is_matlab(file) -> bool:
    return any("MATLAB_class" in thing.attrs for name, thing in file.items() if not name.startswith("#"))


def _matlab(file) -> _Listing:
    """MAT 7.3: structs as groups, matrices transposed, text as codes, cells and struct arrays as references."""
    found = _Listing({}, {}, {}, {})
    for name, thing in file.items():
        if not name.startswith("#"):
            _variable(file, name, thing, found)
    return found


def _variable(file, name: str, thing, found: _Listing) -> None:
    """Columns of one MATLAB variable, into `found`; what only MATLAB reads, into its `unread`."""
    import h5py

    kind = _class(thing)
    if "MATLAB_object_decode" in thing.attrs:
        found.unread[name] = OBJECT.format(kind=kind or "object")
    elif isinstance(thing, h5py.Group):
        for field, inner in thing.items():
            if _class(inner) or isinstance(inner, h5py.Group):
                _variable(file, f"{name}.{field}", inner, found)
            elif inner.dtype.kind == "O":
                for k, reference in enumerate(_references(inner)):
                    _variable(file, f"{name}({k + 1}).{field}", file[reference], found)
    elif "MATLAB_empty" in thing.attrs:
        return
    elif kind == "cell":
        _cell(file, name, thing, found)
    elif kind == "char":
        if len(thing.shape) == 2 and thing.shape[1] > 1:
            found.arrays[name] = _Stored((thing.name,), transposed=True, letters=True)
    else:
        found.arrays[name] = _Stored((thing.name,), thing.shape[::-1], transposed=True)


def _references(thing) -> list[Any]:
    """References of a cell or struct array in MATLAB's order."""
    return list(thing[()].T.flatten(order="F")) if thing.ndim else []


def _cell(file, name: str, thing, found: _Listing) -> None:
    references = _references(thing)
    if references and all(_class(file[ref]) == "char" for ref in references[:MOST_CELLS]):
        found.arrays[name] = _Stored(tuple(file[ref].name for ref in references), letters=True)
    elif len(references) <= MOST_CELLS:
        for k, reference in enumerate(references):
            _variable(file, f"{name}{{{k + 1}}}", file[reference], found)
    else:
        found.unread[name] = f"a cell array of {len(references)} cells: save it as arrays"
