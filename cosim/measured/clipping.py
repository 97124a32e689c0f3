"""Torques at the end of their range: an amplifier or a converter that could give no more.

A signal that turns round smoothly is a parabola at its extreme: of the rows within a width of it, and within twice that
width, the first have sqrt(1 / 2) of the time; sqrt(2) + 1 = 2.4 times as many rows are in the outermost width as in the
next one, at most. One that is held there with noise has fewer in the outermost. A signal that is cut piles all that was
beyond onto less than its own noise. `PILED` = 3 times the share that a smooth signal can have is a pile: with at least
12 rows in groups the chance of a smooth signal is below 1e-4 (tests/measured/doubt_study.py). The width is the noise of
the signal, or its resolution where that is coarser.
"""

import numpy as np
from attrs import evolve

from cosim.measured.notes import Notes
from cosim.measured.stretch import Stretch

PILED = 3.0
PARABOLA = 1 + np.sqrt(2.0)
FEWEST = 12  # rows
GROUP = 3  # rows that stand together
VISITS = (
    3  # times that a signal with nothing next to its extreme must be there: a limit holds each time, chance does not
)
LEVELS = 50
"""Values that a signal must have: a command of fewer (steps, a switch) may sit at its largest for a fiftieth of the
rows or more, as it does at each of the others.
"""
QUARTER = 1.15  # standard deviations of a normal law, beyond which a quarter of it lies
MOST = 0.5  # of the rows at a limit stand in groups
ROUNDING = 1e-9  # of the range: what comes from arithmetic
ENOUGH = 64  # rows: of fewer FEWEST are a fifth, and a sine is in the outer tenth of its range for a fifth of the time


def marked(stretch: Stretch, notes: Notes) -> Stretch:
    """The stretch with values of its torques that sit at their extreme marked; told with their share."""
    marks = np.zeros(stretch.signals.shape, bool)
    for column in stretch.torques:
        rows = at_extreme(stretch.signals[:, column])
        if not rows.any():
            continue
        marks[:, column] = rows
        values = _limits(stretch.signals[rows, column])
        share = 100 * rows.mean()
        text = (
            f"{stretch.name}: {stretch.names[column]} sits at its extreme ({', '.join(f'{v:.5g}' for v in values)}) in "
            f"{share:.3g} % of the rows: saturated? those {int(rows.sum())} rows are left out"
        )
        notes(text, "clipped", stretch.numbers(rows))
    return evolve(stretch, clipped=marks) if marks.any() else stretch


def _limits(values: np.ndarray) -> list[float]:
    """The middle of the values at either end."""
    centre = (values.min() + values.max()) / 2
    return [float(np.median(part)) for part in (values[values < centre], values[values >= centre]) if len(part)]


def at_extreme(values: np.ndarray) -> np.ndarray:
    """Rows (n,) of a signal that sit at its largest or its smallest value, where they are too many to be turning."""
    finite = np.isfinite(values)
    if finite.sum() < ENOUGH:
        return np.zeros(len(values), bool)
    width = _width(values[finite])
    return _at_top(np.where(finite, values, -np.inf), width) | _at_top(np.where(finite, -values, -np.inf), width)


def _width(values: np.ndarray) -> float:
    """The noise of a signal (n,), from its fourth differences, or its resolution where that is coarser."""
    bends = np.abs(np.diff(values, 4)) / np.sqrt(70)  # 70 = 1 + 16 + 36 + 16 + 1
    noise = float(np.quantile(bends, 0.75)) / QUARTER  # not the usual size: rows at a limit have none
    levels = np.diff(np.unique(values))
    return max(noise, float(np.median(levels)) if len(levels) else 0.0)


def _at_top(values: np.ndarray, width: float) -> np.ndarray:
    finite = values[np.isfinite(values)]
    high, none = float(finite.max()), np.zeros(len(values), bool)
    span = float(np.ptp(finite))
    width += ROUNDING * span
    if high == 0 or len(np.unique(finite)) <= LEVELS:  # off, not at its limit; or a command of few values
        return none
    rows = values > high - width
    beside = int(((finite <= high - width) & (finite > high - 2 * width)).sum())
    if not beside and int((np.diff(rows.astype(int)) == 1).sum()) < VISITS:
        return none
    piled = rows.sum() > PILED * PARABOLA * beside and _in_groups(rows).sum() >= max(FEWEST, MOST * rows.sum())
    return rows if piled else none


def _in_groups(rows: np.ndarray) -> np.ndarray:
    edges = np.flatnonzero(np.diff(np.r_[0, rows.astype(int), 0])).reshape(-1, 2)
    result = np.zeros(len(rows), bool)
    for start, stop in edges:
        result[start:stop] = stop - start >= GROUP
    return result
