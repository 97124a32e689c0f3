"""Memory of arrays that are gone, for arrays to come."""

from __future__ import annotations

import weakref
from typing import final

import numpy as np

_MOST_KEPT = 128 << 20  # bytes


@final
class ReusedMemory:
    """Arrays whose memory is used again when neither they nor views of them are left.

    The system maps a page of fresh memory when it is first written, which takes longer than the batch kernel needs to
    compute what it writes there.
    """

    def __init__(self) -> None:
        self.kept: dict[int, list[np.ndarray]] = {}  # by length

    def empty(self, count: int) -> np.ndarray:
        """(count,): doubles of any value."""
        memory = self._found(count)
        array = np.frombuffer(memory.data, count=count)  # its views hold it; those of `memory` would not
        weakref.finalize(array, self._keep, memory).atexit = False
        return array

    def _found(self, count: int) -> np.ndarray:
        try:
            return self.kept[count].pop()  # one operation, whatever other threads do
        except (KeyError, IndexError):
            return np.empty(count)

    def _keep(self, memory: np.ndarray) -> None:
        kept = sum(array.nbytes for arrays in list(self.kept.values()) for array in list(arrays))
        if kept + memory.nbytes > _MOST_KEPT:
            self.kept.clear()
        self.kept.setdefault(len(memory), []).append(memory)
