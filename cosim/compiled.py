"""The compiled executor: the same start and schedule as in Python, the same bits, in a loop that C runs over the FMUs.

fmpy loads and instantiates; this module hands the FMI functions' addresses, the instances, start values and the schedule to
`fmu_src/executor/executor.c`. It starts the instances (`initialise`, as cosim.initialisation) and runs a while at a time
(`execute`, as cosim.execution), so that Ctrl-C and progress get their turn and other threads theirs (no lock of Python's is
held). What a repeated run does not change stays in the job's memory. Whatever goes wrong is worded by the code in Python.

Components that exchange other types than doubles, or that are no FMUs, are left to the Python executor.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Mapping, Sequence
from ctypes import POINTER, byref, c_double, c_int, c_int64, c_void_p
from functools import cache

import numpy as np

from cosim.errors import RunError
from cosim.execution import Ending, Job, Progress, blamed, interrupted, keep, marked, watched
from cosim.execution import execute as execute_in_python
from cosim.fmu import Fmi2Slave, FmuSlave
from cosim.initialisation import initial_sources, wired
from cosim.initialisation import initialise as initialise_in_python
from cosim.native import Arena
from cosim.outcome import Outcome
from cosim.schedule import Step, seconds
from cosim.slave import Slave
from cosim.wiring import Wiring

_CALLS = ("set inputs", "set input derivatives", "get outputs", "step")
_DONE, _CALL_FAILED, _ENDED, _OUT_OF_BOUNDS = range(4)
_FIRST_BATCH = 2000  # communication steps before the clock is looked at for the first time
_TURN = 0.1  # s: after about this time Python gets its turn


class _Slave(ctypes.Structure):
    _fields_ = [
        ("instance", c_void_p), ("set2", c_void_p), ("get2", c_void_p), ("slopes2", c_void_p), ("step2", c_void_p),
        ("set3", c_void_p), ("get3", c_void_p), ("step3", c_void_p), ("input_refs", c_void_p), ("slope_refs", c_void_p),
        ("output_refs", c_void_p), ("orders", c_void_p), ("inputs", c_void_p), ("slopes", c_void_p), ("outputs", c_void_p),
        ("n_inputs", c_int64), ("n_slopes", c_int64), ("n_outputs", c_int64), ("offset", c_int64),
        ("remembered", c_int64), ("event", c_void_p), ("terminate", c_void_p), ("early", c_void_p), ("reached", c_void_p),
    ]  # fmt: skip


class _Bank(ctypes.Structure):
    _fields_ = [("set2", c_void_p), ("set3", c_void_p), ("refs", c_void_p), ("values", c_void_p), ("n", c_int64)]


class _Start(ctypes.Structure):
    _fields_ = [
        ("reset", c_void_p), ("setup2", c_void_p), ("enter2", c_void_p), ("enter3", c_void_p), ("leave", c_void_p),
        ("banks", c_void_p), ("n_banks", c_int64), ("source", c_void_p), ("fresh", c_int64),
    ]  # fmt: skip


class _Job(ctypes.Structure):
    _fields_ = [
        ("slaves", c_void_p), ("phases", c_void_p), ("n_phases", c_int64), ("store", c_void_p), ("n_outputs", c_int64),
        ("table", c_void_p), ("n_columns", c_int64), ("every", c_int64), ("row_start", c_int64), ("step_ns", c_double),
        ("bound", c_double), ("domain", c_void_p), ("n_domain", c_int64), ("mark", c_void_p), ("call", c_int64),
        ("status", c_int64),
    ]  # fmt: skip


@cache
def _library():
    from build_fmus.library import library_path

    return prepared(ctypes.CDLL(str(library_path("executor"))))


def prepared(library: ctypes.CDLL) -> ctypes.CDLL:
    """A compiled fmu_src/executor with the types of its functions."""
    library.execute.argtypes = [POINTER(_Job), c_int64]
    library.initialise.argtypes = [POINTER(_Job), c_void_p, c_int64]
    library.execute.restype = library.initialise.restype = c_int
    return library


def applies(slaves: Sequence[Slave]) -> bool:
    """Whether every component is an FMU that exchanges doubles only (asked when they are wired)."""
    return all(isinstance(s, FmuSlave) and all(bank.shared for bank in s.setters + s.getters) for s in slaves)


# --- start ----------------------------------------------------------------------------------------------------------------


def initialise(wiring: Wiring, slaves: Sequence[Slave], memory: dict, mark: np.ndarray | None = None) -> np.ndarray:
    """The store at t = 0 (see cosim.initialisation.initialise); memory: kept between runs of the same schedule and slaves.

    Raises RunError, worded in Python: an instance that refuses anything is started again there.
    """
    begin = memory.get("start")
    if begin is None:
        wired(wiring, slaves)
        begin = memory["start"] = _Begin(wiring, slaves) if applies(slaves) else False
    mark = marked() if mark is None else mark
    if begin and begin.run(wiring, mark):
        return begin.store
    return initialise_in_python(wiring, slaves, mark)


class _Begin:
    """The start of the instances in C's layout, their start values apart."""

    def __init__(self, wiring: Wiring, slaves: Sequence[FmuSlave]) -> None:
        schedule = wiring.schedule
        self.slaves, self.arena = slaves, Arena()
        self.store = np.zeros(2 * schedule.outputs)
        natives = (_Slave * len(slaves))(*[_native(s, o, self.arena) for s, o in zip(slaves, schedule.offset)])
        self.job = _Job(slaves=self.arena.structures(natives), store=self.arena.array(self.store), n_outputs=schedule.outputs)
        self.starts = (_Start * len(slaves))()
        for start, slave, source in zip(self.starts, slaves, initial_sources(wiring)):
            self._fill(start, slave, source)
        self.values: list[_Values | None] = [None] * len(slaves)

    def _fill(self, start: _Start, slave: FmuSlave, source: np.ndarray) -> None:
        start.reset, start.leave = slave.address("Reset"), slave.address("ExitInitializationMode")
        start.source = self.arena.indices(source)
        if isinstance(slave, Fmi2Slave):
            start.setup2, start.enter2 = slave.address("SetupExperiment"), slave.address("EnterInitializationMode")
        else:
            start.enter3 = slave.address("EnterInitializationMode")

    def run(self, wiring: Wiring, mark: np.ndarray) -> bool:
        """Start every instance; False where one refuses anything."""
        self.job.mark = mark.ctypes.data
        for i, slave in enumerate(self.slaves):
            slave.messages.clear()
            slave.time, slave.fresh, self.starts[i].fresh = 0.0, False, slave.fresh
            if not self._set(i, wiring.starts[slave.name]):
                return False
        return _library().initialise(byref(self.job), ctypes.addressof(self.starts), len(self.slaves)) == 0

    def _set(self, i: int, values: Mapping[str, float | str]) -> bool:
        """Start values of an instance into C's arrays; False where one is a text."""
        known = self.values[i]
        if known is not None and known.given is values:
            return True
        if known is None or known.names != tuple(values):
            if any(isinstance(value, str) for value in values.values()):
                return False
            known = self.values[i] = _Values(self.slaves[i], tuple(values))
            self.starts[i].banks, self.starts[i].n_banks = ctypes.addressof(known.banks), len(known.banks)
        known.fill(values)
        return True


class _Values:
    """Start values of an instance by type: arrays, and the calls that hand them over."""

    def __init__(self, slave: FmuSlave, names: tuple[str, ...]) -> None:
        self.names, self.given = names, None
        kinds = slave.by_kind(names)
        self.banks = (_Bank * len(kinds))()
        self.arrays = []
        for bank, (kind, some) in zip(self.banks, kinds.items()):
            refs, array = slave.references(some), np.zeros(len(some), slave.dtype(kind))
            self.arrays.append((array, some, refs))
            bank.refs, bank.values, bank.n = ctypes.addressof(refs), array.ctypes.data, len(some)
            setattr(bank, "set2" if isinstance(slave, Fmi2Slave) else "set3", slave.address("Set" + kind))

    def fill(self, values: Mapping[str, float | str]) -> None:
        for array, names, _ in self.arrays:
            array[:] = [values[name] for name in names]
        self.given = values


def _native(slave: FmuSlave, offset: int, arena: Arena) -> _Slave:
    native = _Slave(
        instance=slave.component, input_refs=arena.structures(slave.references(slave.input_names)),
        slope_refs=arena.structures(slave.slope_references()),
        output_refs=arena.structures(slave.references(slave.output_names)),
        orders=arena.structures((c_int * max(1, len(slave.slopes)))(*[1] * len(slave.slopes))),
        inputs=arena.array(slave.inputs), slopes=arena.array(slave.slopes), outputs=arena.array(slave.outputs),
        n_inputs=len(slave.inputs), n_slopes=len(slave.slopes), n_outputs=len(slave.outputs), offset=offset,
    )  # fmt: skip
    if isinstance(slave, Fmi2Slave):
        native.set2, native.get2 = slave.address("SetReal"), slave.address("GetReal")
        native.slopes2, native.step2 = slave.address("SetRealInputDerivatives"), slave.address("DoStep")
        return native
    native.set3, native.get3, native.step3 = (slave.address(f) for f in ("SetFloat64", "GetFloat64", "DoStep"))
    native.event, native.terminate, native.early = (ctypes.addressof(flag) for flag in slave.flags)
    native.reached = ctypes.addressof(slave.reached)
    return native


# --- run ------------------------------------------------------------------------------------------------------------------


def execute(job: Job, progress: Callable[[Progress], None] | None = None) -> Ending:
    """Run the schedule in the compiled loop (see `cosim.execution.Executor`); in Python where it does not apply."""
    if "applies" not in job.memory:
        job.memory["applies"] = applies(job.slaves)
    if not job.memory["applies"]:
        return execute_in_python(job, progress)
    ending = watched(job, 0)
    keep(job, 0, job.columns)
    if ending is not None:
        return ending
    loop = job.memory.get("loop")
    if loop is None or loop.store is not job.store:
        loop = job.memory["loop"] = _Loop(job)
    return loop.run(job, progress)


class _Loop:
    """A schedule with its slaves in C's layout, and the arrays that must outlive the calls."""

    def __init__(self, job: Job) -> None:
        self.arena, self.store = Arena(), job.store
        slaves = (_Slave * len(job.slaves))(
            *[_native(slave, offset, self.arena) for slave, offset in zip(job.slaves, job.schedule.offset)]
        )
        for component in job.schedule.remembered:
            slaves[component].remembered = 1
        phases = self.arena.phases(job.schedule.phases, job.columns, job.schedule.step_ns)
        self.native = _Job(
            self.arena.structures(slaves), phases, len(job.schedule.phases), self.arena.array(job.store),
            job.schedule.outputs, None, len(job.columns), job.every, 0, job.schedule.step_ns, job.watch.bound,
            self.arena.indices(job.watch.domain), len(job.watch.domain), None, -1, 0,
        )  # fmt: skip

    def run(self, job: Job, progress: Callable[[Progress], None] | None) -> Ending:
        """Batches of communication steps, each of about a tenth of a second, until the end."""
        execute, steps, done = _library().execute, job.steps, 0
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
                    progress(Progress(done, steps, seconds(done, job.schedule.step_ns), now - began))
        except KeyboardInterrupt:
            return interrupted(int(job.mark[0]))
        return Ending(done)

    def _ending(self, job: Job, answer: int, done: int) -> Ending:
        if answer == _ENDED:
            return watched(job, done) or Ending(done, message="an FMU asked to end the run")
        if answer == _OUT_OF_BOUNDS:
            return watched(job, done)
        try:
            return self._refused(job, done)
        except RunError as error:
            failure = blamed(job, error, done)
            return Ending(done, Outcome.FAILED, str(failure), failure)

    def _refused(self, job: Job, done: int) -> Ending:
        """Raises what the slave itself would have raised for the call's status."""
        component, call, status = int(job.mark[1]), self.native.call, self.native.status
        slave = job.slaves[component]
        slave.time = seconds(done, job.schedule.step_ns)
        if _CALLS[call] == "get outputs":
            slave.time += _step_size(job, component)
        if _CALLS[call] == "step":
            slave.judge(status)
            return Ending(done, message="an FMU asked to end the run")
        banks = {"set inputs": slave.setters[:1], "set input derivatives": slave.setters[-1:], "get outputs": slave.getters}
        slave.check(status, banks[_CALLS[call]][0].what)
        raise AssertionError("a status above 1 is an error")


def _step_size(job: Job, component: int) -> float:
    """Length of a component's steps [s]."""
    operations = (o for phase in job.schedule.phases for o in phase.operations)
    found = (o.multiple for o in operations if isinstance(o, Step) and o.component == component)
    return seconds(next(found), job.schedule.step_ns)
