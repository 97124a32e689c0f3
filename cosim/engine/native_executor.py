"""The structs of the compiled loop (fmu_src/executor/executor.c) as Python fills them, and FMU instances in them."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_double, c_int, c_int64, c_void_p
from functools import cache

from cosim.engine.native import Arena, NativeOperation, NativePhase, check_layout
from cosim.fmu import Fmi2Instance, Fmi3Instance, FmuInstance


class NativeInstance(ctypes.Structure):
    """An instance and its functions."""

    _fields_ = [
        ("instance", c_void_p),
        ("set2", c_void_p),
        ("get2", c_void_p),
        ("slopes2", c_void_p),
        ("step2", c_void_p),
        ("set3", c_void_p),
        ("get3", c_void_p),
        ("step3", c_void_p),
        ("input_refs", c_void_p),
        ("slope_refs", c_void_p),
        ("output_refs", c_void_p),
        ("orders", c_void_p),
        ("inputs", c_void_p),
        ("slopes", c_void_p),
        ("outputs", c_void_p),
        ("n_inputs", c_int64),
        ("n_slopes", c_int64),
        ("n_outputs", c_int64),
        ("offset", c_int64),
        ("remembered", c_int64),
        ("event", c_void_p),
        ("terminate", c_void_p),
        ("early", c_void_p),
        ("reached", c_void_p),
        ("strange", c_int64),
    ]


class NativeBank(ctypes.Structure):
    """Start values of one type behind one call."""

    _fields_ = [("set2", c_void_p), ("set3", c_void_p), ("refs", c_void_p), ("values", c_void_p), ("n", c_int64)]


class NativeStart(ctypes.Structure):
    """How an instance is started."""

    _fields_ = [
        ("reset", c_void_p),
        ("setup2", c_void_p),
        ("enter2", c_void_p),
        ("enter3", c_void_p),
        ("leave", c_void_p),
        ("banks", c_void_p),
        ("n_banks", c_int64),
        ("source", c_void_p),
        ("fresh", c_int64),
        ("scaled", c_void_p),
        ("gain", c_void_p),
        ("shift", c_void_p),
        ("tolerance", c_double),
        ("stop", c_double),
    ]


class NativeExecution(ctypes.Structure):
    """A run."""

    _fields_ = [
        ("instances", c_void_p),
        ("phases", c_void_p),
        ("n_phases", c_int64),
        ("store", c_void_p),
        ("n_outputs", c_int64),
        ("table", c_void_p),
        ("n_columns", c_int64),
        ("every", c_int64),
        ("row_start", c_int64),
        ("step_ns", c_double),
        ("bounds", c_void_p),
        ("domain", c_void_p),
        ("n_domain", c_int64),
        ("mark", c_void_p),
        ("call", c_int64),
        ("status", c_int64),
    ]


@cache
def executor_library() -> ctypes.CDLL:
    """The compiled library."""
    from build_fmus.library import library_path

    return prepared(ctypes.CDLL(str(library_path("executor"))))


def prepared(library: ctypes.CDLL) -> ctypes.CDLL:
    """A compiled fmu_src/executor with the types of its functions. Raises ImportError where its structs are others."""
    mirrors = {
        "Operation": NativeOperation,
        "Phase": NativePhase,
        "Instance": NativeInstance,
        "Bank": NativeBank,
        "Start": NativeStart,
        "Job": NativeExecution,
    }
    check_layout(library, mirrors)
    library.execute.argtypes = [POINTER(NativeExecution), c_int64]
    library.initialise.argtypes = [POINTER(NativeExecution), c_void_p, c_int64]
    library.drive.argtypes = [POINTER(NativeExecution), *[c_void_p] * 4, c_int64, c_void_p]
    library.execute.restype = library.initialise.restype = c_int
    library.drive.restype = c_int64
    return library


def plain(instance: FmuInstance) -> bool:
    """Whether an FMU exchanges doubles only, has no arrays, and has the functions that the loop in C calls."""
    variables = instance.description.variables.values()
    structured = instance.description.arrays or any(v.causality == "structuralParameter" for v in variables)
    needed = ["Reset", "SetupExperiment"] if isinstance(instance, Fmi2Instance) else ["Reset"]
    banks = instance.setters + instance.getters
    return not structured and all(map(instance.has, needed)) and all(bank.shared for bank in banks)


def native_instance(instance: FmuInstance, offset: int, arena: Arena, strange: bool) -> NativeInstance:
    """An instance whose outputs stand at `offset` in the store; strange: an FMU of others, which may change how this
    thread computes.
    """
    native = NativeInstance(
        instance=instance.component,
        input_refs=arena.structures(instance.references(instance.input_names)),
        slope_refs=arena.structures(instance.slope_references()),
        output_refs=arena.structures(instance.references(instance.output_names)),
        orders=arena.structures((c_int * max(1, len(instance.slopes)))(*[1] * len(instance.slopes))),
        inputs=arena.array(instance.inputs),
        slopes=arena.array(instance.slopes),
        outputs=arena.array(instance.outputs),
        n_inputs=len(instance.inputs),
        n_slopes=len(instance.slopes),
        n_outputs=len(instance.outputs),
        offset=offset,
        strange=strange,
    )
    if isinstance(instance, Fmi2Instance):
        native.set2, native.get2 = instance.address("SetReal"), instance.address("GetReal")
        native.slopes2, native.step2 = instance.address("SetRealInputDerivatives"), instance.address("DoStep")
        return native
    assert isinstance(instance, Fmi3Instance)
    native.set3, native.get3, native.step3 = (instance.address(f) for f in ("SetFloat64", "GetFloat64", "DoStep"))
    native.event, native.terminate, native.early = (ctypes.addressof(flag) for flag in instance.flags)
    native.reached = ctypes.addressof(instance.reached)
    return native
