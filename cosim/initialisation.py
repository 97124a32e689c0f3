"""The start of a run in Python, the readable reference: slaves with their start values, outputs carried to inputs.

`cosim.compiled` does the same in C, with the same bits.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from cosim.execution import marked
from cosim.schedule import Schedule
from cosim.slave import Slave
from cosim.wiring import Wiring


def wired(wiring: Wiring, slaves: Sequence[Slave]) -> None:
    """Tell every slave which variables it exchanges."""
    for slave in slaves:
        slave.wire(wiring.inputs(slave.name), wiring.sloped(slave.name), wiring.outputs(slave.name))


def initialise(wiring: Wiring, slaves: Sequence[Slave], mark: np.ndarray | None = None) -> np.ndarray:
    """Start every slave and carry outputs to inputs until nothing changes any more; the store at t = 0, (2n,).

    Inputs are set once at least, and again where they changed.
    Without algebraic loops this ends after at most as many rounds as there are components. Raises RunError.
    """
    schedule, mark = wiring.schedule, marked() if mark is None else mark
    wired(wiring, slaves)
    for slave in _at_work(slaves, mark):
        slave.slopes[:] = 0.0
        slave.start(wiring.starts[slave.name])
    store = np.zeros(2 * schedule.outputs)
    before = np.full(schedule.outputs, np.nan)
    sources = initial_sources(wiring)
    for turn in range(len(slaves) + 1):
        _collect(schedule, slaves, store, mark)
        if np.array_equal(store[: schedule.outputs], before):
            break
        before = store[: schedule.outputs].copy()
        for slave, source in zip(_at_work(slaves, mark), sources):
            if len(source) and not (turn and np.array_equal(slave.inputs, store[source])):
                slave.inputs[:] = store[source]
                slave.set()
    for slave in _at_work(slaves, mark):
        slave.begin()
    _collect(schedule, slaves, store, mark)
    store[schedule.outputs :] = store[: schedule.outputs]
    return store


def initial_sources(wiring: Wiring) -> list[np.ndarray]:
    """Places in the store of each component's inputs."""
    place = {name: i for i, name in enumerate(wiring.signals)}
    source = {str(link.target): place[str(link.source)] for link in wiring.links}
    return [
        np.array([source[f"{name}.{v}"] for v in wiring.inputs(name)], dtype=np.int64)
        for name in wiring.scenario.components
    ]


def _at_work(slaves: Sequence[Slave], mark: np.ndarray) -> Iterator[Slave]:
    """The slaves one after another, each marked as the one at work."""
    for number, slave in enumerate(slaves):
        mark[1] = number
        yield slave


def _collect(schedule: Schedule, slaves: Sequence[Slave], store: np.ndarray, mark: np.ndarray) -> None:
    for slave, offset, count in zip(_at_work(slaves, mark), schedule.offset, schedule.count):
        if count:
            slave.get()
            store[offset : offset + count] = slave.outputs
