"""Least squares by blocks: normal equations of every contiguous block, so that refits, jackknives and held-out errors cost nothing.

For each block b and joint j:  G = X^T X, h = X^T y, s = y^T y  over the rows of that block and joint. The estimate of the fitted
blocks solves (sum G) beta = sum h; leaving a block out subtracts its terms.
"""

import numpy as np
from attrs import frozen

RIDGE = 1e-10  # of the scaled diagonal: keeps unidentified directions at rest
PENALTIES = (0.0, *np.geomspace(1e-5, 1e2, 15))  # of the scaled diagonal, for columns that are too many for their data


@frozen(eq=False)
class Gram:
    """Normal equations: g (B, J, p, p), h (B, J, p), s (B, J), rows (B, J); the first `train` blocks are fitted.

    The first `shrunk` columns are given ones that are too many for the fitted blocks: they get a penalty (ridge).
    """

    g: np.ndarray
    h: np.ndarray
    s: np.ndarray
    rows: np.ndarray
    train: int
    shrunk: int = 0

    @property
    def size(self) -> int:
        """Number of columns p."""
        return self.h.shape[-1]

    def pick(self, columns: np.ndarray) -> "Gram":
        """The normal equations of a subset of the columns."""
        return Gram(self.g[..., columns[:, None], columns], self.h[..., columns], self.s, self.rows, self.train, int(np.sum(columns < self.shrunk)))


@frozen(eq=False)
class Fit:
    """beta (p,), cov (p, p) of the block jackknife, sse (B, J): squared error of every block, each fitted block left out in turn.

    left_out (T, p): estimates without each fitted block; penalty (p,) on the scaled diagonal.
    """

    beta: np.ndarray
    cov: np.ndarray
    sse: np.ndarray
    left_out: np.ndarray
    in_sample: np.ndarray
    penalty: np.ndarray

    @property
    def std(self) -> np.ndarray:
        """Standard deviation (p,) of beta by the jackknife."""
        return np.sqrt(np.maximum(np.diag(self.cov), 0.0))


def fit(gram: Gram) -> Fit:
    """Least squares on the fitted blocks, delete-one-block jackknife, errors of each block with a model that has not seen it.

    A penalty is the largest whose left-out error is within one standard error of the best (Hastie et al., ESL 7.10).
    """
    if not gram.shrunk:
        return _fitted(gram, 0.0)
    fits = [_fitted(gram, penalty) for penalty in PENALTIES]
    errors = np.array([f.sse[: gram.train].sum(axis=1) for f in fits])
    best = int(errors.sum(axis=1).argmin())
    worse = errors - errors[best]
    allowed = np.sqrt(gram.train) * worse.std(axis=1, ddof=1)
    return fits[int(np.flatnonzero(worse.sum(axis=1) <= allowed).max())]


def _fitted(gram: Gram, penalty: float) -> Fit:
    t = gram.train
    g, h = gram.g.sum(axis=1), gram.h.sum(axis=1)
    total_g, total_h = g[:t].sum(axis=0), h[:t].sum(axis=0)
    scale = 1 / np.sqrt(np.maximum(np.diag(total_g), 1e-300))
    extra = np.full(gram.size, RIDGE)
    extra[: gram.shrunk] += penalty
    stack_g = np.concatenate([total_g[None], total_g - g[:t]]) * scale[:, None] * scale
    stack_h = np.concatenate([total_h[None], total_h - h[:t]]) * scale
    solved = np.linalg.solve(stack_g + np.diag(extra), stack_h[..., None])[..., 0] * scale
    beta, left_out = solved[0], solved[1:]
    spread = left_out - left_out.mean(axis=0)
    cov = (t - 1) / max(t, 1) * spread.T @ spread
    every = np.concatenate([left_out, np.broadcast_to(beta, (len(gram.h) - t, gram.size))])
    return Fit(beta, cov, squared_error(gram, every), left_out, squared_error(gram, np.broadcast_to(beta, every.shape)), extra)


def squared_error(gram: Gram, beta: np.ndarray) -> np.ndarray:
    """Squared error (B, J) with coefficients beta (B, p) of each block."""
    linear = np.einsum("bjp,bp->bj", gram.h, beta)
    quadratic = np.einsum("bp,bjpq,bq->bj", beta, gram.g, beta, optimize=True)
    return np.maximum(gram.s - 2 * linear + quadratic, 0.0)


def accumulate(columns: np.ndarray, y: np.ndarray, block: np.ndarray, blocks: int, train: int, shrunk: int = 0) -> Gram:
    """Normal equations of columns (J, m, p) and y (J, m), rows of weight zero already zeroed; rows must be sorted by block or not."""
    joints, _, p = columns.shape
    order = np.argsort(block, kind="stable")
    edges = np.searchsorted(block[order], np.arange(blocks + 1))
    g, h, s = np.zeros((blocks, joints, p, p)), np.zeros((blocks, joints, p)), np.zeros((blocks, joints))
    for j in range(joints):
        x, t = columns[j][order], y[j][order]
        for b in range(blocks):
            part, target = x[edges[b] : edges[b + 1]], t[edges[b] : edges[b + 1]]
            g[b, j], h[b, j], s[b, j] = part.T @ part, target @ part, target @ target
    return Gram(g, h, s, np.zeros((blocks, joints)), train, shrunk)
