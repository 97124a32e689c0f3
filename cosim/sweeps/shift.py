"""Stability maps side by side: where the outcomes of equal points differ, and how far a boundary has moved."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen

from cosim.analysis.evidence import UNSTABLE
from cosim.errors import InputError, Problem
from cosim.opening import read_json
from cosim.results.files import read_table
from cosim.results.summary import number

_PLACES = 401  # of x at which two boundaries are compared
_AXIS = {"name", "unit", "low", "high", "scale", "entries"}  # keys of an axis in summary.json
_UNSTABLE = {outcome.value for outcome in UNSTABLE}


@frozen(eq=False)
class StabilityMap:
    """A sweep as it was saved: the content of its summary.json, and its table by columns."""

    name: str
    summary: Mapping[str, Any]
    columns: Mapping[str, Sequence[float | str]]

    @property
    def axes(self) -> dict[str, Mapping[str, Any]]:
        """Axes by name: unit, low, high, scale, entries."""
        return {axis["name"]: axis for axis in self.summary["sweep"]["axes"]}

    @property
    def frame(self) -> tuple[str, ...]:
        """Names of the axes of the boundary's vertices, x and y; empty where none was traced."""
        return tuple(self.summary.get("boundary_axes", ()))

    @property
    def traced(self) -> int:
        """Over how many axes the boundary was traced."""
        return len(self.summary["sweep"].get("trace", ()))

    def lines(self, label: str) -> list[np.ndarray]:
        """Lines (k, 2) of one curve of the boundary."""
        pairs = zip(self.summary["boundary"], self.summary["boundary_labels"])
        return [np.array(line, dtype=float) for line, name in pairs if name == label]


def read_map(folder: Path) -> StabilityMap:
    """The sweep in a folder that `cosim sweep` has written. Raises InputError where there is none."""
    summary = read_json(folder / "summary.json", "the summary of a sweep")
    if not _is_map(summary):
        got = "one without its axes or boundary"
        raise InputError(Problem(str(folder / "summary.json"), "the summary of a sweep", got, "run the sweep again"))
    return StabilityMap(folder.name, summary, read_table(folder / "sweep.h5"))


def _is_map(summary: Mapping[str, Any]) -> bool:
    """Whether a summary has the axes and the boundary that `cosim sweep` writes."""
    sweep, lines = summary.get("sweep"), summary.get("boundary")
    axes = sweep.get("axes") if isinstance(sweep, dict) else None
    if not isinstance(axes, list) or not isinstance(lines, list):
        return False
    if not all(isinstance(axis, dict) and set(axis) >= _AXIS for axis in axes):
        return False
    labels, names = summary.get("boundary_labels"), {str(axis["name"]) for axis in axes}
    return (
        isinstance(labels, list)
        and len(labels) == len(lines)
        and names >= set(map(str, summary.get("boundary_axes", ())))
    )


@frozen(eq=False)
class BoundaryShift:
    """How far a curve of the boundary is from that of the reference.

    x, shift: places along x where both have one crossing, and y minus the reference's y there [unit of y]; alone: share
    of places where only one of the two has a crossing; distance: the Hausdorff distance of both curves, where each
    axis is as long as its range.
    """

    label: str
    x: np.ndarray
    shift: np.ndarray
    alone: float
    distance: float

    def to_dict(self) -> dict[str, Any]:
        """As compare.json has it."""
        worst = int(np.argmax(np.abs(self.shift))) if len(self.shift) else None
        return {
            "label": self.label,
            "mean_shift": None if worst is None else float(np.mean(self.shift)),
            "greatest_shift": None if worst is None else float(self.shift[worst]),
            "greatest_at": None if worst is None else float(self.x[worst]),
            "only_in_one": self.alone,
            "distance": number(self.distance),
        }


@frozen(eq=False)
class MapPair:
    """A map against the reference: equal points and their outcomes, and every boundary that both have."""

    reference: StabilityMap
    other: StabilityMap
    changes: Mapping[tuple[str, str], int]
    shifts: tuple[BoundaryShift, ...]
    notes: tuple[str, ...]

    @property
    def flipped(self) -> int:
        """Equal points that are stable in one map and unstable in the other."""
        return sum(n for (a, b), n in self.changes.items() if (a in _UNSTABLE) != (b in _UNSTABLE))

    @property
    def points(self) -> int:
        """Points that are in both maps."""
        return sum(self.changes.values())

    def agrees(self, tolerance: float) -> bool:
        """Whether every boundary has moved by at most that share of the axes' ranges; without boundaries, whether all
        equal points are alike.
        """
        if self.reference.frame or self.other.frame:
            return all(shift.distance <= tolerance for shift in self.shifts)
        return self.points > 0 and not self.flipped


def pair_maps(reference: StabilityMap, other: StabilityMap) -> MapPair:
    """Compare two maps over the same axes. Raises InputError where their axes differ."""
    if list(reference.axes) != list(other.axes) or reference.frame != other.frame:
        got, expected = ", ".join(other.axes), ", ".join(reference.axes)
        raise InputError(Problem(other.name, f"a sweep over {expected}, as {reference.name} is", f"one over {got}"))
    notes = [
        f"{name}: {other.name} spans {b['low']:g} to {b['high']:g}, {reference.name} {a['low']:g} to {a['high']:g}"
        for name, a, b in ((n, reference.axes[n], other.axes[n]) for n in reference.axes)
        if (a["low"], a["high"]) != (b["low"], b["high"])
    ]
    labels = dict.fromkeys([*reference.summary["boundary_labels"], *other.summary["boundary_labels"]])
    shifts = tuple(shift for label in labels for shift in _shifts(reference, other, label))
    return MapPair(reference, other, _changes(reference, other), shifts, tuple(notes))


def _changes(reference: StabilityMap, other: StabilityMap) -> dict[tuple[str, str], int]:
    """{(outcome there, outcome here): how many equal points}."""
    names = list(reference.axes)

    def outcomes(which: StabilityMap) -> dict[tuple[float | str, ...], str]:
        entries = zip(*(which.columns[name] for name in names))
        return {place: str(outcome) for place, outcome in zip(entries, which.columns["outcome"])}

    one, two = outcomes(reference), outcomes(other)
    return dict(Counter((one[place], two[place]) for place in one if place in two))


def _shifts(reference: StabilityMap, other: StabilityMap, label: str) -> list[BoundaryShift]:
    if reference.traced == 1:
        return _along_one_axis(reference, other, label)
    shares = [[_shares(which, line) for line in which.lines(label)] for which in (reference, other)]
    places = np.linspace(0.0, 1.0, _PLACES)
    one, two = (_crossings(lines, places) for lines in shares)
    both = np.isfinite(one) & np.isfinite(two)
    alone = float(np.mean(np.isfinite(one) != np.isfinite(two)))
    x, y = (reference.axes[name] for name in reference.frame)
    shift = _number(y, two[both]) - _number(y, one[both])
    return [BoundaryShift(label, _number(x, places[both]), shift, alone, _hausdorff(*shares))]


def _along_one_axis(reference: StabilityMap, other: StabilityMap, label: str) -> list[BoundaryShift]:
    """A boundary along one axis is a crossing for every entry of the other axes."""
    axis = reference.axes[reference.frame[-1]]
    found = []
    ys = [[float(line[0][-1]) for line in _raw(which, label)] for which in (reference, other)]
    both = len(ys[0]) == len(ys[1]) == 1
    shift = np.array([ys[1][0] - ys[0][0]] if both else [])
    distance = abs(_share(axis, ys[1][0]) - _share(axis, ys[0][0])) if both else 0.0 if ys[0] == ys[1] else np.inf
    found.append(BoundaryShift(label, np.zeros(len(shift)), shift, float(not both and ys[0] != ys[1]), float(distance)))
    return found


def _raw(which: StabilityMap, label: str) -> list[list[list[float]]]:
    return [line for line, name in zip(which.summary["boundary"], which.summary["boundary_labels"]) if name == label]


def _share(axis: Mapping[str, Any], value: Any) -> Any:
    low, high = axis["low"], axis["high"]
    return np.log(value / low) / np.log(high / low) if axis["scale"] == "log" else (value - low) / (high - low)


def _number(axis: Mapping[str, Any], share: np.ndarray) -> np.ndarray:
    low, high = axis["low"], axis["high"]
    return low * (high / low) ** share if axis["scale"] == "log" else low + share * (high - low)


def _shares(which: StabilityMap, line: np.ndarray) -> np.ndarray:
    return np.column_stack([_share(which.axes[name], line[:, k]) for k, name in enumerate(which.frame)])


def _crossings(lines: Sequence[np.ndarray], places: np.ndarray) -> np.ndarray:
    """y (n,) of the lines at places of x (n,) where they cross it once, else NaN."""
    count, y = np.zeros(len(places)), np.zeros(len(places))
    for (x0, y0), (x1, y1) in ((a, b) for line in lines for a, b in pairwise(line)):
        inside = (places >= min(x0, x1)) & (places < max(x0, x1))
        count += inside
        y[inside] += y0 + (y1 - y0) * (places[inside] - x0) / (x1 - x0) if x1 != x0 else 0.0
    return np.where(count == 1, y, np.nan)


def _hausdorff(one: Sequence[np.ndarray], two: Sequence[np.ndarray]) -> float:
    """The greatest distance from a place of one set of lines to the nearest place of the other."""
    if not one or not two:
        return 0.0 if len(one) == len(two) else np.inf
    return max(_farthest(one, two), _farthest(two, one))


def _farthest(lines: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> float:
    places = np.concatenate([_dense(line) for line in lines])
    a = np.concatenate([line[:-1] if len(line) > 1 else line for line in others])
    b = np.concatenate([line[1:] if len(line) > 1 else line for line in others])
    along = b - a
    length = np.maximum((along**2).sum(axis=1), 1e-300)
    share = np.clip((((places[:, None] - a) * along).sum(axis=2)) / length, 0.0, 1.0)
    nearest = a + share[..., None] * along
    return float(np.sqrt(((places[:, None] - nearest) ** 2).sum(axis=2)).min(axis=1).max())


def _dense(line: np.ndarray) -> np.ndarray:
    """Places on a line, at most a hundredth of the map apart."""
    pieces = [
        a + np.linspace(0.0, 1.0, 2 + int(100 * np.hypot(*(b - a))))[:, None] * (b - a) for a, b in pairwise(line)
    ]
    return np.concatenate(pieces) if pieces else line


@frozen(eq=False)
class MapsCompared:
    """Sweeps against the first of them."""

    maps: tuple[StabilityMap, ...]
    pairs: tuple[MapPair, ...]
    tolerance: float | None = None

    @property
    def agrees(self) -> bool | None:
        """Whether every boundary has stayed within the tolerance; None where none was asked for."""
        return None if self.tolerance is None else all(found.agrees(self.tolerance) for found in self.pairs)

    def verdict(self, k: int) -> str:
        """What is to be said of map k + 1 against the reference, in a sentence."""
        found = self.pairs[k]
        parts = [_moved(found, shift) for shift in found.shifts]
        if found.points:
            parts.append(f"{found.points} equal points, {found.flipped} of them stable in one and not in the other")
        return "; ".join(parts) or "no boundary and no point that both have"

    def to_dict(self) -> dict[str, Any]:
        """The content of compare.json."""
        return {
            "kind": "sweeps",
            "items": [
                {
                    "name": m.name,
                    **{key: m.summary.get(key) for key in ("points", "outcomes", "shares")},
                    "sweep": {key: m.summary["sweep"].get(key) for key in ("name", "scenario", "set", "effects")},
                }
                for m in self.maps
            ],
            "tolerance": self.tolerance,
            "agrees": self.agrees,
            "pairs": [
                {
                    "reference": found.reference.name,
                    "name": found.other.name,
                    "verdict": self.verdict(k),
                    "agrees": None if self.tolerance is None else found.agrees(self.tolerance),
                    "boundaries": [shift.to_dict() for shift in found.shifts],
                    "equal_points": found.points,
                    "flipped": found.flipped,
                    "outcomes": [{"reference": a, "here": b, "points": n} for (a, b), n in found.changes.items()],
                    "notes": list(found.notes),
                }
                for k, found in enumerate(self.pairs)
            ],
        }

    def __str__(self) -> str:
        """What `cosim compare` prints."""
        lines = [f"{found.other.name}: {self.verdict(k)}" for k, found in enumerate(self.pairs)]
        notes = [f"  note: {note}" for found in self.pairs for note in found.notes]
        return "\n".join([f"reference: {self.maps[0].name}", *lines, *notes])


def _moved(found: MapPair, shift: BoundaryShift) -> str:
    """How a boundary has moved, with the axis that it moved along."""
    axis = found.reference.axes[found.reference.frame[-1]]
    label = f"boundary {shift.label}".strip()
    if not len(shift.shift):
        return f"{label}: {'in one of the two only' if shift.alone else 'nowhere side by side'}"
    told = shift.to_dict()
    unit, x = axis["unit"], found.reference.axes[found.reference.frame[0]]
    if found.reference.traced == 1:
        return f"{label} moved by {told['mean_shift']:+.4g} {unit}"
    where = f"at {x['name']} {told['greatest_at']:.4g} {x['unit']}".rstrip()
    most = f"at most {told['greatest_shift']:+.4g} {unit} {where}"
    return f"{label} moved by {told['mean_shift']:+.4g} {unit} on average along {axis['name']}, {most}"
