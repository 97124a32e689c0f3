"""The structs of the batch kernel (fmu_src/kernel/kernel.c) as Python fills them."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from ctypes import POINTER, c_char_p, c_double, c_int64, c_void_p
from functools import cache

from cosim.engine.native import check_layout
from cosim.sweeps.lane import COURSE, HELD


class NativeComponent(ctypes.Structure):
    """A component in all lanes."""

    _fields_ = [
        ("kind", c_int64),
        ("n_inputs", c_int64),
        ("inputs", c_void_p),
        ("n_outputs", c_int64),
        ("first", c_int64),
        ("outputs", c_void_p),
        ("n_starts", c_int64),
        ("started", c_void_p),
        ("starts", c_void_p),
        ("series", c_void_p),
        ("series_step", c_void_p),
        ("history", c_void_p),
        ("stamps", c_void_p),
        ("capacity", c_int64),
        ("packets", c_void_p),
        ("serial", c_void_p),
    ]


class NativeWire(ctypes.Structure):
    """Wired inputs that follow one another, held or on lines."""

    _fields_ = [*((name, c_int64) for name in ("n", "to", "source", "newer", "older")), ("span", c_double)]


class NativeAct(ctypes.Structure):
    """Inputs of a component set, or its step."""

    _fields_ = [
        ("component", c_int64),
        ("steps", c_int64),
        ("wires", c_void_p),
        ("n_held", c_int64),
        ("n_wires", c_int64),
    ]


class NativeTurn(ctypes.Structure):
    """An even or an odd communication step."""

    _fields_ = [
        ("acts", c_void_p),
        ("n_acts", c_int64),
        ("columns", c_void_p),
        ("rates", c_void_p),
        ("angles", c_void_p),
        ("saturated", c_void_p),
    ]


class NativeCourse(ctypes.Structure):
    """Law of delay and loss of a channel, by the names of the FMU's parameters, and its memory."""

    _fields_ = [
        *((name, c_double) for name in COURSE),
        *((name, c_double) for name in ("origin", "delay", "knot", "sent", "bad")),
        ("walk", c_void_p),
    ]


class NativeSign(ctypes.Structure):
    """A run and its twin, and what is known of the sign of their growth rate (fmu_src/kernel/sign.h)."""

    _fields_ = [
        ("power", c_void_p),
        ("rows", c_int64),
        ("full", c_int64),
        ("part", c_double),
        ("largest_rate", c_double),
        ("largest_angle", c_double),
        ("rate", c_double),
        ("low", c_double),
        ("high", c_double),
        ("sign", c_int64),
    ]


class NativeJob(ctypes.Structure):
    """A run of all lanes."""

    _fields_ = [
        ("components", c_void_p),
        ("n_components", c_int64),
        ("turns", c_void_p),
        ("store", c_void_p),
        ("n_places", c_int64),
        ("table", c_void_p),
        ("rows", c_int64),
        ("n_columns", c_int64),
        ("every", c_int64),
        ("steps", c_int64),
        ("step_ns", c_double),
        ("bound", c_double),
        ("ended", c_void_p),
        ("outcome", c_void_p),
        ("signs", c_void_p),
        ("looks", c_void_p),
        ("n_looks", c_int64),
        ("n_rates", c_int64),
        ("n_saturated", c_int64),
        ("quantile", c_double),
        ("work", c_void_p),
    ]


def prepared(library: ctypes.CDLL) -> ctypes.CDLL:
    """A compiled fmu_src/kernel with the types of its functions. Raises ImportError where its structs are others."""
    mirrors = {
        "Course": NativeCourse,
        "Sign": NativeSign,
        "Wire": NativeWire,
        "Act": NativeAct,
        "Turn": NativeTurn,
        "Component": NativeComponent,
        "Job": NativeJob,
    }
    check_layout(library, mirrors)
    library.run.argtypes = [POINTER(NativeJob), c_void_p]
    library.run.restype = library.course.restype = None
    library.course.argtypes = [POINTER(NativeCourse), c_int64, c_double, c_void_p]
    library.lanes.restype = library.part_size.restype = library.serial_size.restype = c_int64
    library.model_name.argtypes = library.model_held.argtypes = [c_int64]
    library.model_name.restype = library.model_held.restype = c_char_p
    held = {name: library.model_held(kind).decode() for name, kind in kinds(library).items() if name}
    if held != {name: " ".join(vectors) for name, vectors in HELD.items()}:
        raise ImportError(f"{library._name}: the store holds {held}, expected {HELD}: install the package again")
    return library


@cache
def kinds(library: ctypes.CDLL) -> Mapping[str, int]:
    """The kernel's numbers of its models; "" is a series."""
    found: dict[str, int] = {}
    while (name := library.model_name(len(found))) is not None:
        found[name.decode()] = len(found)
    return found | {"": len(found)}
