"""Temporary folders and files whose process may be killed: each is locked while its process lives, and who comes next
removes what nobody holds.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from build_fmus.errors import BuildError

try:
    import fcntl
except ImportError:  # Windows: what a killed process leaves there is not looked for
    fcntl = None

_OURS = ".haptic-cosim-work-"  # how the names of our temporary folders begin
_LOCK = ".in-use"
_TRIES = 20


@contextmanager
def workspace(parent: Path | None = None) -> Iterator[Path]:
    """A temporary folder (in `parent`, or where temporary files go), gone afterwards.

    Raises BuildError where there is no room for one.
    """
    try:
        place = parent or Path(tempfile.gettempdir())
        _clear(place)
        folder, lock = _locked_folder(place)
    except OSError as error:
        raise BuildError(f"no temporary folder to work in: {error}; set TMPDIR") from error
    with lock:
        try:
            yield folder
        finally:
            _remove(folder)


def _locked_folder(place: Path) -> tuple[Path, IO[bytes]]:
    """A new folder and its lock. Another process may remove it before it is locked; then it takes another one."""
    for _ in range(_TRIES):
        folder = Path(tempfile.mkdtemp(prefix=_OURS, dir=place))
        with suppress(FileNotFoundError):
            lock = (folder / _LOCK).open("xb")
            if held(lock) and (folder / _LOCK).exists():
                return folder, lock
            lock.close()
    raise OSError(f"{place}: another process removes what is made there")


def held(file: IO[bytes]) -> bool:
    """Whether this process holds the lock of an open file now; the system frees it when the process ends."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


@contextmanager
def abandoned(file: Path) -> Iterator[bool]:
    """Whether a file is this user's and no living process holds its lock (it is held here meanwhile)."""
    try:
        stream = file.open("rb")
    except OSError:
        yield False
        return
    with stream:
        yield fcntl is not None and os.fstat(stream.fileno()).st_uid == os.getuid() and held(stream)


def _clear(place: Path) -> None:
    """Remove temporary folders of processes that were killed."""
    for folder in place.glob(f"{_OURS}*"):
        with suppress(OSError):
            folder.rmdir()  # works for an empty one only: its process died before it could lock it
        with abandoned(folder / _LOCK) as left:
            if left:
                _remove(folder)


def _remove(folder: Path) -> None:
    """Remove a folder, its lock last: what a kill leaves of the folder then still shows that it is nobody's. Another
    process may have removed it in the meantime.
    """
    entries: list[Path] = []
    with suppress(FileNotFoundError):
        entries = list(folder.iterdir())
    for entry in entries:
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry, ignore_errors=True)
        elif entry.name != _LOCK:
            with suppress(OSError):
                entry.unlink()
    shutil.rmtree(folder, ignore_errors=True)
