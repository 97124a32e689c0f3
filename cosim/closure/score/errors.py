"""Torque error of a model in RMS% (Taati Eq. 15), per joint, before and after, with an interval by blocks."""

import numpy as np
from attrs import frozen

from cosim.closure.model.model import Model


@frozen(eq=False)
class TorqueError:
    """RMS% of the held-out rows per joint on which the joint moves: `before`, `after`, 95 % interval of `after`, and
    the same on fitted rows.

    At a standstill static friction takes any value, and within a filter's reach of a reversal its direction is not
    known: no model of motion is judged there. `all_before`, `all_after` include reversals, but not rests. share_moving,
    share_rest: of the held-out rows.
    """

    before: tuple[float, ...]
    after: tuple[float, ...]
    interval: tuple[tuple[float, float], ...]
    all_before: tuple[float, ...]
    all_after: tuple[float, ...]
    fitted_before: tuple[float, ...]
    fitted_after: tuple[float, ...]
    share_moving: tuple[float, ...]
    share_rest: tuple[float, ...]


def torque_error(before: Model, after: Model) -> TorqueError:
    """100 sqrt(sum r^2 / sum tau^2) of filtered torque, tau the recorded one for both models: no hypothesis lowers its
    error by making the record easier.
    """
    held, moving, rest = before.setting.rows.test, before.setting.rows.moving.T, _resting(before)
    every = _inside(before) & ~rest & after.told
    rows, fitted = every & held, every & ~held
    if not rows.any():
        rows = fitted
    return TorqueError(
        before=_percent(before, before, rows & moving),
        after=_percent(after, before, rows & moving),
        interval=_interval(after, before, rows & moving),
        all_before=_percent(before, before, rows),
        all_after=_percent(after, before, rows),
        fitted_before=_percent(before, before, fitted & moving),
        fitted_after=_percent(after, before, fitted & moving),
        share_moving=tuple(float(m) for m in (rows & moving).sum(axis=1) / np.maximum(rows.sum(axis=1), 1)),
        share_rest=tuple(float(m) for m in (rest & held).sum(axis=1) / max(held.sum(), 1)),
    )


def _inside(model: Model) -> np.ndarray:
    """Rows (m,) whose kernel lies within their run."""
    m, index = model.setting.motion, model.setting.rows.index
    reach = int(np.ceil(m.widths.support / m.step))
    start, stop = (np.array(edge)[m.run[index]] for edge in zip(*m.bounds, strict=True))
    return (index >= start + reach) & (index < stop - reach)


def _resting(model: Model) -> np.ndarray:
    """Rows (J, m) within whose kernel the joint never passes the standstill speed."""
    from scipy.ndimage import maximum_filter1d

    m, rows = model.setting.motion, model.setting.rows
    reach = int(np.ceil(2.5 * m.widths.total / m.step))
    fastest = np.concatenate([maximum_filter1d(np.abs(m.dq[a:b]), 2 * reach + 1, axis=0) for a, b in m.bounds])
    return (fastest[rows.index] < rows.standstill_speed).T


def _percent(model: Model, recorded: Model, rows: np.ndarray) -> tuple[float, ...]:
    rows = np.broadcast_to(rows, model.target.shape)
    pairs = zip(model.miss, torque(recorded), rows, strict=True)
    return tuple(
        100 * float(np.sqrt((r[u] ** 2).sum() / max((y[u] ** 2).sum(), 1e-300))) if u.any() else float("nan")
        for r, y, u in pairs
    )


def torque(model: Model) -> np.ndarray:
    """The measured torque (J, m), filtered, with what is known of it."""
    return model.target + model.given


def _interval(model: Model, recorded: Model, rows: np.ndarray) -> tuple[tuple[float, float], ...]:
    """95 % interval by resampling held-out blocks, 500 times."""
    rows = np.broadcast_to(rows, model.target.shape)
    block = model.setting.rows.block
    out: list[tuple[float, float]] = []
    for r, y, u in zip(model.miss, torque(recorded), rows, strict=True):
        numbers = np.unique(block[u])
        if len(numbers) < 3:
            out.append((float("nan"), float("nan")))
            continue
        place = np.searchsorted(numbers, block[u])
        sums = np.stack([np.bincount(place, x[u] ** 2) for x in (r, y)])
        draws = np.random.default_rng(0).integers(len(numbers), size=(500, len(numbers)))
        spread = 100 * np.sqrt(sums[0][draws].sum(axis=1) / np.maximum(sums[1][draws].sum(axis=1), 1e-300))
        low, high = np.percentile(spread, (2.5, 97.5))
        out.append((float(low), float(high)))
    return tuple(out)
