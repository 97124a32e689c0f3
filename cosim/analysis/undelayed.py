"""What is known of a loop whatever the delays of its channels, found once for points of a sweep that differ in them."""

from collections.abc import Callable, Mapping
from functools import cached_property

from attrs import evolve, frozen

from cosim.analysis.coupling import Coupled, coupled
from cosim.analysis.examination import Examined
from cosim.analysis.linear_fmu import LinearFmu, channel_bounds, is_channel
from cosim.analysis.linearisation import LinearLoop, linear_loop
from cosim.analysis.robust import SAMPLES, delay_law_bound, quick_limit
from cosim.wiring import Wiring

_MOST = 512  # loops that are remembered
_LOOKS = 40
"""Frequencies at which a loop is looked at before its bound is found, which takes many times longer."""


@frozen(eq=False, slots=False)
class UndelayedLoop:
    """How the arms of a loop are coupled, and from its FMUs' equations its linear loop and how long any delays may be.

    wiring: one of those that differ in the parameters of channels only.
    """

    coupling: Coupled
    wiring: Wiring
    fmus: Mapping[str, LinearFmu]

    def bears(self, longest: float) -> bool:
        """Whether it is stable for every delay law that stays below `longest` [s], by `delay_law_bound`."""
        return longest < self._quick and longest < self._closer and longest < self._bound

    def at(self, wiring: Wiring) -> LinearLoop:
        """The linear loop with the delays of a wiring that differs in the parameters of channels only."""
        bounds = channel_bounds(wiring)
        used = {name: bounds[name] for name in self.loop.channels}
        constant = all(one[3] for one in used.values())
        return evolve(self.loop, channels={n: b[:3] for n, b in used.items()}, constant=constant)

    @cached_property
    def loop(self) -> LinearLoop:
        """The linear loop, with the delays of `wiring`."""
        return linear_loop(self.wiring, self.fmus)

    @cached_property
    def _quick(self) -> float:
        family = self.loop.family()
        return quick_limit(family) if family else 0.0

    @cached_property
    def _closer(self) -> float:
        family = self.loop.family()
        return quick_limit(family, SAMPLES // _LOOKS) if family else 0.0

    @cached_property
    def _bound(self) -> float:
        family = self.loop.family()
        return delay_law_bound(family) if family else 0.0


def undelayed(wiring: Wiring, look: Callable[[], Examined]) -> UndelayedLoop:
    """The loop of a wiring, remembered for those that differ in the parameters of our channels only: until the first
    sample arrives a channel shows what goes in, however long it delays.

    look: examines the wiring's FMUs; called where nothing is remembered.
    """
    key = _but_delays(wiring)
    if key not in _KNOWN:
        if len(_KNOWN) >= _MOST:
            _KNOWN.clear()
        found = look()
        _KNOWN[key] = UndelayedLoop(coupled(found), found.wiring, found.fmus)
    return _KNOWN[key]


_KNOWN: dict[tuple[object, ...], UndelayedLoop] = {}


def _but_delays(wiring: Wiring) -> tuple[object, ...]:
    """What decides a loop of FMUs but for the parameters of our channels."""
    scenario, parts = wiring.scenario, []
    for name, description in wiring.descriptions.items():
        component = scenario.components[name]
        ours = component.model is not None and not component.own and is_channel(description)
        starts = () if ours else tuple(sorted(wiring.starts[name].items()))
        parts.append((name, description.sha256, component.step_multiple, starts))
    return tuple(parts), scenario.connections, wiring.hops, scenario.experiment.step_ns, scenario.arms
