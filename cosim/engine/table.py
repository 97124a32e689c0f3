"""The table of a run: a row a recorded communication point, a column a signal; in memory, or on disk where it is large.

A large table is a memory-mapped temporary file without a name: what is written or read a block at a time leaves memory
again, so that a long run needs no more of it than a short one. The file is gone with the table.
"""

import mmap
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from cosim.errors import InputError, Problem

IN_MEMORY = 32 << 20
"""Bytes up to which a table lies in memory."""
_BLOCK = 4 << 20  # bytes handled at once


class SignalTable:
    """A table (rows, columns) of doubles. `values` is an array of it; `drop` and `blocks` keep a large one out of
    memory.

    Raises InputError where neither memory nor disk can hold it.
    """

    def __init__(self, rows: int, columns: int, in_memory: int = IN_MEMORY) -> None:
        size = 8 * rows * columns
        if size > in_memory and size > (free := shutil.disk_usage(tempfile.gettempdir()).free):
            raise InputError(_too_large(rows, columns, free))
        self.file: mmap.mmap | None = _file(size) if size > in_memory else None
        flat = np.empty(rows * columns) if self.file is None else np.frombuffer(self.file)
        self.values: np.ndarray = flat.reshape(rows, columns)
        self.dropped: int = 0

    @classmethod
    def of(cls, values: np.ndarray) -> "SignalTable":
        """A table that is there already, in memory."""
        rows = cls(0, 0)
        rows.values = values
        return rows

    @classmethod
    def shared(cls, rows: int, columns: int) -> "SignalTable":
        """A table that a forked process fills for this one: on disk where it is large, else in shared memory."""
        table = cls(rows, columns)
        if table.on_disk:
            return table
        memory = np.frombuffer(mmap.mmap(-1, max(1, 8 * rows * columns)), count=rows * columns)
        return cls.of(memory.reshape(rows, columns))

    @property
    def on_disk(self) -> bool:
        return self.file is not None

    @property
    def block(self) -> int:
        """Rows of a block."""
        return max(1, _BLOCK // max(1, 8 * self.values.shape[1]))

    def drop(self, done: int) -> None:
        """Let what lies before row `done` leave memory (it stays in the file), a block at a time."""
        if self.file is not None and done - self.dropped >= self.block:
            self._release(self.dropped, done)
            self.dropped = done

    def blocks(self, count: int) -> Iterator[tuple[int, np.ndarray]]:
        """The first `count` rows in blocks (first row, values); what was read leaves memory when the next is asked
        for.
        """
        for first in range(0, count, self.block):
            last = min(count, first + self.block)
            yield first, self.values[first:last]
            self._release(first, last)

    def columns(self, which: int | Sequence[int], count: int, every: int = 1) -> np.ndarray:
        """Every so many of the first `count` rows of a column (its number), or of several: copies where the table is on
        disk, else a view of a single one.
        """
        if self.file is None or count == 0:
            return self.values[:count:every, which]
        return np.concatenate([values[-first % every :: every, which].copy() for first, values in self.blocks(count)])

    def _release(self, first: int, last: int) -> None:
        if self.file is None or not hasattr(mmap, "MADV_DONTNEED"):
            return
        width = 8 * self.values.shape[1]
        start, stop = first * width // mmap.PAGESIZE * mmap.PAGESIZE, last * width // mmap.PAGESIZE * mmap.PAGESIZE
        if stop > start:
            self.file.madvise(mmap.MADV_DONTNEED, start, stop - start)


def _too_large(rows: int, columns: int, free: int) -> Problem:
    return Problem(
        "experiment",
        f"a table of at most {free / 1e9:.3g} GB, which is what {tempfile.gettempdir()} has room for",
        f"{rows} rows x {columns} signals = {8 * rows * columns / 1e9:.3g} GB",
        "raise experiment.record_every, shorten experiment.stop, or let TMPDIR name a larger disk",
    )


def _file(size: int) -> mmap.mmap:
    """A writable mapping of a temporary file without a name. Raises OSError (disk full)."""
    with tempfile.TemporaryFile(prefix="cosim-") as file:
        file.truncate(size)
        return mmap.mmap(file.fileno(), size)


class SignalColumns(Mapping[str, np.ndarray]):
    """Signals by name, (n,) each, from the first n rows of a table; each is looked up when it is asked for."""

    def __init__(self, names: Sequence[str], rows: SignalTable, count: int, every: int = 1) -> None:
        self.names: Sequence[str] = names
        self.rows: SignalTable = rows
        self.count: int = count
        self.every: int = every
        self._place: dict[str, int] | None = None

    def _places(self) -> Mapping[str, int]:
        if self._place is None:
            self._place = {name: i for i, name in enumerate(self.names)}
        return self._place

    def _number(self, name: str) -> int:
        return self._places()[name]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.rows.columns(self._number(name), self.count, self.every)

    def __contains__(self, name: object) -> bool:
        return name in self._places()

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def only(self, names: Sequence[str]) -> "SignalColumns":
        """Some of the signals, read from the same table."""
        chosen = SignalColumns(names, self.rows, self.count, self.every)
        chosen._place = {name: self._number(name) for name in names}
        return chosen

    def __or__(self, other: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return dict(self) | dict(other)

    def stacked(self, names: Sequence[str], every: int = 1) -> np.ndarray:
        """Several signals at every so many rows, (n, names), read in one go."""
        return self.rows.columns([self._number(name) for name in names], self.count, self.every * every)

    def blocks(self) -> Iterator[tuple[int, np.ndarray]]:
        """All signals, (n, signals), a block of rows at a time with the number of its first row."""
        if self.every != 1:
            yield 0, self.stacked(self.names)
            return
        places = [self._number(name) for name in self.names]
        whole = places == list(range(self.rows.values.shape[1]))
        for first, values in self.rows.blocks(self.count):
            yield first, values if whole else values[:, places]


def stacked(signals: Mapping[str, np.ndarray], names: Sequence[str], every: int = 1) -> np.ndarray:
    """Several signals at every so many rows, (n, names)."""
    if isinstance(signals, SignalColumns):
        return signals.stacked(names, every)
    return np.column_stack([np.asarray(signals[name])[::every] for name in names])


def blocks(signals: Mapping[str, np.ndarray]) -> Iterator[tuple[int, np.ndarray]]:
    """All signals, (n, signals), a block of rows at a time with the number of its first row."""
    if isinstance(signals, SignalColumns):
        yield from signals.blocks()
    elif signals:
        yield 0, stacked(signals, list(signals))
