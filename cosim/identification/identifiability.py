"""What the motion could show: rank, base parameters, condition number, parameters that it did not excite."""

import numpy as np
from attrs import frozen

from cosim.identification.estimate import RANK
from cosim.identification.stack import Stack
from cosim.measured.label import Label

EMPTY = 1e-12  # of the largest column: zero but for rounding
SHOWN = 1e-6  # weights that are told
INFLATION = 1e5
"""Variance inflation factor above which a column counts as a combination of the others."""


@frozen(eq=False)
class Identifiability:
    """condition: of the scaled base columns; base: numbers of an independent set of columns; unexcited: parameters of
    the others; combinations: in words, which base columns each dependent column is a combination of.
    """

    condition: float
    rank: int
    base: tuple[int, ...]
    unexcited: tuple[Label, ...]
    combinations: tuple[str, ...]


def identifiability(stack: Stack) -> Identifiability:
    """Pivoted QR of the scaled training regressor; Gautier's base parameters."""
    from scipy.linalg import qr

    y = stack.equations(stack.fit)[0]
    norms = np.sqrt((y**2).sum(axis=0))
    empty = norms <= EMPTY * norms.max()
    scaled = y / np.where(empty, 1.0, norms)
    triangle, pivot = map(np.asarray, qr(np.linalg.qr(scaled, mode="r"), mode="r", pivoting=True))
    rank = int((np.abs(np.diag(triangle)) > RANK * abs(triangle[0, 0])).sum())
    base = tuple(sorted(int(k) for k in pivot[:rank]))
    square = triangle[:rank, :rank]
    singular = np.linalg.svd(square, compute_uv=False)
    inflation = (np.linalg.inv(square) ** 2).sum(axis=1)  # 1 / (1 - R^2) of a column on the others
    dependent = [int(k) for k in pivot[rank:]]
    loose = [int(k) for k, factor in zip(pivot[:rank], inflation, strict=True) if factor > INFLATION]
    labels = tuple(stack.labels[k] for k in sorted({*dependent, *loose}))
    return Identifiability(
        float(singular[0] / singular[-1]), rank, base, labels, _combinations(stack.labels, triangle, pivot, rank, empty)
    )


def _combinations(
    labels: tuple[Label, ...], triangle: np.ndarray, pivot: np.ndarray, rank: int, empty: np.ndarray
) -> tuple[str, ...]:
    """Each dependent column in terms of base columns (scaled weights)."""
    if rank == len(pivot):
        return ()
    weights = np.linalg.solve(triangle[:rank, :rank], triangle[:rank, rank:])
    texts = []
    for column, k in enumerate(pivot[rank:]):
        parts = [str(labels[pivot[b]]) for b in np.flatnonzero(np.abs(weights[:, column]) > SHOWN)]
        texts.append(f"{labels[k]}: {'not excited at all' if empty[k] else 'depends on ' + ', '.join(parts)}")
    return tuple(texts)
