"""A delay law played back in the FMUs: the scenario that does it, and how fast small disturbances grow there."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from attrs import evolve, field, frozen

from cosim.analysis.at_rest import at_rest
from cosim.analysis.twin import twin_of
from cosim.engine.isolation import runner
from cosim.engine.master import Result
from cosim.engine.outcome import Outcome
from cosim.engine.reference import RunProgress
from cosim.errors import RunError
from cosim.fmu import FmuSet, open_system
from cosim.results.saving import write_text
from cosim.scenario import Algorithm, Component, Connection, Extrapolation, Scenario
from cosim.signals import Signal, stem
from cosim.wiring import Wiring

TRACE = "destroying.csv"
COMPONENT = "delay_trace"
_PERIODS = 64
"""Periods of the law that are played."""
_MOMENTS = 12
"""Moments of a period at which the difference is looked at."""
_NOISE, _CARRIED = 1e-7, 1e-3
"""Singular value over the largest below which there is rounding only; part of a snapshot that a mode has to carry."""


@frozen
class PlayedLaw:
    """What small disturbances did under a law in the FMUs: growth rate [1/s] with its 95 % interval, and when they were
    how large (periods, 2).

    `why` says why there is no rate; empty where there is one.
    """

    scenario: Scenario | None
    growth_rate: float | None
    interval: tuple[float, float] | None
    sizes: np.ndarray = field(eq=False, repr=False)
    why: str = ""

    @property
    def grows(self) -> bool:
        """Whether the interval lies above zero."""
        return self.interval is not None and self.interval[0] > 0.0


def columns(channels: Mapping[str, object]) -> list[str]:
    """Column names of a trace: `delay_lr` for `channel_lr`."""
    return [f"delay_{name.removeprefix('channel_')}" for name in channels]


def write_trace(ages: np.ndarray, step: float, channels: Mapping[str, object], path: Path) -> Path:
    """One period of a law as a CSV: time and the delay of each channel [s], ages (channels, period) [steps]."""
    rows = [",".join(["time", *columns(channels)])]
    rows += [",".join(f"{v * step:.9g}" for v in (k, *row)) for k, row in enumerate(ages.T.tolist())]
    return write_text("\n".join(rows) + "\n", path)


def replaying(wiring: Wiring, ages: np.ndarray, channels: Mapping[str, object], folder: Path) -> Scenario:
    """The scenario at rest with the trace in `folder` played into its channels, again and again."""
    rest, period = at_rest(wiring), ages.shape[1] * wiring.scenario.experiment.step
    values: dict[str, object] = {}
    for name in channels:
        values |= {f"{name}.law": "recorded", f"{name}.semantics": "time_delay"}
    values |= {"experiment.stop": round(_PERIODS * period, 9), "experiment.record_every": 1}
    trace = Component(
        recording=str(folder / TRACE), columns=tuple(columns(channels)), unit="s", repeat=True,
        interpolation=Extrapolation.HOLD,
    )  # fmt: skip
    played = {Signal(COMPONENT, f"y[{k + 1}]"): name for k, name in enumerate(channels)}
    links = [c for c in rest.connections if not _sets_delay(c, channels)]
    links += [Connection(source, Signal(name, "delay")) for source, name in played.items()]
    changed = rest.with_values(values)
    order = changed.experiment.order
    experiment = evolve(changed.experiment, order=(COMPONENT, *order) if order else ())
    return evolve(
        changed,
        name=f"{rest.name}-destroying",
        title=f"A delay law that destroys {rest.name}",
        description="Found by `cosim stability --any-delay`; small disturbances grow under it. Arms at rest.",
        components={**changed.components, COMPONENT: trace},
        connections=tuple(links),
        experiment=experiment,
    )


def _sets_delay(connection: Connection, channels: Mapping[str, object]) -> bool:
    return connection.target.component in channels and stem(connection.target.variable) == "delay"


def replayed(scenario: Scenario, period: int, progress: Callable[[RunProgress], None] | None = None) -> PlayedLaw:
    """Run a replay and its twin, and follow their difference from period to period of the law [steps]."""
    nothing = np.zeros((0, 2))
    experiment = scenario.experiment
    if experiment.algorithm is Algorithm.JACOBI and experiment.extrapolation is Extrapolation.LINEAR:
        why = (
            "on lines in Jacobi order a trace is extrapolated at its jumps; with hold or gauss-seidel it can be played"
        )
        return PlayedLaw(scenario, None, None, nothing, why)
    with open_system(scenario) as system:
        twin = twin_of(system.wiring(scenario))
        if twin is None:
            return PlayedLaw(scenario, None, None, nothing, "no start of an arm can be moved to see a disturbance grow")
        runs = [_run(one, system, progress) for one in (scenario, twin)]
    ended = next((run for run in runs if run.outcome in (Outcome.FAILED, Outcome.DOMAIN_EXIT, Outcome.LIMIT_HIT)), None)
    difference = _difference(*runs)
    if len(difference) < 40 * period:
        told = f"ends early: {ended.message or ended.outcome.value}" if ended else "is too short"
        return PlayedLaw(scenario, None, None, nothing, f"the replay {told}")
    return _growth(scenario, difference, period)


def _run(scenario: Scenario, system: FmuSet, progress: Callable[[RunProgress], None] | None) -> Result:
    rates = [name for name in system.wiring(scenario).signals if stem(name).endswith(".dq")]
    result = runner(scenario)(scenario, system, progress, rates)
    if isinstance(result.failure, RunError):
        raise result.failure
    return result


def _difference(one: Result, other: Result) -> np.ndarray:
    """Joint rates of all arms, twin less run, (rows, joints)."""
    names = [name for name in one.signals if stem(name).endswith(".dq")]
    count = min(len(one.time), len(other.time))
    return np.column_stack([other.signals[n][:count] - one.signals[n][:count] for n in names])


def _growth(scenario: Scenario, difference: np.ndarray, period: int) -> PlayedLaw:
    """The rate from the difference at the same moments of every period.

    From period to period one matrix maps it. Three stretches of periods give that matrix by least squares over their
    principal components (dynamic mode decomposition, Schmid 2010), and its largest eigenvalue; their spread gives the
    interval, Student's t times sqrt(3) since they overlap.
    """
    count, seconds = len(difference) // period, period * scenario.experiment.step
    moments = np.linspace(0, period, _MOMENTS, endpoint=False).astype(int)
    snapshots = difference[: count * period].reshape(count, period, -1)[:, moments].reshape(count, -1)
    sizes = np.column_stack([seconds * np.arange(count), np.linalg.norm(snapshots, axis=1)])
    length = round(0.6 * count)
    stretches = [snapshots[first : first + length] for first in np.linspace(0, count - length, 3).astype(int)]
    rates = np.array([np.log(_fastest(part)) / seconds for part in stretches])
    half = max(np.sqrt(3.0) * 4.30 * float(np.std(rates, ddof=1)) / np.sqrt(3.0), 1e-9)
    rate = float(rates.mean())
    return PlayedLaw(scenario, rate, (rate - half, rate + half), sizes)


def _fastest(snapshots: np.ndarray) -> float:
    """Modulus of the largest eigenvalue among those that carry something of the last snapshot (n, places)."""
    u, s, _ = np.linalg.svd(snapshots.T / np.linalg.norm(snapshots, axis=1).max(), full_matrices=False)
    states = u[:, : int(min(np.sum(s > _NOISE * s[0]), len(snapshots) // 3))].T @ snapshots.T
    mapped = np.linalg.lstsq(states[:, :-1].T, states[:, 1:].T, rcond=None)[0].T
    values, vectors = np.linalg.eig(mapped)
    parts = np.abs(np.linalg.solve(vectors, states[:, -1]))
    return float(np.abs(values[parts > _CARRIED * parts.max()]).max())
