"""Files and folders that a user names, looked at before they are opened.

A pipe would be waited for and a device read for ever, so that neither is opened, wherever it is named: on the command
line, in a TOML file, in an SSP, from Python.
"""

import json
import tomllib
from pathlib import Path
from typing import Any

from cosim.errors import InputError, Problem, did_you_mean


def file_problem(path: Path, expected: str, where: str = "", advice: str = "") -> Problem | None:
    """The problem of a path that is no regular file; None where it is one.

    expected: what the file is to hold, "a scenario file"; where: the place that names it (default: the path itself).
    """
    got, todo = _found(path)
    if not got:
        return None
    if where:
        return Problem(where, expected, f"{got} at {path}", advice or todo)
    return Problem(str(path), expected, "no such file" if got == "nothing" else got, advice or todo)


def named_file(path: Path | str, expected: str, where: str = "", advice: str = "") -> Path:
    """The path, which is a regular file. Raises InputError, see `file_problem`."""
    problem = file_problem(Path(path), expected, where, advice)
    if problem is not None:
        raise InputError(problem)
    return Path(path)


def read_toml(path: Path, expected: str = "a TOML file", where: str = "") -> dict[str, Any]:
    """The content of a TOML file. Raises InputError with the place of an error."""
    try:
        return tomllib.loads(named_file(path, expected, where).read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError, OSError) as error:
        raise InputError(Problem(str(path), "TOML", f"text that does not parse: {error}")) from None


def read_json(path: Path, expected: str, advice: str = "") -> dict[str, Any]:
    """The object in a JSON file. Raises InputError where there is none.

    expected: what the file is to hold, "the summary of a run".
    """
    file = named_file(path, expected, advice=advice)
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(Problem(str(path), expected, f"JSON that is damaged ({error})", advice)) from None
    if not isinstance(found, dict):
        raise InputError(Problem(str(path), f"{expected}, a JSON object", type(found).__name__, advice))
    return found


def _found(path: Path) -> tuple[str, str]:
    """What is there instead of a regular file, and what to do; both empty where one is there."""
    try:
        if path.is_file():
            return "", ""
        if path.is_dir():
            return "a folder", ""
        if path.exists():
            return "a device or a pipe", "write it to a file first"
        near = did_you_mean(path.name, [p.name for p in path.parent.glob("*")]) if path.parent.is_dir() else ""
        return "nothing", near
    except (OSError, ValueError) as error:  # a name that is too long, or holds what no name does
        return f"a name that no file has ({error})", ""
