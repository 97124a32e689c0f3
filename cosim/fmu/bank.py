"""Variables of one type behind one FMI call."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from attrs import field, frozen

from cosim.scenario import Conversion
from cosim.signals import EXACT, WHOLE, Variable, stem


def few(verb: str, names: Sequence[str]) -> str:
    """`get y, w, ...`: what a call is about, in a few words."""
    stems = list(dict.fromkeys(map(stem, names)))
    return f"{verb.lower()} {', '.join(stems[:4])}{', ...' if len(stems) > 4 else ''}"


class StatusChecker(Protocol):
    """An object that raises RunError for an FMI status above warning, and for a value that cannot be handed over."""

    def check(self, status: int, what: str) -> None: ...

    def unfit(self, name: str, expected: str, got: float) -> None: ...


class Bank:
    """Variables of one type behind one FMI call; `array` are their doubles, `buffer` what the FMU sees.

    places: where they lie in the buffer, which holds whole arrays; guard: what their values must be.
    """

    def __init__(
        self,
        call: Callable[[], int],
        what: str,
        array: np.ndarray,
        buffer: np.ndarray,
        places: np.ndarray | None = None,
        guard: ValueGuard | None = None,
    ) -> None:
        self.call: Callable[[], int] = call
        self.what: str = what
        self.array: np.ndarray = array
        self.buffer: np.ndarray = buffer
        self.guard: ValueGuard | None = guard
        self.places: np.ndarray | slice = slice(None) if places is None else places
        self.shared: bool = buffer is array

    def set(self, checker: StatusChecker) -> None:
        if not self.shared:
            self.buffer[self.places] = self.array if self.guard is None else self.guard.fitting(self.array, checker)
        if not 0 <= (status := self.call()) <= 1:
            checker.check(status, self.what)

    def get(self, checker: StatusChecker) -> None:
        if not 0 <= (status := self.call()) <= 1:
            checker.check(status, self.what)
        if not self.shared:
            if self.guard is not None:
                self.guard.exact(self.buffer[self.places], checker)
            self.array[:] = self.buffer[self.places]


_CONVERTED: Mapping[Conversion, Callable[[np.ndarray], np.ndarray]] = {
    Conversion.ROUND: np.rint,
    Conversion.FLOOR: np.floor,
    Conversion.CEIL: np.ceil,
    Conversion.NONZERO: lambda values: (values != 0.0).astype(float),
}


@frozen
class ValueGuard:
    """What values of a type that is no double must be: within its limits, whole where it holds whole numbers, and
    exactly a double.

    low, high: (n,) limits; converted: places with the conversion that the scenario asks for there.
    """

    names: tuple[str, ...]
    low: np.ndarray = field(eq=False)
    high: np.ndarray = field(eq=False)
    whole: bool
    converted: tuple[tuple[int, Callable[[np.ndarray], np.ndarray]], ...]

    @classmethod
    def of(cls, variables: Sequence[Variable], conversions: Mapping[str, Conversion]) -> ValueGuard:
        """The guard of variables of one type, in the order of their array."""
        names = tuple(v.name for v in variables)
        limits = [_type_limits(v) for v in variables]
        wished = [(i, _CONVERTED[conversions[n]]) for i, n in enumerate(names) if conversions.get(n) in _CONVERTED]
        whole = not any(v.type == "Float32" for v in variables)
        low, high = (np.array([limit[side] for limit in limits]) for side in (0, 1))
        return cls(names, low, high, whole, tuple(wished))

    def fitting(self, values: np.ndarray, checker: StatusChecker) -> np.ndarray:
        """The values, converted where that is wished. Raises RunError for one that the type cannot hold."""
        if self.converted:
            values = values.copy()
            for place, convert in self.converted:
                values[place] = convert(values[place])
        bad = ~((values >= self.low) & (values <= self.high))
        if self.whole:
            bad |= values != np.rint(values)
        if bad.any():
            k = int(np.argmax(bad))
            what = "a whole number" if self.whole else "a number"
            checker.unfit(self.names[k], f"{what} from {self.low[k]:.10g} to {self.high[k]:.10g}", values[k])
        return values

    def exact(self, values: np.ndarray, checker: StatusChecker) -> None:
        """Raises RunError for a whole number that a double may not hold exactly."""
        if not self.whole or values.itemsize < 8:
            return
        large = (values > EXACT) | (values < (-EXACT if values.dtype.kind == "i" else 0))
        if large.any():
            k = int(np.argmax(large))
            checker.unfit(self.names[k], "a whole number up to 2^53, which a double holds exactly", values[k])


_SINGLE = float(np.finfo(np.float32).max)


def _type_limits(variable: Variable) -> tuple[float, float]:
    """Limits of the type, within what a double holds; of those that the FMU declares it takes care itself."""
    if variable.type == "Float32":
        return -_SINGLE, _SINGLE
    if variable.type == "Boolean":
        return 0.0, 1.0
    low, high = WHOLE[variable.type]
    return max(low, -EXACT), min(high, EXACT)


def caller(function: Callable[..., int], *arguments: object) -> Callable[[], int]:
    """A call without arguments of an FMI function with these ones."""
    return lambda: function(*arguments)


def pointer_to(array: np.ndarray, kind: Any) -> Any:
    """The array as a C pointer."""
    return array.ctypes.data_as(ctypes.POINTER(kind))
