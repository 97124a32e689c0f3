"""The same sweep on an existing Dask cluster: `--dask ADDRESS`. The only module that imports dask (optional extra
`dask`).
"""

import logging
import time
from collections.abc import Iterator, Sequence
from queue import Empty, SimpleQueue
from typing import Any

from cosim.errors import InputError, Problem
from cosim.sweeps.points import Point
from cosim.sweeps.pool import Answer, Task, Workers, attempt, chunked

PATIENCE = 6.0
"""Seconds without scheduler or workers after which a sweep ends."""
_LOOK = 1.0  # s between two looks at the cluster while nothing arrives


class DaskPool(Workers):
    """Workers of the scheduler at `address` ("tcp://host:8786"); they need haptic-cosim installed.

    Raises InputError where the extra is not installed, nothing answers at the address or the cluster has no workers;
    later, ConnectionError where scheduler or workers are gone for longer than `PATIENCE`.
    """

    def __init__(self, address: str, timeout: float = PATIENCE) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise InputError(
                Problem("--dask", "the package distributed", "not installed", "pip install 'haptic-cosim[dask]'")
            ) from None
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what is wrong is told here, once
        self.address = address
        try:
            self.client: Any = Client(address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(Problem("--dask", "the address of a Dask scheduler", repr(address), str(error))) from None
        self._wait_for_workers(timeout)

    def _wait_for_workers(self, timeout: float) -> None:
        from distributed import TimeoutError as LateError

        try:
            self.client.wait_for_workers(1, timeout=timeout)
        except (LateError, TimeoutError, OSError):
            self.close()
            problem = Problem(
                "--dask", f"a cluster with workers at {self.address}", f"none within {timeout:g} s", "start a worker"
            )
            raise InputError(problem) from None

    @property
    def count(self) -> int:
        cores: Any = self.client.ncores()  # a dictionary; awaitable for asynchronous clients only
        return max(1, sum(cores.values()))

    def answers(self, task: Task, points: Sequence[Point], size: int) -> Iterator[Answer]:
        self.ready: SimpleQueue[Any] = SimpleQueue()
        waiting = {self._submit(task, chunk.points): chunk for chunk in chunked(points, size)}
        while waiting:
            future = self._next()
            chunk = waiting.pop(future, None)
            if chunk is None:
                continue
            findings, message = (
                future.result() if future.status == "finished" else (None, f"the worker died: {_cause(future)}")
            )
            if findings is not None:
                yield chunk.points, findings
                continue
            again, settled = chunk.after_failure(message)
            waiting |= {self._submit(task, later.points): later for later in again}
            yield from settled

    def _next(self) -> Any:
        """The next future that is done. Raises ConnectionError where none can be any more."""
        missed = None
        while True:
            try:
                future = self.ready.get(timeout=_LOOK)
            except Empty:
                future = None
            if future is not None and future.status not in ("cancelled", "lost"):
                return future
            missed = None if self._working() else missed or time.monotonic()
            if future is not None or (missed and time.monotonic() - missed >= PATIENCE - _LOOK):
                raise ConnectionError(
                    f"the Dask cluster at {self.address} has lost its scheduler or all its workers; what was computed "
                    "is kept: start it again, and run the same command again to go on"
                )

    def _working(self) -> bool:
        """Whether the scheduler answers and has workers."""
        if self.client.status != "running":
            return False
        scheduler: Any = self.client.scheduler
        try:
            known: Any = self.client.sync(scheduler.ncores, callback_timeout=_LOOK)
        except Exception:  # noqa: BLE001 - whatever a broken connection raises
            return False
        return bool(known)

    def _submit(self, task: Task, points: tuple[Point, ...]) -> Any:
        future = self.client.submit(attempt, task, points, pure=False, retries=0)
        future.add_done_callback(self.ready.put)
        return future

    def close(self) -> None:
        self.client.close(timeout=_LOOK)


def _cause(future: Any) -> str:
    try:
        return str(future.exception(timeout=_LOOK))
    except Exception as error:  # noqa: BLE001 - a lost connection, a future that was cancelled
        return str(error) or type(error).__name__
