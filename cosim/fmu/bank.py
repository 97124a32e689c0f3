"""Variables of one type behind one FMI call."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from cosim.signals import stem


def few(verb: str, names: Sequence[str]) -> str:
    """`get y, w, ...`: what a call is about, in a few words."""
    stems = list(dict.fromkeys(map(stem, names)))
    return f"{verb.lower()} {', '.join(stems[:4])}{', ...' if len(stems) > 4 else ''}"


class StatusChecker(Protocol):
    """An object that knows what an FMI status means and raises RunError for one above warning."""

    def check(self, status: int, what: str) -> None: ...


class Bank:
    """Variables of one type behind one FMI call; `array` are their doubles, `buffer` what the FMU sees."""

    def __init__(self, call: Callable[[], int], what: str, array: np.ndarray, buffer: np.ndarray) -> None:
        self.call, self.what, self.array, self.buffer = call, what, array, buffer
        self.shared = buffer is array

    def set(self, checker: StatusChecker) -> None:
        if not self.shared:
            self.buffer[:] = self.array
        if not 0 <= (status := self.call()) <= 1:
            checker.check(status, self.what)

    def get(self, checker: StatusChecker) -> None:
        if not 0 <= (status := self.call()) <= 1:
            checker.check(status, self.what)
        if not self.shared:
            self.array[:] = self.buffer


def caller(function: Callable[..., int], *arguments: object) -> Callable[[], int]:
    """A call without arguments of an FMI function with these ones."""
    return lambda: function(*arguments)


def pointer_to(array: np.ndarray, kind: type[ctypes._SimpleCData]) -> ctypes._Pointer:
    """The array as a C pointer."""
    return array.ctypes.data_as(ctypes.POINTER(kind))
