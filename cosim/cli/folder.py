"""The folder that a command writes to: chosen, made and tried before anything is computed."""

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import StrEnum
from pathlib import Path

from cosim.errors import InputError, Problem
from cosim.results.saving import make_writable, reason


class TableFormat(StrEnum):
    """Further files of a table."""

    CSV = "csv"
    PARQUET = "parquet"


def named(name: str) -> Path:
    """The folder in `results` for something of that name; no name leads out of it."""
    return Path("results") / (re.sub(r"[^\w .+=,@()-]", "_", name).strip(" .")[:200] or "unnamed")


def made(folder: Path) -> Path:
    """The folder, there and writable. Raises InputError, so that a run does not end with nowhere to put its results."""
    try:
        make_writable(folder)
    except OSError as error:
        problem = Problem("--out", "a folder to write to", f"{folder}: {reason(error)}", "name another one with --out")
        raise InputError(problem) from None
    return folder


@contextmanager
def results(folder: Path) -> Iterator[Path]:
    """The folder as of `made`, for input that is looked at only while it is used: where that is refused, a folder that
    was not there before goes again.
    """
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    made(folder)
    try:
        yield folder
    except InputError:
        with suppress(OSError):  # something else was put there
            for path in new:
                path.rmdir()
        raise
