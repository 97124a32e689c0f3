"""One FMU instance alone, stepped by a loop in C (`drive` of fmu_src/executor/executor.c)."""

from __future__ import annotations

from ctypes import byref
from weakref import WeakKeyDictionary

import numpy as np

from cosim.engine.native import Arena
from cosim.engine.native_executor import NativeExecution, NativeInstance, executor_library, native_instance, plain
from cosim.fmu import FmuInstance
from cosim.fmu.contract import Instance


class LoneStepper:
    """An FMU instance alone in C's layout, as long as it is wired as it is."""

    inputs: np.ndarray
    width: int
    arena: Arena
    job: NativeExecution

    def __init__(self, instance: FmuInstance, step_ns: int) -> None:
        self.inputs, self.width, self.arena = instance.inputs, len(instance.outputs), Arena()
        native = (NativeInstance * 1)(native_instance(instance, 0, self.arena, strange=True))
        self.job = NativeExecution(instances=self.arena.structures(native), step_ns=step_ns)

    @classmethod
    def of(cls, instance: Instance, step_ns: int) -> LoneStepper | None:
        """The one that is remembered, or a new one; None where the loop in C does not apply."""
        known = _STEPPERS.get(instance)
        if known is not None and known.job.step_ns == step_ns and known.inputs is instance.inputs:
            return known
        if not (isinstance(instance, FmuInstance) and plain(instance)):
            return None
        _STEPPERS[instance] = cls(instance, step_ns)
        return _STEPPERS[instance]

    def outputs(
        self, base: np.ndarray, added: np.ndarray, slopes: np.ndarray | None, moved: np.ndarray
    ) -> np.ndarray | None:
        """Outputs (n, p) after each of n steps of the instance, which has been started; before those that `moved` (n,)
        names its inputs become base + added[k], its slopes slopes[k]. None where it refuses anything or asks to end.
        """
        base, added = np.ascontiguousarray(base, dtype=float), np.ascontiguousarray(added, dtype=float)
        lines = None if slopes is None else np.ascontiguousarray(slopes, dtype=float)
        which, found = np.ascontiguousarray(moved, np.uint8), np.empty((len(added), self.width))
        places = (base.ctypes.data, added.ctypes.data, None if lines is None else lines.ctypes.data, which.ctypes.data)
        done = executor_library().drive(byref(self.job), *places, len(added), found.ctypes.data)
        return found if done == len(added) else None


_STEPPERS: WeakKeyDictionary[Instance, LoneStepper] = WeakKeyDictionary()
