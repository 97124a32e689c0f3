"""Workers that evaluate points: this process, local processes, or a Dask cluster (`cluster`). All give results as they
become known.

An evaluator is a function `evaluate(task, points) -> findings`: one of cosim.sweeps.evaluate, or of a file that the
user has named; it may keep what it loaded between calls in its own module. What passes between the processes is JSON:
an evaluator may load FMUs of others, and what those write to a pipe is never more than text. Where a worker dies or an
evaluator raises, the points it had are handed out again, each alone; a point that then fails gets one retry, and after
that is `failed`, with the message of the last failure.
"""

import gc
import json
import multiprocessing
import signal
import sys
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from functools import cache
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from attrs import asdict, field, frozen

from cosim.child import end_with, words
from cosim.sweeps.points import Point, PointResult, failed, from_plain, plain

OWN = "cosim.sweeps.evaluate"
"""The module of our own evaluators."""
_LONGEST = 1 << 28  # bytes of an answer
_DYING = 5.0  # s that a worker may take to end once its pipe is closed
Answer = tuple[tuple[Point, ...], tuple[PointResult, ...]]


@frozen
class Task:
    """What an evaluator needs besides the points: scenario, fixed values, effects file, the level at which the sign of
    a growth rate ends a run, whether a point is to be proven for every delay law, whether the rate is used and not only
    its sign (a boundary is traced).
    """

    evaluator: str
    scenario: str
    set: Mapping[str, object] = field(factory=dict)
    effects: str | None = None
    sign_level: float | None = None
    any_delay: bool = False
    traced: bool = False


def function(name: str) -> Callable[[Task, Sequence[Point]], Sequence[PointResult]]:
    """The evaluator "cosim.sweeps.evaluate:function" or "FILE.py:function". Raises ValueError for any other name."""
    home, _, attribute = name.rpartition(":")
    if home == OWN:
        module: Any = import_module(OWN)
    elif home.endswith(".py"):
        module = _from_file(home)
    else:
        raise ValueError(f"{name!r} is no evaluator")
    return getattr(module, attribute)


@cache
def _from_file(path: str) -> Any:
    """The module in a file; loaded once a process."""
    spec = spec_from_file_location(f"evaluator_{Path(path).stem}", path)
    if spec is None or spec.loader is None:
        raise ValueError(f"{path} is no Python file")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def attempt(task: Task, points: Sequence[Point]) -> tuple[tuple[PointResult, ...] | None, str]:
    """Findings of an evaluator, or None with the words of what it raised."""
    try:
        return tuple(function(task.evaluator)(task, points)), ""
    except Exception as error:  # noqa: BLE001 - whatever an evaluator raises is a point that failed
        return None, f"{type(error).__name__}: {error}"


@frozen
class Chunk:
    """Points handed out together, and how often they were tried alone before."""

    points: tuple[Point, ...]
    tries: int = 0

    def after_failure(self, message: str) -> tuple[list["Chunk"], list[Answer]]:
        """What to hand out again, and what is settled as failed: of several points no one knows which was to blame."""
        if len(self.points) > 1:
            return [Chunk((p,)) for p in self.points], []
        if self.tries == 0:
            return [Chunk(self.points, 1)], []
        return [], [(self.points, (failed(message),))]


def chunked(points: Sequence[Point], size: int) -> list[Chunk]:
    """Points in chunks of at most `size`."""
    return [Chunk(tuple(points[k : k + size])) for k in range(0, len(points), size)]


class Workers(ABC):
    """Evaluates points; a context manager. `count`: how many chunks at once; `spare`: points that will be asked for
    later, for those who have nothing else to do while others work.
    """

    count = 1
    spare: Sequence[Point] = ()

    @abstractmethod
    def answers(self, task: Task, points: Sequence[Point], size: int) -> Iterator[Answer]:
        """Findings of all points in chunks of `size`, in the order in which they become known."""

    def close(self) -> None:  # noqa: B027 - this process has none
        """End the workers."""

    def __enter__(self) -> "Workers":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Here(Workers):
    """This process: for evaluators that need no protection (theory only), and for tests."""

    def answers(self, task: Task, points: Sequence[Point], size: int) -> Iterator[Answer]:
        todo = deque(chunked(points, size))
        while todo:
            chunk = todo.popleft()
            findings, message = attempt(task, chunk.points)
            if findings is not None:
                yield chunk.points, findings
                continue
            again, settled = chunk.after_failure(message)
            todo.extendleft(reversed(again))
            yield from settled


class LocalPool(Workers):
    """`count` worker processes; one that dies is replaced.

    On Linux they are forked, so that they begin with what this process has loaded. A replacement is always spawned,
    because by then this process may have threads, which do not survive a fork. The threads of numpy's BLAS would
    compete with the workers for the cores: set OPENBLAS_NUM_THREADS=1 before numpy is imported, as the command `cosim`
    does.
    """

    def __init__(self, count: int, meanwhile: Callable[[], object] | None = None) -> None:
        """meanwhile: what this process does as soon as a worker has nothing to do."""
        self.meanwhile = meanwhile
        first = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
        self.count: int = max(1, count)
        gc.freeze()  # workers do not search what this process has loaded for cycles
        self.workers: list[_Worker] = [_Worker(first) for _ in range(self.count)]
        gc.unfreeze()

    def answers(self, task: Task, points: Sequence[Point], size: int) -> Iterator[Answer]:
        """Points that follow one another go to the same worker, which remembers what they have in common; one that has
        done its share takes from the end of the longest, then of the spare points. Those that are under way when all
        else is answered are waited for in the next call.
        """
        begun = {point.key for worker in self.workers if worker.chunk for point in worker.chunk.points}
        left = _Left.of(points, [p for p in self.spare if p.key not in begun], begun, size, self.count)
        while left.wanted:
            for k, worker in enumerate(self.workers):
                if worker.chunk is None and (chunk := left.next(k)):
                    worker.give(task, chunk)
            if any(worker.chunk is None for worker in self.workers):
                self._bridge()
            for worker in _heard(self.workers):
                k, (chunk, findings, message) = self.workers.index(worker), worker.take()
                again, settled = (
                    ([], [(chunk.points, findings)]) if findings is not None else chunk.after_failure(message)
                )
                left.settle(k, again, settled)
                if chunk := left.next(k):  # before the answer is looked at: the worker need not wait for that
                    worker.give(task, chunk)
                yield from settled

    def _bridge(self) -> None:
        if self.meanwhile is not None:
            self.meanwhile()
            self.meanwhile = None

    def close(self) -> None:
        for worker in self.workers:
            worker.kill()
        for worker in self.workers:
            worker.stop()


@frozen(eq=False)
class _Left:
    """What is left to do: keys of points without an answer, the share of each worker, and spare chunks."""

    wanted: set[str]
    shares: list[deque[Chunk]]
    spare: deque[Chunk]

    @classmethod
    def of(cls, points: Sequence[Point], spare: Sequence[Point], begun: Set[str], size: int, count: int) -> "_Left":
        """Of points that were asked for now, some of which are begun already."""
        wanted, fresh = {point.key for point in points}, [point for point in points if point.key not in begun]
        share = max(1, -(-len(fresh) // count))
        shares = [deque(chunked(fresh[k : k + share], size)) for k in range(0, share * count, share)]
        return cls(wanted, shares, deque(chunked([point for point in spare if point.key not in wanted], size)))

    def next(self, k: int) -> Chunk | None:
        """The next chunk of worker k's share, else the last one of the longest share, else a spare one while anything
        else has no answer.
        """
        if any(self.shares):
            return self.shares[k].popleft() if self.shares[k] else max(self.shares, key=len).pop()
        return self.spare.popleft() if self.spare and self.wanted else None

    def settle(self, k: int, again: Sequence[Chunk], settled: Sequence[Answer]) -> None:
        """Worker k has done a chunk, of which some points have answers and others are to be tried again."""
        self.wanted.difference_update(point.key for points, _ in settled for point in points)
        for chunk in again:
            asked = any(point.key in self.wanted for point in chunk.points)
            (self.shares[k] if asked else self.spare).append(chunk)


def _heard(workers: Sequence["_Worker"]) -> list["_Worker"]:
    """Busy workers that have answered or died."""
    busy: dict[object, _Worker] = {
        handle: worker for worker in workers if worker.chunk for handle in (worker.pipe, worker.process.sentinel)
    }
    handles: list[Any] = list(busy)
    return list(dict.fromkeys(busy[handle] for handle in wait(handles)))


class _Worker:
    """One process with a pipe, and the chunk it is busy with."""

    def __init__(self, context: Any) -> None:
        self.chunk: Chunk | None = None
        self._start(context)

    def _start(self, context: Any) -> None:  # of forked or of spawned processes, whose types have nothing in common
        self.pipe, far = context.Pipe()
        self.process: BaseProcess = context.Process(target=_serve, args=(far,), daemon=True)
        self.process.start()
        far.close()

    def give(self, task: Task, chunk: Chunk) -> None:
        """Hand out a chunk; a worker that died while idle is replaced first."""
        self.chunk = chunk
        text = json.dumps([asdict(task), [[p.entries, p.values, p.sign_alone] for p in chunk.points]]).encode()
        try:
            self.pipe.send_bytes(text)
        except (BrokenPipeError, OSError):
            self._restart()
            self.pipe.send_bytes(text)

    def take(self) -> tuple[Chunk, tuple[PointResult, ...] | None, str]:
        """Its chunk with the findings, or with a message where it raised or died."""
        chunk, self.chunk = self.chunk, None
        assert chunk is not None  # only a busy worker is asked
        try:
            return chunk, *_heard_from(self.pipe.recv_bytes(_LONGEST), len(chunk.points))
        except ValueError:
            self._restart()
            return chunk, None, "something wrote to the pipe of the worker process"
        except (EOFError, OSError):
            self.process.join(_DYING)
            code = self.process.exitcode
            self._restart()
            how = "closed its pipe, or something wrote to it" if code is None else f"died ({words(code)})"
            return chunk, None, f"the worker process {how}"

    def _restart(self) -> None:
        self.stop()
        self._start(multiprocessing.get_context("spawn"))

    def kill(self) -> None:
        """Let the process end."""
        self.process.kill()  # an FMU may not let itself be terminated

    def stop(self) -> None:
        """End the process."""
        self.pipe.close()
        self.kill()
        self.process.join()


def _heard_from(text: bytes, count: int) -> tuple[tuple[PointResult, ...] | None, str]:
    """What a worker answered for so many points. Raises ValueError where that is no answer."""
    answer = json.loads(text)
    if not isinstance(answer, dict):
        raise ValueError("no answer")
    if "findings" not in answer:
        return None, str(answer.get("message"))
    findings = tuple(map(from_plain, answer["findings"]))
    if len(findings) != count:
        raise ValueError("answers to other points")
    return findings, ""


def _serve(pipe: Connection) -> None:
    """The loop of a worker process. It ignores Ctrl-C, which its parent handles, and ends when its parent does.

    The closing of the pipe would not tell it so: other forked workers hold the parent's end open too.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    assert parent is not None and parent.pid is not None  # this is a worker process
    if sys.platform != "win32":
        end_with(parent.pid)
    try:
        while parent.sentinel not in wait([pipe, parent.sentinel]):
            task, points = json.loads(pipe.recv_bytes())
            given = [
                Point(tuple(entries), tuple((path, value) for path, value in values), alone)
                for entries, values, alone in points
            ]
            findings, message = attempt(Task(**task), given)
            answer = {"message": message} if findings is None else {"findings": [plain(found) for found in findings]}
            pipe.send_bytes(json.dumps(answer).encode())
    except (EOFError, OSError):
        return
