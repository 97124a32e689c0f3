"""The master: initialises the slaves, executes the schedule, watches for failure, keeps what was computed.

This executor is the readable reference, in plain Python; another one may run the same `Schedule` (see `Executor`).
Time is counted in whole steps; two runs of the same scenario give the same bits.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np
from attrs import field, frozen

from cosim.errors import InputError, Problem, RunError, did_you_mean
from cosim.outcome import Outcome
from cosim.scenario import Scenario
from cosim.schedule import GetOutputs, Operation, Phase, Schedule, SetInputs, seconds
from cosim.signals import stem
from cosim.slave import Slave
from cosim.wiring import Wiring


@frozen
class Identity:
    """Which FMU a component was: model, file and its SHA-256."""

    component: str
    model: str
    fmi: str
    path: str
    sha256: str


@frozen
class Result:
    """A run that was made. It ends early where the outcome says so; a run that fails or is interrupted keeps its rows.

    time: (n,) [s]; signals: name -> (n,) values, `arm_l.q[1]`; units: name -> unit; stopped_at: time of an early end [s];
    failure: the error that ended it.
    """

    scenario: Scenario
    outcome: Outcome
    time: np.ndarray = field(eq=False, repr=False)
    signals: Mapping[str, np.ndarray] = field(eq=False, repr=False)
    units: Mapping[str, str] = field(repr=False)
    stopped_at: float | None = None
    message: str = ""
    wall_time: float = field(default=0.0, eq=False)
    fmus: tuple[Identity, ...] = ()
    failure: RunError | None = None
    interrupted: bool = False

    def vector(self, name: str) -> np.ndarray:
        """A signal of several elements as (n, size): `arm_l.x`; a scalar one as (n, 1)."""
        names = [key for key in self.signals if key == name or stem(key) == name]
        if not names:
            raise InputError(Problem("signal", "a recorded signal", repr(name), did_you_mean(name, map(stem, self.signals))))
        return np.column_stack([self.signals[key] for key in names])


@frozen
class Progress:
    """How far a run is: steps done of all, simulated and wall-clock time [s]."""

    done: int
    total: int
    simulated: float
    wall: float

    @property
    def factor(self) -> float:
        """Simulated seconds per second."""
        return self.simulated / self.wall if self.wall > 0 else 0.0


@frozen
class Watch:
    """When a run ends before its time: an output of `domain` (places in the store) below 1, or any value beyond `bound`."""

    domain: tuple[int, ...]
    bound: float


@frozen
class Job:
    """What an executor gets: the schedule, its slaves (initialised), the store at t = 0, which of the recorded signals to
    keep, in which rows, until when.

    store: (2n,) current and previous outputs, filled; table: (rows, columns) to fill, row 0 included; columns: (columns,)
    places among the n outputs; every: communication steps per row; steps: communication steps in all.
    """

    schedule: Schedule
    slaves: Sequence[Slave]
    store: np.ndarray
    table: np.ndarray
    columns: np.ndarray
    every: int
    steps: int
    watch: Watch


@frozen
class Ending:
    """How an execution ended: communication steps completed, outcome where it ended early, message, error."""

    steps: int
    outcome: Outcome | None = None
    message: str = ""
    failure: RunError | None = None
    interrupted: bool = False


class Executor(Protocol):
    """Executes a job and returns how it ended. Never raises for what an FMU does, nor for Ctrl-C."""

    def __call__(self, job: Job, progress: Callable[[Progress], None] | None) -> Ending: ...


class System(Protocol):
    """Loaded FMUs, ready for runs of scenarios with the same components (`cosim.fmu.FmuSet`, or a set of fakes)."""

    def wiring(self, scenario: Scenario) -> Wiring: ...

    def slaves(self, wiring: Wiring) -> Sequence[Slave]: ...


def run(
    scenario: Scenario,
    system: System | None = None,
    progress: Callable[[Progress], None] | None = None,
    record: Sequence[str] | None = None,
    executor: Executor | None = None,
) -> Result:
    """Simulate a scenario once.

    system: FMUs already loaded (default: loaded for this run); record: names of signals to keep, `arm_l.x` or `arm_l.x[1]`
    (default: all). Raises InputError where the scenario does not fit its FMUs, RunError where one cannot be initialised;
    what happens later is told by the result.
    """
    if system is None:
        from cosim.fmu import open_system

        with open_system(scenario) as opened:
            return run(scenario, opened, progress, record, executor)
    began = time.perf_counter()
    wiring = system.wiring(scenario)
    slaves = system.slaves(wiring)
    store = initialise(wiring, slaves)
    job = _job(wiring, slaves, store, record)
    ending = (executor or execute)(job, progress)
    return _result(wiring, job, record, ending, time.perf_counter() - began)


def initialise(wiring: Wiring, slaves: Sequence[Slave]) -> np.ndarray:
    """Start every slave and carry outputs to inputs until nothing changes any more; the store at t = 0, (2n,).

    Without algebraic loops this ends after at most as many rounds as there are components. Raises RunError.
    """
    schedule = wiring.schedule
    for slave in slaves:
        slave.wire(wiring.inputs(slave.name), wiring.sloped(slave.name), wiring.outputs(slave.name))
        slave.start(wiring.starts[slave.name])
    store = np.zeros(2 * schedule.outputs)
    before = np.full(schedule.outputs, np.nan)
    sources = _initial_sources(wiring)
    for _ in range(len(slaves) + 1):
        _collect(schedule, slaves, store)
        if np.array_equal(store[: schedule.outputs], before):
            break
        before = store[: schedule.outputs].copy()
        for slave, source in zip(slaves, sources):
            if len(source):
                slave.inputs[:] = store[source]
                slave.set()
    for slave in slaves:
        slave.begin()
    _collect(schedule, slaves, store)
    store[schedule.outputs :] = store[: schedule.outputs]
    return store


def _initial_sources(wiring: Wiring) -> list[np.ndarray]:
    """Places in the store of each component's inputs."""
    place = {name: i for i, name in enumerate(wiring.signals)}
    source = {str(link.target): place[str(link.source)] for link in wiring.links}
    return [np.array([source[f"{name}.{v}"] for v in wiring.inputs(name)], dtype=np.int64) for name in wiring.scenario.components]


def _collect(schedule: Schedule, slaves: Sequence[Slave], store: np.ndarray) -> None:
    for slave, offset, count in zip(slaves, schedule.offset, schedule.count):
        if count:
            slave.get()
            store[offset : offset + count] = slave.outputs


def _job(wiring: Wiring, slaves: Sequence[Slave], store: np.ndarray, record: Sequence[str] | None) -> Job:
    experiment = wiring.scenario.experiment
    signals = wiring.signals
    columns = np.array([signals.index(name) for name in _recorded(signals, record)], dtype=np.int64)
    rows = experiment.steps // experiment.record_every + 1
    domain = tuple(i for i, name in enumerate(signals) if name.endswith(".domain"))
    table = np.empty((rows, len(columns)))
    return Job(wiring.schedule, slaves, store, table, columns, experiment.record_every, experiment.steps,
               Watch(domain, experiment.bound))  # fmt: skip


def _recorded(signals: Sequence[str], record: Sequence[str] | None) -> list[str]:
    """The chosen signals in the order of the store. Raises InputError for a name that fits none."""
    if record is None:
        return list(signals)
    wanted = set(record)
    stems = {stem(name) for name in signals}
    strangers = [name for name in record if name not in stems and name not in signals]
    if strangers:
        raise InputError([Problem("record", "a signal of the scenario", repr(n), did_you_mean(n, stems)) for n in strangers])
    return [name for name in signals if name in wanted or stem(name) in wanted]


def _result(wiring: Wiring, job: Job, record: Sequence[str] | None, ending: Ending, wall: float) -> Result:
    rows = ending.steps // job.every + 1
    names = _recorded(wiring.signals, record)
    table = job.table[:rows]
    early = ending.steps < job.steps
    fmus = tuple(
        Identity(name, d.model, d.fmi, d.path, d.sha256)
        for name, d in ((name, wiring.descriptions[name]) for name in wiring.scenario.components)
    )
    return Result(
        wiring.scenario, ending.outcome or Outcome.BOUNDED,
        np.arange(rows) * job.every * job.schedule.step_ns / 1_000_000_000,
        {name: table[:, column] for column, name in enumerate(names)},
        {name: wiring.units[name] for name in names},
        seconds(ending.steps, job.schedule.step_ns) if early else None,
        ending.message, wall, fmus, ending.failure, ending.interrupted,
    )  # fmt: skip


# --- the executor in Python ---------------------------------------------------------------------------------------------


def execute(job: Job, progress: Callable[[Progress], None] | None = None) -> Ending:
    """Run the schedule operation by operation (see `Executor`)."""
    phases = [_Turn(phase, job) for phase in job.schedule.phases]
    reporter = _Reporter(job, progress)
    done = 0
    with np.errstate(all="ignore"):
        try:
            ending = _watched(job, 0)
            _keep(job, 0, job.columns)
            while ending is None and done < job.steps:
                turn = phases[done % len(phases)]
                going = turn.act(done)
                if (done + 1) % job.every == 0:
                    _keep(job, done + 1, turn.columns)
                done += 1
                ending = _watched(job, done) if going else Ending(done, message="an FMU asked to end the run")
                reporter.tell(done)
        except RunError as error:
            failure = _blame(job, error, done)
            return Ending(done, Outcome.FAILED, str(failure), failure)
        except KeyboardInterrupt:
            return Ending(done, Outcome.INCONCLUSIVE, "interrupted", interrupted=True)
    return ending or Ending(done)


def _keep(job: Job, done: int, columns: np.ndarray) -> None:
    job.store.take(columns, out=job.table[done // job.every], mode="clip")


class _Turn:
    """One phase with its operations bound to their slaves; `columns` are the places that its row is taken from."""

    def __init__(self, phase: Phase, job: Job) -> None:
        self.operations = [_bound(operation, job) for operation in phase.operations]
        self.columns = phase.record.source[job.columns]

    def act(self, done: int) -> bool:
        """Carry out the operations of the step after `done` steps; False where an FMU asks to end."""
        going = True
        for operation in self.operations:
            if operation(done) is False:
                going = False
        return going


def _bound(operation: Operation, job: Job) -> Callable[[int], bool | None]:
    slave = job.slaves[operation.component]
    if isinstance(operation, SetInputs):
        return _set(operation, slave, job.store)
    if isinstance(operation, GetOutputs):
        return _get(operation, slave, job)
    step_ns = job.schedule.step_ns
    size = seconds(operation.multiple, step_ns)
    return lambda done: slave.step(done * step_ns / 1_000_000_000, size)


def _set(operation: SetInputs, slave: Slave, store: np.ndarray) -> Callable[[int], None]:
    inputs, slopes, hand_over = slave.inputs, slave.slopes, slave.set
    source, line, newer, older = operation.source, operation.line, operation.newer, operation.older
    weight, span = operation.weight, operation.span
    inside = bool(np.any(weight))

    def held(done: int) -> None:
        store.take(source, out=inputs, mode="clip")
        hand_over()

    def lined(done: int) -> None:
        store.take(source, out=inputs, mode="clip")
        rise = store[newer] - store[older]
        if inside:
            inputs[line] += weight * rise
        np.divide(rise, span, out=slopes)
        hand_over()

    return lined if len(line) else held


def _get(operation: GetOutputs, slave: Slave, job: Job) -> Callable[[int], None]:
    offset, count, n = job.schedule.offset[operation.component], job.schedule.count[operation.component], job.schedule.outputs
    newest, older = job.store[offset : offset + count], job.store[n + offset : n + offset + count]

    def get(done: int) -> None:
        slave.get()
        older[:] = newest
        newest[:] = slave.outputs

    return get


def _watched(job: Job, done: int) -> Ending | None:
    """The ending where a value left its bounds: NaN or infinity, beyond the bound, an arm out of its domain; else None."""
    values = job.store[: job.schedule.outputs]
    bound = job.watch.bound
    if not values @ values < bound * bound and not np.abs(values).max() <= bound:
        return _out_of_bounds(job, done)
    for place in job.watch.domain:
        if values.item(place) < 1.0:
            name = _name(job, place)[0]
            at = seconds(done, job.schedule.step_ns)
            return Ending(done, Outcome.DOMAIN_EXIT, f"{name} left the domain of its model at t = {at:.9g} s")
    return None


def _out_of_bounds(job: Job, done: int) -> Ending:
    values = job.store[: job.schedule.outputs]
    at = seconds(done, job.schedule.step_ns)
    undefined = np.flatnonzero(~np.isfinite(values))
    if len(undefined):
        error = _not_finite(job, undefined, at)
        return Ending(max(done - 1, 0), Outcome.FAILED, str(error), error)
    component, index = _name(job, int(np.abs(values).argmax()))
    names = job.slaves[job.schedule.components.index(component)].output_names
    message = f"{component}.{names[index]} passed {job.watch.bound:g} at t = {at:.9g} s"
    return Ending(done, Outcome.DIVERGED, message)


def _not_finite(job: Job, places: np.ndarray, at: float) -> RunError:
    """The error of the first component, in the order of stepping, whose output is not finite."""
    order = [op.component for phase in job.schedule.phases for op in phase.operations if isinstance(op, GetOutputs)]
    found = {_component(job, int(place)): int(place) for place in reversed(places)}
    component = next(c for c in order if c in found)
    slave = job.slaves[component]
    variable = slave.output_names[found[component] - job.schedule.offset[component]]
    return RunError(slave.name, at, f"the output is {job.store[found[component]]}", variable)


def _component(job: Job, place: int) -> int:
    return int(np.searchsorted(np.cumsum(job.schedule.count), place, side="right"))


def _name(job: Job, place: int) -> tuple[str, int]:
    """Component and number of the output at a place in the store."""
    component = _component(job, place)
    return job.schedule.components[component], place - job.schedule.offset[component]


def _blame(job: Job, error: RunError, done: int) -> RunError:
    """The error itself, or that of the FMU whose output was not finite when this one was asked to go on."""
    undefined = np.flatnonzero(~np.isfinite(job.store[: job.schedule.outputs]))
    return _not_finite(job, undefined, seconds(done + 1, job.schedule.step_ns)) if len(undefined) else error


class _Reporter:
    """Tells of the progress about five times a second."""

    def __init__(self, job: Job, progress: Callable[[Progress], None] | None) -> None:
        self.job, self.progress = job, progress
        self.began = self.told = time.perf_counter()

    def tell(self, done: int) -> None:
        if self.progress is None or (done & 127 and done != self.job.steps):
            return
        now = time.perf_counter()
        if now - self.told >= 0.2 or done == self.job.steps:
            self.told = now
            simulated = seconds(done, self.job.schedule.step_ns)
            self.progress(Progress(done, self.job.steps, simulated, now - self.began))
