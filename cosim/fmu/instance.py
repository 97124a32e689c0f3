"""What the instances of both FMI versions have in common."""

from __future__ import annotations

import ctypes
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from cosim.errors import RunError
from cosim.fmu.bank import Bank, pointer_to
from cosim.fmu.contract import Instance
from cosim.signals import FmuDescription

LOADING = threading.Lock()  # fmpy changes the working directory while it loads a library


class FmuInstance(Instance):
    """An instance of an FMU, FMI 2.0 or 3.0; errors carry its name, its time and the FMU's own words."""

    prefix = ""

    def __init__(self, name: str, description: FmuDescription) -> None:
        super().__init__(name, description)
        self.messages: deque[str] = deque(maxlen=8)
        self.fmu: Any = self._load()  # fmpy's object, which differs between the versions; None once freed
        self.fresh = True
        self.sloped: tuple[str, ...] | None = None
        self.setters: list[Bank] = []
        self.getters: list[Bank] = []

    # what the two versions do differently

    def _load(self) -> Any:
        """Load the library and instantiate."""
        raise NotImplementedError

    def _enter(self) -> None:
        """Enter initialisation mode at t = 0."""
        raise NotImplementedError

    def _bank(self, verb: str, kind: str, names: Sequence[str], array: np.ndarray) -> Bank:
        """A bank of variables of one type, over a part of an array of doubles."""
        raise NotImplementedError

    # what they have in common

    @property
    def component(self) -> ctypes.c_void_p:
        """The FMI instance pointer."""
        return self.fmu.component

    def function(self, name: str) -> Callable[..., int]:
        """An FMI function of the library, `DoStep` for fmi2DoStep, with argument types set."""
        return self.fmu._functions[self.prefix + name]

    def address(self, name: str) -> int:
        """Address of an FMI function, for compiled executors."""
        address = ctypes.cast(self.fmu._functions[self.prefix + name], ctypes.c_void_p).value
        assert address is not None, f"{self.prefix}{name} is loaded"
        return address

    def references(self, names: Sequence[str]) -> ctypes.Array[ctypes.c_uint]:
        """Value references as a ctypes array."""
        return (ctypes.c_uint * len(names))(*[self.description.variables[n].reference for n in names])

    def wire(self, inputs: Sequence[str], sloped: Sequence[str], outputs: Sequence[str]) -> None:
        if (tuple(inputs), tuple(outputs), tuple(sloped)) == (
            self.input_names,
            self.output_names,
            self.sloped,
        ):
            return
        super().wire(inputs, sloped, outputs)
        self.sloped = tuple(sloped)
        self.setters = self._banks("Set", inputs, self.inputs)
        self.getters = self._banks("Get", outputs, self.outputs)
        self._wire_slopes()

    def _wire_slopes(self) -> None:
        raise NotImplementedError

    def slope_references(self) -> ctypes.Array[ctypes.c_uint]:
        """Value references that slopes are set by, as a ctypes array."""
        raise NotImplementedError

    def judge(self, status: int) -> bool:
        """What the status of a doStep means: True to go on, False to end the run; RunError where it failed."""
        raise NotImplementedError

    def _banks(self, verb: str, names: Sequence[str], array: np.ndarray) -> list[Bank]:
        banks, first = [], 0
        kinds = [self._kind(self.description.variables[name].type) for name in names]
        while first < len(names):
            last = first
            while last < len(names) and kinds[last] == kinds[first]:
                last += 1
            banks.append(self._bank(verb, kinds[first], names[first:last], array[first:last]))
            first = last
        return banks

    def _kind(self, type_name: str) -> str:
        return type_name

    def by_kind(self, names: Iterable[str]) -> dict[str, list[str]]:
        """Names of variables by the FMI type that they are set and got as."""
        kinds: dict[str, list[str]] = {}
        for name in names:
            kinds.setdefault(self._kind(self.description.variables[name].type), []).append(name)
        return kinds

    def dtype(self, kind: str) -> np.dtype:
        """How numbers of an FMI type lie in memory."""
        raise NotImplementedError

    def start(self, values: Mapping[str, float | str]) -> None:
        self.messages.clear()
        self.time = 0.0
        if not self.fresh:
            self.check(self.function("Reset")(self.component), "reset")
        self.fresh = False
        for kind, names in self.by_kind(values).items():
            self._set_values(kind, names, [values[name] for name in names])
        self._enter()

    def _set_values(self, kind: str, names: Sequence[str], values: Sequence[float | str]) -> None:
        """Set start values of one type."""
        from fmpy.fmi1 import FMICallException

        try:
            setter = getattr(self.fmu, "set" + kind)
            numbers = [
                v if isinstance(v, str) else float(v) if kind in ("Real", "Float64", "Float32") else int(v)
                for v in values
            ]
            setter([self.description.variables[n].reference for n in names], numbers)
        except FMICallException:
            raise self._error(f"refuses start values of {', '.join(names)}") from None

    def begin(self) -> None:
        self.check(self.function("ExitInitializationMode")(self.component), "initialisation")

    def set(self) -> None:
        for bank in self.setters:
            bank.set(self)

    def get(self) -> None:
        for bank in self.getters:
            bank.get(self)

    def jacobian(self, unknowns: Sequence[str], knowns: Sequence[str]) -> np.ndarray:
        """Partial derivatives (unknowns, knowns) of outputs and state derivatives at the present state, by the FMU
        itself.

        Raises RunError where the FMU gives no directional derivatives.
        """
        found, column = np.zeros((len(unknowns), len(knowns))), np.zeros(len(unknowns))
        call, rows, count = self.function("GetDirectionalDerivative"), self.references(unknowns), len(unknowns)
        seed, into = pointer_to(np.ones(1), ctypes.c_double), pointer_to(column, ctypes.c_double)
        rest = (1, seed, into) if self.prefix == "fmi2" else (1, seed, 1, into, count)
        for k, known in enumerate(knowns):
            self.check(
                call(self.component, rows, count, self.references([known]), *rest), f"directional derivative by {known}"
            )
            found[:, k] = column
        return found

    def close(self) -> None:
        if self.fmu is not None:
            fmu, self.fmu = self.fmu, None
            fmu.freeInstance()

    def check(self, status: int, what: str) -> None:
        """Raise RunError, with the FMU's own words, for a status above warning, or one that FMI does not know."""
        if not 0 <= status <= 1:
            raise self._error(f"{what} failed ({_STATUS.get(status, f'status {status}, which FMI does not know')})")

    def _error(self, what: str) -> RunError:
        words = "; ".join(dict.fromkeys(self.messages))
        return RunError(self.name, self.time, f"{words} [{what}]" if words else what)

    def _cut_short(self, reached: str) -> RunError:
        """The error of a step that the FMU carried out in part only. It is not repeated: that needs the state before
        it.
        """
        advice = f"take a shorter communication step (experiment.step, or {self.name}.step_multiple)"
        return self._error(f"step cut short, {reached}; {advice}")

    def _log(self, status: int, text: bytes | None) -> None:
        if status > 0 and text:
            self.messages.append(text.decode("utf-8", "replace").strip())


_STATUS = {2: "discarded", 3: "error", 4: "fatal error", 5: "pending"}
