"""Search for the multipliers of a certificate: a convex problem, cut by cut. The only importer of `cvxpy`."""

import warnings
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from cosim.analysis.certificate import Certificate, Multiplier
from cosim.analysis.delay_grid import DelayGrid
from cosim.analysis.sampled_loop import SampledLoop
from cosim.errors import InputError, Problem

_LEAST_MARGIN = 5e-7
_ROUNDS = 40
_DEMANDED = 0.02
"""Least eigenvalue at a vertex over the margin of the frequencies."""
_VERTICES = 12
"""Vertices that are demanded at first, and at most in a round."""
_Found = list[tuple[np.ndarray, np.ndarray]]
"""Form and rests (lifts,) of each group."""


@frozen
class _LoopSignals:
    """What the multipliers act on, at each frequency: `parts` (frequencies, p channels, size, p), `bends` (f, p, p)."""

    parts: np.ndarray
    bends: np.ndarray

    def cut(self, where: np.ndarray, directions: np.ndarray, uses, groups: int):
        """Coefficients of the forms (cuts, groups, size, size), of the rests (cuts, groups), scaled to one another."""
        v = np.einsum("fcsp,fp->fcs", self.parts[where], directions)
        b = np.abs(np.einsum("fcp,fp->fc", self.bends[where], directions)) ** 2
        scale = np.sum(np.abs(v) ** 2, axis=(1, 2))
        forms = np.zeros((len(v), groups, v.shape[2], v.shape[2]))
        rests = np.zeros((len(v), groups))
        for channel, group in enumerate(uses):
            forms[:, group] += np.einsum("fi,fj->fij", v[:, channel].conj(), v[:, channel]).real / scale[:, None, None]
            rests[:, group] += b[:, channel] / scale
        return forms, rests

    def worst(self, multipliers, uses) -> tuple[np.ndarray, np.ndarray]:
        """Largest eigenvalue (f,), over the size of the signals, of the sum of all forms, and its direction (f, p)."""
        total = sum(
            np.einsum("fsp,st,ftq->fpq", self.parts[:, c].conj(), multipliers[g][0], self.parts[:, c], optimize=True)
            + np.sum(multipliers[g][1]) * np.einsum("fp,fq->fpq", self.bends[:, c].conj(), self.bends[:, c])
            for c, g in enumerate(uses)
        )
        size = np.einsum("fcsp,fcsq->fpq", self.parts.conj(), self.parts, optimize=True)
        root = np.linalg.inv(np.linalg.cholesky(size))
        values, vectors = np.linalg.eigh(root @ total @ np.swapaxes(root.conj(), 1, 2))
        return values[:, -1], np.einsum("fqp,fq->fp", root.conj(), vectors[:, :, -1])


def _signals(loop: SampledLoop, grid: DelayGrid, frequencies: np.ndarray) -> _LoopSignals:
    moved = loop.increments(frequencies)
    late = np.exp(-1j * np.outer(frequencies, np.arange(grid.points[-1] + 1)))
    back = -np.cumsum(late[:, 1:], axis=1)[:, np.array(grid.points) - 1]  # x[k - p] - x[k] from x[k+1] - x[k]
    w = np.einsum("fl,cp->fclp", late[:, list(grid.lifts)], np.eye(loop.channels))
    y = np.einsum("fj,fcp->fcjp", back, moved)
    return _LoopSignals(np.concatenate([w, y], axis=2), (1.0 - late[:, 1])[:, None, None] * moved)


def _frequencies(grid: DelayGrid) -> np.ndarray:
    """Fine where the loop lives, and fine enough for the lifts up to half the sampling rate."""
    period = 2.0 * np.pi / grid.points[-1]
    low, high = 6.0 * period, min(20.0 * period, 3.0)
    dense = np.linspace(1e-3 * period, low, 1500)
    return np.concatenate([dense, np.linspace(low, high, 700)[1:], np.geomspace(high, np.pi, 600)[1:]])


def certify(
    loops: Sequence[SampledLoop], grid: DelayGrid, owner: tuple[int, ...] | None = None
) -> list[Certificate] | None:
    """Certificates of some loops for all delay laws of the grid, or None where this family of multipliers has none.

    Wanted: forms P_c that no law makes negative (`Multiplier`), with the sum over the channels of P_c on the response
    of each loop negative at every frequency. Both conditions are convex in P_c; frequencies and vertices of the laws
    are added where they are violated. All loops (of as many channels) have the same multipliers, which what a law can
    do does not depend on the loop for. Channels of loops that look the same when they are exchanged share one
    multiplier, and so do those of one `owner` (default: each its own); to share one only narrows the search.
    """
    channels = loops[0].channels
    uses = (0,) * channels if all(map(_exchangeable, loops)) else owner or tuple(range(channels))
    each = [_signals(loop, grid, _frequencies(grid)) for loop in loops]
    size = float(max(np.abs(signals.bends).max() for signals in each))
    units = size * np.sqrt(np.maximum(np.array(grid.rests(), dtype=float), 1.0))  # rests are counted in these
    together = _LoopSignals(
        np.concatenate([signals.parts for signals in each]), np.concatenate([s.bends for s in each]) / size
    )
    found = _by_cuts(together, _Programme(grid, max(uses) + 1, units), uses, len(each[0].parts))
    if found is None:
        return None
    multipliers = [Multiplier(form, rests / units**2) for form, rests in found]
    return [Certificate(loop, grid, multipliers, uses) for loop in loops]


def _exchangeable(loop: SampledLoop) -> bool:
    """Whether the response is the same with the channels in reverse order."""
    response = loop.increments(np.geomspace(1e-4, 3.0, 20))
    return bool(np.allclose(response, response[:, ::-1, ::-1], rtol=1e-6, atol=0.0))


def _by_cuts(signals: _LoopSignals, problem: "_Programme", uses: tuple[int, ...], first: int) -> _Found | None:
    """Forms and rests (in units) by cutting planes: solve, look at all frequencies and vertices, add the worst."""
    p, groups = signals.parts.shape[-1], max(uses) + 1
    start = np.unique(np.linspace(0, first - 1, 60).astype(int))
    for direction in _directions(p):
        problem.add(*signals.cut(start, np.tile(direction, (len(start), 1)), uses, groups))
    for _ in range(_ROUNDS):
        margin, found = problem.solve()
        if found is None or margin < _LEAST_MARGIN:
            return None
        values, directions = signals.worst(found, uses)
        if not problem.demand_violated(found, margin) and values.max() < -0.01 * margin:
            return found
        where = _peaks(values, -0.9 * margin)
        if len(where):
            problem.add(*signals.cut(where, directions[where], uses, groups))
    return None


def _directions(p: int) -> np.ndarray:
    """Single channels, and all of them with and against one another."""
    return np.eye(p) if p == 1 else np.vstack([np.eye(p), np.ones(p), np.where(np.arange(p) % 2, -1.0, 1.0)])


def _peaks(values: np.ndarray, floor: float, most: int = 60) -> np.ndarray:
    """Places of the highest local maxima above a floor."""
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    top = np.flatnonzero((values >= padded[:-2]) & (values >= padded[2:]) & (values > floor))
    return top[np.argsort(-values[top])][:most]


def _cvxpy() -> Any:
    """The package that states and solves the programme, an extra of the installation."""
    try:
        import cvxpy
    except ImportError as error:
        advice = "pip install 'haptic-cosim[certify]'"
        raise InputError(Problem("certificate", "the package cvxpy with Clarabel", str(error), advice)) from error
    return cvxpy


class _Programme:
    """The semidefinite programme: largest margin e by which forms of bounded size meet all conditions.

    wholes (vertices, size, size): what takes (y, r) to (w, y) at each vertex; `asked`: those that are demanded so far.
    """

    def __init__(self, grid: DelayGrid, groups: int, units: np.ndarray) -> None:
        cp = _cvxpy()
        lifts, size = len(grid.lifts), len(grid.lifts) + len(grid.points)
        corner = np.zeros((size - lifts, lifts))
        self.wholes = np.array(
            [np.block([[vertex, np.diag(units)], [np.eye(size - lifts), corner]]) for vertex in grid.vertices()]
        )
        self.margin = cp.Variable()
        self.forms = [cp.Variable((size, size), symmetric=True) for _ in range(groups)]
        self.rests = cp.Variable((groups, lifts), nonneg=True)
        self.conditions: list[Any] = [self.margin <= 1.0, self.rests <= 1e3]
        for form in self.forms:
            self.conditions += [form <= 1.0, form >= -1.0, cp.diag(form)[:lifts] <= 0.0]
            if grid.slope is not None:  # not every choice is a vertex, so concave in all laws at once
                self.conditions.append(form[:lifts, :lifts] + _DEMANDED * self.margin * np.eye(lifts) << 0)
        self.asked: set[tuple[int, int]] = set()
        for g in range(groups):
            self._demand(g, range(0, len(self.wholes), max(len(self.wholes) // _VERTICES, 1)))

    def _demand(self, group: int, vertices: Iterable[int]) -> None:
        """No law at these vertices makes the form negative."""
        cp = _cvxpy()
        form, lifts = self.forms[group], self.rests.shape[1]
        size = form.shape[0]
        rest = cp.diag(cp.hstack([np.zeros(size - lifts), self.rests[group]]))
        for v in vertices:
            if (group, v) not in self.asked:
                whole = self.wholes[v]
                self.conditions.append(whole.T @ form @ whole + rest - _DEMANDED * self.margin * np.eye(size) >> 0)
                self.asked.add((group, v))

    def demand_violated(self, found: _Found, margin: float) -> bool:
        """Demand the vertices at which a solution is worst; whether there are any at which it is not good enough."""
        any_ = False
        for group, (form, rests) in enumerate(found):
            least = np.linalg.eigvalsh(
                np.swapaxes(self.wholes, 1, 2) @ form @ self.wholes + np.diag(_behind(rests, form))
            )
            bad = np.flatnonzero(least[:, 0] < 0.1 * _DEMANDED * margin)
            new = [int(v) for v in bad[np.argsort(least[bad, 0])] if (group, int(v)) not in self.asked]
            self._demand(group, new[:_VERTICES])
            any_ = any_ or bool(len(bad))
        return any_

    def add(self, forms: np.ndarray, rests: np.ndarray) -> None:
        """Cuts: sum of <forms, P> + rests rho <= -margin."""
        cp = _cvxpy()
        total = rests @ cp.sum(self.rests, axis=1)
        for g, form in enumerate(self.forms):
            total = total + forms[:, g].reshape(len(forms), -1) @ cp.vec(form, order="C")
        self.conditions.append(total <= -self.margin)

    def solve(self):
        """Margin and (form, rest) of each group; None where the solver finds nothing."""
        cp = _cvxpy()
        problem = cp.Problem(cp.Maximize(self.margin), self.conditions)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # "may be inaccurate": what comes out is checked anyway
                problem.solve(solver=cp.CLARABEL)
        except cp.SolverError:
            return 0.0, None
        if self.margin.value is None:
            return 0.0, None
        forms = [0.5 * (form.value + form.value.T) for form in self.forms]
        return float(self.margin.value), list(zip(forms, np.maximum(self.rests.value, 0.0)))


def _behind(rests: np.ndarray, form: np.ndarray) -> np.ndarray:
    """The rests on a diagonal of the form's size, after zeros for the points."""
    return np.concatenate([np.zeros(len(form) - len(rests)), rests])
