"""A random audit of a traced map: how much area can have been missed."""

from collections.abc import Generator, Iterator

import numpy as np
from attrs import field, frozen

from cosim.sweeps.boundary import Boundary, Precision, Tracer, trace_square
from cosim.sweeps.bracket import Places
from cosim.sweeps.quadtree import opposite


@frozen
class Audit:
    """Points of the last round, how many of them contradicted the map, and the bound on the missed share of the area.

    `bound`: with confidence `level`, less than this share of the square lies on the other side than the map says
    (beyond the tolerance from the boundary). `surprises` holds the places of all rounds that were found wrong (and
    traced afterwards).
    """

    points: int
    wrong: int
    bound: float
    level: float
    rounds: int
    surprises: tuple[tuple[float, float], ...] = field(default=())


def missed_area(wrong: int, points: int, level: float) -> float:
    """Upper Clopper-Pearson limit of a share when `wrong` of `points` independent ones show it; about 3 / points for
    none at 95 %.
    """
    if wrong == 0 and points > 0:
        return 1.0 - (1.0 - level) ** (1.0 / points)  # the same, and scipy.special is long to import
    from scipy.special import betaincinv

    return 1.0 if wrong >= points else float(betaincinv(wrong + 1, points - wrong, level))


@frozen
class AuditPlan:
    """How many random places a round, at most how many rounds, with which seed and confidence."""

    points: int = 60
    rounds: int = 4
    seed: int = 1
    level: float = 0.95

    def draws(self) -> Iterator[Places]:
        """Uniform random places for one round after the other, whatever the map is like."""
        rng = np.random.default_rng([self.seed, 77])
        while True:
            yield [(float(x), float(y)) for x, y in rng.uniform(0.0, 1.0, (self.points, 2))]


def audited(precision: Precision, plan: AuditPlan) -> Generator[Places, list[float], tuple[Boundary, Audit]]:
    """Trace, audit at uniform random places, refine where the audit was surprised, audit again at new places.

    The bound comes from the last round alone: its places are independent of the map they test.
    """
    boundary: Boundary = yield from trace_square(precision)
    surprises: list[tuple[float, float]] = []
    wrong: list[tuple[float, float]] = []
    turn = 0
    if plan.points == 0 or plan.rounds == 0:
        return boundary, Audit(0, 0, 1.0, plan.level, 0)
    for turn, places in zip(range(1, plan.rounds + 1), plan.draws()):
        values = yield places
        wrong = _contradictions(boundary, np.array(places), values, precision.tolerance)
        surprises += wrong
        if not wrong or turn == plan.rounds:
            break
        boundary = yield from _refined(boundary, wrong, precision)
    bound = missed_area(len(wrong), plan.points, plan.level)
    return boundary, Audit(plan.points, len(wrong), bound, plan.level, turn, tuple(surprises))


def _contradictions(
    boundary: Boundary, places: np.ndarray, values: list[float], tolerance: float
) -> list[tuple[float, float]]:
    predicted, distance = boundary.predicted(places), boundary.distance(places)
    return [
        (float(place[0]), float(place[1]))
        for place, value, sign, far in zip(places, values, predicted, distance)
        if opposite(value, sign) and far > tolerance
    ]


def _refined(boundary: Boundary, wrong: list[tuple[float, float]], precision: Precision) -> Tracer:
    """Split the cells that hold contradictions until a corner shares their sign, then trace on."""
    tree = boundary.tree
    assert tree is not None  # a boundary in the square keeps the tree it was found with
    for place in wrong:
        spot = tree.lattice.place(np.array(place))
        for _ in range(5):
            leaf = tree.leaf_at(spot)
            signs = {tree.values[corner] > 0 for corner in leaf.corners if np.isfinite(tree.values[corner])}
            if len(signs) > 1 or not tree.split(leaf):
                break
            nodes = tree.unknown()
            values = yield [tuple(float(x) for x in tree.lattice.position(node)) for node in nodes]
            tree.learn(nodes, values)
    return (yield from trace_square(precision, tree))
