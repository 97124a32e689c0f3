"""Where built FMUs are kept: by content, written whole or not at all, so that two builds at once are safe."""

import glob
import hashlib
import os
import pickle
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TypeVar

from build_fmus.errors import BuildError
from build_fmus.scratch import abandoned, fcntl, held, workspace

Kept = TypeVar("Kept")


def cache_folder() -> Path:
    """$COSIM_CACHE, else ~/.cache/haptic-cosim, else a folder of this user under the temporary folder."""
    user = os.getuid() if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    first = Path(os.environ.get("COSIM_CACHE") or os.path.expanduser("~/.cache/haptic-cosim"))
    second = Path(tempfile.gettempdir()) / f"haptic-cosim-{user}"
    if _writable(first):
        return first
    if _writable(second) and _mine(second):
        return second
    raise BuildError(f"no folder to build in: neither {first} nor {second} can be written; set COSIM_CACHE")


def _mine(folder: Path) -> bool:
    """Libraries that another user could have put under the temporary folder are not loaded."""
    return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()


_TRIED: set[Path] = set()
"""Folders that this process has written into."""


def _writable(folder: Path) -> bool:
    if folder in _TRIED and folder.is_dir():
        return True
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"x")
    except OSError:
        return False
    _TRIED.add(folder)
    return True


def kept(folder: Path) -> dict[str, tuple[int, int]]:
    """{part of the cache: (files, bytes)}."""
    return {part.name: _measured(part) for part in sorted(folder.iterdir()) if not part.name.startswith(".")}


def _measured(part: Path) -> tuple[int, int]:
    files = [part] if part.is_file() else [Path(top, name) for top, _, names in os.walk(part) for name in names]
    sizes = []
    for file in files:
        with suppress(OSError):  # another process has removed it
            sizes.append(file.lstat().st_size)
    return len(sizes), sum(sizes)


def forget(folder: Path, parts: Iterable[str]) -> None:
    """Remove parts of the cache. Raises BuildError where one cannot be removed."""
    with workspace(folder) as aside:
        for name in parts:
            try:
                (folder / name).rename(aside / name)  # moved first: nobody finds half of it
                shutil.rmtree(aside / name) if (aside / name).is_dir() else (aside / name).unlink()
            except OSError as error:
                raise BuildError(f"cannot remove {folder / name}: {error}") from error


def key_of(*parts: bytes | str) -> str:
    """A hash of all parts; the lengths are hashed too, so that no two lists collide."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()


def remembered(
    kind: str, key: str, make: Callable[[], Kept], worth: Callable[[Kept], bool] = lambda found: True
) -> Kept:
    """What `make` gives, kept from one process to the next where it is worth it; `key` must tell everything that
    decides it.
    """
    try:
        path = cache_folder() / kind / f"{key_of(sys.version, builder_code(), key)[:24]}.pickle"
    except BuildError:  # nowhere to keep it
        return make()
    with suppress(Exception):  # not there yet, or damaged
        return pickle.loads(path.read_bytes())
    found = make()
    with suppress(BuildError):  # as good without
        if worth(found):
            store(path, pickle.dumps(found))
    return found


@cache
def builder_code() -> bytes:
    """The bytes of this package: another builder builds other FMUs."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return b"".join(path.read_bytes() for path in files)


def _rename(temporary: str, path: Path) -> None:
    """Windows refuses to replace a file that another process reads; the one that is there has the same content."""
    try:
        os.replace(temporary, path)
    except PermissionError:
        if not (os.name == "nt" and path.is_file() and path.read_bytes() == Path(temporary).read_bytes()):
            raise
        Path(temporary).unlink()


def store(path: Path, data: bytes) -> None:
    """Write a file whole: to a temporary name beside it, then renamed. Raises BuildError (disk full, not writable)."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _clear(path)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                held(file)
                file.write(data)
                file.flush()
                os.chmod(temporary, 0o644)
                if os.name != "nt":  # there, what is open cannot be renamed
                    _rename(temporary, path)
            if os.name == "nt":
                _rename(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise BuildError(f"cannot write {path}: {error.strerror or error}; free space, or set COSIM_CACHE") from error


@contextmanager
def one_at_a_time(path: Path) -> Iterator[None]:
    """Work on a file that is not there: another process that wants the same one waits, and then finds it.

    Nobody waits where the file is there, nor on Windows, where both would do the work.
    """
    if path.is_file() or fcntl is None:
        yield
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = path.with_name(".lock").open("ab")
    except OSError as error:
        raise BuildError(f"cannot write {path}: {error.strerror or error}; free space, or set COSIM_CACHE") from error
    with lock:
        fcntl.flock(lock.fileno(), fcntl.LOCK_EX)  # freed when the file is closed, or the process dies
        yield


def _clear(path: Path) -> None:
    """Remove what processes that were killed have left of the same file."""
    for left in path.parent.glob(f"{glob.escape(path.name)}*.part"):
        with abandoned(left) as found:
            if found:
                left.unlink(missing_ok=True)
