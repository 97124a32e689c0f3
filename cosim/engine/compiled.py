"""The compiled executor: the same start and schedule as in Python, the same bits, in a loop that C runs over the FMUs.

fmpy loads and instantiates; this module hands the FMI functions' addresses, the instances, start values and the
schedule to
`fmu_src/executor/executor.c`. It starts the instances (as cosim.engine.initialisation) and runs a while at a time
(as cosim.engine.reference), so that Ctrl-C and progress get their turn and other threads theirs (no lock of Python's is
held). What a repeated run does not change stays in the executor. Whatever goes wrong is worded by the code in Python.

Components that exchange other types than doubles, or that are no FMUs, are left to the Python executor.
"""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from ctypes import byref
from typing import cast

import numpy as np

from cosim.engine.initialisation import InitialInputs, initial_sources, strangers, wired
from cosim.engine.initialisation import initialise as initialise_in_python
from cosim.engine.native import Arena
from cosim.engine.native_executor import (
    NativeBank,
    NativeExecution,
    NativeInstance,
    NativeStart,
    executor_library,
    native_instance,
    plain,
)
from cosim.engine.outcome import Outcome
from cosim.engine.reference import Ending, Execution, RunProgress, blamed, interrupted, keep, marked, watched
from cosim.engine.reference import execute as execute_in_python
from cosim.errors import RunError
from cosim.fmu import Fmi2Instance, FmuInstance
from cosim.fmu.contract import Instance
from cosim.wiring import Wiring
from cosim.wiring.schedule import Step, seconds

_CALLS = ("set inputs", "set input derivatives", "get outputs", "step")
_DONE, _CALL_FAILED, _ENDED, _OUT_OF_BOUNDS = range(4)
_FIRST_BATCH = 2000  # communication steps before the clock is looked at for the first time
_TURN = 0.1  # s: after about this time Python gets its turn


def applies(instances: Sequence[Instance]) -> bool:
    """Whether every component is an FMU that exchanges doubles only (asked when they are wired)."""
    return all(isinstance(s, FmuInstance) and plain(s) for s in instances)


def _as_fmus(instances: Sequence[Instance]) -> Sequence[FmuInstance]:
    """The same instances, which `applies` has found to be FMUs."""
    return cast(Sequence[FmuInstance], instances)


# --- start ------------------------------------------------------------------------------------------------------------


class _Begin:
    """The start of the instances in C's layout, their start values apart."""

    instances: Sequence[FmuInstance]
    arena: Arena
    store: np.ndarray
    job: NativeExecution
    starts: ctypes.Array[NativeStart]

    def __init__(self, wiring: Wiring, instances: Sequence[FmuInstance]) -> None:
        schedule = wiring.schedule
        self.instances, self.arena, strange = instances, Arena(), strangers(wiring)
        self.store = np.zeros(2 * schedule.outputs)
        natives = (NativeInstance * len(instances))(
            *[
                native_instance(s, o, self.arena, k in strange)
                for k, (s, o) in enumerate(zip(instances, schedule.offset))
            ]
        )
        self.job = NativeExecution(
            instances=self.arena.structures(natives), store=self.arena.array(self.store), n_outputs=schedule.outputs
        )
        self.starts = (NativeStart * len(instances))()
        for start, instance, source in zip(self.starts, instances, initial_sources(wiring)):
            self._fill(start, instance, source)
        self.values: list[_StartValues | None] = [None] * len(instances)

    def _fill(self, start: NativeStart, instance: FmuInstance, source: InitialInputs) -> None:
        start.reset, start.leave = instance.address("Reset"), instance.address("ExitInitializationMode")
        start.source, start.scaled = self.arena.indices(source.places), self.arena.indices(source.scaled)
        start.gain, start.shift = self.arena.array(source.gain), self.arena.array(source.shift)
        settings = instance.settings
        start.tolerance, start.stop = (math.nan if v is None else v for v in (settings.tolerance, settings.stop))
        if isinstance(instance, Fmi2Instance):
            start.setup2, start.enter2 = (
                instance.address("SetupExperiment"),
                instance.address("EnterInitializationMode"),
            )
        else:
            start.enter3 = instance.address("EnterInitializationMode")

    def run(self, wiring: Wiring, mark: np.ndarray) -> bool:
        """Start every instance; False where one refuses anything."""
        self.job.mark = mark.ctypes.data
        for i, instance in enumerate(self.instances):
            instance.messages.clear()
            instance.time, instance.fresh, self.starts[i].fresh = 0.0, False, instance.fresh
            if not self._set(i, wiring.starts[instance.name]):
                return False
        return executor_library().initialise(byref(self.job), ctypes.addressof(self.starts), len(self.instances)) == 0

    def _set(self, i: int, values: Mapping[str, float | str]) -> bool:
        """Start values of an instance into C's arrays; False where one is a text."""
        known = self.values[i]
        if known is not None and known.given is values:
            return True
        if known is None or known.names != tuple(values):
            if any(isinstance(value, str) for value in values.values()):
                return False
            known = self.values[i] = _StartValues(self.instances[i], tuple(values))
            self.starts[i].banks, self.starts[i].n_banks = ctypes.addressof(known.banks), len(known.banks)
        known.fill(values)
        return True


class _StartValues:
    """Start values of an instance by type: arrays, and the calls that hand them over."""

    def __init__(self, instance: FmuInstance, names: tuple[str, ...]) -> None:
        self.names, self.given = names, None
        kinds = instance.by_kind(names)
        self.banks = (NativeBank * len(kinds))()
        self.arrays = []
        for bank, (kind, some) in zip(self.banks, kinds.items()):
            refs, array = instance.references(some), np.zeros(len(some), instance.dtype(kind))
            self.arrays.append((array, some, refs))
            bank.refs, bank.values, bank.n = ctypes.addressof(refs), array.ctypes.data, len(some)
            setattr(bank, "set2" if isinstance(instance, Fmi2Instance) else "set3", instance.address("Set" + kind))

    def fill(self, values: Mapping[str, float | str]) -> None:
        for array, names, _ in self.arrays:
            array[:] = [values[name] for name in names]
        self.given = values


# --- run --------------------------------------------------------------------------------------------------------------


class _CompiledLoop:
    """A schedule with its instances in C's layout, and the arrays that must outlive the calls."""

    arena: Arena
    store: np.ndarray
    native: NativeExecution

    def __init__(self, job: Execution) -> None:
        self.arena, self.store = Arena(), job.store
        instances = (NativeInstance * len(job.instances))(
            *[
                native_instance(instance, at, self.arena, k in job.strange)
                for k, (instance, at) in enumerate(zip(_as_fmus(job.instances), job.schedule.offset))
            ]
        )
        for component in job.schedule.remembered:
            instances[component].remembered = 1
        phases = self.arena.phases(job.schedule.phases, job.columns, job.schedule.step_ns)
        self.native = NativeExecution(
            self.arena.structures(instances),
            phases,
            len(job.schedule.phases),
            self.arena.array(job.store),
            job.schedule.outputs,
            None,
            len(job.columns),
            job.every,
            0,
            job.schedule.step_ns,
            self.arena.array(np.ascontiguousarray(job.watch.bounds)),
            self.arena.indices(job.watch.domain),
            len(job.watch.domain),
            None,
            -1,
            0,
        )

    def run(self, job: Execution, progress: Callable[[RunProgress], None] | None) -> Ending:
        """Batches of communication steps, each of about a tenth of a second, until the end."""
        execute, steps, done = executor_library().execute, job.steps, 0
        self.native.table, self.native.mark, job.mark[0] = job.table.ctypes.data, job.mark.ctypes.data, 0
        began = last = time.perf_counter()
        batch = _FIRST_BATCH
        try:
            while done < steps:
                before = done
                answer = execute(byref(self.native), min(steps, before + batch))
                done = int(job.mark[0])
                if answer != _DONE:
                    return self._ending(job, answer, done)
                now = time.perf_counter()
                batch = max(1, int((done - before) * _TURN / max(now - last, 1e-6)))
                last = now
                job.drop(done // job.every)
                if progress is not None:
                    progress(RunProgress(done, steps, seconds(done, job.schedule.step_ns), now - began))
        except KeyboardInterrupt:
            return interrupted(int(job.mark[0]))
        return Ending(done)

    def _ending(self, job: Execution, answer: int, done: int) -> Ending:
        if answer == _ENDED:
            return watched(job, done) or Ending(done, message="an FMU asked to end the run")
        if answer == _OUT_OF_BOUNDS:
            ending = watched(job, done)
            assert ending is not None, "what the loop in C finds out of bounds is so in Python too"
            return ending
        try:
            return self._refused(job, done)
        except RunError as error:
            failure = blamed(job, error, done)
            return Ending(done, Outcome.FAILED, str(failure), failure)

    def _refused(self, job: Execution, done: int) -> Ending:
        """Raises what the instance itself would have raised for the call's status."""
        component, call, status = int(job.mark[1]), self.native.call, self.native.status
        instance = _as_fmus(job.instances)[component]
        instance.time = seconds(done, job.schedule.step_ns)
        if _CALLS[call] == "get outputs":
            instance.time += _step_size(job, component)
        if _CALLS[call] == "step":
            instance.judge(status)
            return Ending(done, message="an FMU asked to end the run")
        banks = {
            "set inputs": instance.setters[:1],
            "set input derivatives": instance.setters[-1:],
            "get outputs": instance.getters,
        }
        instance.check(status, banks[_CALLS[call]][0].what)
        raise AssertionError("a status above 1 is an error")


def _step_size(job: Execution, component: int) -> float:
    """Length of a component's steps [s]."""
    operations = (o for phase in job.schedule.phases for o in phase.operations)
    found = (o.multiple for o in operations if isinstance(o, Step) and o.component == component)
    return seconds(next(found), job.schedule.step_ns)


class CompiledExecutor:
    """The compiled executor (see `cosim.engine.reference.Executor`), with what runs of the same schedule, instances and
    kept
    signals have in common: start values and schedule in C's layout. In Python where it does not apply.
    """

    def __init__(self) -> None:
        self.begin: _Begin | None = None
        self.loop: _CompiledLoop | None = None
        self.applies: bool | None = None

    def initialise(self, wiring: Wiring, instances: Sequence[Instance], mark: np.ndarray | None = None) -> np.ndarray:
        """The store at t = 0 (see cosim.engine.initialisation.initialise).

        Raises RunError, worded in Python: an instance that refuses anything is started again there.
        """
        if self.applies is None:
            wired(wiring, instances)
            self.applies = applies(instances) and not any(link.text for link in wiring.links)
        mark = marked() if mark is None else mark
        if self.applies:
            self.begin = self.begin or _Begin(wiring, _as_fmus(instances))
            if self.begin.run(wiring, mark):
                return self.begin.store
        return initialise_in_python(wiring, instances, mark)

    def __call__(self, job: Execution, progress: Callable[[RunProgress], None] | None = None) -> Ending:
        """Run the schedule."""
        if self.applies is None:
            self.applies = applies(job.instances) and not job.carriers
        if not self.applies:
            return execute_in_python(job, progress)
        ending = watched(job, 0)
        keep(job, 0, job.columns)
        if ending is not None:
            return ending
        if self.loop is None or self.loop.store is not job.store:
            self.loop = _CompiledLoop(job)
        with _clocked(job):
            return self.loop.run(job, progress)


@contextmanager
def _clocked(job: Execution) -> Iterator[None]:
    """While C calls the FMUs, the mark tells their loggers the time."""
    instances = _as_fmus(job.instances)
    for instance in instances:
        instance.clock = lambda: seconds(int(job.mark[0]), job.schedule.step_ns)
    try:
        yield
    finally:
        for instance in instances:
            instance.clock = None
