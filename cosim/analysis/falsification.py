"""The worst that delays, a hand and losses can do within a scenario's own bounds, searched on its FMUs.

No linearisation is used, so friction, saturation, limits and FMUs of others count as they are. The bounds are those
of the scenario: each channel's delay goes anywhere from zero to the greatest that it has there, by one of the
channel's periodic laws; the operator's sine keeps its amplitude and takes any frequency; where samples are lost,
others are lost. What is found is a scenario that shows it; what is not found is no proof.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from enum import Enum

import numpy as np
from attrs import define, evolve, field, frozen

from cosim.analysis.evidence import UNSTABLE
from cosim.analysis.linear_fmu import channel_bounds
from cosim.analysis.twin import judged_run, verdict_signals
from cosim.analysis.verdict import ENDED
from cosim.engine.isolation import runner
from cosim.engine.outcome import Outcome
from cosim.errors import InputError, Problem, RunError
from cosim.fmu import FmuSet
from cosim.results.summary import Judged, number
from cosim.scenario import Scenario
from cosim.signals import stem
from cosim.wiring import Wiring

LAWS = ("sawtooth", "square", "sinusoidal")
"""Laws of a channel that a period, a phase and two delays describe; `sawtooth` keeps a value in sight."""
_PERIODS = (2.0, 200.0)
"""Periods looked at, as parts of the stop time: from half of it down."""
_FREQUENCIES = (0.02, 5.0)
"""Frequencies of the hand [Hz]."""
_ENDED = 1e3
"""What a run counts that ends early, over the time at which it did: more than any growth rate that is measured."""


class Harm(str, Enum):
    """What is made as large as it gets."""

    GROWTH = "growth"
    ERROR = "error"
    FORCE = "force"

    @property
    def unit(self) -> str:
        """Unit of the measure."""
        return {"growth": "1/s", "error": "m", "force": "N"}[self.value]


@frozen
class Falsification:
    """The scenario that does most harm of all that were run, with the measure before and there.

    changes: values that make it of the scenario, as `--set` takes them; outcome: how its run ended.
    """

    harm: Harm
    runs: int
    before: float
    worst: float
    outcome: Outcome
    changes: Mapping[str, object]
    scenario: Scenario = field(repr=False)

    @property
    def grows(self) -> bool:
        """Whether small disturbances grow in the worst run found."""
        return self.outcome in UNSTABLE

    def to_dict(self) -> dict[str, object]:
        """`falsification` of stability.json."""
        return {
            "harm": self.harm.value,
            "unit": self.harm.unit,
            "runs": self.runs,
            "before": number(self.before) if abs(self.before) < _ENDED else None,
            "worst": None if self.outcome in ENDED else self.worst,
            "outcome": self.outcome.value,
            "changes": dict(self.changes),
        }


class _SpentError(Exception):
    """The budget of runs is spent."""


def falsify(
    scenario: Scenario,
    system: FmuSet,
    runs: int,
    harm: Harm = Harm.GROWTH,
    say: Callable[[str], None] = lambda text: None,
) -> Falsification:
    """Search the worst case with a budget of runs by differential evolution (Storn and Price 1997).

    Raises InputError where nothing of the scenario is free, RunError where its FMUs cannot be run as it stands.
    """
    from scipy.optimize import differential_evolution

    wiring = system.wiring(scenario)
    search = _Search(scenario, system, harm, runs, say, _longest(wiring), _hands(wiring), _losing(wiring))
    axes = search.axes
    if not axes:
        advice = "give a channel a delay, or the operator an amplitude"
        raise InputError(Problem(scenario.name, "a delay, a loss or a hand to vary", "none", advice))
    before = search.measured({})
    with suppress(_SpentError):
        differential_evolution(
            search.cost, [(0.0, 1.0)] * len(axes), maxiter=runs, popsize=max(4, runs // (8 * len(axes))),
            polish=False, rng=scenario.experiment.seed, tol=0.0, atol=0,
        )  # fmt: skip
    worst, outcome, changes = search.best
    name = f"{scenario.name}-worst"
    return Falsification(harm, search.done, before, worst, outcome, changes, _named(scenario, changes, name))


def _named(scenario: Scenario, changes: Mapping[str, object], name: str) -> Scenario:
    return evolve(scenario.with_values(changes), name=name, title=f"The worst that was found of {scenario.name}")


@define
class _Search:
    scenario: Scenario
    system: FmuSet
    harm: Harm
    runs: int
    say: Callable[[str], None]
    delays: dict[str, float]
    hands: list[str]
    losing: list[str]
    done: int = 0
    best: tuple[float, Outcome, dict[str, object]] = (-np.inf, Outcome.NOT_JUDGED, {})

    @property
    def axes(self) -> list[str]:
        """What is varied: law and period in common, phase and least delay of each channel, the hand, the losses."""
        each = [f"{n}.{key}" for n in self.delays for key in ("phase", "least")]
        found = ["law", "period", *each] if each else []
        return found + [f"{n}.frequency" for n in self.hands] + (["seed"] if self.losing else [])

    def changes(self, x: np.ndarray) -> dict[str, object]:
        """Values of the scenario for a place in the unit cube."""
        at, stop = dict(zip(self.axes, x)), self.scenario.experiment.stop
        values: dict[str, object] = {}
        for name, most in self.delays.items():
            values |= {
                f"{name}.law": LAWS[min(int(at["law"] * len(LAWS)), len(LAWS) - 1)],
                f"{name}.delay_period": _between(stop / _PERIODS[1], stop / _PERIODS[0], at["period"]),
                f"{name}.delay_phase": float(2.0 * np.pi * at[f"{name}.phase"]),
                f"{name}.delay_min": float(most * max(at[f"{name}.least"] - 0.5, 0.0) * 2.0),
                f"{name}.delay_max": float(most),
            }
        for name in self.hands:
            values[f"{name}.frequency"] = _between(*_FREQUENCIES, at[f"{name}.frequency"])
        for place, name in enumerate(self.losing):
            values[f"{name}.seed"] = 1 + 2 * int(at["seed"] * 1e6) + place
        return values

    def cost(self, x: np.ndarray) -> float:
        if self.done >= self.runs:
            raise _SpentError
        return -self.measured(self.changes(x))

    def measured(self, changes: dict[str, object]) -> float:
        """The harm of a run with changes; remembered where it is the greatest."""
        scenario = self.scenario.with_values(changes)
        wiring = self.system.wiring(scenario)
        record = [*verdict_signals(wiring), *_forces(wiring)] if self.harm is Harm.FORCE else verdict_signals(wiring)
        try:
            judged = judged_run(scenario, self.system, None, record, simulate=runner(scenario))
        except RunError:
            if not changes:
                raise
            judged = None
        self.done += 1
        value = -np.inf if judged is None else _harm(judged, self.harm, wiring)
        if judged is not None and value > self.best[0]:
            self.best = value, judged.outcome, changes
            self.say(f"run {self.done} of {self.runs}: {self.harm.value} {value:+.4g} {self.harm.unit}")
        return value


def _longest(wiring: Wiring) -> dict[str, float]:
    """The greatest delay of each channel that has one [s]."""
    return {n: b[2] if np.isfinite(b[2]) else b[1] for n, b in channel_bounds(wiring).items() if b[1] > 0.0}


def _hands(wiring: Wiring) -> list[str]:
    """Operators that move."""
    return [
        name
        for name, part in wiring.scenario.components.items()
        if part.model == "Operator"
        and any(wiring.start(name, e) for e in wiring.descriptions[name].elements("amplitude"))
    ]


def _losing(wiring: Wiring) -> list[str]:
    """Channels that lose samples."""
    keys = ("loss_good", "loss_to_bad")
    return [n for n in channel_bounds(wiring) if any(wiring.start(n, key) > 0.0 for key in keys)]


def _between(low: float, high: float, part: float) -> float:
    """A value between two on a logarithmic scale, to six digits."""
    return float(f"{low * (high / low) ** part:.6g}")


def _forces(wiring: Wiring) -> list[str]:
    """What acts on the local arm."""
    arm = (wiring.scenario.arms or ("",))[0]
    return list(dict.fromkeys(str(link.source) for link in wiring.links if link.target.component == arm))


def _harm(judged: Judged, harm: Harm, wiring: Wiring) -> float:
    result = judged.result
    if result.outcome in ENDED:
        return _ENDED / max(float(result.time[-1]), 1e-3)
    if harm is Harm.GROWTH:
        return -np.inf if judged.growth_rate is None else float(judged.growth_rate)
    if harm is Harm.ERROR:
        return -np.inf if judged.tracking is None else float(judged.tracking.total)
    names = [name for name in _forces(wiring) if stem(name).rpartition(".")[2] not in ("x", "dx")]
    return float(np.max(np.linalg.norm(np.column_stack([result.signals[n] for n in names]), axis=1)))
