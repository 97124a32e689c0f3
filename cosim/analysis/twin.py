"""A run and its twin: the same scenario with a slightly different start, so that the growth of small disturbances
shows.
"""

from collections.abc import Callable, Iterable, Sequence

from attrs import evolve

from cosim.analysis.verdict import judge, perturbation
from cosim.engine.master import Result, System, run
from cosim.engine.outcome import Outcome
from cosim.engine.reference import RunProgress
from cosim.engine.table import stacked
from cosim.results.measures import measures, port_signals
from cosim.results.summary import Judged, number, tracking
from cosim.scenario import Scenario
from cosim.signals import FmuDescription, stem
from cosim.wiring import Wiring

_ROWS = 100_000  # that a verdict looks at, at most twice as many


def twin_of(wiring: Wiring) -> Scenario | None:
    """The scenario, the start of every arm moved by 1e-6 rad/s (see cosim.analysis.verdict); None without an arm."""
    moved = _moved(wiring)
    return wiring.scenario.with_values(moved) if moved else None


def twin_wiring(wiring: Wiring) -> Wiring | None:
    """As `twin_of`, but the wiring with those start values, which costs less; it still names the scenario itself."""
    starts = {name: dict(values) for name, values in wiring.starts.items()}
    moved = _moved(wiring)
    for path, value in moved.items():
        name, _, variable = path.partition(".")
        starts[name][variable] = value
    return evolve(wiring, starts=starts) if moved else None


def _moved(wiring: Wiring) -> dict[str, float]:
    """Start values of a twin, {"arm_l.dq_start[1]": 1e-6, ...} [rad/s]; empty without an arm."""
    arms = {
        name: _joints(wiring, name)
        for name in wiring.scenario.components
        if wiring.descriptions[name].elements("dq_start") and _observed(wiring.descriptions[name])
    }
    changes = perturbation(arms)
    starts = {path: float(wiring.starts[path.partition(".")[0]].get(path.partition(".")[2], 0.0)) for path in changes}
    return {path: starts[path] + change for path, change in changes.items()}


def _joints(wiring: Wiring, name: str) -> int:
    """How many joints of an arm move: all, or as many as it says."""
    room = len(wiring.descriptions[name].elements("dq_start"))
    said = wiring.start(name, "joints") if "joints" in wiring.descriptions[name].variables else room
    return min(room, int(said))


def _observed(description: FmuDescription) -> bool:
    """Whether the joint rates of an arm can be read."""
    rates = description.elements("dq")
    return bool(rates) and set(rates) <= set(description.outputs)


def judged_run(
    scenario: Scenario,
    system: System,
    progress: Callable[[RunProgress], None] | None = None,
    record: Sequence[str] | None = None,
    simulate: Callable[..., Result] = run,
) -> Judged:
    """Run a scenario, and its twin unless the scenario wants none or the first run failed or was interrupted; both on
    the loaded FMUs.

    simulate: who runs them (`cosim.engine.isolation.runner`).
    """
    result = simulate(scenario, system, progress, record)
    wiring = system.wiring(scenario)
    plain = Judged(
        _unjudged(result),
        wiring,
        tracking=tracking(result),
        measures=measures(result, wiring),
        notes=wiring.notes,
        interrupted=result.interrupted,
    )
    alone = result.interrupted or result.outcome is Outcome.FAILED or not scenario.experiment.disturb
    twin = None if alone else twin_of(wiring)
    if twin is None:
        return plain
    return _with_verdict(plain, simulate(twin, system, progress, _rates(result.signals)))


def _unjudged(result: Result) -> Result:
    """A run that stayed within its bounds, without a verdict: nothing was disturbed yet."""
    return evolve(result, outcome=Outcome.NOT_JUDGED) if result.outcome is Outcome.BOUNDED else result


def verdict_signals(wiring: Wiring) -> list[str]:
    """What verdict, tracking and measures read of a run: see `_rates`, the operator's force, tips and ports."""
    arms = wiring.scenario.arms or ()
    others = {"operator.f", *(f"{arm}.x" for arm in arms), *port_signals(wiring)}
    return [*_rates(wiring.signals), *(name for name in wiring.signals if stem(name) in others)]


def _rates(signals: Iterable[str]) -> list[str]:
    """What the verdict reads of the twin: joint angles and rates, and whether a motor is at its limit."""
    return [name for name in signals if stem(name).rpartition(".")[2] in ("q", "dq", "saturated")]


def _thinned(result: Result, every: int) -> Result:
    """Every so many rows of what the verdict reads."""
    if every == 1:
        return result
    names = [*_rates(result.signals), *(name for name in result.signals if stem(name) == "operator.f")]
    values = stacked(result.signals, names, every)
    return evolve(result, time=result.time[::every], signals=dict(zip(names, values.T)))


def _with_verdict(plain: Judged, twin: Result) -> Judged:
    if twin.interrupted or twin.outcome is Outcome.FAILED:
        return evolve(
            plain,
            notes=(*plain.notes, f"no verdict: the twin run ended early ({twin.message})"),
            interrupted=twin.interrupted,
        )
    every = len(plain.result.time) // _ROWS + 1
    verdict = judge(_thinned(plain.result, every), _thinned(twin, every))
    interval = tuple(number(v) for v in verdict.interval)
    return evolve(
        plain,
        result=evolve(plain.result, outcome=verdict.outcome),
        growth_rate=number(verdict.growth_rate),
        interval=None if None in interval else interval,
    )
