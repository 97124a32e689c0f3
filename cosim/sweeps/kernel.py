"""The batch kernel: many scenarios of the built-in loop at once, in the vector lanes of fmu_src/kernel/kernel.c.

It runs the same schedule on the same physics source as the FMUs and gives their bits, without FMI. It applies to arms
without effects, P-like controllers, channels with the semantics `time_delay` and no loss, and components that nothing
is
wired into (an operator that does not feel the arm): their signals, and the delays of every law but the constant one,
are
computed beforehand by the FMUs themselves. `refusal` says why it does not apply; then the co-simulation does.
"""

from __future__ import annotations

import ctypes
import itertools
import time
from collections import OrderedDict, defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from ctypes import POINTER, c_double, c_int64, c_void_p
from functools import cache

import numpy as np
from attrs import evolve, field, frozen

from cosim.engine.master import Result, Timetable, run
from cosim.engine.native import Arena
from cosim.engine.outcome import Outcome
from cosim.engine.reference import Ending
from cosim.engine.table import SignalTable
from cosim.errors import RunError
from cosim.signals import FmuDescription, index_of, stem
from cosim.wiring import Wiring
from cosim.wiring.schedule import GetOutputs, Operation, Phase, Record, SetInputs, seconds

_ARM, _CONTROLLER, _CHANNEL, _SERIES = range(4)
_KINDS = {"PhantomArm": _ARM, "PLikeController": _CONTROLLER, "VariableDelayChannel": _CHANNEL}
_INPUTS = {
    _ARM: ("tau", "f", "f_command", "x_ref"),
    _CONTROLLER: ("x_ref", "x", "dx", "q_ref", "q", "dq"),
    _CHANNEL: ("u", "v"),
    _SERIES: (),
}
_OUTPUTS = {
    _ARM: {"q": 0, "dq": 3, "x": 6, "dx": 9, "x_tip": 6, "dx_tip": 9},
    _CONTROLLER: {"f": 0, "tau": 3},
    _CHANNEL: {"y": 0, "w": 3},
}
_ARM_VECTORS = {
    "viscous": 10,
    "coulomb": 13,
    "coulomb_velocity": 16,
    "stiffness": 19,
    "damping": 22,
    "q_start": 25,
    "dq_start": 28,
}
_ARM_PARAMETERS = {"pi", "gravity_compensation", "mounting", "internal_steps", "workspace_limits", *_ARM_VECTORS}
_CONTROLLER_VECTORS = {"stiffness": 0, "damping": 3, "joint_stiffness": 6, "joint_damping": 9}
_COUNTS = {_ARM: 12, _CONTROLLER: 6, _CHANNEL: 6}  # outputs of a kind; a series has what its FMU has
_NUMBERS = {_ARM: 31, _CONTROLLER: 13, _CHANNEL: 0, _SERIES: 0}
_SHARED = ("internal_steps", "workspace_limits", "interpolation")
_CHANNEL_NEUTRAL = {"semantics": 1.0, "loss_to_bad": 0.0, "loss_good": 0.0}
_MOST_OUTPUTS = 12  # of a series
_LEAST_BOUND = 1e5
"""The kernel watches the outputs that it computes; others (packets in flight, ages) stay below this."""
_NO_BOUND = 1e300
_MOST_BYTES = 1 << 30  # of the table of one call, which lies in memory
_MOST_STEPS = 8000  # the channel FMU's buffer, less a margin


class _NativeComponent(ctypes.Structure):
    _fields_ = [
        ("kind", c_int64),
        ("n_inputs", c_int64),
        ("inputs", c_void_p),
        ("first", c_int64),
        ("numbers", c_void_p),
        ("internal_steps", c_int64),
        ("workspace", c_int64),
        ("impedance", c_int64),
        ("viscous", c_int64),
        ("coulomb", c_int64),
        ("linear", c_int64),
        ("series", c_void_p),
        ("n_series", c_int64),
        ("series_step", c_void_p),
        ("history", c_void_p),
        ("stamps", c_void_p),
        ("capacity", c_int64),
    ]


class _NativeBatch(ctypes.Structure):
    _fields_ = [
        ("components", c_void_p),
        ("n_components", c_int64),
        ("phases", c_void_p),
        ("n_phases", c_int64),
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
        ("work", c_void_p),
    ]


@cache
def _library():
    from build_fmus.library import library_path, vectors

    return prepared(ctypes.CDLL(str(library_path("kernel", ("-O3", "-fno-math-errno", *vectors()[1])))))


def prepared(library: ctypes.CDLL) -> ctypes.CDLL:
    """A compiled fmu_src/kernel with the types of its functions."""
    library.run.argtypes = [POINTER(_NativeBatch), c_void_p]
    library.run.restype = None
    library.lanes.restype = library.lane_size.restype = c_int64
    return library


def lanes() -> int:
    """How many scenarios one call runs at once on this machine."""
    return int(_library().lanes())


# --- does it apply? ---------------------------------------------------------------------------------------------------


def refusal(wiring: Wiring, record: Sequence[str] = ()) -> str | None:
    """Why the kernel cannot run a scenario, in words for the user; None where it can. `record`: signals wanted."""
    if wiring.scenario.experiment.bound < _LEAST_BOUND:
        return f"experiment.bound is {wiring.scenario.experiment.bound:g}, and the kernel watches what it computes only"
    kept = sum(name in record or stem(name) in record for name in wiring.signals)
    from build_fmus.library import vectors

    if (size := 8 * vectors()[0] * kept * wiring.scenario.experiment.rows) > _MOST_BYTES:
        return (
            f"the table of a batch would take {size / 1e9:.3g} GB of memory (experiment.record_every makes it shorter)"
        )
    parts = _LaneComponent.all(wiring)
    places = _Places.of(wiring, parts)
    for part in parts:
        if (reason := _unfit(part, wiring)) is not None:
            return f"{part.name}: {reason}"
    for link in wiring.links:
        if str(link.source) not in places.number:
            return f"{link.source} is wired, which the kernel does not compute"
    stems = {stem(name) for name in places.number}
    missing = [name for name in record if name not in places.number and name not in stems]
    return f"{missing[0]} is to be recorded, which the kernel does not compute" if missing else None


def _unfit(part: _LaneComponent, wiring: Wiring) -> str | None:
    if wiring.scenario.components[part.name].step_multiple != 1:
        return "it has a step multiple"
    if part.kind == _SERIES and part.inputs:
        return f"{part.model} feels what is wired into it"
    if part.kind == _SERIES:
        return f"it has more than {_MOST_OUTPUTS} outputs" if len(part.outputs) > _MOST_OUTPUTS else None
    strange = [v for v in part.inputs if stem(v) not in _INPUTS[part.kind]]
    if strange:
        return f"its input {strange[0]} is wired"
    if part.kind == _CHANNEL and (longest := _longest_delay(part)) > _MOST_STEPS * wiring.scenario.experiment.step:
        return f"its delay of up to {longest:g} s does not fit the kernel's buffer"
    return _PARAMETERS[part.kind](part)


def _arm_parameters(part: _LaneComponent) -> str | None:
    return _changed(part, {n: v for n, v in part.starts.items() if stem(n) not in _ARM_PARAMETERS})


def _longest_delay(part: _LaneComponent) -> float:
    return part.number("delay_mean" if _law(part) == "constant" else "delay_max")


def _law(part: _LaneComponent) -> str:
    return part.description.variables["law"].items[int(part.number("law")) - 1]


def _channel_parameters(part: _LaneComponent) -> str | None:
    if _law(part) == "recorded":
        return "its delay is recorded"
    other = {name: part.number(name) for name in _CHANNEL_NEUTRAL if name in part.description.variables}
    wrong = [name for name, value in other.items() if value != _CHANNEL_NEUTRAL[name]]
    return f"its {wrong[0]} is not that of a plain time delay" if wrong else None


def _changed(part: _LaneComponent, values) -> str | None:
    variables = part.description.variables
    for name, value in values.items():
        if value != variables[name].start:
            return f"its {name} is {value!r}"
    return None


_PARAMETERS = {_ARM: _arm_parameters, _CONTROLLER: lambda part: None, _CHANNEL: _channel_parameters}


# --- a scenario as the kernel sees it ---------------------------------------------------------------------------------


@frozen
class _LaneComponent:
    """A component: what it is, which of its inputs are wired, start values."""

    name: str
    model: str
    kind: int
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    starts: dict[str, float | str]
    description: FmuDescription

    @classmethod
    def of(cls, wiring: Wiring, name: str) -> _LaneComponent:
        model = wiring.scenario.components[name].model or ""
        inputs = tuple(wiring.inputs(name))
        return cls(
            name,
            model or "a foreign FMU",
            _KINDS.get(model, _SERIES),
            inputs,
            tuple(wiring.outputs(name)),
            dict(wiring.starts[name]),
            wiring.descriptions[name],
        )

    @classmethod
    def all(cls, wiring: Wiring) -> tuple[_LaneComponent, ...]:
        """The components of a scenario, in its order."""
        return tuple(cls.of(wiring, name) for name in wiring.scenario.components)

    def number(self, name: str) -> float:
        """Start value of a scalar variable."""
        value = self.starts.get(name)
        return float(self.description.variables[name].start or 0.0) if value is None else float(value)

    def vector(self, name: str, size: int = 3) -> list[float]:
        return [self.number(f"{name}[{i + 1}]") for i in range(size)]

    def wired(self) -> list[int]:
        """Wired inputs by their numbers in the kernel."""
        return [3 * _INPUTS[self.kind].index(stem(v)) + index_of(v) - 1 for v in self.inputs]

    def computed(self) -> list[tuple[str, int]]:
        """Outputs that the kernel has, with their numbers."""
        if self.kind == _SERIES:
            return [(name, i) for i, name in enumerate(self.outputs)]
        known = _OUTPUTS[self.kind]
        return [(name, known[stem(name)] + index_of(name) - 1) for name in self.outputs if stem(name) in known]


@frozen
class _Places:
    """Where the kernel's outputs lie in half its store: `first` of each component, `number` by signal name, `at` by
    place in
    the schedule's store (-1: not computed); how many there are.
    """

    first: tuple[int, ...]
    number: dict
    at: np.ndarray = field(eq=False)
    count: int

    @classmethod
    def of(cls, wiring: Wiring, parts: Sequence[_LaneComponent]) -> _Places:
        *first, count = itertools.accumulate((_COUNTS.get(part.kind, len(part.outputs)) for part in parts), initial=0)
        number = {f"{part.name}.{output}": at + i for at, part in zip(first, parts) for output, i in part.computed()}
        return cls(
            tuple(first), number, np.array([number.get(name, -1) for name in wiring.signals], dtype=np.int64), count
        )


# --- running ----------------------------------------------------------------------------------------------------------


def run_batch(wirings: Sequence[Wiring], record: Sequence[str], workers: int = 1) -> list[Result]:
    """The results of many scenarios that differ in parameters only, in their order.

    wirings: of scenarios with the same components, connections and experiment, each of which `refusal` accepts; record:
    signals to keep, `arm_l.q` or `arm_l.q[1]`; workers: threads (the kernel holds no lock of Python's).
    """
    alike, feed = _LaneComponent.all(wirings[0]), _FEED
    settings = [_LaneSetting.of(wiring, alike, feed) for wiring in wirings]
    batches = _batches(settings)
    tasks = [[settings[i] for i in batch] for batch in batches]
    found = _each(lambda settings: _run_lanes(settings, record), tasks, workers)
    results = {i: result for batch, some in zip(batches, found) for i, result in zip(batch, some)}
    return [results[i] for i in range(len(wirings))]


def _each(action: Callable, tasks: Sequence, workers: int) -> list:
    """Results in the order of the tasks; without threads where one would do, for its memory and its cache start
    cold.
    """
    if min(workers, len(tasks)) < 2:
        return [action(task) for task in tasks]
    with ThreadPoolExecutor(max_workers=workers) as pool:
        return list(pool.map(action, tasks))


def _batches(settings: Sequence[_LaneSetting]) -> list[list[int]]:
    """Indices of settings that share what all lanes must share, as many as there are lanes."""
    alike = defaultdict(list)
    for i, setting in enumerate(settings):
        alike[setting.shared].append(i)
    width = lanes()
    return [group[k : k + width] for group in alike.values() for k in range(0, len(group), width)]


_FEED_SIZE = 64


class _Feed:
    """Signals computed beforehand by the FMUs: an operator's force, the delays of a law. Each different one once; the
    last
    of them are remembered.
    """

    def __init__(self) -> None:
        self.known: OrderedDict = OrderedDict()

    def values(self, wiring: Wiring, part: _LaneComponent, outputs: Sequence[str]) -> np.ndarray:
        """(steps + 1, outputs) values of a component's outputs at every communication point, alone in its own run."""
        experiment = wiring.scenario.experiment
        length = (experiment.steps, experiment.step_ns)
        key = (part.model, part.description.sha256, tuple(sorted(part.starts.items())), length, tuple(outputs))
        if key not in self.known:
            self.known[key] = _alone(wiring, part, outputs)
        self.known.move_to_end(key)
        while len(self.known) > _FEED_SIZE:
            self.known.popitem(last=False)
        return self.known[key]


_FEED = _Feed()


def _alone(wiring: Wiring, part: _LaneComponent, outputs: Sequence[str]) -> np.ndarray:
    component = wiring.scenario.components[part.name]
    alone = evolve(
        wiring.scenario,
        components={part.name: evolve(component, parameters=dict(part.starts), parameter_set=None)},
        connections=(),
        experiment=evolve(wiring.scenario.experiment, record_every=1, order=(), bound=_NO_BOUND),
    )
    result = run(alone, record=[f"{part.name}.{name}" for name in outputs])
    if result.failure is not None:
        raise result.failure
    if result.stopped_at is not None:
        raise RunError(part.name, result.stopped_at, f"ended early when run alone: {result.message}")
    return np.ascontiguousarray(np.column_stack([result.signals[f"{part.name}.{name}"] for name in outputs]))


@frozen
class _LaneSetting:
    """A lane: a wiring, its parts, and for each part its numbers or its series."""

    wiring: Wiring
    parts: tuple[_LaneComponent, ...]
    numbers: tuple[np.ndarray, ...] = field(eq=False)
    series: tuple[np.ndarray | None, ...] = field(eq=False)

    @classmethod
    def of(cls, wiring: Wiring, alike: Sequence[_LaneComponent], feed: _Feed) -> _LaneSetting:
        """The lane of a wiring whose components are `alike` but for their start values."""
        parts = tuple(evolve(part, starts=wiring.starts[part.name]) for part in alike)
        return cls(wiring, parts, tuple(_numbers(p) for p in parts), tuple(_series(wiring, p, feed) for p in parts))

    @property
    def shared(self) -> tuple[float, ...]:
        """What all lanes of a call must have in common."""
        return tuple(p.number(name) for p in self.parts for name in _SHARED if name in p.description.variables)


def _numbers(part: _LaneComponent) -> np.ndarray:
    """Per-lane numbers of kernel.c's Component, in its order."""
    numbers = np.zeros(_NUMBERS[part.kind])
    if part.kind == _ARM:
        pi = np.array(part.vector("pi", 8))
        pi[6:] *= -1.0 if part.number("mounting") == 2 else 1.0
        numbers[:8], numbers[8:10] = pi, pi[6:] if part.number("gravity_compensation") else 0.0
    if part.kind == _CONTROLLER:
        numbers[12] = part.number("space") == 1
    for name, at in {_ARM: _ARM_VECTORS, _CONTROLLER: _CONTROLLER_VECTORS}.get(part.kind, {}).items():
        numbers[at : at + 3] = part.vector(name)
    return numbers


def _series(wiring: Wiring, part: _LaneComponent, feed: _Feed) -> np.ndarray | None:
    if part.kind == _SERIES:
        return feed.values(wiring, part, part.outputs)
    if part.kind != _CHANNEL:
        return None
    if _law(part) == "constant":
        return np.array([[part.number("delay_mean")]])
    unwired = evolve(part, inputs=())
    return feed.values(wiring, unwired, ("delay_now",))


def _run_lanes(settings: Sequence[_LaneSetting], record: Sequence[str]) -> list[Result]:
    began = time.perf_counter()
    call = _Call(settings, record)
    _library().run(ctypes.byref(call.job), call.sources)
    wall = (time.perf_counter() - began) / len(settings)
    return [call.result(lane, wall) for lane in range(len(settings))]


class _Call:
    """One call of the kernel: C's layout of up to `lanes()` settings, and the arrays that must outlive the call.

    Lanes that are left over repeat the last setting; their results are not looked at.
    """

    def __init__(self, settings: Sequence[_LaneSetting], record: Sequence[str]) -> None:
        self.settings, self.width = settings, lanes()
        self.filled = list(settings) + [settings[-1]] * (self.width - len(settings))
        self.wiring, self.parts = settings[0].wiring, settings[0].parts
        self.places = _Places.of(self.wiring, self.parts)
        self.experiment = self.wiring.scenario.experiment
        self.timetable = Timetable.of(self.wiring, record)
        self.arena = Arena()
        self.rows = self.experiment.rows
        self.table = np.empty((self.width, self.rows, len(self.timetable.names)))
        self.ended, self.outcome = np.zeros(self.width, np.int64), np.zeros(self.width, np.int64)
        self.job = self._job()
        place = {str(link.target): self.places.number[str(link.source)] for link in self.wiring.links}
        sources = [[place[f"{part.name}.{v}"] for v in part.inputs] for part in self.parts]
        self.sources = self.arena.pointers([self.arena.indices(places) for places in sources])

    def _job(self) -> _NativeBatch:
        schedule = self.wiring.schedule
        components = (_NativeComponent * len(self.parts))(*[self._component(i) for i in range(len(self.parts))])
        phases = [self._phase(odd) for odd in (0, 1)]
        work = self.arena.aligned(np.zeros(len(self.parts) * int(_library().lane_size()) // 8))
        return _NativeBatch(
            self.arena.structures(components),
            len(self.parts),
            self.arena.phases(phases, self.timetable.columns, schedule.step_ns),
            len(phases),
            self.arena.aligned(np.zeros(2 * self.places.count * self.width)),
            self.places.count,
            self.arena.array(self.table),
            self.rows,
            len(self.timetable.names),
            self.experiment.record_every,
            self.experiment.steps,
            schedule.step_ns,
            self.experiment.bound,
            self.arena.array(self.ended),
            self.arena.array(self.outcome),
            work,
        )

    def _phase(self, odd: int) -> Phase:
        """The schedule's one phase in the kernel's places, for odd or even steps: each step writes its outputs into the
        half of
        the store where the values before the newest were, so it needs no operation to get them.
        """
        schedule, n = self.wiring.schedule, self.wiring.schedule.outputs
        half = np.full(n, odd)  # in which the newest value of an output lies
        operations: list[Operation] = []

        def lie(places: np.ndarray) -> np.ndarray:
            return self.places.at[places % n] + (half[places % n] + places // n) % 2 * self.places.count

        for o in schedule.phases[0].operations:
            if isinstance(o, GetOutputs):
                half[schedule.offset[o.component] :][: schedule.count[o.component]] = 1 - odd
            elif isinstance(o, SetInputs):
                line = np.array(self.parts[o.component].wired())[o.line]
                operations.append(evolve(o, source=lie(o.source), line=line, newer=lie(o.newer), older=lie(o.older)))
            else:
                operations.append(o)
        return Phase(tuple(operations), Record(lie(schedule.phases[0].record.source)))

    def _component(self, i: int) -> _NativeComponent:
        part, inputs = self.parts[i], self.parts[i].wired()
        numbers = np.column_stack([setting.numbers[i] for setting in self.filled])
        native = _NativeComponent(
            kind=part.kind,
            n_inputs=len(inputs),
            inputs=self.arena.indices(inputs),
            first=self.places.first[i],
            numbers=self.arena.aligned(numbers),
        )
        if part.kind == _ARM:
            native.internal_steps, native.workspace = (
                int(part.number("internal_steps")),
                int(part.number("workspace_limits")),
            )
            native.viscous, native.coulomb = int(np.any(numbers[10:13])), int(np.any(numbers[13:16]))
            native.impedance = int(np.any(numbers[19:25]))
        if part.kind in (_CHANNEL, _SERIES):
            self._give_series(native, i)
        if part.kind == _CHANNEL:
            self._give_history(native, i)
        return native

    def _give_series(self, native: _NativeComponent, i: int) -> None:
        series = [values for setting in self.filled if (values := setting.series[i]) is not None]
        native.series = self.arena.pointers([self.arena.array(values) for values in series])
        native.n_series = series[0].shape[1]
        native.series_step = self.arena.indices([int(len(values) > 1) for values in series])

    def _give_history(self, native: _NativeComponent, i: int) -> None:
        longest = max(float(values.max()) for setting in self.filled if (values := setting.series[i]) is not None)
        steps = int(np.ceil(longest * 1e9 / self.wiring.schedule.step_ns))
        native.capacity = 1 << (steps + 4).bit_length()
        native.history = self.arena.array(np.zeros((native.capacity, self.width, max(1, native.n_inputs))))
        native.stamps = self.arena.array(np.zeros(native.capacity))
        native.linear = int(self.parts[i].number("interpolation") == 2)

    def result(self, lane: int, wall: float) -> Result:
        """The result of a lane, worded as the co-simulation would."""
        ended, steps = int(self.ended[lane]), self.experiment.steps
        outcome = (None, Outcome.DIVERGED, Outcome.DOMAIN_EXIT)[self.outcome[lane]]
        at = seconds(ended, self.wiring.schedule.step_ns)
        message = {
            Outcome.DIVERGED: f"a value passed {self.experiment.bound:g} at t = {at:.9g} s",
            Outcome.DOMAIN_EXIT: f"an arm left the domain of its model at t = {at:.9g} s",
        }.get(outcome, "")
        return self.timetable.result(
            self.settings[lane].wiring,
            SignalTable.of(self.table[lane]),
            Ending(min(ended, steps), outcome, message),
            wall,
        )
