"""Clocks that were set, stamps that tell when a row arrived and not when it was measured, rows recorded twice.

Positions decide: rows are in the order, and at the times, in which the motion is smooth. Each value is compared with
the cubic through its four neighbours; its error is divided by sqrt(1 + sum of squared weights), so that noise alone
makes errors of one size on any stamps. On stamps that mean nothing the even grid then gives the smaller error in more
than half of the rows: a sign test, widened by the five rows that neighbouring errors share.
"""

import itertools

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
FREE = 0.01
"""Rate error of a clock that runs by itself: the oscillator inside a microcontroller is trimmed to 1 % (STM32F405
datasheet, HSI), a crystal keeps 1e-4. What was set by more was not set to make up for that.
"""
COPIED = 16  # rows in succession that repeat earlier ones
MOST = 0.5  # of such a block: as many rows move, or a joint at rest is taken for a copy
PERIODIC = 0.3  # of all rows that repeat others: beyond, not a block was written twice but the motion has no noise
TESTED = 64  # comparisons of a sign test; SIGNS * SHARED standard deviations of fewer are more than the half there is
JITTER = 0.05  # of a step: stamps this close to an even grid are taken as even
GROUPED = 0.1  # of the rows with the stamp of the row before: no accident, they came, or were rounded, in groups
ROUNDING = 1e-9  # of a column's range: what is less comes from arithmetic


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
        if moving[block].sum() > MOST * (stop - start) and stop - start >= COPIED:
            copied[block] = True
    count = int(copied.sum())
    if not count:
        return stretch
    text = f"{stretch.name}: {count} rows repeat earlier rows to the last digit, in blocks"
    if count > PERIODIC * n:
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
    steps = np.diff(stretch.time)
    step = float(np.median(steps)) if len(steps) else 0.0
    if not stretch.positions or step <= 0:
        return stretch
    rows: list[int] = []  # before which the clock was set
    for kind, places in (("back", np.flatnonzero(steps < 0)), ("forward", np.flatnonzero(steps > MISSED * step))):
        if len(places) > max(len(steps) // SELDOM, 1):
            continue
        going = [int(k) for k in places if _goes_on(stretch, int(k))]
        joined = [k + 1 for k in going if kind == "back" or _leaps(stretch, k, step)]
        if joined:
            shifts = ", ".join(f"{abs(steps[k - 1] - step):.4g} s" for k in joined[:4])
            text = (
                f"{stretch.name}: the clock was set {kind} at {len(joined)} rows ({shifts}) though the motion goes on"
            )
            notes(f"{text}: continued with its step", f"clock set {kind}", stretch.numbers(np.array(joined)))
            rows += joined
    if not rows:
        return stretch
    time = stretch.time.copy()
    for first, last in itertools.pairwise((*sorted(rows), len(time))):
        time[first:last] = time[first - 1] + step + (stretch.time[first:last] - stretch.time[first])
    return evolve(stretch, time=time, pace=_pace(stretch, time, max(rows), notes))


def _pace(stretch: Stretch, time: np.ndarray, last: int, notes: Notes) -> float:
    """Seconds for one of the continued time (n,) if the clock was right in the first row and when it was set for the
    last time, before row `last`: then it runs fast or slow between. 1 where it was set by more than such a clock would
    need.

    A clock that ran before the first row had more time to be wrong: it is that wrong at most.
    """
    pace = float((stretch.time[last] - stretch.time[0]) / (time[last] - time[0]))
    if pace == 1 or abs(pace - 1) > FREE:
        return 1.0
    way = "fast" if pace < 1 else "slow"
    text = (
        f"{stretch.name}: the clock was set as one is set right that runs {way} by up to {100 * abs(1 - pace):.2g} %: "
        "rows cannot tell whether it does. The intervals hold both"
    )
    notes(text, "pace of the clock", stretch.numbers(np.array([last])))
    return pace


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
        if not bends.max() <= JOINS * _usual_bend(q, k) + ROUNDING * np.ptp(q[k - 2 : k + 4]):
            return False
    return True


def at_even_times(stretch: Stretch, notes: Notes) -> Stretch:
    """The stretch on even stamps where its positions are smoother on them than on those of the file."""
    time, n = stretch.time, len(stretch.time)
    columns = [k for k in stretch.positions if np.isfinite(stretch.signals[:, k]).all()]
    if n < TESTED or not columns:
        return stretch
    steps = np.diff(time)
    typical = float(time[-1] - time[0]) / (n - 1)
    if typical <= 0 or np.abs(steps - typical).max() <= 2 * JITTER * typical:
        return stretch
    bursts = float((steps == 0).mean()) > GROUPED
    grid = _line(time)
    if np.abs(time - grid).max() > 2 * FREE * n * typical:  # two clocks: where rows are measured, where they arrive
        return stretch
    smoother = _even_in_groups if bursts else _even_by_sign
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
    differ = np.abs(own - even) > ROUNDING * np.ptp(values)
    more = _more_often(even[differ] < own[differ])
    return more is True and np.median(even) < SMOOTHER * np.median(own)


def _more_often(signs: np.ndarray) -> bool | None:
    """Whether signs (n,) hold in more rows than chance lets them, half of all; None where they are too few to tell."""
    if len(signs) < TESTED:
        return None
    return bool(signs.mean() > 0.5 + SIGNS * SHARED / (2 * np.sqrt(len(signs))))


def _uneven(stamps: np.ndarray) -> np.ndarray:
    """Inner rows (n - 4,) of which a step to a neighbour, or to theirs, is not the usual one."""
    steps = np.diff(stamps)
    usual = (stamps[-1] - stamps[0]) / len(steps)
    odd = np.abs(steps - usual) > JITTER * usual
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


def _even_in_groups(values: np.ndarray, time: np.ndarray) -> bool:
    """Whether rows that share a stamp follow each other as all rows do: a step from one group to the next is as large
    as those inside the two.

    Where the rows of a group belong to one moment, the motion lies between the groups. Where rows were lost at random,
    a step that crosses a given moment is a longer one than others are.
    """
    change, size = np.diff(time) > 0, np.abs(np.diff(values))
    first = np.r_[0, np.flatnonzero(change) + 1, len(time)]  # rows that begin a group
    moved = np.add.reduceat(np.r_[np.where(change, 0.0, size), 0.0], first[:-1])  # within each group
    steps = np.diff(first) - 1
    around = steps[:-1] + steps[1:]
    between = size[first[1:-1] - 1]
    longer = (between - (moved[:-1] + moved[1:]) / np.maximum(around, 1))[around > 0]
    if len(longer) < TESTED:
        return False
    mean = float(longer.mean())
    return mean <= SIGNS * float(longer.std()) / np.sqrt(len(longer)) or mean <= JITTER * float(size.mean())
