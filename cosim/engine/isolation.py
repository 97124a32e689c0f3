"""A run, or another use of FMUs, in a process of its own, so that an FMU that crashes ends neither this process nor
what was computed before.

The table and the mark of the run (see cosim.engine.reference.marked) lie in memory that both processes share. Only the
child process loads the FMUs; where it dies, the mark says how far the run came and which FMU was being called. What it
tells is plain data (see cosim.child). It frees the FMUs when it has told everything, and is not waited for.
"""

from __future__ import annotations

import builtins
import mmap
import os
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_origin

import numpy as np
from attrs import asdict

from cosim.child import Child, News, NoiseError, words
from cosim.engine.master import PreparedRun, Result, Timetable, run
from cosim.engine.outcome import Outcome
from cosim.engine.reference import Ending, RunProgress, interrupted
from cosim.engine.table import SignalTable
from cosim.errors import InputError, Problem, RunError
from cosim.fmu import FmuSet
from cosim.scenario import Scenario
from cosim.wiring import Wiring
from cosim.wiring.schedule import seconds

if TYPE_CHECKING:
    from cattrs import Converter

Answer = TypeVar("Answer")
_LOADING, _STARTING = -2, -1  # in place of the steps completed
_NOISE = "wrote to descriptors that are not its own"
_CLOSED = "closed descriptors that are not its own"


def runner(scenario: Scenario) -> Callable[..., Result]:
    """`run_apart` where FMUs of others or the user's own models take part and the system can fork, else `run`."""
    return run_apart if _distrusted(scenario) else run


def _distrusted(scenario: Scenario) -> bool:
    return any(component.fmu or component.own for component in scenario.components.values()) and hasattr(os, "fork")


def called(
    action: Callable[[np.ndarray | None], Answer], kind: type[Answer], scenario: Scenario, system: FmuSet, doing: str
) -> Answer:
    """What `action(mark)` returns, of the class `kind`: an action that uses the system's FMUs and notes in the mark
    which one is at work.

    It is called in this process, or in one of its own where `runner` would run the scenario in one. `doing` describes
    the action for an error message. Raises what the action raises, and RunError where an FMU crashes.
    """
    if not _distrusted(scenario):
        return action(None)
    wiring, mark = system.wiring(scenario), _shared_mark()

    def work(tell: Callable[[News], None]) -> None:
        with _Told(tell):
            _load(system, wiring, mark)
            mark[0] = _STARTING
            tell({"answer": _plain().unstructure(action(mark), kind)})

    child = _begun(work, system, wiring, mark)
    try:
        for news in child.heard():
            _raise_told(news)
            if "answer" in news:
                child.dismiss()
                return _plain().structure(news["answer"], kind)
        child.ended()
    except NoiseError:
        child.kill()
        raise RunError(_at_work(wiring, mark), None, f"{_strange(_NOISE)} while {doing}") from None
    except BaseException:
        child.kill()
        raise
    phase = "it was loaded" if mark[0] == _LOADING else doing
    raise RunError(_at_work(wiring, mark), None, _crash(phase, child))


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

    def work(tell: Callable[[News], None]) -> None:
        with _Told(tell):
            _load(system, wiring, mark)
            prepared = PreparedRun.of(system, wiring, record)
            mark[0] = _STARTING
            ending = prepared.execute(rows, partial(_tell_progress, tell) if progress else None, mark)
            tell({"ending": _plain().unstructure(ending)})

    ending = _watched(wiring, mark, progress, _begun(work, system, wiring, mark))
    return timetable.result(wiring, rows, ending, time.perf_counter() - began)


def _shared_mark() -> np.ndarray:
    mark = np.frombuffer(mmap.mmap(-1, 16), dtype=np.int64)
    mark[0] = _LOADING
    return mark


def _begun(work: Callable[[Callable[[News], None]], None], system: FmuSet, wiring: Wiring, mark: np.ndarray) -> Child:
    """A child that does the work, and then frees the FMUs one by one."""

    def leave() -> None:
        for number, name in enumerate(wiring.scenario.components):
            mark[1] = number
            if name in system.loaded:
                system.loaded[name].close()

    return Child(work, leave, lambda: f"FMU {_at_work(wiring, mark)} was being freed")


def _watched(wiring: Wiring, mark: np.ndarray, progress: Callable[[RunProgress], None] | None, child: Child) -> Ending:
    """How the run in the child ended. Raises what it raised."""
    try:
        for news in child.heard():
            _raise_told(news)
            if "ending" in news:
                ending = _plain().structure(news["ending"], Ending)
                child.dismiss()
                return ending
            if progress is not None and "progress" in news:
                progress(RunProgress(*_list(news["progress"])))
        child.ended()
        return _crashed(wiring, mark, child)
    except NoiseError:
        child.kill()
        return _failed(wiring, mark, _NOISE)
    except KeyboardInterrupt:
        child.kill()
        if mark[0] < 0:
            raise
        return interrupted(int(mark[0]))
    except BaseException:
        child.kill()
        raise


def _load(system: FmuSet, wiring: Wiring, mark: np.ndarray) -> None:
    for number, name in enumerate(wiring.scenario.components):
        mark[1] = number
        system.instance(name, wiring.descriptions[name])


# --- what passes between the processes --------------------------------------------------------------------------------


class _Told:
    """Whatever is raised inside goes to the parent, as data."""

    def __init__(self, tell: Callable[[News], None]) -> None:
        self.tell = tell

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        if isinstance(error, Exception) and not isinstance(error, BrokenPipeError):
            self.tell({"error": type(error).__name__, **_details(error)})
            return True
        return False


def _details(error: Exception) -> dict[str, Any]:
    if isinstance(error, RunError):
        return {"parts": [error.fmu, error.time, error.message, error.variable]}
    if isinstance(error, InputError):
        return {"parts": [asdict(problem) for problem in error.problems]}
    return {"parts": [str(error)]}


def _raise_told(news: News) -> None:
    """Raise the error that the child tells of, if it does."""
    name = str(news.get("error", ""))
    if not name:
        return
    parts = _list(news.get("parts"))
    if name == "RunError":
        raise RunError(*parts)
    if name == "InputError":
        raise InputError([Problem(**part) for part in parts])
    known = getattr(builtins, name, None)
    if isinstance(known, type) and issubclass(known, Exception):
        raise known(*parts)
    raise RuntimeError(f"{name}: {parts[0] if parts else ''}")


def _list(value: object) -> list[Any]:
    if not isinstance(value, list):
        raise NoiseError
    return value


def _tell_progress(tell: Callable[[News], None], progress: RunProgress) -> None:
    tell({"progress": [progress.done, progress.total, progress.simulated, progress.wall]})


def _sparse(found: Mapping[str, Any], _: object) -> Any:
    """A sparse matrix from its shape and its cells: rows, columns, values."""
    from scipy.sparse import csr_array

    rows, columns, values = (np.array(part) for part in found["cells"])
    shape = tuple(found["shape"])
    return csr_array((values.astype(float), (rows.astype(int), columns.astype(int))), shape=shape)


@cache
def _plain() -> Converter:
    """Between our frozen classes and plain data: arrays with their shape, keys of mappings that are no text, errors."""
    from cattrs import Converter
    from scipy.sparse import csr_array, find

    plain = Converter()
    plain.register_unstructure_hook(np.ndarray, lambda a: {"shape": a.shape, "values": a.ravel().tolist()})
    plain.register_structure_hook(np.ndarray, lambda a, _: np.array(a["values"], dtype=float).reshape(a["shape"]))
    plain.register_unstructure_hook(csr_array, lambda a: {"shape": a.shape, "cells": [p.tolist() for p in find(a)]})
    plain.register_structure_hook(csr_array, _sparse)
    plain.register_unstructure_hook(RunError, lambda error: _details(error)["parts"])
    plain.register_structure_hook(RunError, lambda parts, _: RunError(*parts))
    plain.register_unstructure_hook_factory(
        _by_objects,
        lambda kind: (
            lambda found: [[plain.unstructure(x, t) for x, t in zip(p, get_args(kind))] for p in found.items()]
        ),
    )
    plain.register_structure_hook_factory(
        _by_objects,
        lambda kind: (
            lambda pairs, _: {
                plain.structure(k, get_args(kind)[0]): plain.structure(v, get_args(kind)[1]) for k, v in pairs
            }
        ),
    )
    return plain


def _by_objects(kind: Any) -> bool:
    """Whether it is the type of a mapping whose keys are no text; in JSON it is a list of pairs."""
    return get_origin(kind) in (Mapping, dict) and get_args(kind)[0] is not str


# --- what went wrong --------------------------------------------------------------------------------------------------


def _at_work(wiring: Wiring, mark: np.ndarray) -> str:
    names = list(wiring.scenario.components)
    return names[min(max(int(mark[1]), 0), len(names) - 1)]


def _strange(what: str) -> str:
    return f"the FMU {what}, and so ended what this program does with it"


def _crash(phase: str, child: Child) -> str:
    if child.lost_its_pipe:
        return f"the FMU {_CLOSED} while {phase}; ask its maker, or leave it out"
    return f"the FMU crashed while {phase} ({words(child.exitcode)}); ask its maker, or leave it out"


def _crashed(wiring: Wiring, mark: np.ndarray, child: Child) -> Ending:
    """The ending of a run whose process died. Raises RunError where that was before t = 0."""
    done = int(mark[0])
    if done < 0:
        phase = "it was loaded" if done == _LOADING else "it was initialised"
        raise RunError(_at_work(wiring, mark), None, _crash(phase, child))
    return _failed(wiring, mark, _CLOSED if child.lost_its_pipe else f"crashed ({words(child.exitcode)})")


def _failed(wiring: Wiring, mark: np.ndarray, what: str) -> Ending:
    """The ending of a run that an FMU ended by what it did."""
    component, done, experiment = _at_work(wiring, mark), int(mark[0]), wiring.scenario.experiment
    if done < 0:
        raise RunError(component, None, f"the FMU {what} before t = 0; ask its maker, or leave it out")
    steps = experiment.steps
    where = f"in communication step {done + 1} of {steps}" if done < steps else f"after the last of {steps} steps"
    doing, _, how = what.partition(" (")
    failure = RunError(
        component,
        seconds(done, experiment.step_ns),
        f"the FMU {doing} {where}{f' ({how}' if how else ''}; "
        "what was computed before is kept; ask its maker, or leave it out",
    )
    return Ending(done, Outcome.FAILED, str(failure), failure)
