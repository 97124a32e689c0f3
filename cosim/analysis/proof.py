"""Checks a certificate without optimising: fractions for its forms, balls (Arb) for its frequencies.

The theorem is in ANY_DELAY.md. Every step is exact or encloses what is exact; the only floats are those that the file
holds, and they are taken as the rational numbers that they are.
"""

import itertools
import math
from fractions import Fraction
from functools import lru_cache

import numpy as np
from attrs import frozen

from cosim.analysis.certificate import Certificate, Multiplier
from cosim.analysis.delay_grid import DelayGrid
from cosim.analysis.response import Response

_SMALLEST = 1e-9
"""Width of a frequency interval [rad/step] below which a certificate is given up."""


@frozen
class Check:
    """One condition of the theorem: whether it was proven, and what was seen."""

    condition: str
    holds: bool
    seen: str


@frozen
class Proof:
    """Outcome of `verify`: all conditions with what was seen; the claim is proven where each one holds."""

    checks: tuple[Check, ...]

    @property
    def holds(self) -> bool:
        """Whether every condition was proven."""
        return all(check.holds for check in self.checks)


def proven(certificate: Certificate) -> Proof:
    """Proves or does not prove the claim of a certificate; a False says that this proof fails, not that the loop grows.

    1. The loop without delay is stable: A is Schur, by an exact Lyapunov inequality.
    2. No delay law makes a multiplier negative: exact positive definiteness at each vertex, concave in each law.
    3. On the loop's response their sum is negative at every frequency of [0, pi]: interval by interval, in balls.
    """
    return Proof((_schur(certificate), _concave(certificate), _vertices(certificate), _response(certificate)))


def _exact(matrix: np.ndarray) -> list[list[Fraction]]:
    return [[Fraction(value) for value in row] for row in np.asarray(matrix, dtype=object)]


def _times(a: list[list[Fraction]], b: list[list[Fraction]]) -> list[list[Fraction]]:
    columns = list(zip(*b))
    return [[sum((x * y for x, y in zip(row, column) if x and y), Fraction(0)) for column in columns] for row in a]


def positive_definite(matrix: list[list[Fraction]]) -> bool:
    """Whether an exact symmetric matrix is positive definite: all pivots of its elimination are positive.

    Counted in integers (Bareiss 1968): the k-th pivot is the k-th leading minor, up to a positive factor.
    """
    scale = math.lcm(*(value.denominator for row in matrix for value in row))
    rows = [[int(value * scale) for value in row] for row in matrix]
    before = 1
    for k in range(len(rows)):
        pivot = rows[k][k]
        if pivot <= 0:
            return False
        for i in range(k + 1, len(rows)):
            for j in range(k + 1, len(rows)):
                rows[i][j] = (rows[i][j] * pivot - rows[i][k] * rows[k][j]) // before
        before = pivot
    return True


def _schur(certificate: Certificate) -> Check:
    from scipy.linalg import solve_discrete_lyapunov

    transition = certificate.loop.transition
    size = float(np.abs(np.linalg.eigvals(transition)).max())
    name = "the loop without delay is stable"
    if not size < 1.0:
        return Check(name, False, f"spectral radius {size:.9g}")
    guess = solve_discrete_lyapunov(transition.T, np.eye(len(transition)))
    p, a = _exact(0.5 * (guess + guess.T)), _exact(transition)
    after = _times(_times(list(map(list, zip(*a))), p), a)
    left = [[x - y for x, y in zip(row, other)] for row, other in zip(p, after)]
    return Check(name, positive_definite(p) and positive_definite(left), f"spectral radius {size:.9g}")


def _concave(certificate: Certificate) -> Check:
    lifts = len(certificate.grid.lifts)
    if certificate.grid.slope is not None:
        holds = all(positive_definite(_exact(-m.form[:lifts, :lifts])) for m in certificate.multipliers)
        return Check("each multiplier is concave in all laws at once", holds, f"{lifts} moments")
    most = max(float(np.diag(m.form)[:lifts].max()) for m in certificate.multipliers)
    return Check("each multiplier is concave in each law", most <= 0.0, f"largest curvature {most:.3g}")


def _vertices(certificate: Certificate) -> Check:
    counts = [_good(certificate.grid, m.form.tobytes(), m.rests.tobytes()) for m in certificate.multipliers]
    count = len(counts) * sum(1 for _ in certificate.grid.vertices())
    return Check("no delay law makes a multiplier negative", sum(counts) == count, f"{sum(counts)} of {count} vertices")


@lru_cache(maxsize=32)
def _good(grid: DelayGrid, form: bytes, rests: bytes) -> int:
    """Number of vertices at which a multiplier (as its bytes) is positive; loops of one file often share theirs."""
    size = len(grid.lifts) + len(grid.points)
    multiplier = Multiplier(np.frombuffer(form).reshape(size, size), np.frombuffer(rests))
    exact = _exact(multiplier.form)
    return sum(positive_definite(_at_vertex(exact, multiplier, vertex)) for vertex in grid.vertices())


def _at_vertex(form: list[list[Fraction]], multiplier: Multiplier, vertex: np.ndarray) -> list[list[Fraction]]:
    """The form over (y, r) where w = vertex y + r, with the rests; exact."""
    lifts, points = vertex.shape
    whole = _exact(np.block([[vertex, np.eye(lifts)], [np.eye(points), np.zeros((points, lifts))]]))
    total = _times(_times(list(map(list, zip(*whole))), form), whole)
    for i in range(lifts):
        total[points + i][points + i] += Fraction(float(multiplier.rests[i]))
    return total


def _response(certificate: Certificate) -> Check:
    """Negative on [0, pi]: halves each interval until the enclosure of the form on it is negative."""
    response = Response(certificate)
    # pi lies below 22/7; the response has the period 2 pi, so a little more does no harm
    edges = [Fraction(0), *(Fraction(22, 7) * Fraction(2) ** -k for k in range(14, -1, -1))]
    todo = list(itertools.pairwise(edges))
    done = 0
    while todo:
        low, high = todo.pop()
        if response.negative(low, high):
            done += 1
        elif high - low < _SMALLEST:
            return Check("the sum is negative at every frequency", False, f"not near {float(low):.9g} rad/step")
        else:
            middle = (low + high) / 2
            todo += [(low, middle), (middle, high)]
    return Check("the sum is negative at every frequency", True, f"{done} intervals of [0, pi]")
