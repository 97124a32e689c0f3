"""The same sweep on an existing Dask cluster: `--dask ADDRESS`. The only module that imports dask (optional extra
`dask`).
"""

from collections.abc import Iterator, Sequence
from typing import Any

from cosim.errors import InputError, Problem
from cosim.sweeps.points import Point
from cosim.sweeps.pool import Answer, Task, Workers, attempt, chunked


class DaskPool(Workers):
    """Workers of the scheduler at `address` ("tcp://host:8786"); they need haptic-cosim installed.

    Raises InputError where the extra is not installed or nothing answers at the address.
    """

    def __init__(self, address: str, timeout: float = 10.0) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise InputError(
                Problem("--dask", "the package distributed", "not installed", "pip install 'haptic-cosim[dask]'")
            ) from None
        try:
            self.client = Client(address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(Problem("--dask", "the address of a Dask scheduler", repr(address), str(error))) from None

    @property
    def count(self) -> int:
        cores: Any = self.client.ncores()  # a dictionary; awaitable for asynchronous clients only
        return max(1, sum(cores.values()))

    def answers(self, task: Task, points: Sequence[Point], size: int) -> Iterator[Answer]:
        from distributed import as_completed

        waiting = {self._submit(task, chunk.points): chunk for chunk in chunked(points, size)}
        ready = as_completed(list(waiting), loop=self.client.loop)
        for future in ready:
            chunk = waiting.pop(future)
            findings, message = (
                future.result() if future.status == "finished" else (None, f"the worker died: {future.exception()}")
            )
            if findings is not None:
                yield chunk.points, findings
                continue
            again, settled = chunk.after_failure(message)
            for later in again:
                future = self._submit(task, later.points)
                waiting[future] = later
                ready.add(future)
            yield from settled

    def _submit(self, task: Task, points: tuple[Point, ...]) -> Any:
        return self.client.submit(attempt, task, points, pure=False, retries=0)

    def close(self) -> None:
        self.client.close()
