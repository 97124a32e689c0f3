"""Evaluators: functions that compute the results of a sweep at given points.

An evaluator takes a task and points and returns one result a point; a sweep's file chooses it by name. `simulation`
runs the batch kernel where that applies and the FMUs elsewhere, and repeats one in two hundred of the kernel's points
with the FMUs. `cosimulation` always runs the FMUs. `spectrum` simulates nothing: it takes the growth rate from the
exact spectrum of the loop, linearised at its start pose. Loaded FMUs are kept for the next points.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from attrs import evolve, frozen

from cosim.analysis.assessment import coupling
from cosim.analysis.criteria import delay_sum
from cosim.analysis.evidence import UNSTABLE, StabilityEvidence, strongest
from cosim.analysis.examination import examine
from cosim.analysis.linear_fmu import channel_bounds
from cosim.analysis.linearisation import linearise
from cosim.analysis.spectrum import abscissa
from cosim.analysis.twin import twin_of, twin_wiring
from cosim.analysis.undelayed import undelayed
from cosim.analysis.verdict import judge
from cosim.engine.master import Result, run
from cosim.engine.outcome import Outcome
from cosim.errors import InputError, RunError
from cosim.fmu import FmuSet, describe, fmu_file, open_system
from cosim.results.summary import tracking
from cosim.scenario import Scenario, load_scenario, to_toml
from cosim.signals import stem
from cosim.sweeps.points import Point, PointResult
from cosim.sweeps.pool import OWN, Task
from cosim.sweeps.spec import EVALUATOR_NAMES, SCENARIO
from cosim.wiring import Wiring
from cosim.wiring.structure import of_structure

if TYPE_CHECKING:
    from cosim.sweeps.kernel import TwinRuns

EVALUATORS: Mapping[str, str] = {name: f"{OWN}:{name}" for name in EVALUATOR_NAMES}
"""Evaluators by the short names that a sweep's file uses."""
Twin = TypeVar("Twin", Scenario, Wiring)
_RECORDED = ("q", "dq", "x", "saturated")
_REPLAY_EVERY = 200
"""One in so many of the kernel's points is run by the FMUs too."""
_SHARP = 0.2
"""Where the tracer of a boundary asks for a rate, a run ends only when half the interval of it is at most this part of
it: what the tracer takes a rate near zero for (see `cosim.sweeps.bracket.zero`)."""


@frozen
class PointSetup:
    """A point of a sweep ready to be evaluated: the wiring of its scenario with its values, and the loaded FMUs.

    any_delay: whether a certificate for every delay law is asked for.
    """

    point: Point
    wiring: Wiring
    system: FmuSet
    any_delay: bool = False

    @property
    def scenario(self) -> Scenario:
        """The scenario with the values of the sweep and of the point."""
        return self.wiring.scenario


def setup(task: Task, point: Point) -> PointSetup:
    """The setup of a point. Raises InputError where its values do not fit the scenario."""
    scenario, system = _at(task, point)
    return PointSetup(point, system.wiring(scenario), system, task.any_delay)


def _at(task: Task, point: Point) -> tuple[Scenario, FmuSet]:
    """The scenario with the values of the sweep and of a point, and the FMUs that it is run with."""
    name = str(dict(point.values).get(SCENARIO, task.scenario))
    system = _loaded(name, task.effects)[1]
    values = {path: value for path, value in point.values if path != SCENARIO}
    try:
        scenario = _fixed(name, task.effects, json.dumps(dict(task.set)))
    except InputError:  # not without the point's own values
        return _loaded(name, task.effects)[0].with_values(dict(task.set) | values), system
    return scenario.with_values(values), system


@lru_cache(maxsize=4)
def _fixed(name: str, effects: str | None, values: str) -> Scenario:
    """A scenario with the values of the sweep, which all its points share. values: JSON, in which tasks are passed."""
    return _loaded(name, effects)[0].with_values(json.loads(values))


@lru_cache(maxsize=4)
def _loaded(name: str, effects: str | None) -> tuple[Scenario, FmuSet]:
    """A scenario as its file has it, and the FMUs that all points of the scenario share."""
    scenario = load_scenario(name, effects=Path(effects) if effects else None)
    return scenario, open_system(scenario)


def check(task: Task, point: Point) -> str:
    """How the points will be run, in words. Raises InputError where `point`, the first, does not fit the scenario.

    What an earlier sweep has loaded is read anew: its files may have changed.
    """
    _loaded.cache_clear()
    _fixed.cache_clear()
    wiring = setup(task, point).wiring
    others = {"cosimulation": "co-simulation of FMUs", "spectrum": "exact spectrum, no simulation"}
    if task.evaluator != EVALUATORS["simulation"]:
        return next((said for name, said in others.items() if task.evaluator == EVALUATORS[name]), task.evaluator)
    reason = _refusal(wiring)
    return (
        "batch kernel (same bits as the co-simulation)"
        if reason is None
        else f"co-simulation of FMUs (kernel: {reason})"
    )


def origin(task: Task, points: Sequence[Point]) -> str:
    """What else decides the results: the text of the scenario at the first point, the SHA-256 of every FMU there, and
    those of the user's own models at the other points, which are built here, once for all workers.
    """
    wiring = setup(task, points[0]).wiring
    own = [
        describe(fmu_file(component, scenario)).sha256
        for scenario, _ in (_at(task, point) for point in points[1:])
        for component in scenario.components.values()
        if component.own
    ]
    return to_toml(wiring.scenario) + " ".join([d.sha256 for d in wiring.descriptions.values()] + own)


def simulation(task: Task, points: Sequence[Point]) -> list[PointResult]:
    """Twin runs by the batch kernel where it applies, by FMUs elsewhere."""
    setups = [setup(task, point) for point in points]
    batches: dict[str, list[int]] = {}
    for k, one in enumerate(setups):
        if _refusal(one.wiring) is None:
            batches.setdefault(_batch_key(one.wiring), []).append(k)
    results: dict[int, PointResult] = {}
    for numbers in batches.values():
        results |= zip(numbers, _by_kernel([setups[k] for k in numbers], task))
    return [results[k] if k in results else _by_fmus(one) for k, one in enumerate(setups)]


def cosimulation(task: Task, points: Sequence[Point]) -> list[PointResult]:
    """Twin runs of FMUs."""
    return [_by_fmus(setup(task, point)) for point in points]


def spectrum(task: Task, points: Sequence[Point]) -> list[PointResult]:
    """Exact growth rate of the loop, linearised at the start pose with the mean delays of its channels.

    Raises RunError where an FMU keeps more than its linear equations tell.
    """
    results = []
    for one in (setup(task, point) for point in points):
        loop = linearise(one.scenario, one.system)
        for name, why in loop.unseen.items():
            raise RunError(name, None, f"no spectrum: it {why}; use the evaluator 'simulation'")
        rate = abscissa(loop.system())
        outcome = Outcome.CONVERGED if rate < 0.0 else Outcome.GROWING
        results.append(PointResult(outcome.value, rate, rate, rate, _evidence(one, None, rate).value))
    return results


# --- twin runs --------------------------------------------------------------------------------------------------------


def _batch_key(wiring: Wiring) -> str:
    """What the scenarios of one call of the kernel have in common: components, connections, experiment, signals."""
    scenario = wiring.scenario
    components = [(n, c.kind) for n, c in scenario.components.items()]
    return repr((scenario.name, components, scenario.experiment, _limited(wiring), _connected(wiring)))


@of_structure
def _connected(wiring: Wiring) -> int:
    """A number of the connections, element by element: arms of other numbers of joints have others."""
    return hash(wiring.links)


def _refusal(wiring: Wiring) -> str | None:
    """Why the batch kernel does not apply; None where it does."""
    try:
        from cosim.sweeps.lane_refusal import lane_refusal
    except ImportError as error:
        return str(error)
    return lane_refusal(wiring, _signals(wiring))


def _signals(wiring: Wiring) -> list[str]:
    """The signals that the verdict and the tracking error are computed from."""
    return _signals_of(wiring, _limited(wiring))


def _limited(wiring: Wiring) -> tuple[str, ...]:
    """The arms whose motors have limits."""
    starts = ((name, value) for name, given in wiring.starts.items() for value in given.items())
    return tuple(dict.fromkeys(name for name, (v, x) in starts if stem(v) == "torque_saturation" and x != 0.0))


@of_structure
def _signals_of(wiring: Wiring, limited: tuple[str, ...]) -> list[str]:
    def counts(name: str) -> bool:
        component, _, variable = name.partition(".")
        if stem(name) == "operator.f":
            return True
        told = stem(variable) in _RECORDED and (variable != "saturated" or component in limited)
        return told and wiring.descriptions[component].integrates

    return list(dict.fromkeys(stem(name) for name in wiring.signals if counts(name)))


def _by_kernel(setups: Sequence[PointSetup], task: Task) -> list[PointResult]:
    """Results of points whose scenarios the batch kernel runs together; see `Sweep.sign_level`.

    Raises RunError with the words of an FMU that refuses its start values.
    """
    from cosim.sweeps.kernel import run_pairs

    pairs = [(one.wiring, _with(twin_wiring, one.wiring)) for one in setups]
    parts = [_SHARP if task.traced and not one.point.sign_alone else np.inf for one in setups]
    runs = run_pairs(pairs, _signals(pairs[0][0]), task.sign_level, parts)
    return [
        _by_fmus(one) if found.refused else _replayed(one, found, _found(one, found))
        for one, found in zip(setups, runs)
    ]


def _with(twin_of: Callable[[Wiring], Twin | None], wiring: Wiring) -> Twin:
    """The twin of a run. Raises RunError where no arm has a start that could be moved."""
    twin = twin_of(wiring)
    if twin is None:
        raise RunError(wiring.scenario.name, None, "no arm whose start could be moved: no growth rate")
    return twin


def _replayed(one: PointSetup, runs: "TwinRuns", found: PointResult) -> PointResult:
    """What was found by the kernel; at points drawn for it, beside the largest relative difference to a run of the
    FMUs.
    """
    if not drawn(one.point):
        return found
    again = run(_as_far(one.scenario, runs), one.system, record=list(runs.result.signals))
    apart = difference(runs.result, again, runs.growth is not None)
    return evolve(found, numbers={**found.numbers, "kernel_difference": apart})


def _as_far(scenario: Scenario, runs: "TwinRuns") -> Scenario:
    """The scenario, or where the run ended because its sign was known only so much of it."""
    if runs.growth is None:
        return scenario
    return scenario.with_values({"experiment.stop": float(runs.result.time[-1])})


def drawn(point: Point) -> bool:
    """Whether a point that the kernel ran is run by the FMUs too.

    One in `_REPLAY_EVERY` is. The hash of the point decides, so the choice is random but the same in every process.
    """
    return int(point.key[:8], 16) % _REPLAY_EVERY == 0


def difference(result: Result, other: Result, decided: bool = False) -> float:
    """Largest difference between the signals of two runs, each relative to the largest value of its signal.

    Infinite for runs that ended differently. decided: the first one ended because its sign was known, and is compared
    as far as it went.
    """
    count = len(result.time)
    if count > len(other.time) or (not decided and (count < len(other.time) or result.outcome is not other.outcome)):
        return math.inf
    return max(
        float(np.abs(values - other.signals[name][:count]).max() / max(np.abs(values).max(), 1e-300))
        for name, values in result.signals.items()
    )


def _by_fmus(one: PointSetup) -> PointResult:
    """The result of a point by co-simulation. Raises RunError where an FMU fails."""
    wiring = one.wiring
    record = [
        n for n in dict.fromkeys(map(stem, wiring.signals)) if n.partition(".")[2] in _RECORDED or n == "operator.f"
    ]
    runs = [run(scenario, one.system, record=record) for scenario in (one.scenario, _with(twin_of, wiring))]
    for result in runs:
        if result.failure is not None:
            raise result.failure
    return _judged(one, *runs)


def _found(one: PointSetup, runs: "TwinRuns") -> PointResult:
    """The result of a point that the kernel ran."""
    if runs.growth is None:
        return _judged(one, runs.result, runs.twin)
    outcome = Outcome.GROWING if runs.growth[0] > 0.0 else Outcome.CONVERGED
    return _point_result(one, runs.result, outcome, runs.growth)


def _judged(one: PointSetup, result: Result, twin: Result) -> PointResult:
    """The verdict on a run and its twin."""
    verdict = judge(result, twin)
    return _point_result(one, result, verdict.outcome, (verdict.growth_rate, *verdict.interval))


def _point_result(one: PointSetup, result: Result, outcome: Outcome, growth: tuple[float, float, float]) -> PointResult:
    """A verdict with the evidence for it, and the tracking error. growth: rate [1/s] with its interval."""
    apart = tracking(result)
    numbers = {"tracking_rmse": apart.total} if apart else {}
    numbers["simulated_time"] = float(result.time[-1])
    evidence = _evidence(one, outcome)
    return PointResult(outcome.value, *growth, evidence.value, numbers, result.message)


# --- evidence ---------------------------------------------------------------------------------------------------------


def _evidence(one: PointSetup, outcome: Outcome | None, rate: float | None = None) -> StabilityEvidence:
    """The strongest evidence for a point. Expensive conditions are evaluated only where cheap ones do not decide.

    outcome: of the simulation (None: not simulated); rate: the abscissa [1/s] where it is known already.
    """
    if outcome in UNSTABLE:
        return StabilityEvidence.FALSIFIED
    wiring = one.wiring
    channels = channel_bounds(wiring)
    if len(channels) != 2 or wiring.scenario.arms is None:
        return strongest(outcome)
    longest, constant = [bounds[2] for bounds in channels.values()], all(bounds[3] for bounds in channels.values())
    loop = undelayed(wiring, partial(examine, wiring, one.system))
    found = loop.coupling
    if found.pair and not found.broken and delay_sum(coupling(found.pair), *longest).holds:
        return StabilityEvidence.ANY_MASS
    if loop.loop.unseen:
        return strongest(outcome)
    if loop.bears(max(longest)):
        return StabilityEvidence.KNOWN_MASS
    if one.any_delay and _certified(one, max(longest)):
        return StabilityEvidence.ANY_LAW
    if constant and rate is None:
        rate = abscissa(loop.at(wiring).system())
    return strongest(outcome, abscissa=rate, constant=constant)


def _certified(one: PointSetup, longest: float) -> bool:
    """Whether no delay law up to `longest` [s] destroys the loop of a point at rest, by a certificate."""
    from cosim.analysis.delay_verdict import holds_for_every_law

    return bool(np.isfinite(longest)) and holds_for_every_law(one.scenario, one.system, longest)
