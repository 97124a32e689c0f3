"""Results on disk: HDF5 with units and provenance, CSV and MAT for other tools. The only module that imports h5py.

Layout of the HDF5 file: `/time` (n,) and `/signals/<component>/<name>` (n, elements), each with the attribute `unit`;
`/starts` holds every start value as it was resolved (JSON); the root holds outcome (that of summary.json), message,
scenario (TOML), versions, command and the FMUs with their SHA-256 as attributes.
"""

import csv
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from attrs import evolve

from cosim.engine.master import Identity, Result
from cosim.engine.outcome import Outcome
from cosim.engine.table import blocks
from cosim.errors import InputError, Problem
from cosim.fmu.messages import FmuMessage
from cosim.results.disk import DiskFile
from cosim.results.provenance import provenance
from cosim.results.saving import whole
from cosim.scenario import Scenario, load_text, to_toml
from cosim.signals import grouped

FORMAT = 1
_BESIDE = 2048  # bytes of a signal beside its values


def write_h5(result: Result, path: Path | str, starts: Mapping[str, float | str] | None = None) -> Path:
    """Write a result; the file is complete or not there. Raises OSError (disk full, not writable).

    starts: start values as they were resolved, by `component.variable`.
    """
    import h5py

    path = Path(path)
    with _whole(path, 8 * len(result.time) * (1 + len(result.signals)) + _BESIDE * (8 + len(result.signals))) as file:
        _write(file, result)
        file.create_dataset("starts", data=json.dumps(dict(starts or {})), dtype=h5py.string_dtype())
    return path


@contextmanager
def _whole(path: Path, size: int, **options: Any) -> Iterator[Any]:
    """An HDF5 file to write about `size` bytes to, complete or not there. Raises OSError (disk full, not writable)."""
    import h5py

    path.parent.mkdir(parents=True, exist_ok=True)
    with whole(path) as partial, DiskFile(partial, size) as disk:
        with h5py.File(disk, "w", **options) as file:
            yield file
        if disk.error is not None:
            raise disk.error


def _write(file: Any, result: Result) -> None:
    file.attrs["format"] = FORMAT
    file.attrs["outcome"] = result.outcome.value
    file.attrs["message"] = result.message
    file.attrs["wall_time"] = result.wall_time
    if result.stopped_at is not None:
        file.attrs["stopped_at"] = result.stopped_at
    for key, value in provenance(result).items():
        file.attrs[key] = value if isinstance(value, (str, int)) else json.dumps(value)
    file.attrs["signals"] = json.dumps(list(result.signals))
    file.attrs["messages"] = json.dumps([message.to_dict() for message in result.messages])
    file.create_dataset("time", data=result.time).attrs["unit"] = "s"
    file.create_group("signals")
    places, count = {name: k for k, name in enumerate(result.signals)}, len(result.time)
    written = []
    for name, elements in grouped(result.signals).items():
        component, _, variable = name.partition(".")
        place = f"signals/{_member(component)}/{_member(variable)}"
        data = file.create_dataset(place, (count, len(elements)), dtype=float)
        data.attrs["component"], data.attrs["unit"] = component, result.units[elements[0]]
        data.attrs["elements"] = json.dumps([element.partition(".")[2] for element in elements])
        written.append((data, [places[element] for element in elements]))
    for first, values in blocks(result.signals):
        for data, chosen in written:
            data[first : first + len(values)] = values[:, chosen]


def _member(name: str) -> str:
    """A name as a member of a group: a slash, which parts groups, and a name of dots alone are written otherwise."""
    return name.replace("/", "∕") if name.strip(".") else name.replace(".", "․")


def read_starts(path: Path | str) -> dict[str, float | str]:
    """Start values that `write_h5` was given. Raises InputError where the file is none of ours."""
    return json.loads(_found(Path(path), _starts, "a result of cosim"))


def _found(path: Path, content: Callable[[Any], Any], expected: str) -> Any:
    """What `content` finds in the open file. Raises InputError."""
    import h5py

    from cosim.apart import UnreadableError, read_apart

    def read() -> Any:
        with h5py.File(path, "r") as file:
            return content(file)

    try:
        return read_apart(read, path)
    except UnreadableError as error:
        raise InputError(Problem(str(path), expected, str(error))) from None


def _starts(file: Any) -> str:
    text = file["starts"][()] if "starts" in file else b"{}"
    return text.decode()


def read_h5(path: Path | str) -> Result:
    """A result as it was written. Raises InputError where the file is none."""
    from cosim.apart import damaged

    found = _found(Path(path), _stored, "a result of cosim")
    try:
        return _result(found)
    except (LookupError, ValueError, TypeError, AttributeError, InputError) as error:
        raise InputError(Problem(str(path), "a result of cosim", damaged(error))) from None


def _stored(file: Any) -> dict[str, Any]:  # h5py's types do not know that a member is a group
    """Attributes, time, and for each array its component, unit and elements, as they stand in the file."""
    signals = [
        [data.attrs.get("component", group), data.attrs["unit"], data.attrs["elements"], data[...]]
        for group, variables in file["signals"].items()
        for data in variables.values()
    ]
    return {"attributes": dict(file.attrs), "time": file["time"][...], "signals": signals}


def _result(found: Mapping[str, Any]) -> Result:
    signals, units, told = {}, {}, found["attributes"]
    for component, unit, elements, values in found["signals"]:
        for column, element in enumerate(json.loads(elements)):
            signals[f"{component}.{element}"] = values[:, column]
            units[f"{component}.{element}"] = unit
    fmus = tuple(Identity(f["component"], f["name"], f["fmi"], "", f["sha256"]) for f in json.loads(told["fmus"]))
    order = json.loads(told["signals"])
    stopped = told.get("stopped_at")
    return Result(
        _scenario(told),
        Outcome(told["outcome"]),
        found["time"],
        {name: signals[name] for name in order},
        {name: units[name] for name in order},
        None if stopped is None else float(stopped),
        told["message"],
        float(told["wall_time"]),
        fmus,
        messages=tuple(FmuMessage.of(entry) for entry in json.loads(told.get("messages", "[]"))),
    )


def _scenario(told: Mapping[str, Any]) -> Scenario:
    """The scenario of a result, with the effects and changes that its text does not tell."""
    more = {key: json.loads(told.get(key, "null")) for key in ("effects", "changes")}
    return evolve(
        load_text(told["scenario"]), effects=tuple(more["effects"] or ()), changes=dict(more["changes"] or {})
    )


def export_csv(result: Result, path: Path | str) -> Path:
    """Write the signals as a CSV file: a header line `time [s],arm_l.q[1] [rad],...`, a line per row, 17 digits.

    A name with a comma, a quote or a line end stands in quotes (RFC 4180).
    """
    path = Path(path)
    with whole(path) as partial, open(partial, "w", encoding="utf-8", newline="") as stream:
        header = ["time [s]", *(f"{name} [{result.units[name]}]" for name in result.signals)]
        csv.writer(stream, lineterminator="\n").writerow(header)
        for first, values in blocks(result.signals):
            stream.writelines(
                ",".join(map(repr, row)) + "\n"
                for row in np.column_stack([result.time[first : first + len(values)], values]).tolist()
            )
    return path


def export_mat(result: Result, path: Path | str) -> Path:
    """Write a MATLAB file: `time`, a struct `signals.<component>.<name>` (n, elements), a struct `units` alike.

    A name that is none for MATLAB is changed; `names` has the fields of `signals` with the names as they are.
    """
    from scipy.io import savemat

    signals, units, names = {}, {}, {}
    for name, elements in grouped(result.signals).items():
        component, _, variable = name.partition(".")
        group = _field(component, {key: value["component"] for key, value in names.items()})
        known = names.setdefault(group, {"component": component})
        member = _field(variable, known)
        known[member] = variable
        signals.setdefault(group, {})[member] = np.column_stack([result.signals[e] for e in elements])
        units.setdefault(group, {})[member] = result.units[elements[0]]
    content = {"time": result.time[:, None], "signals": signals, "units": units, "names": names}
    content |= {"outcome": result.outcome.value, "scenario": to_toml(result.scenario)}
    with whole(Path(path)) as partial, open(partial, "wb") as stream:
        savemat(stream, content, long_field_names=True, do_compression=True)
    return Path(path)


def _field(name: str, known: Mapping[str, str]) -> str:
    """A name as a field of a MATLAB struct, other than the fields of other names: letters, digits, underscores."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)[:55]
    plain = plain if re.match(r"[A-Za-z]", plain) else f"x{plain}"
    tries = (plain, *(f"{plain}_{k}" for k in range(2, 1000)))
    return next(field for field in tries if known.get(field, name) == name)


def write_table(
    columns: Mapping[str, Sequence[float | str]],
    units: Mapping[str, str],
    attributes: Mapping[str, str],
    path: Path | str,
) -> Path:
    """Write a table as HDF5: one dataset (n,) a column, numbers or text, in `/columns`; attribute `unit` where there is
    one.

    The same columns give the same bytes: nothing of the moment is written. The file is complete or not there.
    """
    import h5py

    path = Path(path)
    size = sum(16 + len(value) if isinstance(value, str) else 8 for values in columns.values() for value in values)
    with _whole(path, size + _BESIDE * (4 + len(columns)), track_order=True) as file:
        file.attrs.update({"format": FORMAT, **attributes})
        group = file.create_group("columns", track_order=True)
        for name, values in columns.items():
            text = any(isinstance(value, str) for value in values)
            data = group.create_dataset(name, data=list(values), dtype=h5py.string_dtype() if text else float)
            if name in units:
                data.attrs["unit"] = units[name]
    return path


def read_table(path: Path | str) -> dict[str, list[float | str]]:
    """The columns of `write_table`, text as str. Raises InputError where the file is none."""
    return _found(Path(path), _columns, "a table of cosim")


def _columns(file: Any) -> dict[str, list[float | str]]:
    return {
        name: [v.decode() if isinstance(v, bytes) else float(v) for v in data[...]]
        for name, data in file["columns"].items()
    }
