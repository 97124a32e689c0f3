"""The journal of a sweep: a file with one line for each result, so that an interrupted sweep can go on.

The first line says which sweep the file belongs to. A result counts only once its line is written, and a line that was
being written when the process died is cut off when the file is opened again. Every line ends with a checksum: one that
was damaged since is set aside (journal.damaged), and its point is computed again. One process at a time appends (the
file is locked), with one write each. The file is synchronised with the disk once a second at most, and at the end: a
busy disk would take longer than the points do. Only a loss of power can therefore lose results, those of the last
second.
"""

import errno
import json
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from zlib import crc32

from cosim.errors import InputError, Problem
from cosim.results.saving import whole
from cosim.sweeps.points import Point, PointResult, from_plain, plain

FORMAT = 1
SYNCED = 1.0  # s between two waits for the disk


class Journal:
    """An open journal: findings by key of their point."""

    def __init__(self, path: Path, fingerprint: str) -> None:
        """Open or begin the journal at `path`. Raises InputError where it belongs to another sweep or is in use."""
        self.path = path
        self.findings: dict[str, PointResult] = {}
        self.damaged: list[str] = []  # lines that were set aside, in words
        path.parent.mkdir(parents=True, exist_ok=True)
        self.file: int = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        self.synced: float = time.monotonic()
        self._lock()
        self._load(fingerprint)

    def _lock(self) -> None:
        try:
            import fcntl
        except ImportError:  # Windows: the sharing mode of the file has to do
            return
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self.file)
            raise InputError(Problem(str(self.path), "a folder that no other sweep writes to", "one in use")) from None

    def _load(self, fingerprint: str) -> None:
        content = self.path.read_bytes()
        whole = content.rfind(b"\n") + 1
        lines = content[:whole].splitlines()
        if whole < len(content):
            os.ftruncate(self.file, whole)
        os.lseek(self.file, 0, os.SEEK_END)
        if not lines:
            self._write(json.dumps({"format": FORMAT, "sweep": fingerprint}).encode() + b"\n")
            return
        head = self._head(lines[0])
        if head.get("sweep") != fingerprint or head.get("format") != FORMAT:
            os.close(self.file)
            raise InputError(
                Problem(
                    str(self.path),
                    "the journal of this sweep",
                    "that of another one or of a changed one",
                    "choose another --out, or remove the folder to begin anew",
                )
            )
        kept = [lines[0]]
        for number, line in enumerate(lines[1:], 2):
            try:
                key, finding = _entry(line)
            except ValueError as error:
                self.damaged.append(f"{self.path}: line {number} is damaged ({error}): set aside, computed again")
                self._set_aside(line)
            else:
                self.findings[key] = finding
                kept.append(line)
        if self.damaged:
            self._replace(b"".join(line + b"\n" for line in kept))

    def _head(self, line: bytes) -> dict[str, object]:
        """The first line, which says whose journal it is."""
        with suppress(ValueError):
            found = json.loads(line)
            if isinstance(found, dict):
                return found
        return {}

    def _set_aside(self, line: bytes) -> None:
        with open(self.path.with_suffix(".damaged"), "ab") as file:
            file.write(line + b"\n")

    def _replace(self, content: bytes) -> None:
        """Another content in place of the present one, whole or not at all; the lock goes with it."""
        with whole(self.path) as partial:
            fresh = os.open(partial, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o644)
            old, self.file = self.file, fresh
            self._lock()
            self._write(content)
            os.fsync(fresh)
        os.close(old)

    def add(self, points: Sequence[Point], findings: Sequence[PointResult]) -> None:
        """Keep findings: on return they outlive this process. A point that is known already is not written again."""
        fresh = [(p.key, f) for p, f in zip(points, findings) if p.key not in self.findings]
        if fresh:
            self._write("".join(_line(key, finding) for key, finding in fresh).encode())
            self.findings.update(fresh)

    def _write(self, text: bytes) -> None:
        if os.write(self.file, text) < len(text):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))
        if time.monotonic() - self.synced > SYNCED:
            os.fsync(self.file)
            self.synced = time.monotonic()

    def close(self) -> None:
        """Wait for the disk and close the file; the lock goes with it."""
        os.fsync(self.file)
        os.close(self.file)

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


_SUM = ', "sum": "'


def _sealed(body: str) -> str:
    """A line without its last brace, closed with its checksum."""
    return body + _SUM + f"{crc32(body.encode()):08x}" + '"}'


def _line(key: str, finding: PointResult) -> str:
    return _sealed(json.dumps({"key": key, "finding": plain(finding)})[:-1]) + "\n"


def _entry(line: bytes) -> tuple[str, PointResult]:
    """Key and finding of a line. Raises ValueError where it is not as it was written; older ones have no checksum."""
    text = line.decode()
    body, mark, _ = text.rpartition(_SUM)
    if mark and text != _sealed(body):
        raise ValueError("its checksum is wrong")
    found = json.loads(body + "}" if mark else text)
    if not isinstance(found, dict) or set(found) != {"key", "finding"} or not isinstance(found["key"], str):
        raise ValueError("it is no line of a journal")
    return found["key"], from_plain(found["finding"])
