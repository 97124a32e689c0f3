"""Instances of FMI 3.0."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.fmu.bank import Bank, caller, few, pointer_to
from cosim.fmu.instance import LOADING, FmuInstance
from cosim.fmu.places import extracted

_CTYPES3 = {
    "Float64": ctypes.c_double,
    "Float32": ctypes.c_float,
    "Boolean": ctypes.c_bool,
    "Int8": ctypes.c_int8,
    "UInt8": ctypes.c_uint8,
    "Int16": ctypes.c_int16,
    "UInt16": ctypes.c_uint16,
    "Int32": ctypes.c_int32,
    "UInt32": ctypes.c_uint32,
    "Int64": ctypes.c_int64,
    "UInt64": ctypes.c_uint64,
}


class Fmi3Instance(FmuInstance):
    """An FMI 3.0 co-simulation instance; slopes go to the generated inputs der(u)."""

    prefix = "fmi3"

    def _load(self) -> Any:
        from fmpy import fmi3

        with LOADING:
            fmu = fmi3.FMU3Slave(
                guid=self.description.token,
                modelIdentifier=self.description.identifier,
                instanceName=self.name,
                unzipDirectory=str(extracted(Path(self.description.path))),
            )
            fmu.instantiate(logMessage=lambda _, status, category, text: self._log(status, text))
        self.flags = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool()
        self.reached = ctypes.c_double()
        return fmu

    def _kind(self, type_name: str) -> str:
        return {"Enumeration": "Int64", "Real": "Float64"}.get(type_name, type_name)

    def dtype(self, kind: str) -> np.dtype:
        return np.dtype(_CTYPES3[kind])

    def _enter(self) -> None:
        from fmpy.fmi1 import FMICallException

        try:
            self.fmu.enterInitializationMode(startTime=0.0)
        except FMICallException as error:
            raise self._error(str(error)) from None

    def _bank(self, verb: str, kind: str, names: Sequence[str], array: np.ndarray) -> Bank:
        return self._bank_of(verb, kind, self.references(names), array, few(verb, names))

    def _bank_of(
        self, verb: str, kind: str, references: ctypes.Array[ctypes.c_uint], array: np.ndarray, what: str
    ) -> Bank:
        ctype, count = _CTYPES3[kind], len(references)
        buffer = array if kind == "Float64" else np.zeros(count, dtype=np.dtype(ctype))
        call = caller(self.function(verb + kind), self.component, references, count, pointer_to(buffer, ctype), count)
        return Bank(call, what, array, buffer)

    def _wire_slopes(self) -> None:
        if self.sloped:
            self.setters.append(
                self._bank_of("Set", "Float64", self.slope_references(), self.slopes, "set input derivatives")
            )

    def slope_references(self) -> ctypes.Array[ctypes.c_uint]:
        slopes = [self.description.variables[name].slope for name in self.sloped or ()]
        return (ctypes.c_uint * len(slopes))(*slopes)

    def step(self, time: float, size: float) -> bool:
        self.time = time
        event, terminate, early = self.flags
        status = self.function("DoStep")(
            self.component,
            time,
            size,
            True,
            ctypes.byref(event),
            ctypes.byref(terminate),
            ctypes.byref(early),
            ctypes.byref(self.reached),
        )
        going = self.judge(status)
        self.time = time + size
        return going

    def judge(self, status: int) -> bool:
        if self.flags[2].value or status == 2:
            how = "returned early, which was not allowed," if self.flags[2].value else "discarded"
            raise self._cut_short(f"{how} at t = {self.reached.value:.9g} s")
        self.check(status, "step")
        return not self.flags[1].value
