"""Samples that a slow bus repeats behind fast stamps: the same value in several rows until the next one arrives.

Values that are new arrive together. In a recording whose signals change on their own, rows in which one of two signals
changes are rows in which both do with a share of p q / (p + q - p q), below a third where each changes in fewer than
half of the rows. Nine tenths among 30 changes has a probability below 1e-10. A single signal is held where its changes
come at whole multiples of one number of rows, each of several of its smallest steps.
"""

import numpy as np

from cosim.measured.notes import Notes
from cosim.measured.stretch import Stretch

TOGETHER = 0.9
CHANGES = 30
SELDOM = 0.55  # of the rows: a half, every second row, and what chance adds to it
MULTIPLES = 0.95  # of the gaps: a bus may be late now and then
STEPS = 2.5  # smallest steps of a column: a column that moves by one step at a time is a slow encoder, not a held one


def thinned(stretch: Stretch, notes: Notes) -> Stretch:
    """The stretch with the rows alone in which its slowest signals are new; told with the number of rows."""
    columns = (*(k for k in stretch.positions), *stretch.torques)
    if len(stretch.time) < 2 * CHANGES or not columns:
        return stretch
    new = {column: _new(stretch.signals[:, column]) for column in columns}
    new = {column: rows for column, rows in new.items() if rows.sum() > CHANGES}
    held = [column for column, rows in new.items() if _held(stretch.signals[:, column], rows)]
    rows = _together(list(new.values())) if len(new) > 1 else None
    if rows is None and held:
        rows = min((new[column] for column in held), key=lambda r: r.sum())
    if rows is None:
        return stretch
    which = "all signals repeat" if not held or len(held) == len(new) else f"{_names(stretch, held)} repeats"
    every = len(rows) / rows.sum()
    rate = rows.sum() / (stretch.time[-1] - stretch.time[0])
    text = (
        f"{stretch.name}: {which} their last value in {int((~rows).sum())} rows (new about every {every:.3g} rows, "
        f"{rate:.4g} Hz): held samples, thinned to the {int(rows.sum())} rows that are new"
    )
    if held and len(held) < len(new):
        text = text.replace("their last", "its last") + "; the faster signals are taken at these rows, without a filter"
    notes(text, "held samples", stretch.numbers(~rows))
    return stretch.rows(rows)


def _names(stretch: Stretch, columns: list[int]) -> str:
    return ", ".join(stretch.names[column] for column in columns)


def _new(values: np.ndarray) -> np.ndarray:
    """Rows (n,) that differ from the one before; the first is new."""
    with np.errstate(invalid="ignore"):
        return np.r_[True, (np.diff(values) != 0) & np.isfinite(values[1:])]


def _together(new: list[np.ndarray]) -> np.ndarray | None:
    """The rows in which signals change, where they change together and in fewer than half of the rows."""
    either, both = np.any(new, axis=0), np.all(new, axis=0)
    if either.sum() < CHANGES or either.mean() >= SELDOM or both.sum() < TOGETHER * either.sum():
        return None
    return either


def _held(values: np.ndarray, new: np.ndarray) -> bool:
    """Whether one signal changes at multiples of some number of rows only, by several of its smallest steps."""
    places = np.flatnonzero(new)[1:]
    sizes = np.abs(values[places] - values[places - 1])
    if len(places) < CHANGES or np.median(sizes) < STEPS * sizes.min():
        return False
    gaps = np.diff(places)
    period = int(np.median(gaps))
    return period >= 2 and bool((gaps % period == 0).mean() >= MULTIPLES)
