"""Instances of FMI 3.0."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.fmu.bank import Bank, caller, few, pointer_to
from cosim.fmu.instance import LOADING, FmuInstance, whole_arrays
from cosim.fmu.library import tolerant
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
    time: float

    def _load(self, logging: bool) -> Any:
        from fmpy import fmi3

        with LOADING:
            fmu = tolerant(fmi3.FMU3Slave)(
                guid=self.description.token,
                modelIdentifier=self.description.identifier,
                instanceName=self.name,
                unzipDirectory=str(extracted(Path(self.description.path))),
            )
            fmu.instantiate(loggingOn=logging, logMessage=lambda _, status, category, text: self._log(status, text))
        self.flags: tuple[ctypes.c_bool, ...] = (ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool())
        self.reached: ctypes.c_double = ctypes.c_double()
        return fmu

    def _kind(self, type_name: str) -> str:
        return {"Enumeration": "Int64", "Real": "Float64"}.get(type_name, type_name)

    def dtype(self, kind: str) -> np.dtype:
        return np.dtype(_CTYPES3[kind])

    def _enter(self) -> None:
        from fmpy.fmi1 import FMICallException

        try:
            self.fmu.enterInitializationMode(self.settings.tolerance, 0.0, self.settings.stop)
        except FMICallException as error:
            raise self._error(str(error)) from None

    def _settle(self, values: Mapping[str, float | str]) -> None:
        from fmpy.fmi1 import FMICallException

        sizes = [name for name in values if self._structural(name)]
        if not sizes:
            return
        try:
            self.fmu.enterConfigurationMode()
            for kind, names in self.by_kind(sizes).items():
                self._set_values(kind, names, [values[name] for name in names])
            self.fmu.exitConfigurationMode()
        except FMICallException as error:
            raise self._error(f"refuses {', '.join(sizes)}: {error}") from None

    def _bank(self, verb: str, kind: str, names: Sequence[str], array: np.ndarray) -> Bank:
        variables = [self.description.variables[name] for name in names]
        references, places, count = whole_arrays(variables)
        plain = kind == "Float64" and np.array_equal(places, np.arange(count))
        buffer = array if plain else np.zeros(count, dtype=np.dtype(_CTYPES3[kind]))
        if verb == "Set" and len(places) < count:
            self.parts.append((buffer, references))
        call = self._call(verb, kind, (ctypes.c_uint * len(references))(*references), buffer)
        guard = None if kind == "Float64" else self.guard(names)
        return Bank(call, few(verb, names), array, buffer, None if plain else places, guard)

    def start(self, values: Mapping[str, float | str]) -> None:
        super().start(values)
        for buffer, references in self.parts:
            self._fill(buffer, references, values)

    def _fill(self, buffer: np.ndarray, references: Sequence[int], values: Mapping[str, float | str]) -> None:
        """Start values into whole arrays, of which only some elements are wired."""
        known = {(v.reference, v.element): v for v in self.description.variables.values() if v.causality == "input"}
        inside = sorted((k for k in known if k[0] in references), key=lambda k: (references.index(k[0]), k[1]))
        buffer[:] = [values.get(known[k].name, known[k].start or 0.0) for k in inside]

    def _call(self, verb: str, kind: str, references: ctypes.Array[ctypes.c_uint], buffer: np.ndarray) -> Any:
        pointer, count = pointer_to(buffer, _CTYPES3[kind]), len(buffer)
        return caller(self.function(verb + kind), self.component, references, len(references), pointer, count)

    def _wire_slopes(self) -> None:
        if self.sloped:
            call = self._call("Set", "Float64", self.slope_references(), self.slopes)
            self.setters.append(Bank(call, "set input derivatives", self.slopes, self.slopes))

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
