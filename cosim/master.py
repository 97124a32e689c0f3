"""The master: wires the scenario, initialises the slaves, lets an executor run the schedule, keeps what was computed.

Two runs of the same scenario give the same bits, by either executor (cosim.execution in Python, cosim.compiled in C).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np
from attrs import field, frozen

from cosim.compiled import execute
from cosim.errors import InputError, Problem, RunError, did_you_mean
from cosim.execution import Ending, Executor, Job, Progress, Watch
from cosim.outcome import Outcome
from cosim.scenario import Scenario
from cosim.schedule import Schedule, seconds
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
    (default: all); executor: who runs the schedule (default: the compiled loop).
    Raises InputError where the scenario does not fit its FMUs, RunError where one cannot be initialised; what happens later
    is told by the result.
    """
    if system is None:
        from cosim.fmu import open_system

        with open_system(scenario) as opened:
            return run(scenario, opened, progress, record, executor)
    began = time.perf_counter()
    wiring = system.wiring(scenario)
    slaves = system.slaves(wiring)
    store = initialise(wiring, slaves)
    timetable = Timetable.of(wiring, record)
    job = _job(timetable, slaves, store)
    ending = (executor or execute)(job, progress)
    return timetable.result(wiring, job.table, ending, time.perf_counter() - began)


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


@frozen
class Timetable:
    """Which signals a run keeps, and how its table becomes a result.

    names: of the kept signals; columns: their places among all outputs.
    """

    wiring: Wiring
    names: tuple[str, ...]
    columns: np.ndarray = field(eq=False)

    @classmethod
    def of(cls, wiring: Wiring, record: Sequence[str] | None) -> Timetable:
        """The signals chosen by `record` (None: all). Raises InputError for a name that fits none."""
        names = _recorded(wiring.signals, record)
        place = {name: i for i, name in enumerate(wiring.signals)}
        return cls(wiring, tuple(names), np.array([place[name] for name in names], dtype=np.int64))

    @property
    def rows(self) -> int:
        """Rows of a whole run."""
        experiment = self.wiring.scenario.experiment
        return experiment.steps // experiment.record_every + 1

    def result(self, wiring: Wiring, table: np.ndarray, ending: Ending, wall: float) -> Result:
        """The result of a run of `wiring`, which may differ from the timetable's in start values: table (rows, names)."""
        experiment = wiring.scenario.experiment
        rows = ending.steps // experiment.record_every + 1
        early = ending.steps < experiment.steps
        return Result(
            wiring.scenario, ending.outcome or Outcome.BOUNDED,
            np.arange(rows) * experiment.record_every * experiment.step_ns / 1_000_000_000,
            {name: table[:rows, column] for column, name in enumerate(self.names)},
            {name: wiring.units[name] for name in self.names},
            seconds(ending.steps, experiment.step_ns) if early else None,
            ending.message, wall, _identities(wiring), ending.failure, ending.interrupted,
        )  # fmt: skip


def _identities(wiring: Wiring) -> tuple[Identity, ...]:
    found = ((name, wiring.descriptions[name]) for name in wiring.scenario.components)
    return tuple(Identity(name, d.model, d.fmi, d.path, d.sha256) for name, d in found)


def _job(timetable: Timetable, slaves: Sequence[Slave], store: np.ndarray) -> Job:
    wiring, experiment = timetable.wiring, timetable.wiring.scenario.experiment
    domain = tuple(i for i, name in enumerate(wiring.signals) if name.endswith(".domain"))
    table = np.empty((timetable.rows, len(timetable.names)))
    return Job(wiring.schedule, slaves, store, table, timetable.columns, experiment.record_every, experiment.steps,
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
