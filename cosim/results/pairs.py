"""Two sets of signals side by side: every signal's difference, with a tolerance or without."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from attrs import frozen

from cosim.results.summary import number
from cosim.results.traces import MatchedSignal, Traces, matched
from cosim.results.tube import Departure, Tube, departure
from cosim.signals import stem


@frozen
class Tolerance:
    """How far a signal may be from its reference: a tube of half height `relative` times the range of the signal, and
    of half width `time` [s].

    The range is the largest of those of the elements of a vector, so that an axis that hardly moves is not held to a
    scale of its own; the largest absolute value stands in for a range of zero. time None: nothing where both curves
    have the same samples, else the longest interval between two samples of the coarser one, since what happens between
    two samples is not known.
    """

    relative: float
    time: float | None = None


@frozen(eq=False)
class SignalPair:
    """A signal of two sets and how far it is apart; `scale`: the range that the tolerance refers to."""

    match: MatchedSignal
    found: Departure
    scale: float

    @property
    def share(self) -> float:
        """The greatest difference over the scale; infinite for a difference where the reference is zero throughout."""
        return self.found.greatest / self.scale if self.scale else (np.inf if self.found.greatest else 0.0)

    @property
    def moves(self) -> bool:
        """Whether the reference changes over time: else it has no range that a difference could be a share of."""
        return bool((self.match.reference != self.match.reference[0]).any())

    def to_dict(self) -> dict[str, Any]:
        """As compare.json has it."""
        found = self.found
        judged = {"tolerance": found.height, "outside": found.outside, "first_outside": found.first_outside}
        return {
            "unit": self.match.unit,
            **({"called": self.match.theirs} if self.match.theirs != self.match.name else {}),
            "max_difference": number(found.greatest),
            "at": found.at,
            "rms_difference": number(found.rms),
            "range": self.scale,
            **({} if found.height is None else judged),
        }


@frozen(eq=False)
class TracesPair:
    """A set of signals against the reference."""

    reference: Traces
    other: Traces
    signals: tuple[SignalPair, ...]
    notes: tuple[str, ...]
    tube_time: float | None
    ends: tuple[float, float]

    @property
    def same(self) -> bool:
        """Whether all that both have is the same to the last bit."""
        alike = np.array_equal(self.reference.time, self.other.time)
        return alike and all(np.array_equal(s.match.reference, s.match.values, equal_nan=True) for s in self.signals)

    @property
    def whole(self) -> bool:
        """Whether the other one is as long as the reference, within the tolerance in time and a step."""
        return self.ends[1] >= self.ends[0] - (self.tube_time or 0.0) - _step(self.reference.time)

    @property
    def leaving(self) -> tuple[SignalPair, ...]:
        """Signals that leave their tube, the one that does so first before the others."""
        found = [s for s in self.signals if not s.found.within]
        return tuple(sorted(found, key=lambda s: s.found.first_outside or 0.0))

    @property
    def worst(self) -> SignalPair:
        """The signal with the greatest difference over its range; one that has no range only where none has."""
        return max(self.signals, key=lambda s: (s.moves and s.share > 0.0, s.share))

    @property
    def agrees(self) -> bool:
        """Whether no signal leaves its tube, and none ends early."""
        return self.same or (self.whole and not self.leaving)


def pair(reference: Traces, other: Traces, tolerance: Tolerance | None) -> TracesPair:
    """Compare every signal that both have. Raises InputError where there is none."""
    matches, notes = matched(reference, other)
    scales = ranges({match.name: match.reference for match in matches})
    width = None if tolerance is None else _width(tolerance, reference.time, other.time)
    found = []
    for match in matches:
        scale = scales[stem(match.name)]
        tube = None if tolerance is None or width is None else Tube(width, tolerance.relative * scale)
        distance = departure(other.time, match.values, reference.time, match.reference, tube)
        found.append(SignalPair(match, distance, scale))
    ends = float(reference.time[-1]), float(other.time[-1])
    return TracesPair(reference, other, tuple(found), (*notes, *other.notes), width, ends)


def ranges(signals: Mapping[str, np.ndarray]) -> dict[str, float]:
    """{stem: scale of its tolerance}: the largest range of its elements, else the largest absolute value."""
    spans: dict[str, float] = {}
    sizes: dict[str, float] = {}
    for name, values in signals.items():
        kept = values[np.isfinite(values)]
        span, size = (float(np.ptp(kept)), float(np.abs(kept).max())) if len(kept) else (0.0, 0.0)
        spans[stem(name)] = max(spans.get(stem(name), 0.0), span)
        sizes[stem(name)] = max(sizes.get(stem(name), 0.0), size)
    return {name: span or sizes[name] for name, span in spans.items()}


def _width(tolerance: Tolerance, one: np.ndarray, two: np.ndarray) -> float:
    if tolerance.time is not None:
        return tolerance.time
    return 0.0 if np.array_equal(one, two) else max(_step(one), _step(two))


def _step(time: np.ndarray) -> float:
    return float(np.diff(time).max()) if len(time) > 1 else 0.0
