"""Points of a sweep, what was found at each, and the key by which both are remembered."""

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from hashlib import sha256

import numpy as np
from attrs import asdict, field, fields, frozen

from cosim.analysis.evidence import UNSTABLE
from cosim.engine.outcome import Outcome
from cosim.sweeps.spec import SCENARIO, Axis, Choice, Entry, Sweep


@frozen
class Point:
    """One entry of every axis: `entries` for tables (numbers and labels), `values` for the scenario.

    sign_alone: whether no more than the sign of its growth rate is asked for, so that its run may end when that is
    known.
    """

    entries: tuple[float | str, ...]
    values: tuple[tuple[str, object], ...]
    sign_alone: bool = field(default=False, eq=False)

    @cached_property
    def key(self) -> str:
        """Hash of the values: the same point has the same key in every process."""
        return sha256(json.dumps(self.values, sort_keys=True).encode()).hexdigest()[:24]


def point(axes: Sequence[Axis], entries: Sequence[Entry]) -> Point:
    """The point of one entry of each axis."""
    values: dict[str, object] = {}
    for axis, entry in zip(axes, entries):
        values |= axis.settings(entry)
    labels = tuple(entry.label if isinstance(entry, Choice) else float(entry) for entry in entries)
    return Point(labels, tuple(values.items()))


@frozen
class PointResult:
    """What an evaluator found at a point. `numbers` holds further results by name; every field is plain and
    repeatable.
    """

    outcome: str
    growth_rate: float = np.nan
    low: float = np.nan
    high: float = np.nan
    evidence: str = "none"
    numbers: Mapping[str, float] = field(factory=dict)
    message: str = ""

    @property
    def rate(self) -> float:
        """Growth rate for tracing [1/s]: where there is none, +1 or -1 by the outcome; NaN where that does not say
        either.
        """
        if np.isfinite(self.growth_rate):
            return float(self.growth_rate)
        if self.outcome in [o.value for o in UNSTABLE]:
            return 1.0
        return -1.0 if self.outcome == Outcome.CONVERGED.value else np.nan


def plain(finding: PointResult) -> dict[str, object]:
    """The result as JSON holds it."""
    return asdict(
        finding, value_serializer=lambda _, __, value: value.item() if isinstance(value, np.generic) else value
    )


def from_plain(found: object) -> PointResult:
    """The inverse of `plain`. Raises ValueError where that is no result."""
    if not isinstance(found, dict) or not set(found) <= {entry.name for entry in fields(PointResult)}:
        raise ValueError("no result of a point")
    texts = [found.get("outcome"), found.get("evidence", ""), found.get("message", "")]
    numbers = found.get("numbers", {})
    if not all(isinstance(text, str) for text in texts) or not isinstance(numbers, dict):
        raise ValueError("no result of a point")
    values = [*(found.get(name, 0.0) for name in ("growth_rate", "low", "high")), *numbers.values()]
    if not all(isinstance(value, (int, float)) for value in values):
        raise ValueError("no result of a point")
    return PointResult(**found)


def failed(message: str) -> PointResult:
    """The finding of a point whose run failed twice."""
    return PointResult(Outcome.FAILED.value, message=message)


def replay(sweep: Sweep, where: Point) -> str:
    """A command line that runs the point as one co-simulation."""
    import shlex

    settings = dict(sweep.set) | dict(where.values)
    words = ["cosim", "run", str(settings.pop(SCENARIO, sweep.scenario))]
    for path, value in settings.items():
        words += ["--set", f"{path}={json.dumps(value)}"]
    return shlex.join(words + (["--effects", sweep.effects] if sweep.effects else []))
