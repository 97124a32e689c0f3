"""Torques at the end of their range: an amplifier or a converter that could give no more.

A signal that turns round smoothly has a density that grows like 1 / sqrt(distance) towards its extreme, at most. Of the
rows in the outermost tenth of the range, the outermost resolution step then holds sqrt(step / tenth) of them. A signal
that is cut piles all that was beyond onto one value. `PILED` = 3 times the share that a smooth signal can have is a
pile: with at least 12 rows in groups the chance of a smooth signal is below 1e-4 (tests/measured/doubt_study.py).
"""

import numpy as np
from attrs import evolve

from cosim.measured.notes import Notes
from cosim.measured.stretch import Stretch

PILED = 3.0
OUTER = 0.1  # of the range
FEWEST = 12  # rows
GROUP = 3  # rows that stand together
COARSEST = 0.02  # of the range: a signal of fewer values shows nothing


def marked(stretch: Stretch, notes: Notes) -> Stretch:
    """The stretch with values of its torques that sit at their extreme marked; told with their share."""
    marks = np.zeros(stretch.signals.shape, bool)
    for column in stretch.torques:
        rows = at_extreme(stretch.signals[:, column])
        if not rows.any():
            continue
        marks[:, column] = rows
        values = np.unique(stretch.signals[rows, column])
        share = 100 * rows.mean()
        text = (
            f"{stretch.name}: {stretch.names[column]} sits at its extreme ({', '.join(f'{v:.5g}' for v in values)}) in "
            f"{share:.3g} % of the rows: saturated? those {int(rows.sum())} rows are left out"
        )
        notes(text, "clipped", stretch.numbers(rows))
    return evolve(stretch, clipped=marks) if marks.any() else stretch


def at_extreme(values: np.ndarray) -> np.ndarray:
    """Rows (n,) of a signal that sit at its largest or its smallest value, where they are too many to be turning."""
    finite = np.isfinite(values)
    if finite.sum() < 64:
        return np.zeros(len(values), bool)
    return _at_top(np.where(finite, values, -np.inf)) | _at_top(np.where(finite, -values, -np.inf))


def _at_top(values: np.ndarray) -> np.ndarray:
    finite = values[np.isfinite(values)]
    high, span = finite.max(), np.ptp(finite)
    rows = values >= high - 1e-9 * span
    if high == 0:
        return np.zeros(len(values), bool)  # off, not at its limit
    outer = finite[finite > high - OUTER * span]
    levels = np.unique(outer)
    if span == 0 or len(levels) < 4:
        return _only_extreme(values, rows, finite)
    step = float(np.median(np.diff(levels)))
    usual = len(outer) * np.sqrt(step / (OUTER * span))
    grouped = _in_groups(rows)
    piled = step < COARSEST * span and rows.sum() > PILED * usual and grouped.sum() >= max(FEWEST, 0.5 * rows.sum())
    return rows if piled else np.zeros(len(values), bool)


def _only_extreme(values: np.ndarray, rows: np.ndarray, finite: np.ndarray) -> np.ndarray:
    """Where next to nothing else lies in the outermost tenth: a pile if the signal is fine elsewhere and comes back."""
    none = np.zeros(len(values), bool)
    levels = len(np.unique(finite))
    visits = int((np.diff(rows.astype(int)) == 1).sum())
    fine = levels > 1 / COARSEST
    return rows if fine and visits >= 3 and _in_groups(rows).sum() >= max(FEWEST, 0.5 * rows.sum()) else none


def _in_groups(rows: np.ndarray) -> np.ndarray:
    edges = np.flatnonzero(np.diff(np.r_[0, rows.astype(int), 0])).reshape(-1, 2)
    result = np.zeros(len(rows), bool)
    for start, stop in edges:
        result[start:stop] = stop - start >= GROUP
    return result
