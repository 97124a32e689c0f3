"""Evaluators: what is found at points of a sweep. Each is a function of (task, points), exchangeable by name in the
sweep's file.

`simulation` runs the batch kernel where it applies, and FMUs elsewhere, and at one in two hundred of the kernel's
points
too; `cosimulation` always runs FMUs; `spectrum`
takes the growth rate from the exact spectrum of the loop linearised at its start pose (no simulation). Loaded FMUs
stay for the next points.
"""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from attrs import evolve, frozen

from cosim.analysis.assessment import complete, coupling, sides
from cosim.analysis.criteria import delay_sum
from cosim.analysis.evidence import UNSTABLE, StabilityEvidence, strongest
from cosim.analysis.linearisation import channel_bounds, linearise
from cosim.analysis.robust import delay_law_bound, quick_limit
from cosim.analysis.spectrum import abscissa
from cosim.analysis.twin import twin_of
from cosim.analysis.verdict import GrowthVerdict, judge
from cosim.engine.master import Result, run
from cosim.engine.outcome import Outcome
from cosim.errors import RunError
from cosim.fmu import FmuSet, open_system
from cosim.results.summary import tracking
from cosim.scenario import Scenario, load_scenario, to_toml, with_parameters
from cosim.signals import stem
from cosim.sweeps.points import Point, PointResult
from cosim.sweeps.pool import Task
from cosim.sweeps.spec import SCENARIO
from cosim.wiring import Wiring

EVALUATORS: Mapping[str, str] = {
    name: f"cosim.sweeps.evaluate:{name}" for name in ("simulation", "cosimulation", "spectrum")
}
"""Evaluators by the short names of a sweep's file."""
_RECORDED = ("q", "dq", "x", "saturated")
_REPLAY_EVERY = 200
"""One in so many of the kernel's points is run by the FMUs too."""


@frozen
class _LoadedScenario:
    """A scenario and its loaded FMUs."""

    scenario: Scenario
    system: FmuSet

    def wiring(self, task: Task, point: Point) -> Wiring:
        """The checked wiring of the scenario at a point."""
        values = {path: value for path, value in point.values if path != SCENARIO}
        return self.system.wiring(with_parameters(self.scenario, dict(task.set) | values))


def loaded(task: Task, point: Point) -> _LoadedScenario:
    """The loaded FMUs of the scenario that the point belongs to."""
    return _loaded(dict(point.values).get(SCENARIO, task.scenario), task.effects)


@lru_cache(maxsize=4)
def _loaded(scenario: str, effects: str | None) -> _LoadedScenario:
    chosen = load_scenario(scenario, effects=Path(effects) if effects else None)
    return _LoadedScenario(chosen, open_system(chosen))


def check(task: Task, point: Point) -> str:
    """How the points will be run, in words; raises InputError where the first point does not fit the scenario."""
    wiring = loaded(task, point).wiring(task, point)
    if not task.evaluator.endswith(":simulation"):
        return {"cosimulation": "co-simulation of FMUs", "spectrum": "exact spectrum, no simulation"}.get(
            task.evaluator.partition(":")[2], task.evaluator
        )
    reason = _refusal(wiring)
    return (
        "batch kernel (same bits as the co-simulation)"
        if reason is None
        else f"co-simulation of FMUs (kernel: {reason})"
    )


def origin(task: Task, point: Point) -> str:
    """What findings come from besides the task: the text of the scenario at a point and the hashes of its FMUs."""
    wiring = loaded(task, point).wiring(task, point)
    return to_toml(wiring.scenario) + " ".join(d.sha256 for d in wiring.descriptions.values())


def simulation(task: Task, points: Sequence[Point]) -> list[PointResult]:
    """Twin runs by the batch kernel where it applies, by FMUs elsewhere."""
    wired = [_WiredPoint.of(task, point) for point in points]
    by_kernel: dict[str, list[int]] = {}
    for k, at in enumerate(wired):
        if _refusal(at.wiring) is None:
            by_kernel.setdefault(_lanes_key(at.wiring), []).append(k)
    found: dict[int, PointResult] = {}
    for places in by_kernel.values():
        found |= zip(places, _batch([wired[k] for k in places]))
    return [found[k] if k in found else _simulated(at) for k, at in enumerate(wired)]


def cosimulation(task: Task, points: Sequence[Point]) -> list[PointResult]:
    """Twin runs of FMUs."""
    return [_simulated(_WiredPoint.of(task, point)) for point in points]


def spectrum(task: Task, points: Sequence[Point]) -> list[PointResult]:
    """Exact growth rate of the linearised loop at the start pose, for the mean delays."""
    found = []
    for at in (_WiredPoint.of(task, point) for point in points):
        rate = abscissa(linearise(at.wiring.scenario, at.loaded.system).system())
        outcome = Outcome.CONVERGED if rate < 0.0 else Outcome.GROWING
        found.append(PointResult(outcome.value, rate, rate, rate, _evidence(at, None, rate).value))
    return found


@frozen
class _WiredPoint:
    """A point of the sweep with its loaded scenario and checked wiring."""

    loaded: _LoadedScenario
    wiring: Wiring
    point: Point

    @classmethod
    def of(cls, task: Task, point: Point) -> "_WiredPoint":
        chosen = loaded(task, point)
        return cls(chosen, chosen.wiring(task, point), point)


def _lanes_key(wiring: Wiring) -> str:
    """What scenarios of one kernel batch have in common: components, connections, experiment."""
    scenario = wiring.scenario
    return repr((scenario.name, [(n, c.kind) for n, c in scenario.components.items()], scenario.experiment))


def _refusal(wiring: Wiring) -> str | None:
    """Why the batch kernel does not apply; None where it does."""
    try:
        from cosim.sweeps.kernel import refusal
    except ImportError as error:
        return str(error)
    return refusal(wiring, _signals(wiring))


def _signals(wiring: Wiring) -> list[str]:
    """What a verdict and the tracking error read."""
    names = [n for n in wiring.signals if stem(n.partition(".")[2]) in _RECORDED and not n.endswith(".saturated")]
    operator = [n for n in wiring.signals if stem(n) == "operator.f"]
    return list(
        dict.fromkeys(
            stem(n) for n in names + operator if wiring.descriptions[n.partition(".")[0]].integrates or n in operator
        )
    )


def _batch(wired: Sequence[_WiredPoint]) -> list[PointResult]:
    from cosim.sweeps.kernel import run_batch

    wirings = [at.wiring for at in wired]
    twins = [at.loaded.system.wiring(twin_of(at.wiring)) for at in wired]
    results = run_batch([*wirings, *twins], _signals(wirings[0]))
    found = zip(wired, results[: len(wired)], results[len(wired) :])
    return [_replayed(at, result, _finding(at, result, twin)) for at, result, twin in found]


def _replayed(at: _WiredPoint, result: Result, finding: PointResult) -> PointResult:
    """The finding of a kernel's run; where the point was drawn, with the largest relative difference to the FMUs'
    run.
    """
    if not drawn(at.point):
        return finding
    again = run(at.wiring.scenario, at.loaded.system, record=list(result.signals))
    return evolve(finding, numbers={**finding.numbers, "kernel_difference": difference(result, again)})


def drawn(point: Point) -> bool:
    """Whether a point that the kernel ran is run by the FMUs too: one in `_REPLAY_EVERY`, by its hash, so at random but
    the
    same in every process.
    """
    return int(point.key[:8], 16) % _REPLAY_EVERY == 0


def difference(result: Result, other: Result) -> float:
    """Largest difference of two runs' signals, relative to the largest value of its signal; infinite for unlike
    lengths.
    """
    if len(result.time) != len(other.time) or result.outcome is not other.outcome:
        return math.inf
    return max(
        float(np.abs(values - other.signals[name]).max() / max(np.abs(values).max(), 1e-300))
        for name, values in result.signals.items()
    )


def _simulated(at: _WiredPoint) -> PointResult:
    wiring, system = at.wiring, at.loaded.system
    record = [
        n for n in dict.fromkeys(map(stem, wiring.signals)) if n.partition(".")[2] in _RECORDED or n == "operator.f"
    ]
    twin = twin_of(wiring)
    if twin is None:
        raise RunError(wiring.scenario.name, None, "no arm whose start could be moved: no growth rate")
    results = [run(scenario, system, record=record) for scenario in (wiring.scenario, twin)]
    for result in results:
        if result.failure is not None:
            raise result.failure
    return _finding(at, *results)


def _finding(at: _WiredPoint, result: Result, twin: Result) -> PointResult:
    verdict: GrowthVerdict = judge(result, twin)
    evidence = _evidence(at, verdict.outcome)
    apart = tracking(result)
    numbers = {"tracking_rmse": apart.total} if apart else {}
    numbers["simulated_time"] = float(result.time[-1])
    return PointResult(
        verdict.outcome.value, verdict.growth_rate, *verdict.interval, evidence.value, numbers, result.message
    )


def _evidence(at: _WiredPoint, outcome: Outcome | None, rate: float | None = None) -> StabilityEvidence:
    """The strongest evidence, the dear conditions only where the cheap ones leave it open."""
    if outcome in UNSTABLE:
        return StabilityEvidence.FALSIFIED
    wiring = at.wiring
    channels, pair = channel_bounds(wiring), sides(wiring)
    if pair is None or len(channels) != 2 or not complete(wiring):
        return strongest(outcome)
    longest, constant = [bounds[2] for bounds in channels.values()], all(bounds[3] for bounds in channels.values())
    compensated = all(side.compensated for side in pair)
    if compensated and delay_sum(coupling(pair), *longest).holds:
        return StabilityEvidence.ANY_MASS
    loop = linearise(wiring.scenario, at.loaded.system)
    family = loop.family()
    if family and max(longest) < quick_limit(family) and max(longest) < delay_law_bound(family):
        return StabilityEvidence.KNOWN_MASS
    if constant and rate is None:
        rate = abscissa(loop.system())
    return strongest(outcome, abscissa=rate, constant=constant)
