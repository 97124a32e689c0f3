"""Files of a result written one after another, each complete or not there; what fits on a full disk is kept."""

import json
import os
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A file beside `path` to write to, which becomes `path` at the end, or is gone where anything went wrong."""
    partial = path.with_name(path.name + ".part")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_text(text: str, path: Path) -> Path:
    """Write a text in UTF-8; the file is complete or not there. Raises OSError."""
    with whole(path) as partial:
        partial.write_text(text, encoding="utf-8")
    return path


def write_json(content: Mapping[str, object], path: Path, indent: int = 2) -> Path:
    """Write plain data as JSON; the file is complete or not there."""
    return write_text(json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False) + "\n", path)


def save_files(folder: Path, files: Mapping[str, Callable[[Path], object]], former: Iterable[str] = ()) -> None:
    """Write every file by its function, in order. Raises OSError at the end where some were lost (a full disk).

    Files of those names, and of the names in `former`, that an earlier result has left go first: a folder never holds
    parts of two. Ctrl-C (the first one) is heeded when all is written.
    """
    for name in (*files, *former):
        with suppress(OSError):  # a folder of that name: what is written there will say so
            (folder / name).unlink()
    lost, stopped = [], False
    for name, write in files.items():
        try:
            try:
                write(folder / name)
            except KeyboardInterrupt:
                if stopped:
                    raise
                stopped = True
                write(folder / name)
        except (OSError, RuntimeError) as error:  # the latter from HDF5
            lost.append(f"{folder / name}: {reason(error)}")
    if lost:
        raise OSError(f"not written: {'; '.join(lost)}; free space, or name another folder with --out, and run again")
    if stopped:
        raise KeyboardInterrupt


def make_writable(folder: Path) -> None:
    """Make the folder where it is missing. Raises OSError where no file can be written in it."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass


def reason(error: Exception) -> str:
    """What the system says, without the names of its calls and without HDF5's, which may be no OSError at all."""
    number = re.search(r"errno = (\d+)", str(error))
    code = getattr(error, "errno", None) or (number and int(number[1]))
    return os.strerror(code) if code else str(error)
