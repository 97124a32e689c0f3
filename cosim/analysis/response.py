"""The quadratic form of a certificate on the response of its loop, enclosed over intervals of frequency by balls.

The only importer of `flint`. A pair (value, slope) is a quantity and its derivative by the frequency.
"""

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

import numpy as np

from cosim.analysis.certificate import Certificate
from cosim.errors import InputError, Problem

_BITS = 80
_NARROW = Fraction(3, 2)
"""Ends of an interval over each other up to which the response is enclosed well as a whole."""


class Response:
    """F(w) = sum_c Phi_c^* P_c Phi_c + rests R |Delta^2 x_c|^2, a Hermitian (p, p), with its derivative."""

    def __init__(self, certificate: Certificate) -> None:
        flint = _flint()
        self._flint = flint
        self._loop, self._grid, self._uses = certificate.loop, certificate.grid, certificate.uses
        self._a, self._b = (self._matrix(m) for m in (certificate.loop.transition, certificate.loop.drive))
        self._c, self._d = (self._matrix(m) for m in (certificate.loop.moved, certificate.loop.moved_now))
        self._forms = [self._matrix(m.form) for m in certificate.multipliers]
        self._blocks = [self._parted(form) for form in self._forms]
        self._sizes = [self._sized(form) for form in self._forms]
        bounds = [flint.arb(flint.fmpq(r.numerator, r.denominator)) for r in certificate.grid.rests()]
        self._bends = [
            sum((bound * flint.arb(float(r)) for bound, r in zip(bounds, m.rests)), flint.arb(0))
            for m in certificate.multipliers
        ]

    def negative(self, low: Fraction, high: Fraction) -> bool:
        """Whether F is proven negative definite on [low, high]: F(middle) + F'([low, high]) (w - middle).

        With V the eigenvectors at the middle V^* F V is nearly diagonal; where its negative has dominant positive
        diagonals (Gershgorin), V is regular and F negative definite.
        """
        with self._flint.ctx.workprec(_BITS):
            return self._negative(low, high)

    def _negative(self, low: Fraction, high: Fraction) -> bool:
        arb, acb_mat = self._flint.arb, self._flint.acb_mat
        middle, reach = self._interval(low, high)
        try:
            around = self._increments(middle + reach)
            if high <= low * _NARROW and self._quiet(low, high, around[0]):
                return True
            (value, _), (_, slope) = self._form(middle, self._increments(middle)), self._form(middle + reach, around)
        except ZeroDivisionError:  # z - A may be singular somewhere in a ball this wide
            return False
        p = self._loop.channels
        frame = np.linalg.eigh(_floats(value))[1]
        turn = acb_mat([[complex(frame[i, j]) for j in range(p)] for i in range(p)])
        both = _star(turn) * (value + slope * self._flint.acb(reach)) * turn
        return all(
            bool((both[i, i].real + sum((abs(both[i, j]) for j in range(p) if j != i), arb(0))) < 0) for i in range(p)
        )

    def _interval(self, low: Fraction, high: Fraction) -> tuple[Any, Any]:
        """The middle, and a ball about zero as wide as the interval."""
        return self._ball((low + high) / 2), self._flint.arb(0, 1) * self._ball((high - low) / 2)

    def _quiet(self, low: Fraction, high: Fraction, moved) -> bool:
        """Whether F < 0 whatever the phases of all delays on [low, high] are: where the loop hardly answers any more.

        With h the sizes of H, |x[k-p] - x[k]| <= min(p, 1/sin(w/2)) |x[k+1] - x[k]|, so that v^* F v <= |v|^T S |v|
        with S = diag(a) + (b h + its transpose) + h^T c h, of the sums a, b, c of the form's entries; S < 0 by its
        rows. moved: H on all of the interval.
        """
        arb, p = self._flint.arb, self._loop.channels
        edges = [(self._ball(edge) / 2).sin() for edge in (low, high)]
        still = 1 / edges[0].min(edges[1])
        h = [[abs(moved[c, k]) for k in range(p)] for c in range(p)]
        reach = self._flint.arb_mat([[arb(point).min(still)] for point in self._grid.points])
        sums = [self._sums(group, reach) for group in range(len(self._forms))]
        a, b, c = zip(*(sums[group] for group in self._uses))
        rows = [
            a[k]
            + sum((b[k] * h[k][m] + b[m] * h[m][k] for m in range(p)), arb(0))
            + sum((c[n] * h[n][k] * h[n][m] for n in range(p) for m in range(p)), arb(0))
            for k in range(p)
        ]
        return all(bool(row < 0) for row in rows)

    def _sums(self, group: int, reach) -> tuple[Any, Any, Any]:
        """What a form of a group is at most, over |w|^2, |w| |x[k+1] - x[k]| and |x[k+1] - x[k]|^2.

        reach: what stands for the sum behind each point, (points, 1).
        """
        own, cross, square = self._sizes[group]
        return own, (cross * reach)[0, 0], (reach.transpose() * (square * reach))[0, 0] + 4 * self._bends[group]

    def _parted(self, form) -> tuple[Any, Any, Any]:
        """A form's blocks: lifts by lifts, lifts by points, points by points."""
        lifts, size = range(len(self._grid.lifts)), range(len(self._grid.lifts), form.nrows())

        def block(rows: range, columns: range) -> Any:
            return self._flint.acb_mat([[form[i, j] for j in columns] for i in rows])

        return block(lifts, lifts), block(lifts, size), block(size, size)

    def _sized(self, form) -> tuple[Any, Any, Any]:
        """Sums of the sizes of a form's entries: of the lifts, whose diagonal keeps its sign; of the lifts by point
        (1, points); and the sizes of those of the points (points, points).
        """
        flint, lifts, size = self._flint, len(self._grid.lifts), form.nrows()
        with flint.ctx.workprec(_BITS):
            own = sum((form[i, i].real for i in range(lifts)), flint.arb(0))
            own += sum((abs(form[i, j]) for i in range(lifts) for j in range(lifts) if i != j), flint.arb(0))
            cross = [sum((abs(form[i, j]) for i in range(lifts)), flint.arb(0)) for j in range(lifts, size)]
            square = [[abs(form[i, j]) for j in range(lifts, size)] for i in range(lifts, size)]
        return own, flint.arb_mat([cross]), flint.arb_mat(square)

    def _form(self, w, increments):
        """F(w) and F'(w) at a ball w, given `_increments` there.

        With h the row of H of channel c and e its unit row, Phi_c = (l e, s h) for the columns l of the lifts and s of
        the points, so that Phi_c^* P Phi_c = a e^T e + e^T b h + (e^T b h)^* + q h^* h: what is wide in a wide ball
        stands in numbers, once. Summed up is a half, to which its adjoint is added.
        """
        flint, p = self._flint, self._loop.channels
        value, slope = flint.acb_mat(p, p), flint.acb_mat(p, p)
        numbers = self._numbers(w)
        for c, g in enumerate(self._uses):
            (a, b, q), (da, db, dq) = numbers[g]
            h, dh = (flint.acb_mat([[matrix[c, k] for k in range(p)]]) for matrix in increments)
            unit = flint.acb_mat([[int(k == c)] for k in range(p)])
            value += unit * (a / 2 * _star(unit) + b * h) + _star(h) * (q / 2 * h)
            slope += unit * (da / 2 * _star(unit) + db * h + b * dh) + _star(dh) * (q / 2 * h)
            slope += _star(h) * (dq / 2 * h + q / 2 * dh)
        return value + _star(value), slope + _star(slope)

    def _numbers(self, w) -> list[Any]:
        """Of each group a = l^* P l, b = l^* P s and q = s^* P s + rests |1 - 1/z|^2, and their derivatives."""
        late, dlate = self._columns(self._late(w, lift) for lift in self._grid.lifts)
        back, dback = self._columns(self._back(w))
        one, done = self._late(w, 1)
        bend, dbend = abs(1 - one) ** 2, -2 * ((1 - one).conjugate() * done).real
        found = []
        for (own, cross, far), rests in zip(self._blocks, self._bends):
            left, right = _star(late) * own, _star(back) * far
            a, da = (left * late)[0, 0].real, 2 * (left * dlate)[0, 0].real
            b, db = (
                (_star(late) * cross * back)[0, 0],
                (_star(dlate) * cross * back + _star(late) * cross * dback)[0, 0],
            )
            q, dq = (right * back)[0, 0].real, 2 * (right * dback)[0, 0].real
            found.append(((a, b, q + rests * bend), (da, db, dq + rests * dbend)))
        return found

    def _columns(self, pairs: Iterable[tuple[Any, Any]]) -> tuple[Any, Any]:
        """Values and slopes as columns (n, 1)."""
        values, slopes = zip(*pairs)
        return tuple(self._flint.acb_mat([[one] for one in some]) for some in (values, slopes))

    def _increments(self, w):
        """H(w) = C (z - A)^-1 B + D and its derivative -C (z - A)^-1 i z (z - A)^-1 B."""
        flint, n = self._flint, self._a.nrows()
        z = (flint.acb(0, 1) * flint.acb(w)).exp()
        inner = flint.acb_mat([[z if i == j else 0 for j in range(n)] for i in range(n)]) - self._a
        inner = inner.inv()
        state = inner * self._b
        return self._c * state + self._d, self._c * (inner * state) * (-flint.acb(0, 1) * z)

    def _late(self, w, steps: int):
        """z^-steps and its derivative."""
        flint = self._flint
        turn = (flint.acb(0, -steps) * flint.acb(w)).exp()
        return turn, turn * flint.acb(0, -steps)

    def _back(self, w):
        """x[k - p] - x[k] over x[k+1] - x[k] at each point p: minus the sum of z^-s for s = 1..p, with derivatives."""
        sums, found, before = {}, [], 0
        total, dtotal = self._flint.acb(0), self._flint.acb(0)
        for point in self._grid.points:
            stretch = point - before
            if stretch not in sums:
                sums[stretch] = self._summed(w, stretch)
            (part, dpart), (late, dlate) = sums[stretch], self._late(w, before)
            total, dtotal = total - late * part, dtotal - late * dpart - dlate * part
            found.append((total, dtotal))
            before = point
        return found

    def _summed(self, w, steps: int):
        """sum of z^-s for s = 1..steps, by halves: S(2n) = S(n) (1 + z^-n), no division by 1 - z."""
        if steps == 1:
            return self._late(w, 1)
        n = steps // 2
        (total, dtotal), (late, dlate) = self._summed(w, n), self._late(w, n)
        total, dtotal = total * (1 + late), dtotal * (1 + late) + total * dlate
        if steps % 2:
            last, dlast = self._late(w, steps)
            total, dtotal = total + last, dtotal + dlast
        return total, dtotal

    def _matrix(self, values: np.ndarray):
        return self._flint.acb_mat([[self._flint.acb(float(v)) for v in row] for row in values])

    def _ball(self, value: Fraction):
        return self._flint.arb(self._flint.fmpq(value.numerator, value.denominator))


def _flint() -> Any:
    """The package of balls, an extra of the installation."""
    try:
        import flint
    except ImportError as error:
        advice = "pip install 'haptic-cosim[certify]'"
        raise InputError(Problem("certificate", "the package python-flint", str(error), advice)) from error
    return flint


def _star(matrix):
    return matrix.conjugate().transpose()


def _floats(matrix) -> np.ndarray:
    return np.array([[complex(value) for value in row] for row in matrix.tolist()])
