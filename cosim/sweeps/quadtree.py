"""A quadtree of cells over the unit square with a value at every corner, refined where the sign of the value changes.

Corners live on an integer lattice of `cells * 2**DEPTH` steps a side; grid lines are moved by a seed so that no
problem can be aligned with them. Values that are NaN (nothing known) take no part.
"""

import itertools
from collections.abc import Iterator, Mapping

import numpy as np
from attrs import field, frozen

DEPTH = 6
"""Finest cells are 2**-6 of the first ones."""

Node = tuple[int, int]


@frozen
class Cell:
    """A square of the lattice: lower left corner and side, in lattice steps."""

    i: int
    j: int
    side: int

    @property
    def corners(self) -> tuple[Node, Node, Node, Node]:
        """Corners, counter-clockwise from the lower left."""
        i, j, s = self.i, self.j, self.side
        return (i, j), (i + s, j), (i + s, j + s), (i, j + s)

    @property
    def edges(self) -> tuple[tuple[Node, Node], ...]:
        """Edges as pairs of nodes in ascending order."""
        a, b, c, d = self.corners
        return (a, b), (b, c), (d, c), (a, d)

    def children(self) -> tuple["Cell", "Cell", "Cell", "Cell"]:
        """The four quarters."""
        h = self.side // 2
        return (
            Cell(self.i, self.j, h),
            Cell(self.i + h, self.j, h),
            Cell(self.i, self.j + h, h),
            Cell(self.i + h, self.j + h, h),
        )

    def holds(self, place: tuple[float, float]) -> bool:
        """Whether a place in lattice units lies inside."""
        return self.i <= place[0] <= self.i + self.side and self.j <= place[1] <= self.j + self.side


@frozen
class Lattice:
    """Where the lattice lies in the unit square: grid lines of the first cells (cells + 1,) along both directions."""

    lines: tuple[np.ndarray, np.ndarray] = field(eq=False)

    @classmethod
    def jittered(cls, cells: int, seed: int) -> "Lattice":
        """Even grid lines, the inner ones moved by up to a fifth of a cell by `seed`."""
        rng = np.random.default_rng(seed)
        lines = []
        for _ in range(2):
            line = np.linspace(0.0, 1.0, cells + 1)
            line[1:-1] += rng.uniform(-0.2, 0.2, cells - 1) / cells
            lines.append(line)
        return cls(tuple(lines))

    @property
    def cells(self) -> int:
        """Number of first cells a side."""
        return len(self.lines[0]) - 1

    def roots(self) -> list[Cell]:
        """The first cells."""
        side = 2**DEPTH
        return [Cell(i * side, j * side, side) for i in range(self.cells) for j in range(self.cells)]

    def position(self, node: tuple[float, float]) -> np.ndarray:
        """Place (2,) in the unit square of a node or of a place between nodes."""
        steps = 2**DEPTH * np.arange(self.cells + 1)
        return np.array([np.interp(node[k], steps, self.lines[k]) for k in (0, 1)])

    def place(self, position: np.ndarray) -> tuple[float, float]:
        """The inverse of `position`."""
        steps = 2**DEPTH * np.arange(self.cells + 1)
        x, y = (float(np.interp(position[k], self.lines[k], steps)) for k in (0, 1))
        return x, y


class Tree:
    """Leaves of the quadtree and the values known at nodes."""

    def __init__(self, lattice: Lattice) -> None:
        self.lattice = lattice
        self.leaves: dict[Cell, None] = dict.fromkeys(lattice.roots())
        self.values: dict[Node, float] = {}

    def unknown(self) -> list[Node]:
        """Corners of leaves whose value is not known yet, each once, in a fixed order."""
        wanted = dict.fromkeys(node for leaf in self.leaves for node in leaf.corners)
        return [node for node in wanted if node not in self.values]

    def learn(self, nodes: list[Node], values: list[float]) -> None:
        """Keep the values of nodes."""
        self.values.update(zip(nodes, (float(v) for v in values)))

    def split(self, leaf: Cell) -> bool:
        """Replace a leaf by its quarters; False where it is as small as the lattice allows."""
        if leaf.side < 2:
            return False
        del self.leaves[leaf]
        self.leaves.update(dict.fromkeys(leaf.children()))
        return True

    def leaf_at(self, place: tuple[float, float]) -> Cell:
        """A leaf that holds the place."""
        return next(leaf for leaf in self.leaves if leaf.holds(place))

    def along(self, edge: tuple[Node, Node]) -> list[Node]:
        """Known nodes on an edge from end to end, those of finer neighbours included."""
        low, high = edge
        return [node for node in (low, *self._between(low, high), high) if node in self.values]

    def _between(self, low: Node, high: Node) -> tuple[Node, ...]:
        """Known nodes between two: a cell is halved, so that there are none where the middle is not known."""
        middle = (low[0] + high[0]) // 2, (low[1] + high[1]) // 2
        if middle == low or middle not in self.values:
            return ()
        return *self._between(low, middle), middle, *self._between(middle, high)

    def sign_changes(self, edge: tuple[Node, Node]) -> list[tuple[Node, Node]]:
        """Parts of an edge between neighbouring known nodes where the sign changes."""
        nodes = self.along(edge)
        return [pair for pair in itertools.pairwise(nodes) if opposite(self.values[pair[0]], self.values[pair[1]])]

    def crowded(self) -> list[Cell]:
        """Leaves that a single boundary segment cannot describe: an edge crossed twice, or four edges crossed."""
        found = []
        for leaf in self.leaves:
            counts = [len(self.sign_changes(edge)) for edge in leaf.edges]
            if max(counts) > 1 or sum(counts) > 2:
                found.append(leaf)
        return found

    def suspicious(self) -> list[Cell]:
        """First-size leaves of one sign that may hide two sign changes: a cubic through an edge's values and slopes
        leaves the sign.

        Slopes at the ends are central differences over the first cells; the dip of the cubic is taken 1.5 times.
        """
        found: dict[Cell, None] = {}
        side = 2**DEPTH
        for leaf in self.leaves:
            if leaf.side == side and any(self._may_cross(edge, side) for edge in leaf.edges):
                found[leaf] = None
        return list(found)

    def _may_cross(self, edge: tuple[Node, Node], side: int) -> bool:
        (i0, j0), (i1, j1) = edge
        di, dj = (i1 - i0) // side, (j1 - j0) // side
        four = [self.values.get((i0 + k * di * side, j0 + k * dj * side), np.nan) for k in (-1, 0, 1, 2)]
        before, a, b, after = four
        if not np.isfinite(a) or not np.isfinite(b) or a * b <= 0:
            return False
        slope_a = 0.5 * (b - before) if np.isfinite(before) else b - a
        slope_b = 0.5 * (after - a) if np.isfinite(after) else b - a
        if 1.5 * 4 / 27 * (abs(slope_a - b + a) + abs(slope_b - b + a)) < min(abs(a), abs(b)):  # s (1 - s)^2 <= 4 / 27
            return False
        s = np.linspace(0.0, 1.0, 17)
        line = a + (b - a) * s
        cubic = (
            (1 + 2 * s) * (1 - s) ** 2 * a
            + s * (1 - s) ** 2 * slope_a
            + s * s * (3 - 2 * s) * b
            + s * s * (s - 1) * slope_b
        )
        return bool(np.any((line + 1.5 * (cubic - line)) * a < 0))


def opposite(a: float, b: float) -> bool:
    """Whether two known values have different signs (zero counts as negative: on the boundary is stable)."""
    return bool(np.isfinite(a) and np.isfinite(b) and (a > 0) != (b > 0))


def gradient(lattice: Lattice, values: Mapping[Node, float], leaf: Cell) -> np.ndarray:
    """Gradient (2,) of the plane fitted to the corner values of a leaf, in unit coordinates; NaN where a corner is
    unknown.
    """
    points = np.array([lattice.position(corner) for corner in leaf.corners])
    z = np.array([values.get(corner, np.nan) for corner in leaf.corners])
    if not np.all(np.isfinite(z)):
        return np.full(2, np.nan)
    plane = np.linalg.lstsq(np.column_stack([points, np.ones(4)]), z, rcond=None)[0]
    return plane[:2]


def each_edge(tree: Tree) -> Iterator[tuple[Cell, list[tuple[Node, Node]]]]:
    """Leaves that the boundary passes, with the crossed parts of their edges."""
    for leaf in tree.leaves:
        parts = [part for edge in leaf.edges for part in tree.sign_changes(edge)]
        if parts:
            yield leaf, parts
