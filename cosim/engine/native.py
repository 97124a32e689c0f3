"""A schedule in the layout of the C sources (fmu_src/executor/executor.c, fmu_src/kernel/kernel.c), and arrays that C
sees.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from ctypes import c_char_p, c_double, c_int64, c_void_p
from typing import Any

import numpy as np

from cosim.wiring.schedule import GetOutputs, Operation, Phase, SetInputs, Step, seconds

_SET, _STEP, _GET = range(3)
_LINE = 128  # bytes: a cache line, and a vector of 16 lanes


class _NativePlace(ctypes.Structure):
    _fields_ = [("field", c_char_p), ("offset", c_int64)]


def check_layout(library: ctypes.CDLL, mirrors: Mapping[str, type[ctypes.Structure]]) -> None:
    """Compare structs that Python fills with those of a library, by their C names (fmu_src/shared/layout.h).

    Raises ImportError with the first field that lies elsewhere: Python would write into the wrong places.
    """
    for name, mirror in mirrors.items():
        table = getattr(library, f"layout_{name}")
        table.restype = ctypes.POINTER(_NativePlace)
        here = [(field[0], getattr(mirror, field[0]).offset) for field in mirror._fields_]
        for k, (where, expected) in enumerate([*here, ("its end", ctypes.sizeof(mirror))]):
            place = table()[k]
            found = place.field.decode() if place.field else "its end"
            if (found, place.offset) != (where, expected):
                raise ImportError(
                    f"{library._name}: struct {name}: expected {where} at byte {expected} ({mirror.__name__}), "
                    f"got {found} at byte {place.offset}; C sources and Python are of different versions: "
                    "install the package again"
                )


class NativeOperation(ctypes.Structure):
    """An operation of cosim.wiring.schedule."""

    _fields_ = [
        ("kind", c_int64),
        ("component", c_int64),
        ("n_source", c_int64),
        ("n_line", c_int64),
        ("inside", c_int64),
        ("source", c_void_p),
        ("line", c_void_p),
        ("newer", c_void_p),
        ("older", c_void_p),
        ("weight", c_void_p),
        ("span", c_void_p),
        ("size", c_double),
        ("n_scaled", c_int64),
        ("scaled", c_void_p),
        ("gain", c_void_p),
        ("shift", c_void_p),
    ]


class NativePhase(ctypes.Structure):
    """A communication step: its operations, and the places that its row is taken from."""

    _fields_ = [("operations", c_void_p), ("n_operations", c_int64), ("columns", c_void_p), ("in_order", c_int64)]


class Arena:
    """Arrays that must outlive the calls that C makes on them; every method gives an address."""

    def __init__(self) -> None:
        self.kept: list[object] = []

    def structures(self, array: ctypes.Array[Any]) -> int:
        """An array of C structures."""
        self.kept.append(array)
        return ctypes.addressof(array)

    def array(self, array: np.ndarray) -> int:
        """An array of numpy as it lies."""
        self.kept.append(array)
        return array.ctypes.data

    def aligned(self, values: np.ndarray) -> int:
        """A copy of doubles at the start of a cache line, where C's vectors lie."""
        whole = np.empty(values.size + _LINE // 8)
        skip = -whole.ctypes.data % _LINE // 8
        whole[skip : skip + values.size] = values.ravel()
        return self.array(whole) + 8 * skip

    def zeros(self, count: int) -> int:
        """So many doubles, zero, at the start of a cache line."""
        whole = np.zeros(count + _LINE // 8)
        return self.array(whole) + -whole.ctypes.data % _LINE

    def indices(self, values: Sequence[int] | np.ndarray) -> int:
        """A copy as 64-bit integers."""
        return self.array(np.ascontiguousarray(values, dtype=np.int64))

    def pointers(self, addresses: Sequence[int]) -> int:
        """Addresses as an array of pointers."""
        return self.array(np.array(addresses, dtype=np.uintp))

    def phases(self, phases: Sequence[Phase], columns: np.ndarray, step_ns: int) -> int:
        """Phases in C's layout. columns: kept signals, places among the outputs."""
        native = (NativePhase * len(phases))()
        for one, phase in zip(native, phases):
            operations = (NativeOperation * len(phase.operations))(
                *[self._operation(o, step_ns) for o in phase.operations]
            )
            one.operations, one.n_operations = self.structures(operations), len(phase.operations)
            places = phase.record.source[columns]
            one.columns, one.in_order = (
                self.indices(places),
                int(len(places) > 0 and bool(np.all(np.diff(places) == 1))),
            )
        return self.structures(native)

    def _operation(self, operation: Operation, step_ns: int) -> NativeOperation:
        if isinstance(operation, Step):
            return NativeOperation(kind=_STEP, component=operation.component, size=seconds(operation.multiple, step_ns))
        if isinstance(operation, GetOutputs):
            return NativeOperation(kind=_GET, component=operation.component)
        assert isinstance(operation, SetInputs), "texts are carried in Python"
        return self._set(operation)

    def _set(self, o: SetInputs) -> NativeOperation:
        return NativeOperation(
            kind=_SET,
            component=o.component,
            n_source=len(o.source),
            n_line=len(o.line),
            inside=int(bool(np.any(o.weight))),
            source=self.indices(o.source),
            line=self.indices(o.line),
            newer=self.indices(o.newer),
            older=self.indices(o.older),
            weight=self.array(o.weight),
            span=self.array(o.span),
            n_scaled=len(o.scaled),
            scaled=self.indices(o.scaled),
            gain=self.array(o.gain),
            shift=self.array(o.shift),
        )
