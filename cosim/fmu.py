"""FMUs from files, by fmpy: found or built, extracted once, described, loaded, and driven through preallocated arrays.

The only module that imports fmpy. One call sets the inputs of an instance and one gets its outputs.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from hashlib import sha256
from pathlib import Path
from weakref import WeakValueDictionary

import numpy as np
from attrs import evolve, frozen

from cosim.errors import InputError, Problem, RunError, did_you_mean
from cosim.scenario import Component, Scenario
from cosim.signals import Description, Unit, Variable, stem
from cosim.slave import Slave
from cosim.wiring import Wiring, restarted, wire

Progress = Callable[[str], None]
_LOADING = threading.Lock()  # fmpy changes the working directory while it loads a library


# --- files ---------------------------------------------------------------------------------------------------------------


def fmu_file(component: Component, scenario: Scenario, progress: Progress | None = None) -> Path:
    """The .fmu file of a component; models and recordings are built where they are missing.

    Raises InputError for a model or file that is not there, RunError where it cannot be built.
    """
    from build_fmus.errors import BuildError

    try:
        if component.fmu is not None:
            return (scenario.folder / component.fmu).resolve()
        if component.recording is not None:
            return _recording(component, scenario, progress)
        return _model(component.model or "", scenario.experiment.fmi, progress)
    except BuildError as error:
        raise RunError(component.kind, None, f"cannot be built: {error}") from None


_BUILT: dict[tuple[str, int], Path] = {}  # files of models found or built by this process


def _model(model: str, fmi: int, progress: Progress | None) -> Path:
    path = _BUILT.get((model, fmi))
    if path is None or not path.is_file():
        path = _BUILT[model, fmi] = _built(model, fmi, progress)
    return path


def _built(model: str, fmi: int, progress: Progress | None) -> Path:
    from build_fmus.build import fmu_path
    from build_fmus.sources import models

    if model not in models():
        raise InputError(Problem("model", "one of " + ", ".join(models()), repr(model), did_you_mean(model, models())))
    return fmu_path(model, fmi, progress=progress)


def _recording(component: Component, scenario: Scenario, progress: Progress | None) -> Path:
    """A Recording FMU that plays columns of a CSV (header line, comma) over its time column [s] as outputs y[1], y[2], ..."""
    from build_fmus import recording_fmu

    path = scenario.folder / component.recording
    wanted = [component.time, *component.columns]
    table = read_columns(path, wanted)
    columns = {f"y[{i + 1}]": table[:, i + 1] * component.scale for i in range(len(component.columns))}
    units = dict.fromkeys(columns, component.unit or "1")
    return recording_fmu(table[:, 0], columns, units, component.interpolation.value, scenario.experiment.fmi, progress=progress)


def read_columns(path: Path, names: Sequence[str]) -> np.ndarray:
    """Columns of a CSV file with a header line, in the order asked for, as (rows, columns). Raises InputError."""
    with open(path, encoding="utf-8") as stream:
        lines = [line for line in stream if not line.startswith("#")]
    header = [name.strip() for name in lines[0].split(",")] if lines else []
    missing = [name for name in names if name not in header]
    if missing:
        raise InputError([Problem(str(path), "a column", repr(n), did_you_mean(n, header)) for n in missing])
    try:
        data = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:] if line.strip()])
    except ValueError as error:
        raise InputError(Problem(str(path), "numbers", str(error))) from None
    return data[:, [header.index(name) for name in names]]


def extracted(path: Path) -> Path:
    """Folder with the contents of an FMU, extracted once per content (absolute, kept in the cache)."""
    import fmpy
    from build_fmus.cache import cache_folder

    folder = cache_folder() / "extracted" / _digest(str(path), *_stamp(path))[:24]
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(dir=folder.parent, prefix=".part-"))
        try:
            fmpy.extract(path, fresh)
            os.replace(fresh, folder)
        except OSError as error:
            shutil.rmtree(fresh, ignore_errors=True)
            if not folder.is_dir():
                raise RunError(path.name, None, f"cannot be extracted: {error}") from None
    return folder.resolve()


def _stamp(path: Path) -> tuple[int, int]:
    state = path.stat()
    return state.st_mtime_ns, state.st_size


@lru_cache(maxsize=256)
def _digest(path: str, modified: int, size: int) -> str:
    return sha256(Path(path).read_bytes()).hexdigest()


# --- descriptions --------------------------------------------------------------------------------------------------------


def describe(path: Path) -> Description:
    """What an FMU file says of itself. Raises InputError where it is no co-simulation FMU of FMI 2.0 or 3.0."""
    return _describe(str(path), *_stamp(path))


def descriptions(scenario: Scenario, progress: Progress | None = None) -> dict[str, Description]:
    """The description of every component, FMUs built where they are missing. Raises InputError with every problem found."""
    found, problems = {}, []
    for name, component in scenario.components.items():
        try:
            found[name] = describe(fmu_file(component, scenario, progress))
        except InputError as error:
            problems += [evolve(p, where=f"{scenario.name}: components.{name}: {p.where}") for p in error.problems]
    if problems:
        raise InputError(problems)
    return found


@lru_cache(maxsize=256)
def _describe(path: str, modified: int, size: int) -> Description:
    import fmpy

    try:
        model = fmpy.read_model_description(path, validate=False)
    except Exception as error:  # fmpy raises bare exceptions for whatever it meets in a file
        raise InputError(Problem(path, "an FMU", str(error) or type(error).__name__)) from None
    if model.coSimulation is None or not model.fmiVersion.startswith(("2", "3")):
        raise InputError(Problem(path, "a co-simulation FMU of FMI 2.0 or 3.0", f"FMI {model.fmiVersion}, no co-simulation"))
    interface = model.coSimulation
    units = {u.name: _unit(u) for u in model.unitDefinitions}
    return Description(
        model.modelName, _variables(model, units), model.numberOfContinuousStates > 0 or _has_states(model),
        _takes_slopes(model), model.fmiVersion, path, _digest(path, modified, size), interface.modelIdentifier, model.guid,
        model.description or "", interface.canBeInstantiatedOnlyOncePerProcess, interface.canGetAndSetFMUstate,
        float(model.defaultExperiment.stepSize) if model.defaultExperiment and model.defaultExperiment.stepSize else None,
    )  # fmt: skip


def _has_states(model) -> bool:
    return any(variable.derivative is not None for variable in model.modelVariables)


def _takes_slopes(model) -> bool:
    """FMI 2.0 says so by a flag; in FMI 3.0 our FMUs have an input der(u) for each real input u."""
    if model.fmiVersion.startswith("2"):
        return bool(model.coSimulation.canInterpolateInputs)
    return any(v.causality == "input" and v.name.startswith("der(") for v in model.modelVariables)


def _unit(unit) -> Unit:
    base = unit.baseUnit
    if base is None:
        return Unit(unit.name)
    return Unit(unit.name, tuple(getattr(base, name) for name in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")), base.factor)


def _variables(model, units: Mapping[str, Unit]) -> dict[str, Variable]:
    through = {u.variable.name: u.dependencies for u in model.outputs}
    slopes = {v.name[4:-1]: v.valueReference for v in model.modelVariables if v.causality == "input" and v.name.startswith("der(")}
    return {v.name: _variable(v, units, through.get(v.name), slopes) for v in model.modelVariables}


def _variable(v, units: Mapping[str, Unit], through, slopes: Mapping[str, int]) -> Variable:
    declared = v.declaredType
    name = v.unit or (declared.unit if declared else None) or ""
    low, high = (getattr(v, key) or (getattr(declared, key) if declared else None) for key in ("min", "max"))
    items = tuple(item.name for item in declared.items) if declared is not None and v.type == "Enumeration" else ()
    return Variable(
        v.name, v.causality, v.type, units.get(name, Unit(name)), _start(v), _bound(low), _bound(high), v.valueReference,
        None if through is None else tuple(d.name for d in through if d.causality == "input"), items, v.description or "",
        slopes.get(v.name), v.derivative.name if v.derivative is not None else None, v.variability == "tunable",
    )  # fmt: skip


def _start(v) -> float | str | None:
    if v.start is None or v.type in ("String", "Binary"):
        return v.start
    if v.type == "Boolean":
        return float(v.start in ("true", "1", True))
    return float(str(v.start).split()[0])


def _bound(text: str | None) -> float | None:
    return None if text is None else float(text)


# --- instances -----------------------------------------------------------------------------------------------------------


class FmuSlave(Slave):
    """An instance of an FMU, FMI 2.0 or 3.0; errors carry its name, its time and the FMU's own words."""

    prefix = ""

    def __init__(self, name: str, description: Description) -> None:
        super().__init__(name, description)
        self.messages: deque[str] = deque(maxlen=8)
        self.fmu = self._load()
        self.fresh = True
        self.setters: list[_Bank] = []
        self.getters: list[_Bank] = []

    # what the two versions do differently

    def _load(self):
        """Load the library and instantiate."""
        raise NotImplementedError

    def _enter(self) -> None:
        """Enter initialisation mode at t = 0."""
        raise NotImplementedError

    def _bank(self, verb: str, kind: str, names: Sequence[str], array: np.ndarray) -> _Bank:
        """A bank of variables of one type, over a part of an array of doubles."""
        raise NotImplementedError

    # what they have in common

    @property
    def component(self):
        """The FMI instance pointer."""
        return self.fmu.component

    def function(self, name: str):
        """An FMI function of the library, `DoStep` for fmi2DoStep, with argument types set."""
        return self.fmu._functions[self.prefix + name]

    def address(self, name: str) -> int:
        """Address of an FMI function, for compiled executors."""
        return ctypes.cast(self.function(name), ctypes.c_void_p).value

    def references(self, names: Sequence[str]):
        """Value references as a ctypes array."""
        return (ctypes.c_uint * len(names))(*[self.description.variables[n].reference for n in names])

    def wire(self, inputs: Sequence[str], sloped: Sequence[str], outputs: Sequence[str]) -> None:
        if (tuple(inputs), tuple(outputs), tuple(sloped)) == (self.input_names, self.output_names, getattr(self, "sloped", None)):
            return
        super().wire(inputs, sloped, outputs)
        self.sloped = tuple(sloped)
        self.setters = self._banks("Set", inputs, self.inputs)
        self.getters = self._banks("Get", outputs, self.outputs)
        self._wire_slopes()

    def _wire_slopes(self) -> None:
        raise NotImplementedError

    def slope_references(self):
        """Value references that slopes are set by, as a ctypes array."""
        raise NotImplementedError

    def judge(self, status: int) -> bool:
        """What the status of a doStep means: True to go on, False to end the run; RunError where it failed."""
        raise NotImplementedError

    def _banks(self, verb: str, names: Sequence[str], array: np.ndarray) -> list[_Bank]:
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

    def start(self, values: Mapping[str, float | str]) -> None:
        self.messages.clear()
        self.time = 0.0
        if not self.fresh:
            self.check(self.function("Reset")(self.component), "reset")
        self.fresh = False
        for kind, names in _by_kind(values, self).items():
            self._set_values(kind, names, [values[name] for name in names])
        self._enter()

    def _set_values(self, kind: str, names: Sequence[str], values: Sequence[float | str]) -> None:
        """Set start values of one type."""
        from fmpy.fmi1 import FMICallException

        try:
            setter = getattr(self.fmu, "set" + kind)
            numbers = [v if isinstance(v, str) else float(v) if kind in ("Real", "Float64", "Float32") else int(v) for v in values]
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
        """Partial derivatives (unknowns, knowns) of outputs and state derivatives at the present state, by the FMU itself.

        Raises RunError where the FMU gives no directional derivatives.
        """
        found, column = np.zeros((len(unknowns), len(knowns))), np.zeros(len(unknowns))
        call, rows, seed = self.function("GetDirectionalDerivative"), self.references(unknowns), np.ones(1)
        double = ctypes.c_double
        for k, known in enumerate(knowns):
            sizes = (1,) if self.prefix == "fmi2" else (1, _pointer(seed, double), 1)
            arguments = [self.component, rows, len(unknowns), self.references([known]), *sizes]
            arguments += [_pointer(seed, double), _pointer(column, double)] if self.prefix == "fmi2" else [_pointer(column, double), len(unknowns)]
            self.check(call(*arguments), f"directional derivative by {known}")
            found[:, k] = column
        return found

    def close(self) -> None:
        if self.fmu is not None:
            fmu, self.fmu = self.fmu, None
            fmu.freeInstance()

    def check(self, status: int, what: str) -> None:
        """Raise RunError, with the FMU's own words, for a status above warning."""
        if status > 1:
            raise self._error(f"{what} failed ({_STATUS.get(status, status)})")

    def _error(self, what: str) -> RunError:
        words = "; ".join(dict.fromkeys(self.messages))
        return RunError(self.name, self.time, f"{words} [{what}]" if words else what)

    def _log(self, status: int, text: bytes | None) -> None:
        if status > 0 and text:
            self.messages.append(text.decode("utf-8", "replace").strip())


_STATUS = {2: "discarded", 3: "error", 4: "fatal error", 5: "pending"}


def _by_kind(values: Mapping[str, float | str], slave: FmuSlave) -> dict[str, list[str]]:
    kinds: dict[str, list[str]] = {}
    for name in values:
        kinds.setdefault(slave._kind(slave.description.variables[name].type), []).append(name)
    return kinds


def _few(verb: str, names: Sequence[str]) -> str:
    """`get y, w, ...`: what a call is about, in a few words."""
    stems = list(dict.fromkeys(map(stem, names)))
    return f"{verb.lower()} {', '.join(stems[:4])}{', ...' if len(stems) > 4 else ''}"


class _Bank:
    """Variables of one type behind one FMI call; `array` are their doubles, `buffer` what the FMU sees."""

    def __init__(self, call: Callable[[], int], what: str, array: np.ndarray, buffer: np.ndarray) -> None:
        self.call, self.what, self.array, self.buffer = call, what, array, buffer
        self.shared = buffer is array

    def set(self, slave: FmuSlave) -> None:
        if not self.shared:
            self.buffer[:] = self.array
        if (status := self.call()) > 1:
            slave.check(status, self.what)

    def get(self, slave: FmuSlave) -> None:
        if (status := self.call()) > 1:
            slave.check(status, self.what)
        if not self.shared:
            self.array[:] = self.buffer


def _caller(function, *arguments) -> Callable[[], int]:
    return lambda: function(*arguments)


def _pointer(array: np.ndarray, kind) -> ctypes._Pointer:
    return array.ctypes.data_as(ctypes.POINTER(kind))


class Fmi2Slave(FmuSlave):
    """An FMI 2.0 co-simulation instance."""

    prefix = "fmi2"

    def _load(self):
        from fmpy import fmi2

        self.callbacks = _callbacks(self)
        with _LOADING:
            fmu = fmi2.FMU2Slave(
                guid=self.description.token, modelIdentifier=self.description.identifier, instanceName=self.name,
                unzipDirectory=str(extracted(Path(self.description.path))),
            )  # fmt: skip
            fmu.instantiate(callbacks=self.callbacks)
        return fmu

    def _kind(self, type_name: str) -> str:
        return "Integer" if type_name == "Enumeration" else type_name

    def _enter(self) -> None:
        from fmpy.fmi1 import FMICallException

        try:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        except FMICallException as error:
            raise self._error(str(error)) from None

    def _bank(self, verb: str, kind: str, names: Sequence[str], array: np.ndarray) -> _Bank:
        buffer = array if kind == "Real" else np.zeros(len(names), dtype=np.int32)
        pointer = _pointer(buffer, ctypes.c_double if kind == "Real" else ctypes.c_int)
        function = self.function(verb + kind)
        call = _caller(function, self.component, self.references(names), len(names), pointer)
        return _Bank(call, _few(verb, names), array, buffer)

    def _wire_slopes(self) -> None:
        if self.sloped:
            function = self.function("SetRealInputDerivatives")
            orders = (ctypes.c_int * len(self.sloped))(*[1] * len(self.sloped))
            pointer = _pointer(self.slopes, ctypes.c_double)
            call = _caller(function, self.component, self.slope_references(), len(self.sloped), orders, pointer)
            self.setters.append(_Bank(call, "set input derivatives", self.slopes, self.slopes))

    def slope_references(self):
        return self.references(self.sloped)

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
            reached = f"reached t = {self.fmu.getRealStatus(2):.9g} s only"
        except Exception:  # status functions are optional, and fmpy raises for each that is missing
            reached = "reached part of it only"
        raise self._error(f"step discarded, {reached}")


_SPEAKERS: WeakValueDictionary[int, FmuSlave] = WeakValueDictionary()  # by the environment that an FMU hands to its logger


def _callbacks(slave: FmuSlave):
    """Callbacks for FMI 2.0 whose logger finds the slave by the component environment.

    All instances share one logger, which lives as long as the process: fmpy's compiled helper, which fills in the printf
    marks of a message, remembers only the logger that it was given last.
    """
    from fmpy import calloc, fmi2, free

    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = _logger2()
    callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
    callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
    callbacks.componentEnvironment = id(slave)
    _SPEAKERS[id(slave)] = slave
    try:
        from fmpy.logging import addLoggerProxy

        addLoggerProxy(ctypes.byref(callbacks))
    except (ImportError, OSError, AttributeError):
        pass  # without fmpy's compiled helper, messages keep their printf marks
    return callbacks


@cache
def _logger2():
    from fmpy import fmi2

    def hear(environment, name, status, category, text) -> None:
        slave = _SPEAKERS.get(environment)
        if slave is not None:
            slave._log(status, text)

    return fmi2.fmi2CallbackLoggerTYPE(hear)


_CTYPES3 = {
    "Float64": ctypes.c_double, "Float32": ctypes.c_float, "Boolean": ctypes.c_bool, "Int8": ctypes.c_int8,
    "UInt8": ctypes.c_uint8, "Int16": ctypes.c_int16, "UInt16": ctypes.c_uint16, "Int32": ctypes.c_int32,
    "UInt32": ctypes.c_uint32, "Int64": ctypes.c_int64, "UInt64": ctypes.c_uint64,
}  # fmt: skip


class Fmi3Slave(FmuSlave):
    """An FMI 3.0 co-simulation instance; slopes go to the generated inputs der(u)."""

    prefix = "fmi3"

    def _load(self):
        from fmpy import fmi3

        with _LOADING:
            fmu = fmi3.FMU3Slave(
                guid=self.description.token, modelIdentifier=self.description.identifier, instanceName=self.name,
                unzipDirectory=str(extracted(Path(self.description.path))),
            )  # fmt: skip
            fmu.instantiate(logMessage=lambda _, status, category, text: self._log(status, text))
        self.flags = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool()
        self.reached = ctypes.c_double()
        return fmu

    def _kind(self, type_name: str) -> str:
        return {"Enumeration": "Int64", "Real": "Float64"}.get(type_name, type_name)

    def _enter(self) -> None:
        from fmpy.fmi1 import FMICallException

        try:
            self.fmu.enterInitializationMode(startTime=0.0)
        except FMICallException as error:
            raise self._error(str(error)) from None

    def _bank(self, verb: str, kind: str, names: Sequence[str], array: np.ndarray) -> _Bank:
        return self._bank_of(verb, kind, self.references(names), array, _few(verb, names))

    def _bank_of(self, verb: str, kind: str, references, array: np.ndarray, what: str) -> _Bank:
        ctype, count = _CTYPES3[kind], len(references)
        buffer = array if kind == "Float64" else np.zeros(count, dtype=np.dtype(ctype))
        call = _caller(self.function(verb + kind), self.component, references, count, _pointer(buffer, ctype), count)
        return _Bank(call, what, array, buffer)

    def _wire_slopes(self) -> None:
        if self.sloped:
            self.setters.append(self._bank_of("Set", "Float64", self.slope_references(), self.slopes, "set input derivatives"))

    def slope_references(self):
        return (ctypes.c_uint * len(self.sloped))(*[self.description.variables[n].slope for n in self.sloped])

    def step(self, time: float, size: float) -> bool:
        self.time = time
        event, terminate, early = self.flags
        status = self.function("DoStep")(
            self.component, time, size, True, ctypes.byref(event), ctypes.byref(terminate), ctypes.byref(early),
            ctypes.byref(self.reached),
        )  # fmt: skip
        going = self.judge(status)
        self.time = time + size
        return going

    def judge(self, status: int) -> bool:
        if self.flags[2].value:
            raise self._error(f"returned early, at t = {self.reached.value:.9g} s, though that was not allowed")
        self.check(status, "step" if status != 2 else f"step, at t = {self.reached.value:.9g} s,")
        return not self.flags[1].value


# --- a loaded system -----------------------------------------------------------------------------------------------------


@frozen
class _Wired:
    """The wiring of a scenario and what it depends on, kept between runs."""

    scenario: Scenario
    wiring: Wiring


class FmuSet:
    """FMUs of a scenario, loaded once and reset between runs; a context manager (see cosim.master.System)."""

    def __init__(self, scenario: Scenario, progress: Progress | None = None) -> None:
        self.progress = progress
        self.loaded: dict[str, FmuSlave] = {}
        self.last: _Wired | None = None
        self.wiring(scenario)

    def wiring(self, scenario: Scenario) -> Wiring:
        """The checked wiring of a scenario; scenarios may differ from run to run in anything. Raises InputError."""
        if self.last is None or self.last.scenario != scenario or self.last.scenario.folder != scenario.folder:
            wiring = restarted(self.last.wiring, scenario) if self.last else None
            self.last = _Wired(scenario, wiring or wire(scenario, descriptions(scenario, self.progress)))
        return self.last.wiring

    def slaves(self, wiring: Wiring) -> list[FmuSlave]:
        """An instance for each component, in the order of the scenario; loaded where it was not yet. Raises RunError."""
        return [self._slave(name, wiring.descriptions[name]) for name in wiring.scenario.components]

    def _slave(self, name: str, description: Description) -> FmuSlave:
        slave = self.loaded.get(name)
        if slave is None or slave.description.sha256 != description.sha256:
            if slave is not None:
                slave.close()
            self.loaded[name] = load(name, description)
        return self.loaded[name]

    def close(self) -> None:
        """Free every instance."""
        for slave in self.loaded.values():
            slave.close()
        self.loaded.clear()

    def __enter__(self) -> FmuSet:
        return self

    def __exit__(self, *_) -> None:
        self.close()


def load(name: str, description: Description) -> FmuSlave:
    """Load the library of an FMU and instantiate it under the given name. Raises RunError."""
    kind = Fmi3Slave if description.fmi.startswith("3") else Fmi2Slave
    try:
        return kind(name, description)
    except RunError:
        raise
    except Exception as error:  # fmpy raises bare exceptions: no binary for this platform, wrong token, ...
        raise RunError(name, None, f"cannot be loaded: {error}") from None


def open_system(scenario: Scenario, progress: Progress | None = None) -> FmuSet:
    """Check a scenario against its FMUs and be ready to load them; use as a context manager.

    Raises InputError with every problem found, RunError where an FMU cannot be built.
    """
    return FmuSet(scenario, progress)
