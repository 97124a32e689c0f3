"""The loop of a scenario, linearised by its own FMUs at a pose: x' = sum over paths of A x(t - age - channel delays).

Every FMU gives its A, B, C, D by directional derivatives after initialisation at the pose. Outputs that act at once
(a controller's force) are followed back to states; on the way each connection adds the age that the master gives it
(`Hop.age`) and each channel its delay. A loop whose own-position and damping paths cross FMUs carries those ages too:
to first order an age d of the own position takes K d off the damping (-K x(t - d) = -K x + K d dx), one of the
velocity B d off the mass; at the crossing frequency w the two together act as B - m w^2 d. So the boundary moves by
more than the age of the received sample; the spectrum with the age of every path predicts it.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from attrs import evolve, field, frozen

from cosim.analysis.examination import examine
from cosim.analysis.linear_fmu import LinearFmu, channel_bounds
from cosim.analysis.spectrum import DelayFamily, DelaySystem
from cosim.engine.master import System
from cosim.errors import InputError, Problem
from cosim.scenario import Scenario, joints_of
from cosim.wiring import Link, Wiring
from cosim.wiring.structure import of_structure


@frozen
class Way:
    """How a state reaches a derivative: age added by the co-simulation [s] and the channels passed."""

    age: float
    channels: tuple[str, ...]


@frozen
class LinearLoop:
    """The linearised loop: names of the states kept, and one matrix (n, n) for every way; delays of the channels [s].

    `channels` maps each channel to its bounds (least, mean, greatest) [s]; `constant` says whether all delays are
    constant.
    """

    states: tuple[str, ...]
    terms: Mapping[Way, np.ndarray] = field(eq=False)
    channels: Mapping[str, tuple[float, float, float]]
    constant: bool
    fmus: Mapping[str, LinearFmu] = field(eq=False, repr=False)

    def system(self) -> DelaySystem:
        """The loop at the mean delays of its channels."""
        delays = [max(way.age + sum(self.channels[c][1] for c in way.channels), 0.0) for way in self.terms]
        return DelaySystem(list(self.terms.values()), delays)

    def family(self) -> DelayFamily | None:
        """The loop with one free delay for all channels; None where it has no channel or a way passes two."""
        if not self.channels or any(len(way.channels) > 1 for way in self.terms):
            return None
        size = len(self.states)
        parts = []
        for count in (0, 1):
            chosen = [(matrix, max(way.age, 0.0)) for way, matrix in self.terms.items() if len(way.channels) == count]
            matrices, ages = zip(*chosen) if chosen else ((np.zeros((size, size)),), (0.0,))
            parts.append(DelaySystem(matrices, ages))
        return DelayFamily(*parts)

    @property
    def unseen(self) -> dict[str, str]:
        """Components that the matrices do not tell completely, and what they miss; empty for a complete loop."""
        return {name: fmu.why for name, fmu in self.fmus.items() if fmu.why}

    @property
    def delays(self) -> tuple[float, float]:
        """Mean delays of the first two channels [s] (local to remote, remote to local); zeros where there are none."""
        means = [bounds[1] for bounds in self.channels.values()] + [0.0, 0.0]
        return means[0], means[1]

    @property
    def longest(self) -> tuple[float, float]:
        """Greatest delays of the first two channels [s]."""
        bounds = [b[2] for b in self.channels.values()] + [0.0, 0.0]
        return bounds[0], bounds[1]


def at_pose(scenario: Scenario, pose: Sequence[float] | None) -> Scenario:
    """The scenario with both arms starting at rest at the pose (n,) [rad]; unchanged without one.

    Raises InputError where an arm has another number of joints.
    """
    if pose is None:
        return scenario
    arms = scenario.arms or ()
    wrong = [
        Problem(f"pose of {arm}", f"{joints} angles", str(len(pose)))
        for arm in arms
        if (joints := joints_of(scenario.components[arm]) or (3 if scenario.components[arm].model else None))
        not in (None, len(pose))
    ]
    if wrong:
        raise InputError(wrong)
    values = {f"{arm}.q_start[{k + 1}]": float(q) for arm in arms for k, q in enumerate(pose)}
    return scenario.with_values(values | {f"{arm}.dq_start": 0.0 for arm in arms})


def linearise(scenario: Scenario, system: System, mark: np.ndarray | None = None) -> LinearLoop:
    """Linearise the loop at the start pose of the scenario, on loaded FMUs. Raises RunError, InputError.

    mark: where it says which FMU is at work (see cosim.engine.reference.marked).
    """
    found = examine(system.wiring(scenario), system, mark)
    return linear_loop(found.wiring, found.fmus)


def linear_loop(wiring: Wiring, fmus: Mapping[str, LinearFmu]) -> LinearLoop:
    """The loop of examined FMUs. Raises InputError where there is none."""
    channels, scenario = channel_bounds(wiring), wiring.scenario
    states = tuple(f"{name}.{state}" for name, fmu in fmus.items() for state in fmu.states)
    if not states:
        raise InputError(Problem(scenario.name, "an FMU with states, to linearise", "none"))
    paths = _Paths(wiring, fmus, states, set(channels))
    terms = paths.derivatives()
    fmus = {name: evolve(fmu, why=fmu.why or _ECHO) if name in paths.echoing else fmu for name, fmu in fmus.items()}
    kept = _relevant(states, terms)
    if not kept:
        raise InputError(
            Problem(
                scenario.name,
                "states whose FMUs act on each other in a loop",
                "none",
                "connect the arms through a controller",
            )
        )
    terms = {way: matrix[np.ix_(kept, kept)] for way, matrix in terms.items()}
    terms = {way: matrix for way, matrix in terms.items() if np.any(matrix) or way == Way(0.0, ())}
    used = {c for way in terms for c in way.channels}
    return LinearLoop(
        tuple(states[k] for k in kept),
        terms,
        {n: b[:3] for n, b in channels.items() if n in used},
        all(channels[n][3] for n in used),
        fmus,
    )


_ECHO = "passes on at once what comes back to it over the channels: not a retarded loop"
_ROUNDING = 1e-12
"""Share of the largest derivative of an output or state below which one is the rounding of a difference quotient."""


_Row = dict[int, float]
"""Weights by the places of states."""


class _Paths:
    """Follows signals back to states: each is a sum over ways of a row over the states of the system, most of which it
    does not hold: {place: weight}, which Python adds up in a tenth of the time that short arrays take.

    echoing: components with an output that comes back to itself without passing a state, as an unmatched wave does. It
    is followed once only.
    """

    def __init__(
        self, wiring: Wiring, fmus: Mapping[str, LinearFmu], states: Sequence[str], channels: set[str]
    ) -> None:
        place = {s: k for k, s in enumerate(states)}
        self.fmus, self.size = fmus, len(states)
        self.places = {name: [place[f"{name}.{state}"] for state in fmu.states] for name, fmu in fmus.items()}
        self.channels = channels
        self.sources = _sources(wiring)
        self.known: dict[tuple[str, str], dict[Way, _Row]] = {}
        self.followed: list[tuple[str, str]] = []
        self.echoing: set[str] = set()

    def derivatives(self) -> dict[Way, np.ndarray]:
        """One matrix (n, n) for every way."""
        total: dict[Way, np.ndarray] = {Way(0.0, ()): np.zeros((self.size, self.size))}
        for name, fmu in self.fmus.items():
            changing = np.any(fmu.a, axis=1) | np.any(fmu.b, axis=1)
            rows = np.flatnonzero(changing).tolist()
            for row, by_state, by_input in zip(rows, fmu.a[changing].tolist(), fmu.b[changing].tolist()):
                k = self.places[name][row]
                for way, weights in self._sum(name, by_state, by_input).items():
                    matrix = total.setdefault(way, np.zeros((self.size, self.size)))
                    for place, weight in weights.items():
                        matrix[k, place] += weight
        return total

    def _sum(self, name: str, by_state: list[float], by_input: list[float]) -> dict[Way, _Row]:
        total: dict[Way, _Row] = {}
        _add(total, Way(0.0, ()), 1.0, dict(zip(self.places[name], by_state)))
        least = _ROUNDING * max(map(abs, (*by_state, *by_input)), default=0.0)
        for variable, weight in zip(self.fmus[name].inputs, by_input):
            if abs(weight) > least:
                for way, row in self._input(name, variable).items():
                    _add(total, way, weight, row)
        return total

    def _input(self, name: str, variable: str) -> dict[Way, _Row]:
        if (name, variable) not in self.known:
            component, output, age, gain = self.sources[f"{name}.{variable}"]
            self.known[name, variable] = {
                Way(round(way.age + age, 12), way.channels): {place: gain * weight for place, weight in row.items()}
                for way, row in self._output(component, output).items()
            }
        return self.known[name, variable]

    def _output(self, name: str, variable: str) -> dict[Way, _Row]:
        if (name, variable) in self.followed:
            self.echoing |= {n for n, _ in self.followed[self.followed.index((name, variable)) :]} - self.channels
            return {}
        fmu = self.fmus[name]
        k = fmu.outputs.index(variable)
        through = (name,) if name in self.channels else ()
        self.followed.append((name, variable))
        found = self._sum(name, fmu.c[k].tolist(), fmu.d[k].tolist())
        self.followed.pop()
        return {Way(way.age, way.channels + through): row for way, row in found.items()}


def _add(total: dict[Way, _Row], way: Way, factor: float, row: _Row) -> None:
    """Add a row times a factor, where that is anything."""
    added = {place: value for place, weight in row.items() if (value := factor * weight) != 0.0}
    if added:
        known = total.setdefault(way, {})
        for place, value in added.items():
            known[place] = known.get(place, 0.0) + value


@of_structure
def _sources(wiring: Wiring) -> dict[str, tuple[str, str, float, float]]:
    """By input the component and the output that it comes from, the age that it then has [s], and its factor."""
    age = {str(hop.connection): hop.age for hop in wiring.hops}
    return {
        str(link.target): (link.source.component, link.source.variable, age_of(link, wiring, age), link.gain)
        for link in wiring.links
    }


def age_of(link: Link, wiring: Wiring, ages: Mapping[str, float]) -> float:
    """Age of the connection that the link is part of [s]."""
    for connection in wiring.scenario.connections:
        ends = (connection.source, link.source), (connection.target, link.target)
        if any(a.component != b.component for a, b in ends):
            continue
        if all(b.variable in wiring.descriptions[a.component].elements(a.variable) for a, b in ends):
            return ages[str(connection)]
    return 0.0


def _relevant(states: Sequence[str], terms: Mapping[Way, np.ndarray]) -> list[int]:
    """States that change and that act on something: effects that are absent leave states that do neither."""
    total = np.asarray(sum(np.abs(matrix) for matrix in terms.values()))
    kept = list(range(len(states)))
    while True:
        part = total[np.ix_(kept, kept)]
        off = part - np.diag(np.diag(part))
        useful = [k for n, k in enumerate(kept) if part[n].any() and (off[:, n].any() or _is_arm_state(states[k]))]
        if useful == kept:
            return kept
        kept = useful


def _is_arm_state(name: str) -> bool:
    return name.partition(".")[2].partition("[")[0] in ("q", "dq", "q_link", "dq_link")
