"""What a run found, in numbers: tracking, verdict with growth rate, and the `summary.json` of the contract."""

import math
from collections.abc import Mapping

import numpy as np
from attrs import field, frozen

from cosim.engine.master import Result
from cosim.engine.outcome import Outcome
from cosim.results.measures import Measure
from cosim.results.provenance import command_line, versions
from cosim.results.tips import facing_tips
from cosim.wiring import Wiring, direction_table


@frozen
class Tracking:
    """How far the arms' tips were apart over the whole run: RMS of x_l - x_r [m], per axis and of its norm, x_l mapped
    into the remote arm's frame (see `FacingTips`).
    """

    axes: tuple[float, ...]
    total: float


@frozen
class Judged:
    """A run with what is known of it: wiring, growth rate [1/s] with its 95 % interval, tracking, measures by name.

    The outcome of `result` is that of the verdict where there is one.
    """

    result: Result
    wiring: Wiring
    growth_rate: float | None = None
    interval: tuple[float, float] | None = None
    tracking: Tracking | None = None
    measures: Mapping[str, Measure] = field(factory=dict)
    notes: tuple[str, ...] = field(default=(), converter=tuple)
    interrupted: bool = False

    @property
    def outcome(self) -> Outcome:
        """How the run ended."""
        return self.result.outcome


def tracking(result: Result) -> Tracking | None:
    """RMS over the recorded rows (evenly spaced), in the remote arm's frame where the arms' frames or sizes differ;
    None without two arms.
    """
    tips = facing_tips(result)
    if tips is None:
        return None
    squares = tips.apart**2
    axes, total = np.sqrt(np.mean(squares, axis=0)), np.sqrt(np.mean(squares[:, 0] + squares[:, 1] + squares[:, 2]))
    return Tracking(tuple(float(a) for a in axes), float(total))


def simulated_time(result: Result) -> float:
    """How far the run came [s]; the last row may stand before it (`record_every`)."""
    if result.stopped_at is not None:
        return result.stopped_at
    return float(result.time[-1]) if result.interrupted else result.scenario.experiment.stop


def limit_time(result: Result) -> float | None:
    """When an actuator first was at its limit [s]; None if never."""
    for name in (name for name in result.signals if name.endswith(".saturated")):
        values = result.signals[name]
        if np.any(values > 0.5):
            return float(result.time[int(np.argmax(values > 0.5))])
    return None


def summary(judged: Judged) -> dict[str, object]:
    """The content of `summary.json`: the keys of the contract, and what else a reader may want."""
    result, experiment = judged.result, judged.result.scenario.experiment
    return {
        "scenario": result.scenario.name,
        "outcome": judged.outcome.value,
        "advice": judged.outcome.advice,
        "message": result.message,
        "growth_rate": judged.growth_rate,
        "growth_rate_interval": None if judged.interval is None else list(judged.interval),
        "tracking_rmse": _tracking(judged.tracking),
        "measures": {name: measure.to_dict() for name, measure in judged.measures.items()},
        "simulated_time": simulated_time(result),
        "stopped_at": result.stopped_at,
        "interrupted": judged.interrupted,
        "wall_time": result.wall_time,
        "communication_step": experiment.step,
        "algorithm": experiment.algorithm.value,
        "extrapolation": experiment.extrapolation.value,
        "added_delay": [
            {"what": what, "way": way, "seconds": age} for what, way, age in direction_table(judged.wiring)
        ],
        "limit_hit_at": limit_time(result),
        "effects": list(result.scenario.effects),
        "changes": dict(result.scenario.changes),
        "fmus": [{"component": f.component, "name": f.model, "fmi": f.fmi, "sha256": f.sha256} for f in result.fmus],
        "seed": experiment.seed,
        "versions": versions(),
        "command": command_line(),
        "notes": list(judged.notes),
        "messages": [message.to_dict() for message in result.messages],
    }


def _tracking(found: Tracking | None) -> dict[str, float] | None:
    return None if found is None else {**dict(zip("xyz", found.axes)), "total": found.total}


def number(value: float | None) -> float | None:
    """A number that JSON can hold: None for NaN and infinity."""
    return value if value is not None and math.isfinite(value) else None
