"""Adaptive tracing of the stability boundary: where a growth rate changes sign, in one or two dimensions.

A tracer is a generator that yields lists of places in the unit interval or square, receives their growth rates (NaN:
unknown), and returns the boundary. It asks in rounds and decides from complete rounds only, so that its path does not
depend on how many workers answer or in which order.

Two dimensions: values on a jittered lattice; cells with doubtful signs are split (`quadtree`); each crossed edge gets
its zero by Chandrupatla's method; between two zeros the boundary is checked at the middle and moved along the gradient
until the sagitta of what is left is below the tolerance.
"""

import itertools
from collections.abc import Generator, Mapping

import numpy as np
from attrs import field, frozen

from cosim.sweeps.bracket import Bracket, Places, narrow
from cosim.sweeps.quadtree import Cell, Lattice, Node, Tree, each_edge, gradient, opposite

Tracer = Generator[Places, list[float], "Boundary"]

_TRACES = 5
"""How often a trace is begun again because the boundary left a cell unseen (places known are not asked for again)."""


@frozen
class Precision:
    """How finely to trace: `tolerance` in the unit box, `cells` first cells a side, `seed` of the jitter."""

    tolerance: float = 0.002
    cells: int = 8
    seed: int = 0


@frozen
class Boundary:
    """What a tracer found: curves (n, d) in the unit box, and in two dimensions the tree it found them with."""

    curves: tuple[np.ndarray, ...] = field(eq=False)
    tree: Tree | None = field(default=None, eq=False)

    def predicted(self, positions: np.ndarray) -> np.ndarray:
        """Sign (n,) that the traced boundary gives positions (n, 2): +1 unstable, -1 stable, 0 not known.

        The sign of the nearest known corner, turned once for each boundary segment between.
        """
        assert self.tree is not None  # in two dimensions there is one
        known = [(self.tree.lattice.position(n), v) for n, v in self.tree.values.items() if np.isfinite(v)]
        corners, signs = np.array([p for p, _ in known]), np.array([1.0 if v > 0 else -1.0 for _, v in known])
        positions = np.asarray(positions, float)
        if not known:
            return np.zeros(len(positions))
        nearest = np.argmin(np.sum((corners - positions[:, None]) ** 2, axis=2), axis=1)
        crossed = sum((_crossings(positions, corners[nearest], curve) for curve in self.curves), np.zeros(1, int))
        return signs[nearest] * (-1.0) ** crossed

    def distance(self, positions: np.ndarray) -> np.ndarray:
        """Distance (n,) of positions (n, 2) from the boundary in the unit box; inf where there is none."""
        if not self.curves:
            return np.full(len(positions), np.inf)
        return np.min([_distances(np.asarray(positions, float), curve) for curve in self.curves], axis=0)


# one dimension -------------------------------------------------------------------------------------------------------


def trace_line(precision: Precision) -> Tracer:
    """All sign changes along the unit interval that `cells` even steps can tell apart; curves are single places (1,
    1).
    """
    nodes = np.linspace(0.0, 1.0, precision.cells + 1)
    values = yield [(float(x),) for x in nodes]
    pairs = [k for k in range(precision.cells) if opposite(values[k], values[k + 1])]
    brackets = [Bracket(nodes[[k]], nodes[[k + 1]], values[k], values[k + 1]) for k in pairs]
    places = yield from narrow(brackets, precision.tolerance)
    return Boundary(tuple(place[None, :] for place in places))


# two dimensions ------------------------------------------------------------------------------------------------------


def trace_square(precision: Precision, tree: Tree | None = None) -> Tracer:
    """The boundary in the unit square; `tree` goes on from an earlier trace (after an audit has found something
    missed).
    """
    tree = tree or Tree(Lattice.jittered(precision.cells, precision.seed))
    yield from _complete(tree)
    for leaf in tree.suspicious():
        tree.split(leaf)
    yield from _complete(tree)
    lines: list[list[np.ndarray]] = []
    for _ in range(_TRACES):
        while any([tree.split(leaf) for leaf in tree.crowded()]):  # noqa: C419 - every leaf is split
            yield from _complete(tree)
        segments = yield from _segments(tree, precision.tolerance)
        lines, loose = yield from _bent(segments, tree, precision.tolerance)
        if not any([tree.split(leaf) for leaf in _around(tree, loose)]):  # noqa: C419 - every leaf is split
            break
        yield from _complete(tree)
    return Boundary(tuple(_joined(lines)), tree)


def _around(tree: Tree, places: list[np.ndarray]) -> list[Cell]:
    """Leaves that hold places where the boundary was not found across a chord: it runs on through an edge, as tips of
    tongues do.
    """
    return list(dict.fromkeys(tree.leaf_at(tree.lattice.place(place)) for place in places))


def _complete(tree: Tree) -> Generator[Places, list[float], None]:
    nodes = tree.unknown()
    if nodes:
        values = yield [tuple(float(x) for x in tree.lattice.position(node)) for node in nodes]
        tree.learn(nodes, values)


@frozen
class _BoundarySegment:
    """Two zeros on the edges of one leaf."""

    leaf: Cell
    start: np.ndarray = field(eq=False)
    end: np.ndarray = field(eq=False)


def _segments(tree: Tree, tolerance: float) -> Generator[Places, list[float], list[_BoundarySegment]]:
    """Zeros of all crossed edges, joined across leaves."""
    crossed = list(each_edge(tree))
    parts = list(dict.fromkeys(part for _, leaf_parts in crossed for part in leaf_parts))
    brackets = [_bracket(tree, part) for part in parts]
    zeros = dict(zip(parts, (yield from narrow(brackets, tolerance))))
    return [_BoundarySegment(leaf, zeros[p[0]], zeros[p[1]]) for leaf, p in crossed if len(p) == 2]


def _bracket(tree: Tree, part: tuple[Node, Node]) -> Bracket:
    low, high = part
    position = tree.lattice.position
    return Bracket(position(low), position(high), tree.values[low], tree.values[high])


@frozen
class _Chord:
    """A chord of line number `line` of the polylines, the gradient of the rate in its leaf, and where the boundary is
    expected across its middle.
    """

    line: int
    start: np.ndarray = field(eq=False)
    end: np.ndarray = field(eq=False)
    slope: np.ndarray = field(eq=False)
    expected: np.ndarray = field(eq=False)

    @property
    def middle(self) -> np.ndarray:
        """Middle of the chord (2,)."""
        return 0.5 * (self.start + self.end)

    @property
    def length(self) -> float:
        """Length of the chord in the unit box."""
        return float(np.linalg.norm(self.end - self.start))

    def step(self, value: float) -> np.ndarray:
        """Newton step (2,) from the expected place, across the chord, at most half its length."""
        normal = _normal(self.start, self.end)
        slope = float(self.slope @ normal)
        size = np.clip(-value / slope if slope != 0 else self.length, -0.5 * self.length, 0.5 * self.length)
        return size * normal


def _bent(
    segments: list[_BoundarySegment], tree: Tree, tolerance: float
) -> Generator[Places, list[float], tuple[list[list[np.ndarray]], list[np.ndarray]]]:
    """Polylines of all segments, bent until a chord leaves the boundary by less than the tolerance; and loose places.

    The zero across the middle of each chord becomes a vertex; the two new chords have a quarter of its sagitta, so
    that bending ends where the vertex lies within two tolerances of the chord. A place is loose where no zero was met
    across a chord.
    """
    lines, loose = [[s.start, s.end] for s in segments], []
    slopes = [gradient(tree.lattice, tree.values, segment.leaf) for segment in segments]
    todo = [(n, segment.start, segment.end) for n, segment in enumerate(segments)]
    for _ in range(5):
        near = _neighbours(lines)
        chords = [_Chord(n, a, b, slopes[n], _expected(a, b, near)) for n, a, b in todo]
        chords = [chord for chord in chords if chord.length > 2.0 * tolerance and np.all(np.isfinite(chord.slope))]
        if not chords:
            break
        vertices, lost = yield from _vertices(chords, tolerance)
        loose += lost
        todo = []
        for chord, vertex in zip(chords, vertices):
            lines[chord.line].insert(_index(lines[chord.line], chord.end), vertex)
            if np.linalg.norm(vertex - chord.middle) > 2.0 * tolerance:
                todo += [(chord.line, chord.start, vertex), (chord.line, vertex, chord.end)]
    return lines, loose


def _neighbours(lines: list[list[np.ndarray]]) -> dict[bytes, list[np.ndarray]]:
    """The vertices next to each vertex of the polylines; lines of leaves side by side have common ends."""
    near: dict[bytes, list[np.ndarray]] = {}
    for a, b in (pair for line in lines for pair in itertools.pairwise(line)):
        near.setdefault(a.tobytes(), []).append(b)
        near.setdefault(b.tobytes(), []).append(a)
    return near


def _expected(start: np.ndarray, end: np.ndarray, near: Mapping[bytes, list[np.ndarray]]) -> np.ndarray:
    """Where the boundary (2,) is expected across the middle of a chord: on the cubic through its ends and the vertices
    next to them, by the length of the chords; at most half the chord's length away.
    """
    before, after = ([p for p in near[a.tobytes()] if p is not b][:1] for a, b in ((start, end), (end, start)))
    points = np.array([*before, start, end, *after])
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at -= 0.5 * (at[len(before)] + at[len(before) + 1])
    others = ~np.eye(len(at), dtype=bool)
    weights = [np.prod(at[other] / (at[other] - x)) for x, other in zip(at, others)]
    middle, normal, most = 0.5 * (start + end), _normal(start, end), 0.5 * float(np.linalg.norm(end - start))
    return np.clip(middle + np.clip((weights @ points - middle) @ normal, -most, most) * normal, 0.0, 1.0)


def _normal(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Unit vector (2,) across a chord."""
    across = np.array([start[1] - end[1], end[0] - start[0]])
    return across / max(float(np.linalg.norm(across)), 1e-300)


def _vertices(
    chords: list[_Chord], tolerance: float
) -> Generator[Places, list[float], tuple[list[np.ndarray], list[np.ndarray]]]:
    """The zero across the middle of each chord: one Newton step from where it is expected where that is short, else
    bracketed and narrowed.

    Where no other sign is found within half the chord's length the expected place itself is returned, and is among the
    loose places.
    """
    values = yield [tuple(float(x) for x in chord.expected) for chord in chords]
    steps = [chord.step(v) if np.isfinite(v) else np.zeros(2) for chord, v in zip(chords, values)]
    found = [np.clip(chord.expected + step, 0.0, 1.0) for chord, step in zip(chords, steps)]
    far = [k for k, step in enumerate(steps) if np.linalg.norm(step) > 0.5 * tolerance]
    brackets = yield from _bracketed([(chords[k], values[k], steps[k]) for k in far])
    hits = [bracket for bracket in brackets if bracket is not None]
    zeros = iter((yield from narrow(hits, tolerance)))
    lost = []
    for k, bracket in zip(far, brackets):
        found[k] = next(zeros) if bracket is not None else chords[k].expected
        lost += [] if bracket is not None else [chords[k].expected, np.clip(chords[k].expected + steps[k], 0.0, 1.0)]
    return found, lost


def _bracketed(starts: list[tuple[_Chord, float, np.ndarray]]) -> Generator[Places, list[float], list[Bracket | None]]:
    """Brackets from the expected places along their steps, the steps tripled until the sign changes; None where it
    does not.
    """
    brackets: list[Bracket | None] = [None] * len(starts)
    reach = dict.fromkeys(range(len(starts)), 1.2)
    while reach:
        ends = {k: np.clip(starts[k][0].expected + reach[k] * starts[k][2], 0.0, 1.0) for k in reach}
        values = yield [tuple(float(x) for x in end) for end in ends.values()]
        for (k, end), value in zip(ends.items(), values):
            chord, at_expected, step = starts[k]
            if opposite(at_expected, value):
                brackets[k] = Bracket(chord.expected, end, at_expected, value)
                del reach[k]
            elif reach[k] * np.linalg.norm(step) >= 0.5 * chord.length or not np.isfinite(value):
                del reach[k]
            else:
                reach[k] *= 3.0
    return brackets


def _index(line: list[np.ndarray], point: np.ndarray) -> int:
    return next(k for k, other in enumerate(line) if other is point)


def _joined(lines: list[list[np.ndarray]]) -> list[np.ndarray]:
    """Lines with common ends put together to long curves (n, 2)."""
    pending = [list(line) for line in lines]
    curves = []
    while pending:
        curve = pending.pop(0)
        grown = True
        while grown:
            grown = False
            for k, line in enumerate(pending):
                if (joined := _join(curve, line)) is not None:
                    curve, grown = joined, True
                    del pending[k]
                    break
        curves.append(np.array(curve))
    return curves


def _join(one: list[np.ndarray], other: list[np.ndarray]) -> list[np.ndarray] | None:
    def same(a, b):
        return bool(np.all(np.abs(a - b) < 1e-12))

    if same(one[-1], other[0]):
        return one + other[1:]
    if same(one[-1], other[-1]):
        return one + other[-2::-1]
    if same(one[0], other[-1]):
        return other[:-1] + one
    if same(one[0], other[0]):
        return other[:0:-1] + one
    return None


# geometry ------------------------------------------------------------------------------------------------------------


def _crossings(a: np.ndarray, b: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """How often each segment a-b, ends (k, 2), crosses a polyline (n, 2): (k,)."""
    a, b, p, q = a[:, None], b[:, None], curve[:-1], curve[1:]

    def side(u, v, w):
        return (v[..., 0] - u[..., 0]) * (w[..., 1] - u[..., 1]) - (v[..., 1] - u[..., 1]) * (w[..., 0] - u[..., 0])

    apart = (side(p, q, a) > 0) != (side(p, q, b) > 0)
    between = (side(a, b, p) > 0) != (side(a, b, q) > 0)
    return np.sum(apart & between, axis=1)


def _distances(positions: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """Distance (k,) of positions (k, 2) from a polyline (n, 2)."""
    if len(curve) == 1:
        return np.linalg.norm(positions - curve[0], axis=1)
    positions, p, d = positions[:, None], curve[:-1], np.diff(curve, axis=0)
    length = np.maximum(np.sum(d * d, axis=1), 1e-300)
    s = np.clip(np.sum((positions - p) * d, axis=2) / length, 0.0, 1.0)
    return np.min(np.linalg.norm(p + s[:, :, None] * d - positions, axis=2), axis=1)
