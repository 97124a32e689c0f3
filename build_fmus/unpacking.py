"""Archives unpacked whole or not at all: checked names, sizes and checksums, aside first, then moved into place."""

import os
import zipfile
import zlib
from pathlib import Path

from build_fmus.errors import BuildError
from build_fmus.scratch import workspace

LIMIT = "COSIM_UNPACK_LIMIT"
"""Environment variable: the most bytes that one archive may hold when it is unpacked, `8e9`."""
_LIMIT = 4e9  # bytes: room for large FMUs, none for an archive made to fill a disk


class UnpackError(BuildError):
    """An archive that is damaged, too large, or that names files outside itself."""


def unpack(archive: Path, folder: Path) -> None:
    """Make `folder` of the contents of a zip file; it appears when all is there and every checksum is right.

    Raises UnpackError for what is wrong with the archive, BuildError or OSError where the folder cannot be written.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with workspace(folder.parent) as aside:  # what a killed process left of its own goes now
        _extract(archive, aside / folder.name)
        _move(aside / folder.name, folder)


def _move(aside: Path, folder: Path) -> None:
    """Two processes may unpack the same archive: what is there already has the same contents."""
    try:
        os.replace(aside, folder)
    except OSError:
        if not folder.is_dir():
            raise


def _extract(archive: Path, folder: Path) -> None:
    try:
        with zipfile.ZipFile(archive) as opened:
            members = opened.infolist()
            problems = _problems(members)
            if problems:
                raise UnpackError(problems)
            for member in members:
                opened.extract(member, folder)  # raises BadZipFile for a wrong checksum
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError, ValueError) as error:
        raise UnpackError(str(error) or type(error).__name__) from None


def _problems(members: list[zipfile.ZipInfo]) -> list[str]:
    size, limit = sum(member.file_size for member in members), _limit()
    found = [f"the name {m.filename!r} leaves the archive" for m in members if _leaves(m.orig_filename)]
    if size > limit:
        found.append(f"{size:.3g} bytes when unpacked, more than {limit:.3g}; {LIMIT} raises the limit")
    return found


def _leaves(name: str) -> bool:
    """Whether a member's name is absolute, names a drive, goes up, or is written with backslashes."""
    return name.startswith("/") or ":" in name or "\\" in name or "\0" in name or ".." in name.split("/")


def _limit() -> float:
    text = os.environ.get(LIMIT, "")
    try:
        return float(text) if text else _LIMIT
    except ValueError:
        raise UnpackError(f"{LIMIT} is {text!r}, expected a number of bytes") from None
