"""Arrays of any file as columns: vectors by their name, matrices by the longer side."""

from collections.abc import Callable, Iterator
from functools import cache

import numpy as np

from cosim.measured.table import WIDEST, elements

Reader = Callable[[], np.ndarray]


def array_columns(name: str, shape: tuple[int, ...], read: Reader) -> Iterator[tuple[str, Reader]]:
    """Columns of an array (n,), (n, 1) or (n, k); rows run along the longer side of a matrix.

    Scalars, arrays of three and more dimensions and matrices wider than WIDEST hold no columns.
    """
    sides = [side for side in shape if side != 1]
    if len(sides) == 1:
        yield name, lambda: plain(read().reshape(-1))
    elif len(sides) == 2 and min(sides) <= WIDEST:
        upright = sides[0] >= sides[1]
        matrix = cache(lambda: read().reshape(sides))

        def column(k: int) -> np.ndarray:
            return plain(matrix()[:, k] if upright else matrix()[k])

        for k, element in enumerate(elements(name, min(sides))):
            yield element, lambda k=k: column(k)


def plain(values: np.ndarray) -> np.ndarray:
    """Numbers as float64 (integers as they are, for stamps), stamps as they are, everything else as text."""
    values = values.reshape(-1)
    if values.dtype.kind in "fb":
        return np.ascontiguousarray(values, dtype=float)
    if values.dtype.kind in "iuMm":
        return np.ascontiguousarray(values)
    if values.dtype.kind == "S":
        return np.array([cell.decode("utf-8", "replace") for cell in values.tolist()])
    return np.array([cell.decode("utf-8", "replace") if isinstance(cell, bytes) else str(cell) for cell in values])
