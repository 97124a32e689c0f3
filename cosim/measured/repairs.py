"""Named repairs of a recorded run: what was wrong with it, what was done, in words; or why it cannot be used.

A run enters as raw columns in SI and leaves as one or more stretches on an even time grid.
"""

import itertools

import numpy as np
from attrs import evolve

from cosim.errors import InputError, Problem
from cosim.measured import clipping, clock, held, impossible
from cosim.measured.notes import Notes
from cosim.measured.stamps import FASTEST, SCATTERED, SLOWEST
from cosim.measured.stretch import Stretch

SHORTEST = 64  # rows; a low-pass filter needs that many
BRIDGED = 5  # missing samples up to this are interpolated, more split the run
WRAPPED = 0.75  # of a turn between two rows: nearer to a whole turn than to the half one up to which a joint may move


def repair(stretch: Stretch, note: Notes) -> list[Stretch]:
    """Even, complete stretches from one run; each repair is described to `note`. Raises InputError."""
    stretch = clock.continued(clock.without_copies(_timed(stretch, note), note), note)
    pieces = [piece for part in _restarts(stretch, note) for piece in _repair_times(part, note)]
    even = [_even(_unwrapped(_filled(piece, note), note), note) for piece in pieces]
    return _long_enough(stretch.name, even, note)


def _repair_times(stretch: Stretch, note: Notes) -> list[Stretch]:
    stretch = _distinct(clock.at_even_times(_sorted(stretch, note), note), note)
    _check_step(stretch)
    stretch = clipping.marked(impossible.possible(held.thinned(stretch, note), note), note)
    return [piece for part in _complete(stretch, note) for piece in _without_gaps(part, note)]


def _timed(stretch: Stretch, note: Notes) -> Stretch:
    good = np.isfinite(stretch.time)
    missing = int((~good).sum())
    if not missing:
        return stretch
    if missing > SCATTERED * len(good):
        raise InputError(Problem(f"{stretch.name}: time", "numbers", f"{missing} of {len(good)} rows without a time"))
    note(f"{stretch.name}: {missing} rows without a time dropped", "no time", stretch.numbers(~good))
    return stretch.rows(good)


def _restarts(stretch: Stretch, note: Notes) -> list[Stretch]:
    """Split where the clock starts again: blocks whose times overlap are separate recordings."""
    back = np.flatnonzero(np.diff(stretch.time) < 0) + 1
    if not len(back) or len(back) > max(len(stretch.time) // SHORTEST, 1):
        return [stretch]
    blocks = np.split(np.arange(len(stretch.time)), back)
    spans = sorted((stretch.time[block].min(), stretch.time[block].max()) for block in blocks)
    slack = SHORTEST * float(np.median(np.abs(np.diff(stretch.time))))  # a few rows out of order are no new recording
    apart = all(after[0] >= before[1] - slack for before, after in itertools.pairwise(spans))
    if apart or min(len(block) for block in blocks) < SHORTEST:
        return [stretch]
    note(
        f"{stretch.name}: time starts again at row(s) {', '.join(str(b + 1) for b in back[:8])}: "
        f"taken as {len(blocks)} separate recordings",
        "restart",
        stretch.numbers(back),
    )
    return [stretch.rows(block, f"{stretch.name}#{number}") for number, block in enumerate(blocks, 1)]


def _sorted(stretch: Stretch, note: Notes) -> Stretch:
    descents = int((np.diff(stretch.time) < 0).sum())
    if not descents:
        return stretch
    rows = stretch.numbers(np.flatnonzero(np.diff(stretch.time) < 0) + 1)
    note(f"{stretch.name}: time runs backwards at {descents} rows: rows sorted by time", "order", rows)
    return stretch.rows(np.argsort(stretch.time, kind="stable"))


def _distinct(stretch: Stretch, note: Notes) -> Stretch:
    repeated = np.r_[False, np.diff(stretch.time) == 0]
    count = int(repeated.sum())
    if not count:
        return stretch
    if count > clock.GROUPED * len(repeated):
        raise InputError(
            Problem(
                f"{stretch.name}: time",
                "a time stamp per row",
                f"{count} of {len(repeated)} rows repeat a time stamp",
                "is the time column written with too few digits?",
            )
        )
    text = f"{stretch.name}: {count} rows repeat a time stamp: the first of each kept"
    note(text, "repeated stamp", stretch.numbers(repeated))
    return stretch.rows(~repeated)


def _check_step(stretch: Stretch) -> None:
    if len(stretch.time) < 2:
        return
    step = float(np.median(np.diff(stretch.time)))
    where = f"{stretch.name}: time"
    if step > SLOWEST:
        advice = 'if the column is in ms, say [units] time = "ms"'
        raise InputError(Problem(where, "seconds, at least 10 rows a second", f"a step of {step:.4g} s", advice))
    if step < FASTEST:
        raise InputError(Problem(where, "seconds", f"a step of {step:.3g} s", "wrong [units] of time?"))


def _complete(stretch: Stretch, note: Notes) -> list[Stretch]:
    """Cut out long holes (NaN, inf) of any signal; short ones stay for `_filled`."""
    bad = ~np.isfinite(stretch.signals)
    for column in np.flatnonzero(bad.mean(axis=0) > SCATTERED):
        share = 100 * bad[:, column].mean()
        got = f"{share:.0f} % of the rows are empty, NaN or infinite"
        raise InputError(Problem(f"{stretch.name}: {stretch.names[column]}", "numbers", got))
    hole = _long_holes(np.asarray(bad.any(axis=1)))
    if not hole.any():
        return [stretch]
    pieces = np.split(np.arange(len(hole)), np.flatnonzero(np.diff(hole.astype(int))) + 1)
    kept = [piece for piece in pieces if not hole[piece[0]]]
    note(
        f"{stretch.name}: {int(hole.sum())} rows with missing values (more than {BRIDGED} in a row) left out, "
        f"{len(kept)} stretches kept",
        "hole",
        stretch.numbers(hole),
    )
    return [stretch.rows(piece, _part(stretch.name, number, len(kept))) for number, piece in enumerate(kept, 1)]


def _long_holes(bad: np.ndarray) -> np.ndarray:
    """Rows of holes longer than BRIDGED, and holes at either end. bad: (n,) bool."""
    edges = np.flatnonzero(np.diff(np.r_[0, bad.astype(int), 0]))
    hole = np.zeros(len(bad), bool)
    for start, stop in edges.reshape(-1, 2):
        hole[start:stop] = stop - start > BRIDGED or start == 0 or stop == len(bad)
    return hole


def _part(name: str, number: int, parts: int) -> str:
    return name if parts == 1 else f"{name}/{number}"


def _without_gaps(stretch: Stretch, note: Notes) -> list[Stretch]:
    """Split where more than BRIDGED samples are missing from the time column."""
    steps = np.diff(stretch.time)
    if not len(steps):
        return [stretch]
    typical = float(np.median(steps))
    gaps = np.flatnonzero(steps > (BRIDGED + clock.MISSED) * typical)
    if not len(gaps):
        return [stretch]
    longest = float(steps[gaps].max())
    text = f"{stretch.name}: {len(gaps)} gaps in time (longest {longest:.4g} s, step {typical:.4g} s): split there"
    note(text, "gap", stretch.numbers(gaps + 1))
    pieces = np.split(np.arange(len(stretch.time)), gaps + 1)
    return [stretch.rows(piece, _part(stretch.name, number, len(pieces))) for number, piece in enumerate(pieces, 1)]


def _filled(stretch: Stretch, note: Notes) -> Stretch:
    """Short holes by linear interpolation in time."""
    bad = ~np.isfinite(stretch.signals)
    if not bad.any():
        return stretch
    signals = stretch.signals.copy()
    for column in np.flatnonzero(bad.any(axis=0)):
        good = ~bad[:, column]
        signals[~good, column] = np.interp(stretch.time[~good], stretch.time[good], signals[good, column])
    where = ", ".join(f"{stretch.names[c]} {int(bad[:, c].sum())}" for c in np.flatnonzero(bad.any(axis=0))[:6])
    note(
        f"{stretch.name}: missing values interpolated ({where})",
        "missing",
        stretch.numbers(np.asarray(bad.any(axis=1))),
    )
    return evolve(stretch, signals=signals)


def _unwrapped(stretch: Stretch, note: Notes) -> Stretch:
    """Joint angles that jump by a turn between rows are made continuous."""
    if not stretch.angles:
        return stretch
    signals = stretch.signals
    for column in stretch.positions:
        jumps = int((np.abs(np.diff(signals[:, column])) > WRAPPED * 2 * np.pi).sum())
        if jumps:
            signals = signals.copy()
            rows = stretch.numbers(np.flatnonzero(np.abs(np.diff(signals[:, column])) > WRAPPED * 2 * np.pi) + 1)
            signals[:, column] = np.unwrap(signals[:, column])
            note(f"{stretch.name}: {stretch.names[column]} wraps round at {jumps} rows: unwrapped", "wrap", rows)
    return evolve(stretch, signals=signals)


def _even(stretch: Stretch, note: Notes) -> Stretch:
    """Onto an even time grid: stamps within `clock.JITTER` of one are replaced by it, others are resampled.

    Positions and torques by cubic splines, all else linear; no low-pass, no delay.
    """
    n = len(stretch.time)
    if n < SHORTEST:
        return stretch
    grid = np.linspace(stretch.time[0], stretch.time[-1], n)
    step = (grid[-1] - grid[0]) / (n - 1)
    if np.abs(stretch.time - grid).max() <= clock.JITTER * step:
        return evolve(stretch, time=grid)
    step = float(np.median(np.diff(stretch.time)))
    count = int(np.floor((stretch.time[-1] - stretch.time[0]) / step * (1 + 1e-12))) + 1
    grid = stretch.time[0] + step * np.arange(count)
    steps = np.diff(stretch.time)
    note(
        f"{stretch.name}: non-uniform time stamps (steps {steps.min():.4g} to {steps.max():.4g} s) resampled to "
        f"{step:.6g} s, positions and torques by cubic splines, other signals by linear interpolation",
        "uneven stamps",
        stretch.numbers(np.arange(n)),
    )
    nearest = np.clip(np.searchsorted(stretch.time, grid - step / 2), 0, n - 1)
    return evolve(stretch.rows(nearest), time=grid, signals=_resampled(stretch, grid))


def _resampled(stretch: Stretch, grid: np.ndarray) -> np.ndarray:
    """Signals on the grid: both sides of the equation of motion by one operator, cubic splines; all else by lines."""
    from scipy.interpolate import CubicSpline

    columns = []
    for column in range(stretch.signals.shape[1]):
        values = stretch.signals[:, column]
        smooth = column in stretch.positions or column in stretch.torques
        columns.append(CubicSpline(stretch.time, values)(grid) if smooth else np.interp(grid, stretch.time, values))
    return np.column_stack(columns)


def _long_enough(name: str, stretches: list[Stretch], note: Notes) -> list[Stretch]:
    kept = [stretch for stretch in stretches if len(stretch.time) >= SHORTEST]
    short = len(stretches) - len(kept)
    if not kept:
        longest = max((len(stretch.time) for stretch in stretches), default=0)
        got = f"{longest} rows in a piece after the repairs"
        raise InputError(Problem(name, f"at least {SHORTEST} rows without a gap", got, "record longer"))
    if short:
        note(f"{name}: {short} stretches shorter than {SHORTEST} rows left out")
    return kept


def recentred(stretch: Stretch, columns: tuple[int, ...], note: Notes) -> Stretch:
    """A torque that is held from its stamp to the next, as its mean over one step either side of the stamp.

    tau(t_k) = (tau_k-1 + tau_k) / 2: as it stands the column is half a step early against q.
    """
    if not columns:
        return stretch
    signals = stretch.signals.copy()
    own = signals[:, list(columns)]
    signals[1:, list(columns)] = (own[1:] + own[:-1]) / 2
    note(f"{stretch.name}: torque is held from its stamp to the next: moved half a step to the middle")
    clipped = stretch.clipped
    if clipped is not None:
        clipped = clipped | np.r_[clipped[:1], clipped[:-1]]
    return evolve(stretch, signals=signals, clipped=clipped)
