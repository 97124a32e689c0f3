"""Signals with stamps of their own, read at the stamps of another."""

import numpy as np

LONGEST_GAP = 6.5  # steps of a signal over which no value is made up; `repairs` splits a run there too


def aligned(values: np.ndarray, stamps: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Values (m,) at stamps (m,) [s], read at the wanted ones (n,) [s]: numbers on lines between them, words held.

    NaN (or "") outside the stamps and in gaps of more than LONGEST_GAP of their steps. Between neighbours that lie more
    than half the range of the signal apart (an angle that wraps, a counter, a switch) the nearer one is taken. No
    filter: what is faster than the wanted stamps folds back.
    """
    good = np.isfinite(stamps)
    stamps, first = np.unique(stamps[good], return_index=True)
    values = values[good][first]
    if not len(stamps):
        return np.full(len(wanted), np.nan)
    after = np.clip(np.searchsorted(stamps, wanted), 0, len(stamps) - 1)
    before = np.where(stamps[after] == wanted, after, np.maximum(after - 1, 0))
    inside = (wanted >= stamps[0]) & (wanted <= stamps[-1])
    steps = np.diff(stamps)
    inside &= stamps[after] - stamps[before] <= LONGEST_GAP * (np.median(steps) if len(steps) else np.inf)
    if values.dtype.kind in "US":
        return np.where(inside, values[before], "")
    numbers = values.astype(float)
    lines = np.interp(wanted, stamps, numbers)
    good = numbers[np.isfinite(numbers)]
    jumps = np.abs(numbers[after] - numbers[before]) > np.ptp(good) / 2 if len(good) else np.zeros(len(wanted), bool)
    nearer = np.where(wanted - stamps[before] <= stamps[after] - wanted, before, after)
    return np.where(inside, np.where(jumps, numbers[nearer], lines), np.nan)
