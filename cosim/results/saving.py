"""Files of a result written one after another; what fits on a full disk is kept."""

import json
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path


def write_json(content: Mapping[str, object], path: Path, indent: int = 2) -> Path:
    """Write plain data as JSON; the file is complete or not there."""
    text = json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False)
    partial = path.with_name(path.name + ".part")
    try:
        partial.write_text(text + "\n", encoding="utf-8")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return path


def save_files(folder: Path, files: Mapping[str, Callable[[Path], object]]) -> None:
    """Write every file by its function, in order. Raises OSError at the end where some were lost (a full disk)."""
    lost = []
    for name, write in files.items():
        try:
            write(folder / name)
        except (OSError, RuntimeError) as error:  # the latter from HDF5
            (folder / name).unlink(missing_ok=True)
            lost.append(f"{folder / name}: {reason(error)}")
    if lost:
        raise OSError(f"not written: {'; '.join(lost)}; free space, or name another folder with --out, and run again")


def reason(error: Exception) -> str:
    """What the system says, without the names of its calls and without HDF5's, which may be no OSError at all."""
    number = re.search(r"errno = (\d+)", str(error))
    code = getattr(error, "errno", None) or (number and int(number[1]))
    return os.strerror(code) if code else str(error)
