"""A run in a process of its own, so that an FMU that crashes takes neither the run's rows nor this process with it.

The table and the mark of the run (see cosim.execution.marked) lie in memory that both processes share; only the child loads
the FMUs. Where it dies, the mark says how far the run came and which FMU was at work.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import signal
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cosim.errors import RunError
from cosim.execution import Ending, Progress, interrupted
from cosim.fmu import FmuSet
from cosim.master import Result, Stage, Timetable, run
from cosim.outcome import Outcome
from cosim.rows import Rows
from cosim.scenario import Scenario
from cosim.schedule import seconds
from cosim.wiring import Wiring

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

_LOADING, _STARTING = -2, -1  # in place of the steps completed


def runner(scenario: Scenario) -> Callable[..., Result]:
    """`run_apart` where FMUs of others are in the scenario and the system can fork, else `run`."""
    foreign = any(component.fmu for component in scenario.components.values())
    return run_apart if foreign and hasattr(os, "fork") else run


def run_apart(
    scenario: Scenario,
    system: FmuSet,
    progress: Callable[[Progress], None] | None = None,
    record: Sequence[str] | None = None,
) -> Result:
    """As `cosim.master.run`, in a process of its own; an FMU that crashes fails the run, and its rows are kept.

    Raises RunError where an FMU cannot be initialised or crashes before t = 0.
    """
    began, wiring = time.perf_counter(), system.wiring(scenario)
    timetable = Timetable.of(wiring, record)
    rows = Rows.shared(timetable.rows, len(timetable.names))
    mark = np.frombuffer(mmap.mmap(-1, 16), dtype=np.int64)
    mark[0] = _LOADING
    ending = _watched(wiring, mark, progress, (system, wiring, record, rows, mark, progress is not None))
    return timetable.result(wiring, rows, ending, time.perf_counter() - began)


def _watched(wiring: Wiring, mark: np.ndarray, progress: Callable[[Progress], None] | None, work: tuple) -> Ending:
    """Starts the child and tells how it ended. Raises what it raised."""
    from multiprocessing import get_context

    context = get_context("fork")
    pipe, far = context.Pipe(duplex=False)
    child = context.Process(target=_work, args=(far, *work), daemon=True)
    child.start()
    far.close()
    try:
        while not isinstance(news := pipe.recv(), Ending):
            if isinstance(news, Exception):
                raise news
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


def _work(pipe: Connection, system: FmuSet, wiring: Wiring, record, rows: Rows, mark: np.ndarray, telling: bool) -> None:
    """What the child does: load the FMUs, run, tell, free them. Ctrl-C is the parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        for number, name in enumerate(wiring.scenario.components):
            mark[1] = number
            system.slave(name, wiring.descriptions[name])
        stage = Stage.of(system, wiring, record)
        mark[0] = _STARTING
        pipe.send(stage.carry_out(rows, pipe.send if telling else None, mark))
    except Exception as error:
        pipe.send(error)
    system.close()
    ctypes.CDLL(None).fflush(None)  # what FMUs printed


def _crashed(wiring: Wiring, mark: np.ndarray, code: int) -> Ending:
    """The ending of a run whose process died. Raises RunError where that was before t = 0."""
    component, done = list(wiring.scenario.components)[mark[1]], int(mark[0])
    experiment = wiring.scenario.experiment
    words = f"signal {signal.Signals(-code).name}, {signal.strsignal(-code)}" if code < 0 else f"it ended the process, exit code {code}"
    if done < 0:
        phase = "it was loaded" if done == _LOADING else "it was initialised"
        raise RunError(component, None, f"the FMU crashed while {phase} ({words}); ask its maker, or leave it out")
    failure = RunError(
        component, seconds(done, experiment.step_ns),
        f"the FMU crashed in communication step {done + 1} of {experiment.steps} ({words}); "
        "what was computed before is kept; ask its maker, or leave it out",
    )  # fmt: skip
    return Ending(done, Outcome.FAILED, str(failure), failure)
