"""The folder that a command writes to: made and tried before anything is computed."""

import os
import re
import tempfile
from pathlib import Path

from cosim.errors import InputError, Problem


def made(folder: Path) -> Path:
    """The folder, there and writable. Raises InputError, so that a run does not end with nowhere to put its results."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        problem = Problem("--out", "a folder to write to", f"{folder}: {words(error)}", "name another one with --out")
        raise InputError(problem) from None
    return folder


def words(error: Exception) -> str:
    """What the system says, without the names of its calls and without HDF5's, which may be no OSError at all."""
    number = re.search(r"errno = (\d+)", str(error))
    code = getattr(error, "errno", None) or (number and int(number[1]))
    return os.strerror(code) if code else str(error)
