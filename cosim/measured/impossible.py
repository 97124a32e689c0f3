"""Values that no motion can produce: jumps of a position, sentinel values, torques that drop to zero.

A position moves between two rows by its speed times the step. Its largest steps are close to each other, as extremes of
one law are: where the tail falls off exponentially or faster, the largest of n is more than r times the next with a
probability of at most about n^(1 - r). A step that is `APART` = 3 times as large as all that follow (n^-2, 1e-6 of a
thousand rows) is therefore not one of them. No threshold depends on the device or its units.
"""

import numpy as np
from attrs import evolve, frozen

from cosim.measured.clock import MISSED
from cosim.measured.notes import Notes
from cosim.measured.stretch import Stretch

APART = 3.0  # ratio of neighbouring order statistics that separates impossible steps from the largest possible one
FAR = 10.0  # the same for values of a signal that may jump; n^-9
SHARE = 0.1  # of the rows that may be impossible; where more are, the signal is another one
SHORT = 5  # rows; what is at most this long is interpolated over
FEW = 5  # new zeros of an encoder in one recording: someone resets it by hand; more jumps belong to another signal
LONE = 64  # values that stand out at all: of so many the largest is APART the next by chance in n^-2 = 2e-4
ORDERED = 16  # sizes: of fewer the largest may be APART from the next by chance in one of 256 signals and more
WHOLE_TURN = 0.2  # of a turn: the motion between two rows, which a jump of one turn holds too
COUNTS = 8.0  # smallest steps of the column: what is below is the encoder's own rounding
NINES = tuple(sign * (10.0**k - 1) for k in range(3, 10) for sign in (1, -1))
ENDS = tuple(float(v) for b in (15, 16, 31, 32) for v in (2**b, 2**b - 1, -(2**b), 1 - 2**b))


def possible(stretch: Stretch, notes: Notes) -> Stretch:
    """The stretch with impossible values as NaN and overflows of counters joined; each is told."""
    for column in range(len(stretch.names)):
        if column not in stretch.computed:
            check = _position if column in stretch.positions else _signal
            stretch = check(stretch, column, notes)
    return stretch


def separated(sizes: np.ndarray, ratio: float, most: int) -> float:
    """The largest of the sizes (n,) that belong together: those above it, at most `most`, are `ratio` times as large.

    Infinite where none stand apart.
    """
    if len(sizes) < ORDERED:
        return np.inf
    top = -np.sort(-sizes)[: most + 1]
    apart = np.flatnonzero((top[:-1] > ratio * top[1:]) & (top[1:] > 0))
    return float(top[apart[-1] + 1]) if len(apart) else np.inf


def _rounding(stretch: Stretch, column: int) -> float:
    """What is nothing beside the range of the column in the whole file: where a joint rests, numbers are rounding."""
    return 1e-4 * stretch.spans[column] if stretch.spans else 0.0


@frozen
class _Jump:
    """A step from row `before` to row `after` that no motion makes."""

    before: int
    after: int
    size: float


def _position(stretch: Stretch, column: int, notes: Notes) -> Stretch:
    values = stretch.signals[:, column]
    good = np.flatnonzero(np.isfinite(values))
    steps = np.diff(values[good])
    near = (
        np.diff(stretch.time[good]) <= (SHORT + MISSED) * float(np.median(np.diff(stretch.time)))
        if len(good) > 1
        else 0
    )
    sizes = np.abs(steps) * near
    largest = separated(sizes, APART, max(int(SHARE * len(sizes)), 1))
    if not np.isfinite(largest):
        return stretch
    count = float(sizes[sizes > 0].min())
    least = max(APART * largest, COUNTS * count, _rounding(stretch, column))
    found = np.flatnonzero(sizes > least * (1 - 1e-9))
    jumps = [_Jump(int(good[k]), int(good[k + 1]), float(steps[k])) for k in found]
    return _without_jumps(stretch, column, jumps, largest, notes) if jumps else stretch


def _without_jumps(stretch: Stretch, column: int, jumps: list[_Jump], largest: float, notes: Notes) -> Stretch:
    """Excursions are left out, overflows joined; of parts with zeros of their own the longest is kept."""
    values = stretch.signals[:, column].copy()
    missing, rest = _excursions(values, jumps, largest, stretch.angles)
    frozen_rows, rest = _frozen(values, rest, largest)
    overflows = _overflows(values, rest, missing, largest, stretch.angles)
    moved = [jump for jump in rest if jump not in overflows]
    where = f"{stretch.name}: {stretch.names[column]}"
    bound = f"no step of the others is larger than {largest:.3g}"
    if missing.any():
        rows = stretch.numbers(missing)
        text = f"{where} jumps away and back, {len(rows)} rows that no motion can reach ({bound}): left out as missing"
        notes(text, "jump", rows)
    if frozen_rows.any():
        rows = stretch.numbers(frozen_rows)
        text = (
            f"{where} stands still in {len(rows)} rows and then catches up in one step ({bound}): left out as missing"
        )
        notes(text, "frozen", rows)
    _joined(stretch, values, overflows, where, notes)
    values[missing | frozen_rows] = np.nan
    signals = stretch.signals.copy()
    signals[:, column] = values
    cells = np.ix_(missing, np.array(stretch.torques, dtype=int))
    signals[cells] = _zero_frames(signals[cells])
    stretch = evolve(stretch, signals=signals)
    if len(moved) > FEW:
        text = (
            f"{where} jumps in {len(moved)} rows and stays ({bound}), as no position does: was it swapped with another?"
        )
        notes(text, "swapped", stretch.numbers(np.array([jump.after for jump in moved])))
        return stretch
    return _longest(stretch, column, moved, where, notes) if moved else stretch


def _zero_frames(torques: np.ndarray) -> np.ndarray:
    """Torques of rows whose position is impossible: exact zeros belong to the same empty frame."""
    return np.where(torques == 0, np.nan, torques)


def _excursions(values: np.ndarray, jumps: list[_Jump], largest: float, angles: bool) -> tuple[np.ndarray, list[_Jump]]:
    """Rows (n,) between a jump and the ones that undo it, and the jumps that are not undone.

    An excursion is short, or holds one value throughout. One turn is a wrap and no excursion.
    """
    missing, rest, k = np.zeros(len(values), bool), [], 0
    while k < len(jumps):
        total, end = jumps[k].size, 0
        for stop in range(k + 1, len(jumps)):
            total += jumps[stop].size
            rows = jumps[stop].before - jumps[k].after + 1
            inside = values[jumps[k].after : jumps[stop].after]
            if rows > SHORT and np.nanmax(inside) > np.nanmin(inside):
                break
            net = values[jumps[stop].after] - values[jumps[k].before]
            if abs(net) <= APART * largest * (rows + 1):
                end = stop
                break
        if end and not (angles and _turn(jumps[k].size, largest)):
            missing[jumps[k].after : jumps[end].after] = True
            k = end + 1
        else:
            rest.append(jumps[k])
            k += 1
    return missing, rest


def _turn(size: float, largest: float) -> bool:
    turns = round(abs(size) / (2 * np.pi))
    return turns > 0 and abs(abs(size) - 2 * np.pi * turns) <= APART * largest


def _frozen(values: np.ndarray, jumps: list[_Jump], largest: float) -> tuple[np.ndarray, list[_Jump]]:
    """Rows (n,) in which a position stood at one value before it caught up, and the other jumps."""
    rows, rest = np.zeros(len(values), bool), []
    for jump in jumps:
        start = jump.before
        while start > 0 and values[start - 1] == values[jump.before]:
            start -= 1
        length = jump.before - start
        if length >= APART - 1 and abs(jump.size) <= APART * largest * (length + 1):
            rows[start + 1 : jump.before + 1] = True
        else:
            rest.append(jump)
    return rows, rest


def _overflows(
    values: np.ndarray, jumps: list[_Jump], missing: np.ndarray, largest: float, angles: bool
) -> list[_Jump]:
    """Jumps from one end of the column's range to the other, as a counter makes that overflows; whole turns too."""
    kept = values[~missing & np.isfinite(values)]
    low, high, slack = kept.min(), kept.max(), APART * largest
    found = []
    for jump in jumps:
        first, last = sorted((values[jump.before], values[jump.after]))
        if (first - low <= slack and high - last <= slack) or (angles and _turn(jump.size, largest)):
            found.append(jump)
    return found


def _joined(stretch: Stretch, values: np.ndarray, jumps: list[_Jump], where: str, notes: Notes) -> None:
    """Make one motion of the parts, in place: the range is that of the jumps, less the motion between two rows."""
    if not jumps:
        return
    turn = stretch.angles and all(_turn(jump.size, np.inf) for jump in jumps)
    sizes = np.array([abs(jump.size) for jump in jumps])
    span = 2 * np.pi if turn and abs(np.median(sizes) / (2 * np.pi) - 1) < WHOLE_TURN else _range(values, jumps)
    for jump in jumps:
        values[jump.after :] -= np.sign(jump.size) * span
    rows = stretch.numbers(np.array([jump.after for jump in jumps]))
    if span == 2 * np.pi:
        notes(f"{where} wraps round at {len(jumps)} rows: unwrapped", "wrap", rows)
        return
    text = f"{where} jumps from one end of its range to the other at {len(jumps)} rows, as a counter of {span:.6g} does"
    notes(f"{text} that overflows: joined to one motion", "overflow", rows)


def _range(values: np.ndarray, jumps: list[_Jump]) -> float:
    """Range of a counter: size of the jumps with the motion of one row added, as the rows before show it."""
    spans = []
    for jump in jumps:
        slope = values[jump.before] - values[max(jump.before - 1, 0)]
        spans.append(abs(jump.size - slope))
    return float(np.median(spans))


def _longest(stretch: Stretch, column: int, jumps: list[_Jump], where: str, notes: Notes) -> Stretch:
    """The longest part between steps that stay; positions of the other parts count from another zero."""
    edges = [0, *(jump.after for jump in jumps), len(stretch.time)]
    lengths = np.diff(edges)
    k = int(np.argmax(lengths))
    outside = np.ones(len(stretch.time), bool)
    outside[edges[k] : edges[k + 1]] = False
    sizes = ", ".join(f"{jump.size:.4g}" for jump in jumps[:4])
    text = f"{where} jumps by {sizes} and stays there: the encoder counts from another zero; the longest part is used"
    notes(f"{text}, {int(outside.sum())} rows left out", "new zero", stretch.numbers(outside))
    return stretch.rows(~outside)


def _signal(stretch: Stretch, column: int, notes: Notes) -> Stretch:
    """Sentinels and single wild values of a signal that may jump; torques that drop to exactly zero."""
    values = stretch.signals[:, column]
    good = np.isfinite(values)
    if good.sum() < ORDERED or not stretch.torques:
        return stretch
    bad = _sentinels(values, good, stretch.factors[column] if stretch.factors else 1.0) | _lone(values)
    bad &= np.abs(values) > _rounding(stretch, column)
    where = f"{stretch.name}: {stretch.names[column]}"
    if bad.any():
        held = np.unique(values[bad])
        kinds = f"{held[0]:g}" if len(held) == 1 else f"up to {np.abs(held).max():.4g}"
        text = f"{where} is {kinds} in {int(bad.sum())} rows, far from all other values: no measured value; left out"
        notes(f"{text} as missing", "sentinel", stretch.numbers(bad))
    dropped = _dropped(np.where(bad, np.nan, values)) if column in stretch.torques else np.zeros(len(values), bool)
    if dropped.any():
        text = (
            f"{where} drops to exactly 0 in {int(dropped.sum())} rows between values far from it: left out as missing"
        )
        notes(text, "dropout", stretch.numbers(dropped))
    if not (bad | dropped).any():
        return stretch
    signals = stretch.signals.copy()
    signals[bad | dropped, column] = np.nan
    return evolve(stretch, signals=signals)


def _sentinels(values: np.ndarray, good: np.ndarray, factor: float) -> np.ndarray:
    """Rows (n,) of values that stand apart from all others, alone or written as codes for `no value`."""
    off = np.where(good, np.abs(values - np.median(values[good])), 0.0)
    largest = separated(off[good], FAR, max(int(SHARE * good.sum()), 1))
    if not np.isfinite(largest):
        return np.zeros(len(values), bool)
    apart = off > largest
    coded = apart & np.isin(np.round(values / factor, 6), (*NINES, *ENDS))
    return coded | (apart & _short(apart))


def _lone(values: np.ndarray) -> np.ndarray:
    """Single rows (n,) that stand out against both neighbours further than any others do.

    How far a value lies beyond both of its neighbours is noise, whose largest values belong together.
    """
    ahead, behind = values[1:-1] - values[:-2], values[1:-1] - values[2:]
    out = np.where(ahead * behind > 0, np.minimum(np.abs(ahead), np.abs(behind)), 0.0)
    sizes = out[np.isfinite(out) & (out > 0)]
    rows = np.zeros(len(values), bool)
    if len(sizes) < LONE:
        return rows
    largest = separated(sizes, APART, max(int(SHARE * len(sizes)), 1))
    usual = float(np.nanmedian(np.abs(ahead)))  # where a signal is steep, noise seldom makes a value stand out
    rows[1:-1] = np.isfinite(out) & (out > max(largest, APART * usual))
    return rows


def _short(rows: np.ndarray) -> np.ndarray:
    """Those of the marked rows (n,) that stand in groups of at most SHORT."""
    edges = np.flatnonzero(np.diff(np.r_[0, rows.astype(int), 0])).reshape(-1, 2)
    result = np.zeros(len(rows), bool)
    for start, stop in edges:
        result[start:stop] = stop - start <= SHORT
    return result


def _dropped(values: np.ndarray) -> np.ndarray:
    """Rows (n,) with exact zeros, a few in a row, between values of one sign that are far away for single steps."""
    zero = _short(values == 0)
    steps = np.abs(np.diff(values))
    usual = FAR * float(np.nanmedian(steps)) if np.isfinite(steps).any() else np.inf
    for start, stop in np.flatnonzero(np.diff(np.r_[0, zero.astype(int), 0])).reshape(-1, 2):
        before, after = values[max(start - 1, 0)], values[min(stop, len(values) - 1)]
        zero[start:stop] &= bool(before * after > 0 and min(abs(before), abs(after)) > max(usual, 0.0))
    return zero
