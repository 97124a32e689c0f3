"""A scenario as the batch kernel sees it: components, where their outputs lie, what is computed beforehand."""

from __future__ import annotations

import itertools
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from attrs import evolve, field, frozen

from cosim.engine.master import run
from cosim.errors import RunError
from cosim.signals import FmuDescription, stem
from cosim.wiring import Wiring

HELD = {
    "PhantomArm": {
        "q_link": ("q",),
        "dq_link": ("dq",),
        "x_tip": ("x", "x_tip"),
        "dx_tip": ("dx", "dx_tip"),
        "saturated": ("saturated",),
        "f_contact": ("f_contact",),
    },
    "PLikeController": {"f": ("f",), "tau": ("tau",)},
    "VariableDelayChannel": {"y": ("y",), "w": ("w",)},
    "Operator": {"f": ("f",)},
    "Environment": {"f": ("f",)},
    "ArmController": {"f": ("f",), "tau": ("tau",)},
    "PacketChannel": {"y": ("y",)},
    "SerialArm": {
        name: (name,) for name in ("q", "dq", "x", "dx", "x_tip", "dx_tip", "tau_motor", "f_contact", "saturated")
    },
    "PDLikeController": {},
    "PositionForceController": {},
    "FourChannelController": {},
    "WaveController": {},
    "PassivityController": {},
    "TwoLayerController": {},
    "ModelMediatedController": {},
    "AdaptiveController": {},
    "PDController": {},
    "InverseDynamicsController": {},
}
"""Models that the kernel has, which of their vectors its store holds (none: all outputs), and the outputs that have the
same values: an arm without effects measures what is.
"""
ARMS = ("PhantomArm", "SerialArm")
CHANNELS = ("VariableDelayChannel", "PacketChannel")
COURSE = (
    *("law", "knots", "seed", "delay_mean", "delay_min", "delay_max", "delay_period", "delay_phase"),
    *("delay_interval", "delay_step", "loss_to_bad", "loss_to_good", "loss_good", "loss_bad"),
)
"""Parameters of a channel that its delays and losses follow from."""
_SERIES_ALONE = ("Operator",)
"""Models of those whose outputs are computed beforehand where nothing is wired into them."""
_NO_BOUND = 1e300
_REMEMBERED = 64  # series of a feed


@frozen
class LaneComponent:
    """A component: what it is, which of its inputs are wired, start values.

    model: empty for a series, a component that the kernel does not have and whose outputs are computed beforehand;
    inputs: without the delay of a channel, which is known beforehand too; held: vectors that the store holds, with the
    outputs that show them.
    """

    name: str
    model: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    starts: Mapping[str, float | str]
    description: FmuDescription
    held: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(cls, wiring: Wiring, name: str) -> LaneComponent:
        model = wiring.scenario.components[name].model or ""
        inputs = tuple(v for v in wiring.inputs(name) if v != "delay" or model not in CHANNELS)
        known = model if model in HELD and not (model in _SERIES_ALONE and not inputs) else ""
        held = HELD.get(known, {})
        if known == "PhantomArm" and not _felt(wiring, name):
            held = {kind: shown for kind, shown in held.items() if kind != "f_contact"}
        outputs, starts, description = tuple(wiring.outputs(name)), wiring.starts[name], wiring.descriptions[name]
        return cls(name, known, inputs, outputs, starts, description, held)

    def starting(self, wiring: Wiring) -> LaneComponent:
        """The component with the start values of a wiring of the same structure."""
        starts, description = wiring.starts[self.name], wiring.descriptions[self.name]
        if starts is self.starts and description is self.description:
            return self
        return LaneComponent(self.name, self.model, self.inputs, self.outputs, starts, description, self.held)

    @classmethod
    def all(cls, wiring: Wiring) -> tuple[LaneComponent, ...]:
        """The components of a scenario, in its order."""
        return tuple(cls.of(wiring, name) for name in wiring.scenario.components)

    def number(self, name: str) -> float:
        """Start value of a scalar variable."""
        value = self.starts.get(name)
        return float(self.description.variables[name].start or 0.0) if value is None else float(value)

    def choice(self, name: str) -> str:
        """Start value of an enumeration, in words."""
        return self.description.variables[name].item(self.number(name))

    @property
    def packets(self) -> bool:
        """Whether it is a channel of packets, which are dropped, overtaken or lost."""
        return self.model in CHANNELS and self.choice("semantics") != "time_delay"

    @property
    def loses(self) -> bool:
        """Whether it is a channel that may lose samples."""
        return self.number("loss_to_bad") != 0.0 or self.number("loss_good") != 0.0

    def places(self, names: Iterable[str]) -> list[int]:
        """Where variables lie in the struct of the model: their value references in an FMU with room for all joints."""
        if "joints" in self.description.variables:
            known = _references(self.model)
            return [known[name] for name in names]
        return [self.description.variables[name].reference for name in names]

    def elements(self, vectors: Iterable[str]) -> list[str]:
        """The variables of these vectors."""
        return [name for vector in vectors for name in self.description.elements(vector)]

    @property
    def sizes(self) -> list[int]:
        """How many numbers of each of its vectors the kernel's store holds."""
        return [len(self.description.elements(same[0])) for same in self.held.values()]

    @property
    def count(self) -> int:
        """How many numbers of it the kernel's store holds."""
        return sum(self.sizes) if self.held else len(self.outputs)

    @property
    def computed(self) -> list[tuple[str, int]]:
        """Outputs that the kernel has, with their places among what its store holds."""
        if not self.held:
            return [(name, i) for i, name in enumerate(self.outputs)]
        firsts = itertools.accumulate(self.sizes, initial=0)
        places = {
            element: first + i
            for first, same in zip(firsts, self.held.values())
            for output in same
            for i, element in enumerate(self.description.elements(output))
        }
        return [(name, places[name]) for name in self.outputs if name in places]


def _felt(wiring: Wiring, name: str) -> bool:
    """Whether a contact that an arm has of its own is felt by another component."""
    return any(link.source.component == name and stem(link.source.variable) == "f_contact" for link in wiring.links)


@cache
def _references(model: str) -> Mapping[str, int]:
    """Value references of a model of ours by name."""
    from build_fmus.unchanged import unchanged

    def references() -> dict[str, int]:
        from build_fmus.sources import model_table

        return {scalar.name: scalar.reference for scalar in model_table(model).scalars}

    return unchanged("references", model, references)


@frozen
class LanePlaces:
    """Where the kernel's outputs lie in half its store: `first` of each component, how many it has, `number` by signal
    name, `at` by place in the schedule's store (-1: not computed); how many there are.
    """

    first: tuple[int, ...]
    counts: tuple[int, ...]
    number: Mapping[str, int]
    at: np.ndarray = field(eq=False)
    count: int

    @classmethod
    def of(cls, wiring: Wiring, parts: Sequence[LaneComponent]) -> LanePlaces:
        counts = tuple(part.count for part in parts)
        *first, count = itertools.accumulate(counts, initial=0)
        number = {f"{part.name}.{output}": at + i for at, part in zip(first, parts) for output, i in part.computed}
        at = np.array([number.get(name, -1) for name in wiring.signals], dtype=np.int64)
        return cls(tuple(first), counts, number, at, count)


Course = Callable[[Sequence[float], int, int], np.ndarray]
"""Delays (steps + 1, 1) [s], infinite where a sample is lost, from the values of `COURSE`, steps, and nanoseconds of a
step.
"""


class Feed:
    """Signals computed beforehand: an operator's force by the FMU, delays and losses by a channel's law. Each different
    one once; the last of them are remembered.
    """

    def __init__(self, law: Course) -> None:
        self.law: Course = law
        self.known: OrderedDict[tuple[object, ...], Any] = OrderedDict()

    def course(self, wiring: Wiring, part: LaneComponent) -> np.ndarray:
        """Delays of a channel at every communication point, infinite where it loses the sample."""
        experiment = wiring.scenario.experiment
        values = tuple(part.number(name) for name in COURSE)
        key = values, experiment.steps, experiment.step_ns
        return self._known(key, lambda: self.law(*key))

    def values(self, wiring: Wiring, part: LaneComponent, outputs: Sequence[str]) -> np.ndarray:
        """(steps + 1, outputs) values of a component's outputs at every communication point, alone in its own run; one
        row where they never change.
        """
        experiment = wiring.scenario.experiment
        length = (experiment.steps, experiment.step_ns)
        key = (part.description.sha256, tuple(sorted(part.starts.items())), length, tuple(outputs))
        return self._known(key, lambda: _alone(wiring, part, outputs))

    def _known(self, key: tuple[object, ...], found: Callable[[], Any]) -> Any:
        if key not in self.known:
            self.known[key] = found()
        self.known.move_to_end(key)
        while len(self.known) > _REMEMBERED:
            self.known.popitem(last=False)
        return self.known[key]


def _alone(wiring: Wiring, part: LaneComponent, outputs: Sequence[str]) -> np.ndarray:
    component = wiring.scenario.components[part.name]
    alone = evolve(
        wiring.scenario,
        components={part.name: evolve(component, parameters=dict(part.starts), parameter_set=None)},
        connections=(),
        experiment=evolve(wiring.scenario.experiment, record_every=1, order=(), bound=_NO_BOUND),
    )
    result = run(alone, record=[f"{part.name}.{name}" for name in outputs])
    if result.failure is not None:
        raise result.failure
    if result.stopped_at is not None:
        raise RunError(part.name, result.stopped_at, f"ended early when run alone: {result.message}")
    values = np.ascontiguousarray(np.column_stack([result.signals[f"{part.name}.{name}"] for name in outputs]))
    bits = values.view(np.int64)
    return values[:1] if np.all(bits == bits[0]) else values
