"""Where built FMUs are kept: by content, written whole or not at all, so that two builds at once are safe."""

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from build_fmus.errors import BuildError


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


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"x")
    except OSError:
        return False
    return True


@contextmanager
def workspace() -> Iterator[Path]:
    """A temporary folder, gone afterwards. Raises BuildError where there is no room for one."""
    try:
        folder = Path(tempfile.mkdtemp(prefix="build-fmus-"))
    except OSError as error:
        raise BuildError(f"no temporary folder to build in: {error}; set TMPDIR") from error
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def key_of(*parts: bytes | str) -> str:
    """A hash of all parts; the lengths are hashed too, so that no two lists collide."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()


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
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
            os.chmod(temporary, 0o644)
            _rename(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise BuildError(f"cannot write {path}: {error.strerror or error}; free space, or set COSIM_CACHE") from error
