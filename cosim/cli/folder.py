"""The folder that a command writes to: chosen, made and tried before anything is computed."""

import re
import tempfile
from enum import StrEnum
from pathlib import Path

from cosim.errors import InputError, Problem
from cosim.results.saving import reason


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
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        problem = Problem("--out", "a folder to write to", f"{folder}: {reason(error)}", "name another one with --out")
        raise InputError(problem) from None
    return folder
