"""Adaptive tracing of the stability boundary: where a growth rate changes sign, in one or two dimensions.

A tracer is a generator that yields lists of places in the unit interval or square, receives their growth rates (NaN:
unknown), and returns the boundary. It asks in rounds and decides from complete rounds only, so that its path does not
depend on how many workers answer or in which order.

Two dimensions: values on a jittered lattice; cells with doubtful signs are split (`quadtree`); each crossed edge gets
its zero by Chandrupatla's method; between two zeros the boundary is checked at the middle and moved along the gradient
until the sagitta of what is left is below the tolerance.
"""

import itertools
from collections.abc import Generator, Iterator, Mapping
from typing import final

import numpy as np
from attrs import field, frozen

from cosim.sweeps.bracket import Bracket, Places, as_place, side_by_side, zero
from cosim.sweeps.quadtree import Cell, Lattice, Node, Tree, each_edge, gradient, opposite

Tracer = Generator[Places, list[float], "Boundary"]

_TRACES = 5
"""How often a trace is begun again because the boundary left a cell unseen (places known are not asked for again)."""
_BENDS = 5
"""How often a line is bent at most: each time its chords become half as long."""


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
    zeros: dict[int, np.ndarray] = {}

    def keep(k: int, place: np.ndarray) -> tuple[()]:
        zeros[k] = place
        return ()

    yield from side_by_side(((k, zero(b, precision.tolerance)) for k, b in enumerate(brackets)), keep)
    return Boundary(tuple(zeros[k][None, :] for k in sorted(zeros)))


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
        outline = _Outline(tree, precision.tolerance)
        yield from side_by_side(outline.hunts(), outline.goes_on)
        lines = [outline.lines[n] for n in sorted(outline.lines)]
        if not any([tree.split(leaf) for leaf in _around(tree, outline.loose)]):  # noqa: C419 - every leaf is split
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
        values = yield [as_place(tree.lattice.position(node)) for node in nodes]
        tree.learn(nodes, values)


def _bracket(tree: Tree, part: tuple[Node, Node]) -> Bracket:
    low, high = part
    position = tree.lattice.position
    return Bracket(position(low), position(high), tree.values[low], tree.values[high])


@frozen
class _Chord:
    """A chord of line number `line`, how often that was bent before, the gradient of the rate in its leaf, and where
    the boundary is expected across its middle.
    """

    line: int
    depth: int
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


_Part = tuple[Node, Node]
_Search = Generator[Places, list[float], "np.ndarray | _Vertex"]


@final
class _Outline:
    """The boundary as it becomes known in the leaves of a tree: zeros of the crossed edges, joined across each leaf,
    and lines bent between them until a chord leaves the boundary by less than the tolerance.

    The zero across the middle of each chord becomes a vertex; the two new chords have a quarter of its sagitta, so
    that bending ends where the vertex lies within two tolerances of the chord. A line is bent as soon as its zeros and
    those beside them are known. A place is loose where no zero was met across a chord.
    """

    def __init__(self, tree: Tree, tolerance: float) -> None:
        crossed = list(each_edge(tree))
        self.tree, self.tolerance = tree, tolerance
        self.parts: list[_Part] = list(dict.fromkeys(part for _, parts in crossed for part in parts))
        self.leaves: list[Cell] = [leaf for leaf, parts in crossed if len(parts) == 2]
        self.ends: list[tuple[_Part, _Part]] = [(parts[0], parts[1]) for _, parts in crossed if len(parts) == 2]
        self.zeros: dict[_Part, np.ndarray] = {}
        self.lines: dict[int, list[np.ndarray]] = {}
        self.bent: set[int] = set()
        self.loose: list[np.ndarray] = []

    def hunts(self) -> Iterator[tuple["_Part | _Chord", _Search]]:
        """For the zeros of all crossed edges."""
        return ((part, zero(_bracket(self.tree, part), self.tolerance)) for part in self.parts)

    def goes_on(self, key: "_Part | _Chord", found: "np.ndarray | _Vertex") -> list[tuple["_Part | _Chord", _Search]]:
        """What is searched for after a zero or a vertex was found."""
        if isinstance(key, _Chord):
            assert isinstance(found, _Vertex)  # what is found across a chord
            chords = self._bend(key, found)
        else:
            assert isinstance(found, np.ndarray)
            chords = self._joins(key, found)
        long = [chord for chord in chords if chord.length > 2.0 * self.tolerance and np.all(np.isfinite(chord.slope))]
        return [(chord, _vertex(chord, self.tolerance)) for chord in long]

    def _joins(self, part: _Part, place: np.ndarray) -> list["_Chord"]:
        """The chords that can be bent now that one more zero is known."""
        self.zeros[part] = place
        for n, (one, other) in enumerate(self.ends):
            if n not in self.lines and one in self.zeros and other in self.zeros:
                self.lines[n] = [self.zeros[one], self.zeros[other]]
        ready = [n for n in self.lines if n not in self.bent and all(m in self.lines for m in self._beside(n))]
        self.bent.update(ready)
        return [self._chord(n, 0, *self.lines[n]) for n in sorted(ready)]

    def _beside(self, n: int) -> list[int]:
        """A line and those that share an end with it."""
        return [m for m, parts in enumerate(self.ends) if set(parts) & set(self.ends[n])]

    def _chord(self, n: int, depth: int, start: np.ndarray, end: np.ndarray) -> "_Chord":
        near = _neighbours([self.lines[m] for m in self._beside(n)])
        slope = gradient(self.tree.lattice, self.tree.values, self.leaves[n])
        return _Chord(n, depth, start, end, slope, _expected(start, end, near))

    def _bend(self, chord: "_Chord", found: "_Vertex") -> list["_Chord"]:
        """A line with one more vertex, and its chords that are to be bent again."""
        line, vertex = self.lines[chord.line], found.place
        line.insert(_index(line, chord.end), vertex)
        self.loose += found.lost
        if chord.depth == _BENDS - 1 or np.linalg.norm(vertex - chord.middle) <= 2.0 * self.tolerance:
            return []
        ends = (chord.start, vertex), (vertex, chord.end)
        return [self._chord(chord.line, chord.depth + 1, *pair) for pair in ends]


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


@frozen
class _Vertex:
    """What was found across the middle of a chord, and where a zero was looked for but not met."""

    place: np.ndarray = field(eq=False)
    lost: tuple[np.ndarray, ...] = field(default=(), eq=False)


def _vertex(chord: _Chord, tolerance: float) -> Generator[Places, list[float], _Vertex]:
    """The zero across the middle of a chord: one Newton step from where it is expected where that is short, else
    bracketed and narrowed.

    Where no other sign is found within half the chord's length the expected place itself is returned, and is lost.
    """
    (value,) = yield [as_place(chord.expected)]
    step = chord.step(value) if np.isfinite(value) else np.zeros(2)
    there = np.clip(chord.expected + step, 0.0, 1.0)
    if np.linalg.norm(step) <= 0.5 * tolerance:
        return _Vertex(there)
    bracket = yield from _bracketed(chord, value, step)
    if bracket is None:
        return _Vertex(chord.expected, (chord.expected, there))
    return _Vertex((yield from zero(bracket, tolerance)))


def _bracketed(chord: _Chord, value: float, step: np.ndarray) -> Generator[Places, list[float], Bracket | None]:
    """A bracket from the expected place, which has the rate `value`, along a step that is tripled until the sign
    changes; None where it does not.
    """
    reach = 1.2
    while True:
        end = np.clip(chord.expected + reach * step, 0.0, 1.0)
        (there,) = yield [as_place(end)]
        if opposite(value, there):
            return Bracket(chord.expected, end, value, there)
        if reach * np.linalg.norm(step) >= 0.5 * chord.length or not np.isfinite(there):
            return None
        reach *= 3.0


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
