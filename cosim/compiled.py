"""The compiled executor: the same schedule as `cosim.execution.execute`, the same bits, in a loop that C runs over the FMUs.

fmpy loads, instantiates and initialises; this module hands the FMI functions' addresses, the instances and the schedule to
`fmu_src/executor/executor.c` and lets it run a while at a time, so that Ctrl-C and progress get their turn and other
threads theirs (no lock of Python's is held). What ends a run is worded by the same code as in the Python executor.

Components that exchange other types than doubles, or that are no FMUs, are left to the Python executor.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from ctypes import POINTER, byref, c_double, c_int, c_int64, c_void_p
from functools import cache

import numpy as np

from cosim.errors import RunError
from cosim.execution import Ending, Job, Progress, blamed, interrupted, keep, watched
from cosim.execution import execute as execute_in_python
from cosim.fmu import Fmi2Slave, FmuSlave
from cosim.outcome import Outcome
from cosim.schedule import GetOutputs, Operation, SetInputs, Step, seconds

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
        ("event", c_void_p), ("terminate", c_void_p), ("early", c_void_p), ("reached", c_void_p),
    ]  # fmt: skip


class _Operation(ctypes.Structure):
    _fields_ = [
        ("kind", c_int64), ("component", c_int64), ("n_source", c_int64), ("n_line", c_int64), ("inside", c_int64),
        ("source", c_void_p), ("line", c_void_p), ("newer", c_void_p), ("older", c_void_p), ("weight", c_void_p),
        ("span", c_void_p), ("size", c_double),
    ]  # fmt: skip


class _Phase(ctypes.Structure):
    _fields_ = [("operations", c_void_p), ("n_operations", c_int64), ("columns", c_void_p)]


class _Job(ctypes.Structure):
    _fields_ = [
        ("slaves", c_void_p), ("phases", c_void_p), ("n_phases", c_int64), ("store", c_void_p), ("n_outputs", c_int64),
        ("table", c_void_p), ("n_columns", c_int64), ("every", c_int64), ("row_start", c_int64), ("step_ns", c_double),
        ("bound", c_double), ("domain", c_void_p), ("n_domain", c_int64), ("component", c_int64), ("call", c_int64),
        ("status", c_int64),
    ]  # fmt: skip


@cache
def _library():
    from build_fmus.library import library_path

    library = ctypes.CDLL(str(library_path("executor")))
    library.execute.argtypes = [POINTER(_Job), POINTER(c_int64), c_int64]
    library.execute.restype = c_int
    return library


def applies(job: Job) -> bool:
    """Whether every component is an FMU that exchanges doubles only."""
    return all(isinstance(s, FmuSlave) and all(bank.shared for bank in s.setters + s.getters) for s in job.slaves)


def execute(job: Job, progress: Callable[[Progress], None] | None = None) -> Ending:
    """Run the schedule in the compiled loop (see `cosim.execution.Executor`); in Python where it does not apply."""
    if not applies(job):
        return execute_in_python(job, progress)
    ending = watched(job, 0)
    keep(job, 0, job.columns)
    if ending is not None:
        return ending
    return _Loop(job, progress).run()


class _Loop:
    """A job in C's layout, and the arrays that must outlive the calls."""

    def __init__(self, job: Job, progress: Callable[[Progress], None] | None) -> None:
        self.job, self.progress = job, progress
        self.kept: list[object] = []
        self.done = c_int64(0)
        self.native = self._native()

    def run(self) -> Ending:
        """Batches of communication steps, each of about a tenth of a second, until the end."""
        execute, steps = _library().execute, self.job.steps
        began = last = time.perf_counter()
        batch = _FIRST_BATCH
        try:
            while self.done.value < steps:
                before = self.done.value
                answer = execute(byref(self.native), byref(self.done), min(steps, before + batch))
                if answer != _DONE:
                    return self._ending(answer)
                now = time.perf_counter()
                batch = max(1, int((self.done.value - before) * _TURN / max(now - last, 1e-6)))
                last = now
                self._tell(now - began)
        except KeyboardInterrupt:
            return interrupted(self.done.value)
        return Ending(self.done.value)

    def _tell(self, wall: float) -> None:
        if self.progress is not None:
            done = self.done.value
            self.progress(Progress(done, self.job.steps, seconds(done, self.job.schedule.step_ns), wall))

    def _ending(self, answer: int) -> Ending:
        done = self.done.value
        if answer == _ENDED:
            return watched(self.job, done) or Ending(done, message="an FMU asked to end the run")
        if answer == _OUT_OF_BOUNDS:
            return watched(self.job, done)
        try:
            return self._refused(done)
        except RunError as error:
            failure = blamed(self.job, error, done)
            return Ending(done, Outcome.FAILED, str(failure), failure)

    def _refused(self, done: int) -> Ending:
        """Raises what the slave itself would have raised for the call's status."""
        slave, call, status = self.job.slaves[self.native.component], self.native.call, self.native.status
        slave.time = seconds(done, self.job.schedule.step_ns)
        if _CALLS[call] == "step":
            slave.judge(status)
            return Ending(done, message="an FMU asked to end the run")
        names = slave.output_names if _CALLS[call] == "get outputs" else slave.input_names
        slave.check(status, f"{_CALLS[call]} {', '.join(names)}")
        raise AssertionError("a status above 1 is an error")

    # --- C's layout

    def _native(self) -> _Job:
        job = self.job
        phases = (_Phase * len(job.schedule.phases))()
        for native, phase in zip(phases, job.schedule.phases):
            operations = (_Operation * len(phase.operations))(*[self._operation(o) for o in phase.operations])
            native.operations, native.n_operations = self._keep(operations), len(phase.operations)
            native.columns = self._indices(phase.record.source[job.columns])
        slaves = (_Slave * len(job.slaves))(*[self._slave(i) for i in range(len(job.slaves))])
        return _Job(
            self._keep(slaves), self._keep(phases), len(phases), self._array(job.store), job.schedule.outputs,
            self._array(job.table), len(job.columns), job.every, 0, job.schedule.step_ns, job.watch.bound,
            self._indices(job.watch.domain), len(job.watch.domain), -1, -1, 0,
        )  # fmt: skip

    def _slave(self, number: int) -> _Slave:
        slave, schedule = self.job.slaves[number], self.job.schedule
        version2 = isinstance(slave, Fmi2Slave)
        native = _Slave(
            instance=slave.component, input_refs=self._references(slave, slave.input_names),
            slope_refs=self._keep(slave.slope_references()), output_refs=self._references(slave, slave.output_names),
            orders=self._keep((c_int * max(1, len(slave.slopes)))(*[1] * len(slave.slopes))), inputs=self._array(slave.inputs),
            slopes=self._array(slave.slopes), outputs=self._array(slave.outputs), n_inputs=len(slave.inputs),
            n_slopes=len(slave.slopes), n_outputs=len(slave.outputs), offset=schedule.offset[number],
        )  # fmt: skip
        if version2:
            native.set2, native.get2 = slave.address("SetReal"), slave.address("GetReal")
            native.slopes2, native.step2 = slave.address("SetRealInputDerivatives"), slave.address("DoStep")
            return native
        native.set3, native.get3, native.step3 = (slave.address(f) for f in ("SetFloat64", "GetFloat64", "DoStep"))
        native.event, native.terminate, native.early = (ctypes.addressof(flag) for flag in slave.flags)
        native.reached = ctypes.addressof(slave.reached)
        return native

    def _operation(self, operation: Operation) -> _Operation:
        if isinstance(operation, Step):
            return _Operation(kind=1, component=operation.component, size=seconds(operation.multiple, self.job.schedule.step_ns))
        if isinstance(operation, GetOutputs):
            return _Operation(kind=2, component=operation.component)
        return self._set(operation)

    def _set(self, operation: SetInputs) -> _Operation:
        return _Operation(
            kind=0, component=operation.component, n_source=len(operation.source), n_line=len(operation.line),
            inside=int(bool(np.any(operation.weight))), source=self._indices(operation.source),
            line=self._indices(operation.line), newer=self._indices(operation.newer), older=self._indices(operation.older),
            weight=self._array(operation.weight), span=self._array(operation.span),
        )  # fmt: skip

    def _references(self, slave: FmuSlave, names) -> int:
        return self._keep(slave.references(names))

    def _keep(self, array: ctypes.Array) -> int:
        self.kept.append(array)
        return ctypes.addressof(array)

    def _indices(self, values) -> int:
        return self._array(np.ascontiguousarray(values, dtype=np.int64))

    def _array(self, array: np.ndarray) -> int:
        self.kept.append(array)
        return array.ctypes.data
