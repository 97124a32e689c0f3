"""The journal of a sweep: a file with one line for each result, so that an interrupted sweep can go on.

The first line says which sweep the file belongs to. A result counts only once its line is written, and a line that was
being written when the process died is cut off when the file is opened again. One process at a time appends (the file is
locked), with one write each. The file is synchronised with the disk once a second at most, and at the end: a busy disk
would take longer than the points do. Only a loss of power can therefore lose results, those of the last second.
"""

import json
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from attrs import asdict

from cosim.errors import InputError, Problem
from cosim.sweeps.points import Point, PointResult

FORMAT = 1
SYNCED = 1.0  # s between two waits for the disk


class Journal:
    """An open journal: findings by key of their point."""

    def __init__(self, path: Path, fingerprint: str) -> None:
        """Open or begin the journal at `path`. Raises InputError where it belongs to another sweep or is in use."""
        self.path = path
        self.findings: dict[str, PointResult] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        self.file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        self.synced = time.monotonic()
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
            self._append({"format": FORMAT, "sweep": fingerprint})
            return
        head = json.loads(lines[0])
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
        for line in lines[1:]:
            entry = json.loads(line)
            self.findings[entry["key"]] = PointResult(**entry["finding"])

    def add(self, points: Sequence[Point], findings: Sequence[PointResult]) -> None:
        """Keep findings: on return they outlive this process. A point that is known already is not written again."""
        fresh = [(p.key, f) for p, f in zip(points, findings) if p.key not in self.findings]
        if fresh:
            self._append(*({"key": key, "finding": _plain(finding)} for key, finding in fresh))
            self.findings.update(fresh)

    def _append(self, *entries: Mapping[str, object]) -> None:
        text = "".join(json.dumps(entry) + "\n" for entry in entries).encode()
        written = os.write(self.file, text)
        if written < len(text):
            raise OSError(f"{self.path}: disk full")
        if time.monotonic() - self.synced > SYNCED:
            os.fsync(self.file)
            self.synced = time.monotonic()

    def close(self) -> None:
        """Wait for the disk and close the file; the lock goes with it."""
        os.fsync(self.file)
        os.close(self.file)

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_) -> None:
        self.close()


def _plain(finding: PointResult) -> dict[str, object]:
    return asdict(
        finding, value_serializer=lambda _, __, value: float(value) if isinstance(value, np.floating) else value
    )
