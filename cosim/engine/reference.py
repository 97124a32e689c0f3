"""Execution of a schedule: what an executor gets and gives, and the plain one in Python, which is the readable
reference.

`cosim.engine.compiled` runs the same schedule in C, with the same bits. Time is counted in whole steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from attrs import field, frozen

from cosim.engine.outcome import Outcome
from cosim.engine.rounding import kept
from cosim.errors import RunError
from cosim.fmu.contract import Instance
from cosim.fmu.messages import FmuMessage
from cosim.wiring.schedule import CarryTexts, GetOutputs, Operation, Phase, Schedule, SetInputs, seconds

_TURN = 1024  # steps between two looks at what can leave memory


@frozen
class RunProgress:
    """How far a run is: steps done of all, simulated and wall-clock time [s]."""

    done: int
    total: int
    simulated: float
    wall: float

    @property
    def factor(self) -> float:
        """Simulated seconds per second."""
        return self.simulated / self.wall if self.wall > 0 else 0.0

    def __str__(self) -> str:
        total = self.simulated * self.total / self.done if self.done else 0.0
        return f"{self.simulated:.4g} of {total:g} s, {self.factor:.3g} x real time"


@frozen
class Watch:
    """What ends a run early: an output of `domain` (places in the store) below 1, or one beyond its bound, (n,)."""

    domain: tuple[int, ...]
    bounds: np.ndarray = field(eq=False)
    least: float = field(init=False)

    def __attrs_post_init__(self) -> None:
        object.__setattr__(self, "least", float(self.bounds.min(initial=np.inf)))


def marked() -> np.ndarray:
    """A new mark: the number of communication steps completed, and of the component that is being called.

    It is kept up to date at every call, so that it tells where a run was when an FMU crashed.
    """
    return np.zeros(2, dtype=np.int64)


@frozen
class Execution:
    """What an executor needs: the schedule, the initialised instances, the state at t = 0, and what to record.

    store: (2n,) current and previous outputs at t = 0; table: (rows, columns) to fill, row 0 included; columns:
    (columns,) which of the n outputs to record; every: communication steps per row; steps: communication steps in all;
    drop: called now and then with the number of rows that are filled; mark: (2,) where the run is (see `marked`);
    carriers: a call for each component that hands texts over (see cosim.engine.texts); strange: components whose FMUs
    others have built.
    """

    schedule: Schedule
    instances: Sequence[Instance]
    store: np.ndarray
    table: np.ndarray
    columns: np.ndarray
    every: int
    steps: int
    watch: Watch
    drop: Callable[[int], None] = lambda done: None
    mark: np.ndarray = field(factory=marked, repr=False)
    carriers: Sequence[Callable[[], None]] = ()
    strange: frozenset[int] = frozenset()


@frozen
class Ending:
    """How an execution ended: communication steps completed, outcome where it ended early, message, error."""

    steps: int
    outcome: Outcome | None = None
    message: str = ""
    failure: RunError | None = None
    interrupted: bool = False
    messages: tuple[FmuMessage, ...] = ()


class Executor(Protocol):
    """Executes a job and returns how it ended. Never raises for what an FMU does, nor for Ctrl-C."""

    def __call__(self, job: Execution, progress: Callable[[RunProgress], None] | None) -> Ending: ...


# --- the executor in Python -------------------------------------------------------------------------------------------


def execute(job: Execution, progress: Callable[[RunProgress], None] | None = None) -> Ending:
    """Run the schedule operation by operation (see `Executor`)."""
    phases = [_Turn(phase, job) for phase in job.schedule.phases]
    reporter = _Reporter(job, progress)
    done = 0
    with np.errstate(all="ignore"):
        try:
            ending = watched(job, 0)
            keep(job, 0, job.columns)
            job.mark[0] = 0
            while ending is None and done < job.steps:
                turn = phases[done % len(phases)]
                going = turn.act(done)
                if (done + 1) % job.every == 0:
                    keep(job, done + 1, turn.columns)
                done += 1
                job.mark[0] = done
                ending = watched(job, done) if going else Ending(done, message="an FMU asked to end the run")
                if done % _TURN == 0:
                    job.drop(done // job.every)
                reporter.tell(done)
        except RunError as error:
            failure = blamed(job, error, done)
            return Ending(done, Outcome.FAILED, str(failure), failure)
        except KeyboardInterrupt:
            return interrupted(done)
    return ending or Ending(done)


def interrupted(done: int) -> Ending:
    """The ending of a run that Ctrl-C stopped."""
    return Ending(done, Outcome.INCONCLUSIVE, "interrupted", interrupted=True)


def keep(job: Execution, done: int, columns: np.ndarray) -> None:
    """Record the row of the communication point after `done` steps."""
    job.store.take(columns, out=job.table[done // job.every], mode="clip")


class _Turn:
    """One phase with its operations bound to their instances; `columns` are the places that its row is taken from."""

    def __init__(self, phase: Phase, job: Execution) -> None:
        self.mark = job.mark
        self.operations = [(o.component, _guarded(_bound(o, job), o, job)) for o in phase.operations]
        self.columns = phase.record.source[job.columns]

    def act(self, done: int) -> bool:
        """Carry out the operations of the step after `done` steps; False where an FMU asks to end."""
        going = True
        for component, operation in self.operations:
            self.mark[1] = component
            if operation(done) is False:
                going = False
        return going


def _guarded(
    action: Callable[[int], bool | None], operation: Operation, job: Execution
) -> Callable[[int], bool | None]:
    """The action, after which this thread computes as before."""
    return kept()(action) if operation.component in job.strange else action


def _bound(operation: Operation, job: Execution) -> Callable[[int], bool | None]:
    instance = job.instances[operation.component]
    if isinstance(operation, SetInputs):
        return _set(operation, instance, job.store)
    if isinstance(operation, GetOutputs):
        return _get(operation, instance, job)
    if isinstance(operation, CarryTexts):
        return lambda done: job.carriers[operation.component]()
    step_ns = job.schedule.step_ns
    size = seconds(operation.multiple, step_ns)
    return lambda done: instance.step(done * step_ns / 1_000_000_000, size)


def _set(operation: SetInputs, instance: Instance, store: np.ndarray) -> Callable[[int], None]:
    inputs, slopes = instance.inputs, instance.slopes
    source, line, newer, older = operation.source, operation.line, operation.newer, operation.older
    weight, span = operation.weight, operation.span
    inside, scaled, gain, shift = bool(np.any(weight)), operation.scaled, operation.gain, operation.shift

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

    def hand_over() -> None:
        if len(scaled):
            inputs[scaled] = gain * inputs[scaled] + shift
        instance.set()

    return lined if len(line) else held


def _get(operation: GetOutputs, instance: Instance, job: Execution) -> Callable[[int], None]:
    offset, count, n = (
        job.schedule.offset[operation.component],
        job.schedule.count[operation.component],
        job.schedule.outputs,
    )
    newest, older = job.store[offset : offset + count], job.store[n + offset : n + offset + count]

    def get(done: int) -> None:
        instance.get()
        older[:] = newest
        newest[:] = instance.outputs

    return get


def watched(job: Execution, done: int) -> Ending | None:
    """The ending where a value left its bounds: NaN or infinity, beyond the bound, an arm out of its domain; else
    None.
    """
    values = job.store[: job.schedule.outputs]
    least = job.watch.least
    if not values @ values < least * least and not np.all(np.abs(values) <= job.watch.bounds):
        return _out_of_bounds(job, done)
    for place in job.watch.domain:
        if values.item(place) < 1.0:
            name = _name(job, place)[0]
            at = seconds(done, job.schedule.step_ns)
            return Ending(done, Outcome.DOMAIN_EXIT, f"{name} left the domain of its model at t = {at:.9g} s")
    return None


def _out_of_bounds(job: Execution, done: int) -> Ending:
    values = job.store[: job.schedule.outputs]
    at = seconds(done, job.schedule.step_ns)
    undefined = np.flatnonzero(~np.isfinite(values))
    if len(undefined):
        error = _not_finite(job, undefined, at)
        return Ending(max(done - 1, 0), Outcome.FAILED, str(error), error)
    bounds = job.watch.bounds
    beyond = int(np.argmax(np.where(np.abs(values) > bounds, np.abs(values) / bounds, 0.0)))
    component, index = _name(job, beyond)
    names = job.instances[job.schedule.components.index(component)].output_names
    message = f"{component}.{names[index]} passed {bounds[beyond]:g} at t = {at:.9g} s (experiment.bound)"
    return Ending(done, Outcome.DIVERGED, message)


def _not_finite(job: Execution, places: np.ndarray, at: float) -> RunError:
    """The error of the first component, in the order of stepping, whose output is not finite."""
    order = [op.component for phase in job.schedule.phases for op in phase.operations if isinstance(op, GetOutputs)]
    found = {_component(job, int(place)): int(place) for place in reversed(places)}
    component = next(c for c in order if c in found)
    instance = job.instances[component]
    variable = instance.output_names[found[component] - job.schedule.offset[component]]
    return RunError(instance.name, at, f"the output is {job.store[found[component]]}", variable)


def _component(job: Execution, place: int) -> int:
    return int(np.searchsorted(np.cumsum(job.schedule.count), place, side="right"))


def _name(job: Execution, place: int) -> tuple[str, int]:
    """Component and number of the output at a place in the store."""
    component = _component(job, place)
    return job.schedule.components[component], place - job.schedule.offset[component]


def blamed(job: Execution, error: RunError, done: int) -> RunError:
    """The error itself, or that of the FMU whose output was not finite when this one was asked to go on."""
    undefined = np.flatnonzero(~np.isfinite(job.store[: job.schedule.outputs]))
    return _not_finite(job, undefined, seconds(done + 1, job.schedule.step_ns)) if len(undefined) else error


class _Reporter:
    """Tells of the progress about five times a second."""

    def __init__(self, job: Execution, progress: Callable[[RunProgress], None] | None) -> None:
        self.job, self.progress = job, progress
        self.began = self.told = time.perf_counter()

    def tell(self, done: int) -> None:
        if self.progress is None or (done & 127 and done != self.job.steps):
            return
        now = time.perf_counter()
        if now - self.told >= 0.2 or done == self.job.steps:
            self.told = now
            simulated = seconds(done, self.job.schedule.step_ns)
            self.progress(RunProgress(done, self.job.steps, simulated, now - self.began))
