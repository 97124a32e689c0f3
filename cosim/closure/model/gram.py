"""Least squares by blocks: normal equations of every contiguous block, which make refits, jackknives and errors of
blocks that the fit has not seen cheap.

For each block b and joint j:  G = X^T X, h = X^T y, s = y^T y  over the rows of that block and joint. The estimate of
the fitted blocks solves (sum w G) beta = sum w h; leaving a block out subtracts its terms. The weights w of the blocks
are those of a multivariate t: every block has a noise level of its own about the joint's (Lange, Little, Taylor 1989,
J. Am. Stat. Assoc. 84), so that a spike in one block neither makes nor hides an effect.
"""

import numpy as np
from attrs import frozen

from cosim.effects.constants import FREEDOM

RIDGE = 1e-10  # of the scaled diagonal: keeps unidentified directions at zero
PENALTIES = (0.0, *np.geomspace(1e-5, 1e2, 15))  # of the scaled diagonal, for columns that are too many for their data
SMOOTHNESS = (1e-6, 1e-3, 1e-2, 1e-1)  # the same for columns of nameless functions
LEAST = 1e-150  # of a variance, where a joint has no rows
ROUNDS, STEPS = 2, 8  # of the weights, and of the scale within each


@frozen(eq=False)
class Gram:
    """Normal equations: g (B, J, p, p), h (B, J, p), s (B, J), rows (B, J); the first `train` blocks are fitted.

    The first `shrunk` columns are too many for the fitted blocks and get a penalty (ridge). It is chosen by leaving out
    `group` (train,), the runs of the fitted blocks, or single blocks where there are fewer than four runs. precision
    (p,): prior precision of each coefficient, one over its variance about zero. smooth (p,): columns of nameless
    functions, whose penalty is the best of `SMOOTHNESS` for blocks left out.
    """

    g: np.ndarray
    h: np.ndarray
    s: np.ndarray
    rows: np.ndarray
    train: int
    shrunk: int = 0
    group: np.ndarray | None = None
    precision: np.ndarray | float = 0.0
    smooth: np.ndarray | None = None

    @property
    def size(self) -> int:
        """Number of columns p."""
        return self.h.shape[-1]


@frozen(eq=False)
class GramFit:
    """beta (p,), cov (p, p) of the block jackknife, sse (B, J): squared error of every block, each fitted block left
    out in turn.

    left_out (T, p): estimates without each fitted block; penalty (p,) on the scaled diagonal; weight (B, J) of the
    blocks; variance (J,): scale of a row's squared error in a usual block; loss (B, J): minus the log density of every
    block, without constants.
    """

    beta: np.ndarray
    cov: np.ndarray
    sse: np.ndarray
    left_out: np.ndarray
    in_sample: np.ndarray
    penalty: np.ndarray
    weight: np.ndarray
    variance: np.ndarray
    loss: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """Standard deviation (p,) of beta by the jackknife."""
        return np.sqrt(np.maximum(np.diag(self.cov), 0.0))


def fit(gram: Gram) -> GramFit:
    """Robust least squares on the fitted blocks, delete-one-block jackknife, errors of each block with a model that has
    not seen it.
    """
    base = np.full(gram.size, RIDGE)
    if gram.shrunk:
        base[: gram.shrunk] += _penalty(gram)
    if gram.smooth is None or not gram.smooth.any():
        return _fitted(gram, base)
    options = [_fitted(gram, base + penalty * gram.smooth) for penalty in SMOOTHNESS]
    return min(options, key=lambda found: found.loss[: gram.train].sum())


def _penalty(gram: Gram) -> float:
    """The largest penalty whose left-out error is within one standard error of the best (Hastie et al., ESL 7.10)."""
    group = gram.group if gram.group is not None and len(np.unique(gram.group)) >= 4 else np.arange(gram.train)
    member = (group[:, None] == np.unique(group)).astype(float).T
    parts = [member @ x[: gram.train].sum(axis=1).reshape(gram.train, -1) for x in (gram.g, gram.h, gram.s)]
    g, h, s = parts[0].reshape(-1, gram.size, gram.size), parts[1], parts[2][:, 0]
    scale = 1 / np.sqrt(np.maximum(np.diag(g.sum(axis=0)), 1e-300))
    g, h = g * scale[:, None] * scale, h * scale
    errors = []
    for penalty in PENALTIES:
        extra = np.full(gram.size, RIDGE)
        extra[: gram.shrunk] += penalty
        beta = np.linalg.solve(g.sum(axis=0) - g + np.diag(extra), (h.sum(axis=0) - h)[..., None])[..., 0]
        errors.append(s - 2 * (h * beta).sum(axis=1) + np.einsum("bp,bpq,bq->b", beta, g, beta))
    worse = np.array(errors) - errors[int(np.sum(errors, axis=1).argmin())]
    allowed = np.sqrt(len(g)) * worse.std(axis=1, ddof=1)
    return PENALTIES[int(np.flatnonzero(worse.sum(axis=1) <= allowed).max())]


def _fitted(gram: Gram, penalty: np.ndarray) -> GramFit:
    weight = np.ones_like(gram.s)
    for _ in range(ROUNDS - 1):
        weight = _solved(gram, penalty, weight).weight
    return _solved(gram, penalty, weight)


def _solved(gram: Gram, penalty: np.ndarray, weight: np.ndarray) -> GramFit:
    """The fit with given weights (B, J) of the blocks; its own weights are those that its errors ask for."""
    t = gram.train
    g, h = np.einsum("bjpq,bj->bpq", gram.g, weight), np.einsum("bjp,bj->bp", gram.h, weight)
    total_g, total_h = g[:t].sum(axis=0), h[:t].sum(axis=0)
    scale = 1 / np.sqrt(np.maximum(np.diag(total_g), 1e-300))
    extra = penalty + gram.precision * scale**2
    stack_g = np.concatenate([total_g[None], total_g - g[:t]]) * scale[:, None] * scale
    stack_h = np.concatenate([total_h[None], total_h - h[:t]]) * scale
    solved = np.linalg.solve(stack_g + np.diag(extra), stack_h[..., None])[..., 0] * scale
    beta, left_out = solved[0], solved[1:]
    every = np.concatenate([left_out, np.broadcast_to(beta, (len(gram.h) - t, gram.size))])
    sse = squared_error(gram, every)
    variance, usual = scales(sse, gram.rows, t)
    spread = left_out - left_out.mean(axis=0)
    cov = (t - 1) / max(t, 1) * spread.T @ spread
    in_sample = squared_error(gram, np.broadcast_to(beta, every.shape))
    return GramFit(beta, cov, sse, left_out, in_sample, penalty, usual, variance, losses(sse, gram.rows, variance))


def scales(sse: np.ndarray, rows: np.ndarray, train: int) -> tuple[np.ndarray, np.ndarray]:
    """Scale (J,) of a row's squared error, and weights (B, J) of the blocks: maximum likelihood of a multivariate t of
    `FREEDOM` degrees for each block, by expectation and maximisation.
    """
    count = np.maximum(rows[:train].sum(axis=0), 1)
    variance = np.maximum(sse[:train].sum(axis=0) / count, LEAST)
    weight = np.ones_like(sse)
    for _ in range(STEPS):
        weight = (rows + FREEDOM) / (FREEDOM + sse / variance)
        variance = np.maximum((weight * sse)[:train].sum(axis=0) / count, LEAST)
    return variance, weight


def losses(sse: np.ndarray, rows: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Minus the log density (B, J) of each block's residuals, without constants [nats]."""
    return rows / 2 * np.log(variance) + (rows + FREEDOM) / 2 * np.log1p(sse / (FREEDOM * variance))


def squared_error(gram: Gram, beta: np.ndarray) -> np.ndarray:
    """Squared error (B, J) with coefficients beta (B, p) of each block."""
    linear = np.einsum("bjp,bp->bj", gram.h, beta)
    quadratic = np.einsum("bjp,bp->bj", np.einsum("bjpq,bq->bjp", gram.g, beta), beta)
    return np.maximum(gram.s - 2 * linear + quadratic, 0.0)


def accumulate(columns: np.ndarray, y: np.ndarray, block: np.ndarray, blocks: int, train: int) -> Gram:
    """Normal equations of columns (J, m, p) and y (J, m), in which rows of weight zero are zero; in any order."""
    order = np.argsort(block, kind="stable")
    edges = np.searchsorted(block[order], np.arange(blocks + 1))
    place = edges[:-1, None] + np.arange(np.diff(edges).max())  # (B, L); blocks are padded with the last row, of zeros
    rows = np.append(order, len(block))[np.where(place < edges[1:, None], place, len(block))]
    count = np.zeros((blocks, len(columns)))
    np.add.at(count, block, (columns != 0).any(axis=2).T)
    torque = np.pad(y[..., None], ((0, 0), (0, 1), (0, 0)))[:, rows]  # (J, B, L, 1)
    joints = [_products(x, t, rows) for x, t in zip(columns, torque, strict=True)]  # one by one, to limit memory
    g, h, s = (np.stack(parts, axis=1) for parts in zip(*joints, strict=True))
    return Gram(g, h, s, count, train)


def _products(columns: np.ndarray, t: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """X^T X (B, p, p), X^T t (B, p) and t^T t (B,) of each block, of a joint's columns (m, p) and torque t (B, L, 1).

    rows (B, L): numbers of the rows of each block; m stands for none.
    """
    x = np.pad(columns, ((0, 1), (0, 0)))[rows]
    across = np.swapaxes(x, 1, 2)
    return across @ x, (across @ t)[..., 0], (np.swapaxes(t, 1, 2) @ t)[..., 0, 0]
