"""Instances of FMI 2.0."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from cosim.fmu.bank import Bank, caller, few, pointer_to
from cosim.fmu.instance import LOADING, FmuInstance
from cosim.fmu.library import tolerant
from cosim.fmu.places import extracted


class Fmi2Instance(FmuInstance):
    """An FMI 2.0 co-simulation instance."""

    prefix = "fmi2"
    time: float

    def _load(self, logging: bool) -> Any:
        from fmpy import fmi2

        self.callbacks: Any = _callbacks(self)
        with LOADING:
            fmu = tolerant(fmi2.FMU2Slave)(
                guid=self.description.token,
                modelIdentifier=self.description.identifier,
                instanceName=self.name,
                unzipDirectory=str(extracted(Path(self.description.path))),
            )
            fmu.instantiate(callbacks=self.callbacks, loggingOn=logging)
        return fmu

    def _kind(self, type_name: str) -> str:
        return "Integer" if type_name == "Enumeration" else type_name

    def dtype(self, kind: str) -> np.dtype:
        return np.dtype(float if kind == "Real" else np.int32)

    def _enter(self) -> None:
        from fmpy.fmi1 import FMICallException

        try:
            self.fmu.setupExperiment(self.settings.tolerance, 0.0, self.settings.stop)
            self.fmu.enterInitializationMode()
        except FMICallException as error:
            raise self._error(str(error)) from None

    def _bank(self, verb: str, kind: str, names: Sequence[str], array: np.ndarray) -> Bank:
        plain = kind == "Real"
        buffer = array if plain else np.zeros(len(names), dtype=np.int32)
        pointer = pointer_to(buffer, ctypes.c_double if plain else ctypes.c_int)
        function = self.function(verb + kind)
        call = caller(function, self.component, self.references(names), len(names), pointer)
        return Bank(call, few(verb, names), array, buffer, guard=None if plain else self.guard(names))

    def _wire_slopes(self) -> None:
        if self.sloped:
            function = self.function("SetRealInputDerivatives")
            orders = (ctypes.c_int * len(self.sloped))(*[1] * len(self.sloped))
            pointer = pointer_to(self.slopes, ctypes.c_double)
            call = caller(function, self.component, self.slope_references(), len(self.sloped), orders, pointer)
            self.setters.append(Bank(call, "set input derivatives", self.slopes, self.slopes))

    def slope_references(self) -> ctypes.Array[ctypes.c_uint]:
        return self.references(self.sloped or ())

    def step(self, time: float, size: float) -> bool:
        self.time = time
        going = self.judge(self.function("DoStep")(self.component, time, size, 1))
        self.time = time + size
        return going

    def judge(self, status: int) -> bool:
        if status == 2:
            return self._discarded()
        self.check(status, "step")
        return True

    def _discarded(self) -> bool:
        """False where the FMU wants the run to end; else an error with the time that it reached."""
        try:
            if self.fmu.getBooleanStatus(3):
                return False
            reached = f"discarded at t = {self.fmu.getRealStatus(2):.9g} s"
        except Exception:  # noqa: BLE001 - status functions are optional, and fmpy raises for each that is missing
            reached = "discarded at a time that the FMU does not tell"
        raise self._cut_short(reached)


_LOGGING: WeakValueDictionary[int, FmuInstance] = WeakValueDictionary()
"""Instances by the component environment that an FMU gives to its logger."""


def _callbacks(instance: FmuInstance) -> Any:
    """Callbacks for FMI 2.0 whose logger finds the instance by the component environment.

    All instances share one logger, which lives as long as the process: fmpy's compiled helper, which fills in the
    printf marks of a message, remembers only the logger that it was given last.
    """
    from fmpy import calloc, fmi2, free

    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = _logger2()
    callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
    callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
    callbacks.componentEnvironment = id(instance)
    _LOGGING[id(instance)] = instance
    try:
        from fmpy.logging import addLoggerProxy

        addLoggerProxy(ctypes.byref(callbacks))
    except (ImportError, OSError, AttributeError):
        pass  # without fmpy's compiled helper, messages keep their printf marks
    return callbacks


@cache
def _logger2() -> Any:
    from fmpy import fmi2

    def log(environment: int, name: bytes, status: int, category: bytes, text: bytes | None) -> None:
        instance = _LOGGING.get(environment)
        if instance is not None:
            instance._log(status, text)

    return fmi2.fmi2CallbackLoggerTYPE(log)
