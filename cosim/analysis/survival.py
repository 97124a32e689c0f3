"""Which delay two equal arms and their controllers bear at several poses, by which evidence, and which gains bear more.

Every bound is a delay each way [s] up to which a statement holds: the sum condition for every law and mass, small gain
for every law near the pose, the exact spectrum for constant delays near the pose. At the pose that bears least the
FMUs are run with delays below and above the spectrum's, and every gain in use is changed to see what it does.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from attrs import field, frozen

from cosim.analysis.assessment import boundary, theory
from cosim.analysis.coupling import coupled
from cosim.analysis.delay_verdict import AnyDelay, any_delay
from cosim.analysis.examination import examine
from cosim.analysis.linear_fmu import channel_bounds, steady_channel
from cosim.analysis.linearisation import linear_loop
from cosim.analysis.twin import judged_run
from cosim.engine.isolation import called, runner
from cosim.fmu import FmuSet
from cosim.results.summary import number
from cosim.scenario import Scenario
from cosim.wiring import Wiring

REPLAYED = (0.9, 1.1)
"""Constant delays of the replays, as parts of the spectrum's boundary: as near as a run of seconds can tell."""
CHANGE = 1.25
"""A gain is raised by this factor, or lowered by it, to see what it does."""
Say = Callable[[str], None]


@frozen
class BorneDelays:
    """Delays each way [s] up to which a statement holds at a pose; None where it cannot be made, `withheld` says why.

    any_mass: every law, every mass (sum condition); any_law: every law (small gain); constant: constant delays (exact
    spectrum), infinite where none is too long.
    """

    pose: tuple[float, ...]
    any_mass: float | None
    any_law: float | None
    constant: float | None
    withheld: Mapping[str, str] = field(factory=dict)

    @property
    def every_law(self) -> float | None:
        """The larger of the two bounds that hold for every delay law."""
        return max((b for b in (self.any_mass, self.any_law) if b is not None), default=None)


@frozen
class DelayReplay:
    """The FMUs run with a constant delay each way [s]: outcome and growth rate [1/s] of small disturbances."""

    delay: float
    expected: str
    outcome: str
    growth_rate: float | None
    interval: tuple[float, float] | None

    @property
    def agrees(self) -> bool | None:
        """Whether the run did what the spectrum says; None where its interval holds zero."""
        if self.interval is None or self.interval[0] <= 0.0 <= self.interval[1]:
            return None
        return (self.interval[0] > 0.0) == (self.expected == "grows")


@frozen
class GainChange:
    """A gain of all controllers that have it, multiplied by `factor`, and what is borne then."""

    gain: str
    factor: float
    borne: BorneDelays


@frozen
class Survival:
    """What was found: bounds by pose, and at the pose that bears least the replays, what gains do and, where it was
    asked, the two-sided verdict on every delay law.
    """

    scenario: str
    borne: tuple[BorneDelays, ...]
    worst: int
    replays: tuple[DelayReplay, ...]
    gains: tuple[GainChange, ...]
    any_delay: AnyDelay | None = None

    @property
    def least(self) -> BorneDelays:
        """The bounds at the pose that bears least."""
        return self.borne[self.worst]

    def better(self, bound: str) -> list[GainChange]:
        """Changes under which more is borne by `any_mass` or `constant`, best first."""
        before = getattr(self.least, bound)
        found = [g for g in self.gains if _longer(getattr(g.borne, bound), before)]
        return sorted(found, key=lambda g: -getattr(g.borne, bound))


def _longer(after: float | None, before: float | None) -> bool:
    """Whether a bound is larger by more than differences of derivatives err."""
    return after is not None and before is not None and after > before * (1.0 + 1e-4)


def survival(posed: Sequence[Scenario], system: FmuSet, say: Say, every_law: bool = False) -> Survival:
    """The study of a scenario of two arms, given at each pose; every_law: with certificate and destroying law at the
    pose that bears least. Raises InputError, RunError.
    """
    borne = []
    for k, scenario in enumerate(posed):
        say(f"pose {k + 1} of {len(posed)}")
        borne.append(_borne(scenario, system))
    worst = min(range(len(borne)), key=lambda k: _size(borne[k]))
    there = posed[worst]
    return Survival(
        there.name,
        tuple(borne),
        worst,
        tuple(_replays(there, system, borne[worst], say)),
        tuple(_gain_changes(there, system, borne[worst], say)),
        any_delay(there, system, borne[worst].constant, say) if every_law else None,
    )


def _size(one: BorneDelays) -> float:
    """What poses are compared by: the spectrum's bound, else that for every law."""
    first = one.constant if one.constant is not None else one.every_law
    return np.inf if first is None else first


def _borne(scenario: Scenario, system: FmuSet) -> BorneDelays:
    doing = "the loop was linearised"
    return called(partial(_looked_at, scenario, system), BorneDelays, scenario, system, doing)


def _looked_at(scenario: Scenario, system: FmuSet, mark: np.ndarray | None) -> BorneDelays:
    found = examine(system.wiring(scenario), system, mark)
    loop = linear_loop(found.wiring, found.fmus)
    said = theory(found.wiring, loop, coupled(found))
    limit = boundary(loop)
    return BorneDelays(
        said.pose,
        said.delay_sum.max_delay if said.delay_sum else None,
        said.law_bound,
        None if "spectrum" in said.withheld else limit,
        said.withheld,
    )


# --- replay -----------------------------------------------------------------------------------------------------------


def _replays(scenario: Scenario, system: FmuSet, least: BorneDelays, say: Say) -> list[DelayReplay]:
    """Runs with delays around the spectrum's bound; none where there is no bound."""
    if least.constant is None or not np.isfinite(least.constant) or least.constant <= 0.0:
        return []
    found = []
    for part in REPLAYED:
        delay = part * least.constant
        say(f"replay with {1e3 * delay:.4g} ms each way")
        judged = judged_run(_delayed(scenario, system, delay), system, simulate=runner(scenario))
        interval = None if judged.interval is None else (judged.interval[0], judged.interval[1])
        expected = "grows" if part > 1.0 else "dies out"
        found.append(DelayReplay(delay, expected, judged.outcome.value, number(judged.growth_rate), interval))
    return found


def _delayed(scenario: Scenario, system: FmuSet, delay: float) -> Scenario:
    """The scenario with a constant delay in all channels, and no loss."""
    values: dict[str, object] = {}
    for name in channel_bounds(system.wiring(scenario)):
        values |= steady_channel(name, delay)
    return scenario.with_values(values)


# --- gains ------------------------------------------------------------------------------------------------------------


def gains_of(wiring: Wiring) -> dict[str, list[str]]:
    """{gain: paths}: tunable start values that are not zero of the components which drive an arm and feel it."""
    arms, found = set(wiring.scenario.arms or ()), dict[str, list[str]]()
    driven = {link.source.component for link in wiring.links if link.target.component in arms}
    felt = {link.target.component for link in wiring.links if link.source.component in arms}
    for name in sorted((driven & felt) - arms):
        description = wiring.descriptions[name]
        for key in description.names("parameter"):
            variable = description.variables[key]
            if variable.tunable and not variable.items and wiring.start(name, key) != 0.0:
                found.setdefault(key, []).append(f"{name}.{key}")
    return found


def _gain_changes(scenario: Scenario, system: FmuSet, least: BorneDelays, say: Say) -> list[GainChange]:
    """Every gain raised; where that bears less, lowered. Gains that change no bound are left out."""
    wiring, found = system.wiring(scenario), []
    for gain, paths in gains_of(wiring).items():
        for factor in (CHANGE, 1.0 / CHANGE):
            say(f"{gain} times {factor:g}")
            starts = {path: wiring.start(*path.split(".", 1)) for path in paths}
            changed = scenario.with_values({path: factor * value for path, value in starts.items()})
            borne = _borne(changed, system)
            bounds = [(getattr(borne, b), getattr(least, b)) for b in ("any_mass", "any_law", "constant")]
            if all(not _longer(a, b) and not _longer(b, a) for a, b in bounds):
                break
            if any(_longer(a, b) for a, b in bounds):
                found.append(GainChange(gain, factor, borne))
    return found


def survival_document(found: Survival) -> dict[str, object]:
    """The study as plain data: `survives` of robot.json. An infinite bound is null with `unbounded` true."""
    return {
        "scenario": found.scenario,
        "every_law": number(found.least.every_law),
        "constant": _bound(found.least.constant),
        "poses": [_borne_document(one) for one in found.borne],
        "worst_pose": found.worst,
        "replays": [
            {
                "delay": r.delay,
                "expected": r.expected,
                "outcome": r.outcome,
                "growth_rate": r.growth_rate,
                "interval": None if r.interval is None else list(r.interval),
                "agrees": r.agrees,
            }
            for r in found.replays
        ],
        "gains": [{"gain": g.gain, "factor": g.factor, **_borne_document(g.borne)} for g in found.gains],
        "any_delay": None if found.any_delay is None else found.any_delay.to_dict(),
    }


def _borne_document(one: BorneDelays) -> dict[str, object]:
    return {
        "pose": list(one.pose),
        "any_mass": _bound(one.any_mass),
        "any_law": _bound(one.any_law),
        "constant": _bound(one.constant),
        "withheld": dict(one.withheld),
    }


def _bound(value: float | None) -> dict[str, object]:
    return {"max_delay": number(value), "unbounded": value is not None and not np.isfinite(value)}
