"""From TOML to a scenario: unknown keys and wrong types are collected as problems."""

import math
import re
from collections.abc import Iterable, Mapping
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from attrs import AttrsInstance, fields

from cosim.errors import InputError, Problem, did_you_mean
from cosim.opening import read_toml
from cosim.scenario.parts import Algorithm, Connection, Conversion, Extrapolation, FmuLogging
from cosim.signals import Linear, Signal

Record = TypeVar("Record", bound=AttrsInstance)


def table_of(path: Path, allow_outside: bool = False) -> dict[str, Any]:
    """The table of a TOML file, or that of an SSP: an archive, a folder, or the .ssd file in one."""
    if path.suffix not in (".ssp", ".ssd") and not path.is_dir():
        return read_toml(path)
    from build_fmus.cache import cache_folder
    from cosim.scenario.ssp import read_ssp

    try:
        return read_ssp(path, cache_folder() / "ssp", allow_outside)
    except ValueError as error:
        raise InputError(Problem(str(path), "numbers where the standard wants them", str(error))) from None


def unknown_keys(table: Mapping[str, object], known: Iterable[str], where: str, problems: list[Problem]) -> None:
    """Adds a problem for each key that nobody reads."""
    known = sorted(known)
    for key in table:
        if key not in known:
            problems.append(Problem(f"{where}: {key}", "a known key", "an unknown one", did_you_mean(key, known)))


def record_of(kind: type[Record], table: object, where: str, problems: list[Problem]) -> Record | None:
    """An instance of a frozen class from a TOML table, made by cattrs; None where the table does not give one.

    Unknown keys and values of a wrong type are added to `problems`.
    """
    if not isinstance(table, dict):
        problems.append(Problem(where, "a table", type(table).__name__))
        return None
    names = [entry.name for entry in fields(kind)]
    unknown_keys(table, names, where, problems)
    try:
        return _converter().structure({key: value for key, value in table.items() if key in names}, kind)
    except Exception as error:  # noqa: BLE001 - converters of attrs raise many kinds
        problems += _translated(error, where)
        return None


@cache
def _converter():
    """A strict cattrs converter: no text for numbers, no numbers for text, whole numbers where they are asked for."""
    from cattrs import Converter

    converter = Converter(detailed_validation=True)
    converter.register_structure_hook(float, lambda value, _: float(_strict(value, (int, float), "a number")))
    converter.register_structure_hook(int, lambda value, _: _strict(value, int, "a whole number"))
    converter.register_structure_hook(str, lambda value, _: _strict(value, str, "text"))
    converter.register_structure_hook(bool, lambda value, _: _strict(value, bool, "true or false"))
    converter.register_structure_hook(
        str | None, lambda value, _: None if value is None else _strict(value, str, "text")
    )
    converter.register_structure_hook(
        float | None, lambda value, _: None if value is None else float(_strict(value, (int, float), "a number"))
    )
    converter.register_structure_hook_func(
        lambda kind: kind == Mapping[str, object], lambda value, _: dict(_strict(value, dict, "a table"))
    )
    for kind in (Algorithm, Extrapolation, FmuLogging):
        converter.register_structure_hook(kind, _member)
    return converter


class _UnfitError(Exception):
    """A value of the wrong kind: what was expected, what came, advice."""


def _strict(value: object, kind: type | tuple[type, ...], words: str) -> Any:
    """The value, which is of the kind asked for. Raises _UnfitError where it is of another."""
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise _UnfitError(words, repr(value), "")
    return value


def _member(value: object, kind: type[Enum]) -> Enum:
    words = [member.value for member in kind]
    if value in words:
        return kind(value)
    raise _UnfitError(" or ".join(repr(word) for word in words), repr(value), did_you_mean(str(value), words))


def _translated(error: Exception, where: str) -> list[Problem]:
    """Problems of a cattrs validation error, with the key that each belongs to."""
    if isinstance(error, _UnfitError):
        return [Problem(where, *error.args)]
    if isinstance(error, ExceptionGroup):
        return [p for inner in error.exceptions for p in _translated(inner, where + _key(inner))]
    if isinstance(error, (KeyError, TypeError)):
        return [Problem(where, "a value", "nothing" if isinstance(error, KeyError) else str(error))]
    return [Problem(where, "a fitting value", str(error))]


def _key(error: Exception) -> str:
    for note in getattr(error, "__notes__", ()):
        name = getattr(note, "name", None)
        if name is not None:
            return f".{name}"
        if getattr(note, "index", None) is not None:
            return f"[{note.index}]"
    return f".{error.args[0]}" if isinstance(error, KeyError) and error.args else ""


_WIRE = re.compile(r"^\s*(?P<source>\S.*?)\s*->\s*(?P<target>\S.*?)(\s+\((?P<wish>\w+|(times|plus)\b[^()]*)\))?\s*$")
_CHANGE = re.compile(r"^(times +(?P<factor>\S+))?( *plus +(?P<offset>\S+))?$")


def connections_of(entries: object, known: set[str], where: str, problems: list[Problem]) -> tuple[Connection, ...]:
    """The connections of a table; what is wrong with an entry is added to `problems`."""
    found = []
    for number, entry in enumerate(entries if isinstance(entries, list) else [entries], start=1):
        if isinstance(entry, Connection):  # an SSP's names may hold what the text of a connection cannot
            found.append(entry)
            continue
        match = _WIRE.match(entry) if isinstance(entry, str) else None
        place = f"{where}: connections, line {number}"
        if match is None or not all("." in match[end] for end in ("source", "target")):
            problems.append(Problem(place, "'component.output -> component.input'", repr(entry)))
            continue
        wish = _wish(match["wish"])
        if match["wish"] is not None and wish is None:
            wishes = [*(conversion.value for conversion in Conversion), "times 2.0 plus 1.0"]
            advice = did_you_mean(match["wish"], wishes)
            problems.append(Problem(place, f"({') or ('.join(wishes)})", f"({match['wish']})", advice))
            continue
        ends = [Signal(*match[end].split(".", 1)) for end in ("source", "target")]
        strangers = [end for end in ends if end.component not in known]
        problems += [
            Problem(
                f"{place} ({entry})", "a component of the scenario", repr(s.component), did_you_mean(s.component, known)
            )
            for s in strangers
        ]
        if not strangers:
            found.append(Connection(ends[0], ends[1], wish))
    return tuple(found)


def _wish(text: str | None) -> Conversion | Linear | None:
    """What the brackets behind a connection say; None for what cannot be read, and a factor of 0."""
    if text in [conversion.value for conversion in Conversion]:
        return Conversion(text)
    match = _CHANGE.match(text or "")
    if not text or match is None:
        return None
    try:
        change = Linear(*(float(match[key] or usual) for key, usual in (("factor", 1.0), ("offset", 0.0))))
    except ValueError:
        return None
    return change if change.factor and math.isfinite(change.factor * change.offset) else None
