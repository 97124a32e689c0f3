"""What was found of our sources by an earlier process, where none of their files has changed since."""

import os
import platform
import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from build_fmus.cache import Kept, remembered
from build_fmus.homes import source_root

Stamp = tuple[str, int, int, int, int]
"""Of a file: name, inode, size, and when its content and its inode last changed, which nothing sets back."""


def unchanged(kind: str, name: str, make: Callable[[], Kept]) -> Kept:
    """What `make` gave when all that our FMUs and libraries are built from was as it is now, else what it gives now.

    To look at the files' stamps takes a hundredth of the time that reading them all takes. A compiler of the user's own
    is asked for its version each time.
    """
    if os.environ.get("CC"):
        return make()
    return remembered(kind, repr((name, sys.platform, platform.machine(), stamps())), make)


def unchanged_file(name: str, make: Callable[[], Path]) -> Path:
    """As `unchanged`, of a file, which may have been removed since."""
    found = Path(unchanged("current", name, lambda: str(make())))
    return found if found.is_file() else make()


@cache
def stamps() -> tuple[Stamp, ...]:
    """Of every file that decides what is built, as they were when this process first asked."""
    root = source_root()
    ours = (*_of_folder(str(root)), *_of_folder(str(Path(__file__).parent)))
    beside = (path for path in (root.parent / "LICENSE", *_of_packages()) if path.is_file())
    return tuple(sorted((*ours, *(_stamp(str(path), path.stat()) for path in beside))))


def _of_folder(folder: str) -> Iterator[Stamp]:
    """Of the files of a folder and of the folders in it, compiled Python left out."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if not entry.is_dir():
                yield _stamp(entry.path, entry.stat())
            elif entry.name != "__pycache__":
                yield from _of_folder(entry.path)


def _stamp(file: str, state: os.stat_result) -> Stamp:
    return file, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns


@cache
def _of_packages() -> tuple[Path, ...]:
    """The compiler, and the headers of FMI that come with fmpy."""
    zig, fmpy = (find_spec(name) for name in ("ziglang", "fmpy"))
    found = [Path(zig.origin).with_name("zig.exe" if sys.platform == "win32" else "zig")] if zig and zig.origin else []
    return (*found, *(Path(fmpy.origin).parent.glob("c-code/*.h") if fmpy and fmpy.origin else ()))
