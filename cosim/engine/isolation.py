"""A run, or another use of FMUs, in a process of its own, so that an FMU that crashes ends neither this process nor
what was computed before.

The table and the mark of the run (see cosim.engine.reference.marked) lie in memory that both processes share. Only the
child process loads the FMUs; where it dies, the mark says how far the run came and which FMU was being called.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import signal
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from cosim.engine.master import PreparedRun, Result, Timetable, run
from cosim.engine.outcome import Outcome
from cosim.engine.reference import Ending, RunProgress, interrupted
from cosim.engine.table import SignalTable
from cosim.errors import RunError
from cosim.fmu import FmuSet
from cosim.scenario import Scenario
from cosim.wiring import Wiring
from cosim.wiring.schedule import seconds

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

Answer = TypeVar("Answer")
_LOADING, _STARTING = -2, -1  # in place of the steps completed


def runner(scenario: Scenario) -> Callable[..., Result]:
    """`run_apart` where FMUs of others are in the scenario and the system can fork, else `run`."""
    return run_apart if _distrusted(scenario) else run


def _distrusted(scenario: Scenario) -> bool:
    return any(component.fmu for component in scenario.components.values()) and hasattr(os, "fork")


def called(action: Callable[[np.ndarray | None], Answer], scenario: Scenario, system: FmuSet, doing: str) -> Answer:
    """What `action(mark)` returns: an action that uses the system's FMUs and notes in the mark which one is at work.

    It is called in this process, or in one of its own where `runner` would run the scenario in one. `doing` describes
    the action for an error message. Raises what the action raises, and RunError where an FMU crashes.
    """
    if not _distrusted(scenario):
        return action(None)
    wiring, mark = system.wiring(scenario), _shared_mark()
    pipe, child = _begun(_answer, action, system, wiring, mark)
    try:
        answer = pipe.recv()
    except EOFError:
        child.join()
        phase = "it was loaded" if mark[0] == _LOADING else doing
        raise RunError(list(scenario.components)[mark[1]], None, _crash(phase, child.exitcode)) from None
    except KeyboardInterrupt:
        child.kill()
        raise
    finally:
        child.join()
    if isinstance(answer, Exception):
        raise answer
    return answer


def _answer(
    pipe: Connection, action: Callable[[np.ndarray], object], system: FmuSet, wiring: Wiring, mark: np.ndarray
) -> None:
    """What the child of `called` does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        _load(system, wiring, mark)
        mark[0] = _STARTING
        pipe.send(action(mark))
    except Exception as error:  # noqa: BLE001 - whatever the child raises is the parent's to tell
        pipe.send(error)
    system.close()
    ctypes.CDLL(None).fflush(None)  # what FMUs printed


def run_apart(
    scenario: Scenario,
    system: FmuSet,
    progress: Callable[[RunProgress], None] | None = None,
    record: Sequence[str] | None = None,
) -> Result:
    """As `cosim.master.run`, in a process of its own; an FMU that crashes fails the run, and its rows are kept.

    Raises RunError where an FMU cannot be initialised or crashes before t = 0.
    """
    began, wiring = time.perf_counter(), system.wiring(scenario)
    timetable = Timetable.of(wiring, record)
    rows = SignalTable.shared(timetable.rows, len(timetable.names))
    mark = _shared_mark()
    ending = _watched(wiring, mark, progress, (system, wiring, record, rows, mark, progress is not None))
    return timetable.result(wiring, rows, ending, time.perf_counter() - began)


def _shared_mark() -> np.ndarray:
    mark = np.frombuffer(mmap.mmap(-1, 16), dtype=np.int64)
    mark[0] = _LOADING
    return mark


def _begun(target: Callable[..., None], *work: object) -> tuple[Connection, BaseProcess]:
    """A forked process that does `target(pipe, *work)`, and the end of its pipe that hears it."""
    from multiprocessing import get_context

    context = get_context("fork")
    pipe, far = context.Pipe(duplex=False)
    child = context.Process(target=target, args=(far, *work), daemon=True)
    child.start()
    far.close()
    return pipe, child


def _watched(wiring: Wiring, mark: np.ndarray, progress: Callable[[RunProgress], None] | None, work: tuple) -> Ending:
    """Starts the child and tells how it ended. Raises what it raised."""
    pipe, child = _begun(_work, *work)
    try:
        while not isinstance(news := pipe.recv(), Ending):
            if isinstance(news, Exception):
                raise news
            if progress is not None:
                progress(news)
        return news
    except EOFError:
        child.join()
        return _crashed(wiring, mark, child.exitcode)
    except KeyboardInterrupt:
        child.kill()
        if mark[0] < 0:
            raise
        return interrupted(int(mark[0]))
    finally:
        child.join()


def _work(
    pipe: Connection,
    system: FmuSet,
    wiring: Wiring,
    record: Sequence[str] | None,
    rows: SignalTable,
    mark: np.ndarray,
    telling: bool,
) -> None:
    """What the child does: load the FMUs, run, tell, free them. Ctrl-C is the parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        _load(system, wiring, mark)
        prepared = PreparedRun.of(system, wiring, record)
        mark[0] = _STARTING
        pipe.send(prepared.execute(rows, pipe.send if telling else None, mark))
    except Exception as error:  # noqa: BLE001 - whatever the child raises is the parent's to tell
        pipe.send(error)
    system.close()
    ctypes.CDLL(None).fflush(None)  # what FMUs printed


def _load(system: FmuSet, wiring: Wiring, mark: np.ndarray) -> None:
    for number, name in enumerate(wiring.scenario.components):
        mark[1] = number
        system.instance(name, wiring.descriptions[name])


def _crash(phase: str, code: int | None) -> str:
    return f"the FMU crashed while {phase} ({_words(code)}); ask its maker, or leave it out"


def _words(code: int | None) -> str:
    if code is not None and code < 0:
        return f"signal {signal.Signals(-code).name}, {signal.strsignal(-code)}"
    return f"it ended the process, exit code {code}"


def _crashed(wiring: Wiring, mark: np.ndarray, code: int | None) -> Ending:
    """The ending of a run whose process died. Raises RunError where that was before t = 0."""
    component, done = list(wiring.scenario.components)[mark[1]], int(mark[0])
    experiment = wiring.scenario.experiment
    if done < 0:
        raise RunError(component, None, _crash("it was loaded" if done == _LOADING else "it was initialised", code))
    failure = RunError(
        component,
        seconds(done, experiment.step_ns),
        f"the FMU crashed in communication step {done + 1} of {experiment.steps} ({_words(code)}); "
        "what was computed before is kept; ask its maker, or leave it out",
    )
    return Ending(done, Outcome.FAILED, str(failure), failure)
