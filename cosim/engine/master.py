"""The master: wires the scenario, initialises the instances, lets an executor run the schedule, keeps what was
computed.

Two runs of the same scenario give the same bits, by either executor (cosim.engine.reference in Python,
cosim.engine.compiled in C).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np
from attrs import evolve, field, frozen

from cosim.engine.compiled import CompiledExecutor
from cosim.engine.initialisation import initialise, strangers
from cosim.engine.outcome import Outcome
from cosim.engine.reference import Ending, Execution, Executor, RunProgress, Watch, marked
from cosim.engine.rounding import kept
from cosim.engine.table import SignalColumns, SignalTable, stacked
from cosim.engine.texts import text_carriers
from cosim.errors import InputError, Problem, RunError, did_you_mean
from cosim.fmu.contract import Instance
from cosim.fmu.messages import FmuMessage
from cosim.scenario import Scenario
from cosim.signals import stem
from cosim.wiring import Wiring
from cosim.wiring.bounds import bounds, usual_sizes
from cosim.wiring.schedule import seconds


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

    time: (n,) [s]; signals: name -> (n,) values, `arm_l.q[1]`; units: name -> unit; stopped_at: time of an early end
    [s]; failure: the error that ended it; messages: what FMUs said, each message once.
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
    messages: tuple[FmuMessage, ...] = ()

    def vector(self, name: str) -> np.ndarray:
        """A signal of several elements as (n, size): `arm_l.x`; a scalar one as (n, 1)."""
        names = [key for key in self.signals if key == name or stem(key) == name]
        if not names:
            raise InputError(
                Problem("signal", "a recorded signal", repr(name), did_you_mean(name, map(stem, self.signals)))
            )
        return stacked(self.signals, names)

    def only(self, names: Sequence[str]) -> Result:
        """The same run with chosen signals, `arm_l.x` or `arm_l.x[1]`. Raises InputError for a name that fits none."""
        chosen = _recorded(list(self.signals), names)
        signals = self.signals
        kept = signals.only(chosen) if isinstance(signals, SignalColumns) else {name: signals[name] for name in chosen}
        return evolve(self, signals=kept, units={name: self.units[name] for name in chosen})


class System(Protocol):
    """Loaded FMUs, ready for runs of scenarios with the same components (`cosim.fmu.FmuSet`, or a set of fakes).

    prepared: what repeated runs have in common, by the signals that they record; emptied when instances or connections
    change.
    """

    prepared: dict[tuple[str, ...] | None, object]

    def wiring(self, scenario: Scenario) -> Wiring: ...

    def instances(self, wiring: Wiring) -> Sequence[Instance]: ...


def run(
    scenario: Scenario,
    system: System | None = None,
    progress: Callable[[RunProgress], None] | None = None,
    record: Sequence[str] | None = None,
    executor: Executor | None = None,
) -> Result:
    """Simulate a scenario once.

    system: FMUs already loaded (default: loaded for this run); record: names of signals to keep, `arm_l.x` or
    `arm_l.x[1]` (default: all); executor: who runs the schedule (default: start and schedule in the compiled loop).
    Raises InputError where the scenario does not fit its FMUs, RunError where one cannot be initialised; what happens
    later is told by the result.
    """
    if system is None:
        from cosim.fmu import open_system

        with open_system(scenario) as opened:
            return run(scenario, opened, progress, record, executor)
    began = time.perf_counter()
    prepared = PreparedRun.of(system, system.wiring(scenario), record)
    rows = SignalTable(prepared.timetable.rows, len(prepared.timetable.names))
    ending = prepared.execute(rows, progress, marked(), executor)
    return prepared.timetable.result(prepared.wiring, rows, ending, time.perf_counter() - began)


@frozen
class PreparedRun:
    """What runs with the same instances, connections and choice of signals have in common; `wiring` is that of one of
    them.
    """

    wiring: Wiring
    instances: Sequence[Instance]
    timetable: Timetable
    domain: tuple[int, ...]
    compiled: CompiledExecutor
    usual: np.ndarray = field(eq=False, repr=False)

    @classmethod
    def of(cls, system: System, wiring: Wiring, record: Sequence[str] | None) -> PreparedRun:
        """What the system remembers, for this wiring, or a new one."""
        with kept():
            instances, known = system.instances(wiring), system.prepared
        key = None if record is None else tuple(record)
        found = known.get(key)
        if isinstance(found, PreparedRun) and found.wiring.schedule is wiring.schedule and found.instances is instances:
            return found if found.wiring is wiring else evolve(found, wiring=wiring)
        domain = tuple(i for i, name in enumerate(wiring.signals) if name.endswith(".domain"))
        made = cls(wiring, instances, Timetable.of(wiring, record), domain, CompiledExecutor(), usual_sizes(wiring))
        known[key] = made
        return made

    def execute(
        self,
        rows: SignalTable,
        progress: Callable[[RunProgress], None] | None,
        mark: np.ndarray,
        executor: Executor | None = None,
    ) -> Ending:
        """Initialise the instances and run the schedule, by default both in C; what is computed goes to `rows`. Raises
        RunError.
        """
        wiring, instances, experiment = self.wiring, self.instances, self.wiring.scenario.experiment
        store = initialise(wiring, instances) if executor else self.compiled.initialise(wiring, instances, mark)
        start = store[: wiring.schedule.outputs]
        watch = Watch(self.domain, bounds(wiring, self.usual, start))
        texts = any(link.text for link in wiring.links)
        job = Execution(
            wiring.schedule,
            instances,
            store,
            rows.values,
            self.timetable.columns,
            experiment.record_every,
            experiment.steps,
            watch,
            rows.drop,
            mark,
            text_carriers(wiring, instances) if texts else (),
            strangers(wiring),
        )
        ending = (executor or self.compiled)(job, progress)
        return evolve(ending, messages=tuple(said for instance in instances for said in instance.said()))


@frozen
class Timetable:
    """Which signals a run keeps, and how its table becomes a result.

    names, units: of the kept signals; columns: their places among all outputs; fmus: what the components are.
    """

    wiring: Wiring
    names: tuple[str, ...]
    columns: np.ndarray = field(eq=False)
    units: Mapping[str, str]
    fmus: tuple[Identity, ...]

    @classmethod
    def of(cls, wiring: Wiring, record: Sequence[str] | None) -> Timetable:
        """The signals chosen by `record` (None: all). Raises InputError for a name that fits none."""
        names = _recorded(wiring.signals, record)
        place = {name: i for i, name in enumerate(wiring.signals)}
        columns = np.array([place[name] for name in names], dtype=np.int64)
        return cls(wiring, tuple(names), columns, {name: wiring.units[name] for name in names}, _identities(wiring))

    @property
    def rows(self) -> int:
        """Rows of a whole run."""
        return self.wiring.scenario.experiment.rows

    def result(self, wiring: Wiring, rows: SignalTable, ending: Ending, wall: float) -> Result:
        """The result of a run of `wiring`, which may differ from the timetable's in start values: rows (rows,
        names).
        """
        experiment = wiring.scenario.experiment
        count, tick = ending.steps // experiment.record_every + 1, experiment.record_every * experiment.step_ns
        early = ending.steps < experiment.steps
        return Result(
            wiring.scenario,
            ending.outcome or Outcome.BOUNDED,
            np.arange(0, count * tick, tick) / 1_000_000_000,
            SignalColumns(self.names, rows, count),
            self.units,
            seconds(ending.steps, experiment.step_ns) if early else None,
            ending.message,
            wall,
            self.fmus,
            ending.failure,
            ending.interrupted,
            ending.messages,
        )


def _identities(wiring: Wiring) -> tuple[Identity, ...]:
    found = ((name, wiring.descriptions[name]) for name in wiring.scenario.components)
    return tuple(Identity(name, d.model, d.fmi, d.path, d.sha256) for name, d in found)


def _recorded(signals: Sequence[str], record: Sequence[str] | None) -> list[str]:
    """The chosen signals in the order of the store. Raises InputError for a name that fits none."""
    if record is None:
        return list(signals)
    wanted = set(record)
    stems = {stem(name) for name in signals}
    strangers = [name for name in record if name not in stems and name not in signals]
    if strangers:
        raise InputError(
            [Problem("record", "a signal of the scenario", repr(n), did_you_mean(n, stems)) for n in strangers]
        )
    return [name for name in signals if name in wanted or stem(name) in wanted]
