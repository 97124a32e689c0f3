"""The start of a run in Python, the readable reference: instances with their start values, outputs carried to inputs.

`cosim.engine.compiled` does the same in C, with the same bits.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from attrs import frozen

from cosim.engine.reference import marked
from cosim.engine.rounding import kept
from cosim.engine.texts import text_carriers
from cosim.fmu.contract import FmuSettings, Instance
from cosim.wiring import Wiring
from cosim.wiring.schedule import Schedule, seconds
from cosim.wiring.structure import of_structure


def wired(wiring: Wiring, instances: Sequence[Instance]) -> None:
    """Tell every instance the settings of the run and which variables it exchanges."""
    experiment = wiring.scenario.experiment
    for instance in instances:
        tolerance = experiment.tolerance or wiring.descriptions[instance.name].tolerance
        settings = FmuSettings(tolerance, seconds(experiment.steps, experiment.step_ns))
        instance.configure(settings, wiring.conversions(instance.name))
        instance.wire(wiring.inputs(instance.name), wiring.sloped(instance.name), wiring.outputs(instance.name))


def initialise(wiring: Wiring, instances: Sequence[Instance], mark: np.ndarray | None = None) -> np.ndarray:
    """Start every instance and pass outputs on to inputs until nothing changes any more; the store at t = 0, (2n,).

    Inputs are set at least once, and again where they changed. Without algebraic loops this takes at most as many
    rounds as there are components. Raises RunError.
    """
    schedule, mark = wiring.schedule, marked() if mark is None else mark
    wired(wiring, instances)
    with kept():
        store = _started(wiring, instances, schedule, mark)
    store[schedule.outputs :] = store[: schedule.outputs]
    return store


def strangers(wiring: Wiring) -> frozenset[int]:
    """Numbers of the components whose FMUs others have built."""
    return frozenset(k for k, one in enumerate(wiring.scenario.components.values()) if one.fmu or one.own)


def _started(wiring: Wiring, instances: Sequence[Instance], schedule: Schedule, mark: np.ndarray) -> np.ndarray:
    for instance in _at_work(instances, mark):
        instance.slopes[:] = 0.0
        instance.start(wiring.starts[instance.name])
    store = np.zeros(2 * schedule.outputs)
    before = np.full(schedule.outputs, np.nan)
    sources, texts = initial_sources(wiring), text_carriers(wiring, instances)
    for turn in range(len(instances) + 1):
        _collect(schedule, instances, store, mark)
        if np.array_equal(store[: schedule.outputs], before):
            break
        before = store[: schedule.outputs].copy()
        for number, (instance, source) in enumerate(zip(_at_work(instances, mark), sources)):
            inputs = source.values(store)
            if len(inputs) and not (turn and np.array_equal(instance.inputs, inputs)):
                instance.inputs[:] = inputs
                instance.set()
            texts[number]()
    for instance in _at_work(instances, mark):
        instance.begin()
    _collect(schedule, instances, store, mark)
    return store


@frozen
class InitialInputs:
    """Places in the store of a component's inputs; where `scaled`, input = gain value + shift turns the units."""

    places: np.ndarray
    scaled: np.ndarray
    gain: np.ndarray
    shift: np.ndarray

    def values(self, store: np.ndarray) -> np.ndarray:
        """What the inputs are."""
        values = store[self.places]
        return np.where(self.scaled, self.gain * values + self.shift, values) if self.scaled.any() else values


@of_structure
def initial_sources(wiring: Wiring) -> list[InitialInputs]:
    """Where each component's inputs come from at t = 0."""
    place = {name: i for i, name in enumerate(wiring.signals)}
    source = {str(link.target): link for link in wiring.links}
    found = []
    for name in wiring.scenario.components:
        links = [source[f"{name}.{v}"] for v in wiring.inputs(name)]
        places = np.array([place[str(link.source)] for link in links], dtype=np.int64)
        scaled = np.array([link.scaled for link in links], dtype=np.int64)
        gain, shift = (np.array([getattr(link, key) for link in links], dtype=float) for key in ("gain", "shift"))
        found.append(InitialInputs(places, scaled, gain, shift))
    return found


def _at_work(instances: Sequence[Instance], mark: np.ndarray) -> Iterator[Instance]:
    """The instances one after another, each marked as the one at work."""
    for number, instance in enumerate(instances):
        mark[1] = number
        with kept():
            yield instance


def _collect(schedule: Schedule, instances: Sequence[Instance], store: np.ndarray, mark: np.ndarray) -> None:
    for instance, offset, count in zip(_at_work(instances, mark), schedule.offset, schedule.count):
        if count:
            instance.get()
            store[offset : offset + count] = instance.outputs
