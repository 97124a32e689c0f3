"""What the instances of both FMI versions have in common."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from cosim.errors import RunError
from cosim.fmu.bank import Bank, ValueGuard, pointer_to
from cosim.fmu.contract import FmuSettings, Instance
from cosim.fmu.messages import FmuMessage, MessageLog
from cosim.scenario import Conversion, FmuLogging
from cosim.signals import REALS, FmuDescription, Variable

LOADING = threading.Lock()  # fmpy changes the working directory while it loads a library


class FmuInstance(Instance):
    """An instance of an FMU, FMI 2.0 or 3.0; errors carry its name, its time and the FMU's own words."""

    prefix = ""
    time: float

    def __init__(self, name: str, description: FmuDescription, logging: FmuLogging = FmuLogging.WARNINGS) -> None:
        super().__init__(name, description)
        self.logging = logging
        self.messages: MessageLog = MessageLog(name, everything=logging is FmuLogging.ALL)
        self.clock: Callable[[], float] | None = None  # tells the time while a loop in C calls the FMU
        self.fmu: Any = None  # fmpy's object, which differs between the versions; None once freed
        self.fmu = self._loaded()
        self.fresh: bool = True
        self.sloped: tuple[str, ...] | None = None
        self.setters: list[Bank] = []
        self.getters: list[Bank] = []
        self.parts: list[tuple[np.ndarray, Sequence[int]]] = []  # arrays of which only some elements are wired

    def _loaded(self) -> Any:
        """fmpy's object, instantiated. Raises RunError with what the FMU said.

        FMUs of others are asked to talk unless that is turned off, since many tell the reason of an error only then;
        ours tell it anyway.
        """
        from build_fmus.homes import GENERATOR

        others = self.description.tool != GENERATOR
        try:
            return self._load(self.logging is FmuLogging.ALL or (others and self.logging is FmuLogging.WARNINGS))
        except Exception as error:  # noqa: BLE001 - fmpy raises bare exceptions: no binary here, wrong token, ...
            raise RunError(self.name, None, self._with_words(f"cannot be loaded: {error}")) from None

    # what the two versions do differently

    def _load(self, logging: bool) -> Any:
        """Load the library and instantiate."""
        raise NotImplementedError

    def _enter(self) -> None:
        """Tell the settings and enter initialisation mode at t = 0."""
        raise NotImplementedError

    def _settle(self, values: Mapping[str, float | str]) -> None:
        """Set what settles the sizes of arrays."""

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
        found = self.fmu._functions.get(self.prefix + name)
        if found is None:
            raise self._error(f"its library lacks {self.prefix}{name}, which this scenario needs")
        return found

    def has(self, name: str) -> bool:
        """Whether the library has an FMI function, which may be an optional one."""
        return self.prefix + name in self.fmu._functions

    def address(self, name: str) -> int | None:
        """Address of an FMI function, for compiled executors; None where the library lacks it."""
        found = self.fmu._functions.get(self.prefix + name)
        return None if found is None else ctypes.cast(found, ctypes.c_void_p).value

    def references(self, names: Sequence[str]) -> ctypes.Array[ctypes.c_uint]:
        """Value references as a ctypes array."""
        return (ctypes.c_uint * len(names))(*[self.description.variables[n].reference for n in names])

    def configure(self, settings: FmuSettings, conversions: Mapping[str, Conversion]) -> None:
        if conversions != self.conversions:
            self.sloped = None  # wired anew
        super().configure(settings, conversions)

    def said(self) -> tuple[FmuMessage, ...]:
        return self.messages.counted()

    def wire(self, inputs: Sequence[str], sloped: Sequence[str], outputs: Sequence[str]) -> None:
        if (tuple(inputs), tuple(outputs), tuple(sloped)) == (
            self.input_names,
            self.output_names,
            self.sloped,
        ):
            return
        super().wire(inputs, sloped, outputs)
        self.sloped = tuple(sloped)
        self.parts = []
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
        self._settle(values)
        for kind, names in self.by_kind(n for n in values if not self._structural(n)).items():
            self._set_values(kind, names, [values[name] for name in names])
        self._enter()

    def _structural(self, name: str) -> bool:
        return self.description.variables[name].causality == "structuralParameter"

    def _set_values(self, kind: str, names: Sequence[str], values: Sequence[float | str]) -> None:
        """Set start values of one type, whole arrays each (see cosim.wiring.starts)."""
        from fmpy.fmi1 import FMICallException

        chosen = [self.description.variables[n] for n in names]
        given = {(v.reference, v.element): _handed(kind, value) for v, value in zip(chosen, values)}
        references = list(dict.fromkeys(v.reference for v in chosen))
        ordered = [given[key] for key in sorted(given, key=lambda key: (references.index(key[0]), key[1]))]
        try:
            getattr(self.fmu, "set" + kind)(references, ordered)
        except (FMICallException, KeyError):  # the latter where the library has no such function
            raise self._error(f"refuses start values of {', '.join(names)}") from None

    def begin(self) -> None:
        self.check(self.function("ExitInitializationMode")(self.component), "initialisation")

    def set(self) -> None:
        for bank in self.setters:
            bank.set(self)

    def get(self) -> None:
        for bank in self.getters:
            bank.get(self)

    def get_text(self, name: str) -> str | bytes:
        (value,) = self._text("get", name)
        if isinstance(value, bytes) and self.description.variables[name].kind == "String":
            return value.decode("utf-8")
        return b"" if value is None else value

    def set_text(self, name: str, text: str | bytes) -> None:
        self._text("set", name, [text])

    def _text(self, verb: str, name: str, *values: list[str | bytes]) -> Any:
        from fmpy.fmi1 import FMICallException

        variable = self.description.variables[name]
        try:
            return getattr(self.fmu, verb + variable.type)([variable.reference], *values)
        except (FMICallException, KeyError) as error:
            raise self._error(f"{verb} {name} failed ({error})") from None

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

    def unfit(self, name: str, expected: str, got: float) -> None:
        """Raise RunError for a value that a variable's type cannot hold."""
        raise RunError(self.name, self.time, f"expected {expected}, got {_exact(got)}", name)

    def _error(self, what: str) -> RunError:
        return RunError(self.name, self.time, self._with_words(what))

    def _with_words(self, what: str) -> str:
        words = "; ".join(dict.fromkeys(self.messages.recent))
        return f"{words} [{what}]" if words else what

    def _cut_short(self, reached: str) -> RunError:
        """The error of a step that the FMU carried out in part only. It is not repeated: that needs the state before
        it.
        """
        advice = f"take a shorter communication step (experiment.step, or {self.name}.step_multiple)"
        return self._error(f"step cut short, {reached}; {advice}")

    def _log(self, status: int, text: bytes | None) -> None:
        if text:
            now = self.time if self.clock is None else self.clock()
            self.messages.hear(status, text.decode("utf-8", "replace").strip(), now)

    def guard(self, names: Sequence[str]) -> ValueGuard:
        """What values of variables of one type must be."""
        return ValueGuard.of([self.description.variables[name] for name in names], self.conversions)


def _exact(value: float) -> str:
    return str(int(value)) if float(value).is_integer() else f"{value:.17g}"


def _handed(kind: str, value: float | str) -> object:
    """A start value as fmpy's setters take it."""
    if isinstance(value, str):
        return bytes.fromhex(value) if kind == "Binary" else value
    return float(value) if kind in REALS else int(value)


def whole_arrays(variables: Sequence[Variable]) -> tuple[list[int], np.ndarray, int]:
    """Value references, each once; the places of the variables in the arrays behind them, laid end to end; how many
    values that are.
    """
    sizes = {v.reference: v.size for v in variables}
    ends = np.cumsum(list(sizes.values()), dtype=int)
    begins = dict(zip(sizes, (ends - list(sizes.values())).tolist()))
    places = np.array([begins[v.reference] + v.element for v in variables], dtype=int)
    return list(sizes), places, int(ends[-1]) if len(ends) else 0


_STATUS = {2: "discarded", 3: "error", 4: "fatal error", 5: "pending"}
