"""All delay laws up to a bound as combinations of a few: knots of the delay, and what lies between them."""

import itertools
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from attrs import field, frozen

from cosim.errors import InputError, Problem


def _steps(values) -> tuple[int, ...]:
    return tuple(int(v) for v in values)


def _knots(values) -> tuple[tuple[int, ...], ...]:
    return tuple(_steps(row) for row in values)


@frozen
class DelayGrid:
    """Ages 0..most in steps, looked at now and at some earlier moments k - lift, each time cut at its own knots.

    With y_j[k] = x[k - p_j] - x[k] over the points p_j = all lift + knot (but 0), what a law makes of x at a lift is
    x[k - lift - d] - x[k - lift]. With d at a knot that is one y less another; between two knots it is a mean of both
    plus a rest r, and the rest is small because it is the distance of x from its chord.

    slope: steps by which a delay changes in a step, at most, rounding to whole steps apart; None for any change.
    """

    lifts: tuple[int, ...] = field(converter=_steps)
    knots: tuple[tuple[int, ...], ...] = field(converter=_knots)
    slope: float | None = None

    def __attrs_post_init__(self) -> None:
        problems = [
            Problem(f"{name} of a delay grid", "steps that start at 0 and grow", str(values))
            for name, values in [("lifts", self.lifts), *(("knots", row) for row in self.knots)]
            if not values or values[0] != 0 or any(b <= a for a, b in itertools.pairwise(values))
        ]
        if len(self.knots) != len(self.lifts) or len({row[-1] for row in self.knots if row}) != 1 or self.most < 1:
            problems.append(
                Problem("knots of a delay grid", "a row a lift, each up to the same bound", str(self.knots))
            )
        if self.slope is not None and not 0.0 <= self.slope < np.inf:
            problems.append(Problem("slope of a delay grid", "a number >= 0, or None", str(self.slope)))
        if problems:
            raise InputError(problems)

    @property
    def most(self) -> int:
        """Largest age [steps]."""
        return self.knots[0][-1]

    @property
    def points(self) -> tuple[int, ...]:
        """Ages p_j > 0 [steps] at which the signals are looked at: lift + knot, sorted."""
        return tuple(sorted({lift + knot for lift, row in zip(self.lifts, self.knots) for knot in row} - {0}))

    def rows(self) -> list[np.ndarray]:
        """For each lift x[k - lift - knot] - x[k - lift] at its knots over the y_j, (knots, points), of 0, 1, -1."""
        unit = dict(zip((0, *self.points), np.vstack([np.zeros(len(self.points)), np.eye(len(self.points))])))
        return [np.array([unit[lift + k] - unit[lift] for k in row]) for lift, row in zip(self.lifts, self.knots)]

    def vertices(self) -> Iterator[np.ndarray]:
        """Every choice of one knot a lift that some law may be near, as a matrix (lifts, points).

        A law that changes little is at k and at k - lift in segments that are not far apart; the knots are those that
        bound such segments.
        """
        rows = self.rows()
        return (np.array([row[i] for row, i in zip(rows, choice)]) for choice in self._choices())

    def _choices(self) -> list[tuple[int, ...]]:
        segments = itertools.product(*(range(len(row) - 1) for row in self.knots))
        within = [cell for cell in segments if self._near(cell)]
        return sorted({choice for cell in within for choice in itertools.product(*((i, i + 1) for i in cell))})

    def _near(self, cell: tuple[int, ...]) -> bool:
        """Whether a law can be in these segments, one a lift."""
        if self.slope is None:
            return True
        ends = [(lift, row[i], row[i + 1]) for lift, row, i in zip(self.lifts, self.knots, cell)]
        return all(
            max(low - other_high, other_low - high) <= self.slope * abs(lift - other) + 1.0
            for (lift, low, high), (other, other_low, other_high) in itertools.combinations(ends, 2)
        )

    def rests(self) -> list[Fraction]:
        """For each lift R with sum_k r[k]^2 <= R sum_k (x[k+1] - 2 x[k] + x[k-1])^2 for every law.

        On a segment of n steps, t steps in, r = -sum_s G(s) Delta^2 x with Green's function G(s) = min(s, t)
        (n - max(s, t)) / n of the chord. By Schwarz r^2 <= (sum G^2) (sum over the segment of (Delta^2 x)^2); whichever
        segment the law is in at k, all segments together bound it, and summing over k counts each sample n - 1 times.
        """
        lengths = [[b - a for a, b in itertools.pairwise(row)] for row in self.knots]
        return [sum(((n - 1) * _chord(n) for n in row), Fraction(0)) for row in lengths]


def _chord(length: int) -> Fraction:
    """max over t of sum_s G(s)^2, about n^3 / 48."""
    up = [sum(s * s for s in range(t + 1)) for t in range(length + 1)]
    most = max((length - t) ** 2 * up[t] + t * t * up[length - t - 1] for t in range(1, length)) if length > 1 else 0
    return Fraction(most, length**2)


def uniform_grid(
    most: int, intervals: int, lifts: dict[int, int] | None = None, slope: float | None = None
) -> DelayGrid:
    """Ages 0..most [steps] in that many intervals, the last one the shortest.

    `lifts`: earlier moments, counted in intervals, each with the number of intervals that lie between its knots; {6: 2}
    looks six intervals back with every second knot.
    """
    width = -(-most // intervals)
    strides = {0: 1, **(lifts or {})}
    return DelayGrid(
        [lift * width for lift in strides],
        [[*range(0, most, stride * width), most] for stride in strides.values()],
        slope,
    )
