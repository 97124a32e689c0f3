"""Clocks that were set, stamps that tell when a row arrived and not when it was measured, rows recorded twice.

Positions decide: rows are in the order, and at the times, in which the motion is smooth. Each value is compared with
the cubic through its four neighbours; its error is divided by sqrt(1 + sum of squared weights), so that noise alone
makes errors of one size on any stamps. On stamps that mean nothing the even grid then gives the smaller error in more
than half of the rows: a sign test, widened by the five rows that neighbouring errors share.
"""

import numpy as np
from attrs import evolve

from cosim.measured.notes import Notes
from cosim.measured.stretch import Stretch

SIGNS = 4.5  # standard deviations of the share of smaller errors, 3e-6
SHARED = np.sqrt(5.0)  # rows that two neighbouring errors have in common
SMOOTHER = 0.7  # median error on the even grid over that on the stamps
JOINS = 3.0
"""Usual second differences (their 95 % quantile) that a joint between rows may have: of a normal law 1.96 standard
deviations, so that one in 2e8 joints of a motion that goes on has more.
"""
MISSED = 1.5  # steps: longer ones are nearer to two than to one, so that a row is missing or the clock was set
SELDOM = 64  # rows for each time that a clock is set: one that jumps more often is no clock that was set
COPIED = 16  # rows in succession that repeat earlier ones


def without_copies(stretch: Stretch, notes: Notes) -> Stretch:
    """The stretch without blocks of rows that repeat, in all signals and to the last digit, the block before.

    A signal with noise repeats no value; one without (a simulation) may repeat its period, but does so throughout.
    """
    signals = stretch.signals
    n = len(signals)
    rows = np.ascontiguousarray(np.where(np.isfinite(signals), signals, -1e300)).view(
        np.dtype((np.void, 8 * signals.shape[1]))
    )
    _, first, inverse = np.unique(rows.ravel(), return_index=True, return_inverse=True)
    lag = np.arange(n) - first[inverse.ravel()]
    steady = np.r_[False, (np.diff(lag) == 0) & (lag[1:] > 0)]
    moving = np.r_[False, (np.diff(signals, axis=0) != 0).any(axis=1)]
    copied = np.zeros(n, bool)
    for start, stop in np.flatnonzero(np.diff(np.r_[0, steady.astype(int), 0])).reshape(-1, 2):
        block = slice(start - 1, stop)
        if (moving[block].sum() > 0.5 * (stop - start)) and stop - start >= COPIED:
            copied[block] = True
    count = int(copied.sum())
    if not count:
        return stretch
    text = f"{stretch.name}: {count} rows repeat earlier rows to the last digit, in blocks"
    if count > 0.3 * n:
        notes(
            f"{text}: a simulation without noise, or the same data twice; used as they are",
            "repeats",
            np.flatnonzero(copied),
        )
        return stretch
    notes(f"{text}: recorded twice, left out", "repeated block", stretch.numbers(copied))
    return stretch.rows(~copied)


def continued(stretch: Stretch, notes: Notes) -> Stretch:
    """The stretch with its time continued where the clock was set, back or forward, though the motion goes on."""
    time = stretch.time.copy()
    steps = np.diff(time)
    step = float(np.median(steps)) if len(steps) else 0.0
    if not stretch.positions or step <= 0:
        return stretch
    for kind, places in (("back", np.flatnonzero(steps < 0)), ("forward", np.flatnonzero(steps > MISSED * step))):
        if len(places) > max(len(time) // SELDOM, 1):
            continue
        going = [int(k) for k in places if _goes_on(stretch, int(k))]
        joined = [k for k in going if kind == "back" or _leaps(stretch, k, step)]
        for k in joined:
            time[k + 1 :] += time[k] + step - time[k + 1]
        if joined:
            shifts = ", ".join(f"{abs(stretch.time[k] + step - stretch.time[k + 1]):.4g} s" for k in joined[:4])
            text = (
                f"{stretch.name}: the clock was set {kind} at {len(joined)} rows ({shifts}) though the motion goes on"
            )
            notes(f"{text}: continued with its step", f"clock set {kind}", stretch.numbers(np.array(joined) + 1))
    return evolve(stretch, time=time)


def _leaps(stretch: Stretch, k: int, step: float) -> bool:
    """Whether some position would have to stop for the time that the stamps of rows k and k + 1 are apart, of rows that
    are usually `step` [s] apart.
    """
    rows = (stretch.time[k + 1] - stretch.time[k]) / step
    for column in stretch.positions:
        q = stretch.signals[:, column]
        speed = (q[k] - q[k - 2] + q[k + 3] - q[k + 1]) / 4
        if abs(speed) * (rows - 1) > 2 * JOINS * _usual_bend(q, k):  # a joint on either side of the gap
            return True
    return False


def _usual_bend(q: np.ndarray, k: int) -> float:
    """Second differences that are usual around row k."""
    around = np.abs(np.diff(q[max(k - 40, 0) : k + 42], 2))
    return float(np.quantile(around[np.isfinite(around)], 0.95)) if np.isfinite(around).any() else 0.0


def _goes_on(stretch: Stretch, k: int) -> bool:
    """Whether every position goes on from row k to k + 1 as it does between other rows, in place and in speed."""
    if k < 2 or k + 3 >= len(stretch.time):
        return False
    for column in stretch.positions:
        q = stretch.signals[:, column]
        bends = np.abs(np.diff(q[k - 1 : k + 3], 2))
        if not bends.max() <= JOINS * _usual_bend(q, k) + 1e-12:
            return False
    return True


def at_even_times(stretch: Stretch, notes: Notes) -> Stretch:
    """The stretch on even stamps where its positions are smoother on them than on those of the file."""
    time, n = stretch.time, len(stretch.time)
    columns = [k for k in stretch.positions if np.isfinite(stretch.signals[:, k]).all()]
    if n < 64 or not columns:
        return stretch
    steps = np.diff(time)
    typical = float(time[-1] - time[0]) / (n - 1)
    if typical <= 0 or np.abs(steps - typical).max() <= 0.1 * typical:
        return stretch
    bursts = float((steps == 0).mean()) > 0.1
    grid = _line(time)
    if np.abs(time - grid).max() > 0.02 * n * typical:
        return stretch
    smoother = _even_beside_distinct if bursts else _even_by_sign
    if not all(smoother(stretch.signals[:, k], time) for k in columns):
        return stretch
    kind = "bursts" if bursts else f"steps of {steps.min():.3g} to {steps.max():.3g} s"
    text = (
        f"{stretch.name}: the stamps tell when rows arrived ({kind}), not when they were measured: the motion is "
        f"smoother on an even grid of {typical:.6g} s, which is used"
    )
    notes(text, "stamps of arrival", stretch.numbers(np.arange(n)))
    return evolve(stretch, time=grid)


def _line(time: np.ndarray) -> np.ndarray:
    """The straight line through stamps (n,) over their numbers."""
    k = np.arange(len(time))
    slope, start = np.polyfit(k, time, 1)
    return start + slope * k


def _even_by_sign(values: np.ndarray, time: np.ndarray) -> bool:
    """Whether the sign test speaks for the even grid, and its errors are clearly smaller."""
    distinct = np.r_[True, np.diff(time) > 0]
    values, time = values[distinct], time[distinct]
    number = np.flatnonzero(distinct).astype(float)
    uneven = _uneven(time)
    own, even = _errors(values, time)[uneven], _errors(values, number)[uneven]
    differ = np.abs(own - even) > 1e-9 * np.ptp(values)
    count = int(differ.sum())
    if count < 64:
        return False
    share = float((even < own)[differ].mean())
    return share > 0.5 + SIGNS * SHARED / (2 * np.sqrt(count)) and np.median(even) < SMOOTHER * np.median(own)


def _uneven(stamps: np.ndarray) -> np.ndarray:
    """Inner rows (n - 4,) of which a step to a neighbour, or to theirs, is not the usual one."""
    steps = np.diff(stamps)
    usual = (stamps[-1] - stamps[0]) / len(steps)
    odd = np.abs(steps - usual) > 0.05 * usual
    return odd[:-3] | odd[1:-2] | odd[2:-1] | odd[3:]


def _errors(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Distance (n - 4,) of inner values from the cubic through two neighbours on either side, noise of one size."""
    offsets = (-2, -1, 1, 2)
    n = len(values)
    here = time[2 : n - 2]
    at = {o: time[2 + o : n - 2 + o] for o in offsets}
    total, squares = np.zeros(n - 4), np.ones(n - 4)
    for o in offsets:
        weight = np.ones(n - 4)
        for other in offsets:
            if other != o:
                weight *= (here - at[other]) / (at[o] - at[other])
        total += weight * values[2 + o : n - 2 + o]
        squares += weight**2
    return np.abs(values[2 : n - 2] - total) / np.sqrt(squares)


def _even_beside_distinct(values: np.ndarray, time: np.ndarray) -> bool:
    """Whether an even grid suits the first row of each stamp, and rows that share a stamp follow each other on it."""
    bends = np.abs(np.diff(values, 2))
    changes = np.diff(time) > 0
    border = changes[:-1] & changes[1:] if (changes[:-1] & changes[1:]).sum() >= 32 else changes[:-1] | changes[1:]
    inside = ~(changes[:-1] & changes[1:])
    if border.sum() < 32 or inside.sum() < 32:
        return False
    moves = np.abs(np.diff(values))
    within, between = np.mean(moves[~changes]), np.mean(moves[changes])
    alike = np.mean(bends[border]) < 3 * np.mean(bends[inside]) + 1e-15
    return bool(alike and within / 1.5 < between < 1.5 * within)
