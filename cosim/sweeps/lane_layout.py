"""What all calls of the batch kernel on scenarios of one structure have in common, in C's layout."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cosim.engine.master import Timetable
from cosim.engine.native import Arena
from cosim.signals import stem
from cosim.sweeps.lane import ARMS, LaneComponent, LanePlaces
from cosim.sweeps.native_kernel import NativeAct, NativeTurn, NativeWire
from cosim.wiring import Wiring
from cosim.wiring.schedule import GetOutputs, SetInputs, Step
from cosim.wiring.structure import of_structure


class LaneLayout:
    """Components, places, the kept signals, and the two kinds of communication step of a wiring.

    parts: with the start values of the first wiring that had the structure; turns, sources, inputs: addresses.
    """

    def __init__(self, wiring: Wiring, record: Sequence[str]) -> None:
        self.wiring: Wiring = wiring
        self.parts: tuple[LaneComponent, ...] = LaneComponent.all(wiring)
        self.places: LanePlaces = LanePlaces.of(wiring, self.parts)
        self.timetable: Timetable = Timetable.of(wiring, record)
        self.arena: Arena = Arena()
        self.rates: np.ndarray = self._of_arms("dq")
        self.saturated: np.ndarray = self._of_arms("saturated")
        self.inputs: list[int] = [self.arena.indices(part.places(part.inputs)) for part in self.parts]
        self.outputs: list[int] = [
            0 if part.held or not part.model else self.arena.indices(part.places(part.outputs)) for part in self.parts
        ]
        self.turns: int = self.arena.structures((NativeTurn * 2)(self._turn(0), self._turn(1)))
        place = {str(link.target): self.places.number[str(link.source)] for link in wiring.links}
        sources = [[place[f"{part.name}.{v}"] for v in part.inputs] for part in self.parts]
        self.sources: int = self.arena.pointers([self.arena.indices(places) for places in sources])

    def _of_arms(self, kind: str) -> np.ndarray:
        """Places among the schedule's outputs of the joint rates ("dq") or angles ("q") of all arms, or of what the
        kernel knows of their limits ("saturated").
        """
        arms = {part.name for part in self.parts if part.model in ARMS}
        names = (name.partition(".") for name in self.wiring.signals)
        wanted = np.array([head in arms and stem(tail) == kind for head, _, tail in names], dtype=bool)
        return np.flatnonzero(wanted & (self.places.at >= 0))

    def _turn(self, odd: int) -> NativeTurn:
        """The schedule's one phase in the kernel's places, for odd or even steps: each step writes its outputs into the
        half of the store where the values before the newest were, so it needs no operation to get them.
        """
        schedule, n = self.wiring.schedule, self.wiring.schedule.outputs
        half = np.full(n, odd)  # in which the newest value of an output lies
        acts: list[NativeAct] = []

        def lie(places: np.ndarray) -> np.ndarray:
            return self.places.at[places % n] + (half[places % n] + places // n) % 2 * self.places.count

        for o in schedule.phases[0].operations:
            if isinstance(o, GetOutputs):
                half[schedule.offset[o.component] :][: schedule.count[o.component]] = 1 - odd
            elif isinstance(o, SetInputs):
                acts.append(self._wired(o, lie))
            elif isinstance(o, Step):
                acts.append(NativeAct(component=o.component, steps=1))
        row = lie(schedule.phases[0].record.source)
        chosen = (self.timetable.columns, self.rates, self._of_arms("q"), self.saturated)
        array = self.arena.structures((NativeAct * len(acts))(*acts))
        return NativeTurn(array, len(acts), *(self.arena.indices(row[places]) for places in chosen))

    def _wired(self, o: SetInputs, lie: Callable[[np.ndarray], np.ndarray]) -> NativeAct:
        """The wires of a component, held ones first; `lie` gives the kernel's places."""
        part = self.parts[o.component]
        ports = self.wiring.inputs(part.name)
        to, source = dict(zip(part.inputs, part.places(part.inputs))), lie(o.source).tolist()
        lines = dict(zip(o.line.tolist(), zip(lie(o.newer).tolist(), lie(o.older).tolist(), o.span.tolist())))
        known = [(i, to[name]) for i, name in enumerate(ports) if name in to]
        held = _runs([(at, source[i], source[i], source[i], 1.0) for i, at in known if i not in lines])
        wires = [*held, *_runs([(at, source[i], *lines[i]) for i, at in known if i in lines])]
        array = self.arena.structures((NativeWire * len(wires))(*wires))
        return NativeAct(component=o.component, wires=array, n_held=len(held), n_wires=len(wires))


_SingleWire = tuple[int, int, int, int, float]
"""Input, place, newer and older place, span."""


def _runs(wires: Sequence[_SingleWire]) -> list[NativeWire]:
    """Wires whose inputs and places follow one another, put together."""
    found: list[list[_SingleWire]] = []
    for wire in wires:
        if found and wire == (*(place + 1 for place in found[-1][-1][:4]), found[-1][-1][4]):
            found[-1].append(wire)
        else:
            found.append([wire])
    return [NativeWire(len(run), *run[0]) for run in found]


@of_structure
def lane_layout(wiring: Wiring, record: tuple[str, ...]) -> LaneLayout:
    """The layout of a wiring and of all that differ from it in start values only."""
    return LaneLayout(wiring, record)
