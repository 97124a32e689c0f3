"""Growth rate of a small difference between two runs, with an interval: what stability means in a simulation.

The difference y(t) of twin runs obeys the loop's variational equation, whatever forcing and delays they share. Its
exponential rate is estimated in two ways:

* modes: where the loop is constant, y is a sum of damped sinusoids. Their poles are found by ESPRIT (Roy and Kailath
  1989) on Hankel matrices of overlapping windows; the least damped pole that carries part of the difference gives the
  rate, the spread over the windows its interval.
* envelope: no model, for jitter, noise and loss. The rate is the slope of log |y|, averaged over one period of the
  dominant oscillation so that the envelope of a single mode has no ripple; the spread over blocks gives the interval.

The envelope's estimate is kept unless the interval of the modes is at least five times narrower, which shows that the
modes explain the difference. To take the narrower of two comparable intervals would make intervals too narrow.
"""

from functools import cache

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

_SAMPLES = 100
_ROWS = 20
_ORDER = 12
_SKETCH = 20
"""Columns of the sketch that the dominant singular vectors of a Hankel matrix are found from."""
_SHARP = 1e-5
"""A rate known to this [1/s] is not worth another look at the later part of the run."""
_T95 = {1: 12.71, 2: 4.30, 3: 3.18, 4: 2.78, 5: 2.57, 6: 2.45, 7: 2.36}
"""Two-sided 95 % quantiles of Student's t by degrees of freedom."""


@frozen
class Growth:
    """Rate [1/s] with its 95 % interval, frequency [rad/s] of the mode that shows it, and the time window [s] it was
    seen in.
    """

    rate: float
    low: float
    high: float
    frequency: float
    window: tuple[float, float]
    estimator: str

    @property
    def half_width(self) -> float:
        """Half the width of the interval [1/s]."""
        return 0.5 * (self.high - self.low)


def usable(norm: np.ndarray, floor: float, ceiling: float) -> slice:
    """The longest stretch of `norm` (n,) that lies above the round-off `floor` and below the saturation `ceiling`.

    The norm oscillates, so a moment counts as at the floor only if it and what follows within 2 % of the run stay
    there.
    """
    if len(norm) == 0:
        return slice(0, 0)
    reach = max(1, len(norm) // 50)
    ahead = _running_max(norm, reach)
    inside = (ahead > floor) & (ahead < ceiling)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    if edges.size == 0:
        return slice(0, 0)
    starts, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - starts))
    return slice(int(starts[longest]), int(stops[longest]))


def _running_max(values: np.ndarray, reach: int) -> np.ndarray:
    """The largest of each value and those that follow, `reach` in all: windows doubled in length, then overlapped."""
    found, length = np.concatenate([values, np.repeat(values[-1:], reach - 1)]), 1
    while 2 * length <= reach:
        found, length = np.maximum(found[:-length], found[length:]), 2 * length
    rest = reach - length
    return np.maximum(found[: len(found) - rest], found[rest:])


def growth(time: np.ndarray, difference: np.ndarray) -> Growth | None:
    """Growth rate of `difference` (n, channels) sampled evenly at `time` (n,) [s]; None where there are fewer than 40
    samples.

    The caller has cut round-off floor and saturation off (`usable`).
    """
    if len(time) < 40 or not np.all(np.isfinite(difference)):
        return None
    slope = _rough_slope(time, difference)
    level = difference * np.exp(-slope * (time - time[0]))[:, None]
    modes = _modes_growth(time, level)
    frequency = modes.frequency if modes else 0.0
    best = _preferred(modes, _envelope_growth(time, level, frequency))
    if best is None:
        return None
    return Growth(best.rate + slope, best.low + slope, best.high + slope, best.frequency, best.window, best.estimator)


def _preferred(modes: Growth | None, envelope: Growth | None) -> Growth | None:
    if modes is None or envelope is None:
        return modes or envelope
    return modes if modes.half_width < 0.2 * envelope.half_width else envelope


def _rough_slope(time: np.ndarray, difference: np.ndarray) -> float:
    stride = max(1, len(time) // 500)
    norm, moments = np.linalg.norm(difference[::stride], axis=1), time[::stride]
    positive = norm > 0
    return _line(moments[positive], np.log(norm[positive])) if positive.sum() > 10 else 0.0


def _line(t: np.ndarray, y: np.ndarray) -> float:
    """Slope of the least-squares line through y (n,) at t (n,)."""
    t = t - t.mean()
    return float(t @ y / (t @ t))


def _interval(values: np.ndarray) -> tuple[float, float]:
    """Mean and 95 % half width of nearly independent values by Student's t."""
    count = len(values)
    return float(np.mean(values)), float(_T95.get(count - 1, 2.31) * np.std(values, ddof=1) / np.sqrt(count))


# modes ---------------------------------------------------------------------------------------------------------------


def _modes_growth(time: np.ndarray, level: np.ndarray) -> Growth | None:
    """Least damped mode over three overlapping windows; of the later part where its interval is three times
    narrower.
    """
    whole = _modes_from(time, level, 0.0)
    if whole is not None and whole.half_width < _SHARP:
        return whole
    return _modes_from(time, level, 0.4, whole.half_width / 3.0 if whole else np.inf) or whole


def _modes_from(time: np.ndarray, level: np.ndarray, begin: float, limit: float = np.inf) -> Growth | None:
    """Least damped mode from the share `begin` of the run on; None as soon as it is sure that half its interval reaches
    `limit`.
    """
    first, count = int(begin * len(time)), len(time)
    length = int(0.55 * (count - first))
    if length < 40:
        return None
    begins = first + np.linspace(0, count - first - length, 3).astype(int)
    modes: dict[int, complex] = {}
    for k in (0, 2, 1):  # what is farthest apart differs most
        part = slice(begins[k], begins[k] + length)
        mode = dominant_mode(time[part], level[part])
        if mode is None:
            return None
        modes[k] = mode
        rates = [modes[k].real for k in sorted(modes)]
        if 0.5 * _T95[2] * np.ptp(rates) >= limit:  # three values deviate by half their range at least
            return None
    rate, half = _interval(np.array(rates))
    # Windows overlap, so that their spread alone is too small: the standard error of the mean is not divided by
    # sqrt(3).
    half = max(np.sqrt(3.0) * half, 1e-9)
    return (
        None
        if half >= limit
        else Growth(
            rate,
            float(rate - half),
            float(rate + half),
            abs(modes[2].imag),
            (float(time[first]), float(time[-1])),
            "modes",
        )
    )


def dominant_mode(time: np.ndarray, signals: np.ndarray) -> complex | None:
    """Pole [1/s + i rad/s] with the largest real part among those that carry at least 3 % of `signals` (n,
    channels).
    """
    stride = max(1, len(time) // _SAMPLES)
    y, step = _principal(signals[::stride]), stride * (time[-1] - time[0]) / (len(time) - 1)
    found = poles(y, step)
    found = found[found.imag >= 0.0]
    if found.size == 0:
        return None
    shares = _shares(found, y, step)
    shares[~np.isfinite(shares)] = 0.0  # a pole out of the range of doubles carries nothing
    carrying = found[shares > 0.03 * shares.max()]
    return complex(carrying[np.argmax(carrying.real)]) if carrying.size else None


def _principal(signals: np.ndarray, keep: int = 4) -> np.ndarray:
    """At most `keep` principal components of the channels."""
    u, s, _ = np.linalg.svd(signals, full_matrices=False)
    count = max(1, min(keep, int(np.sum(s > 1e-6 * s[0]))))
    return u[:, :count] * s[:count]


def poles(signals: np.ndarray, step: float, order: int = _ORDER, cut: float = 1e-6) -> NDArray[np.complex128]:
    """Poles of a sum of exponentials by ESPRIT: shift invariance of the signal subspace of the block Hankel matrix.

    `signals` (n, c) sampled every `step` [s]; the channels stand side by side in the rows, so that modes of nearly
    the same frequency but different shape are told apart. Singular values below `cut` times the first are noise.
    Shape (k,) [1/s].
    """
    count, channels = signals.shape
    delays = min(count // 2, _ROWS)
    hankel = np.concatenate([signals[k : count - delays + 1 + k].T for k in range(delays)])
    u, s = _left_singular(hankel)
    rank = int(min(order, np.sum(s > cut * s[0]), (delays - 1) * channels - 1))
    if rank < 1:
        return np.empty(0, complex)
    shift = np.linalg.lstsq(u[:-channels, :rank], u[channels:, :rank], rcond=None)[0]
    z = np.linalg.eigvals(shift)
    z = z[np.abs(z) > 1e-8]
    logarithms: NDArray[np.complex128] = np.log(z.astype(complex))
    return logarithms / step


def _left_singular(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Leading left singular vectors (m, k) and values (k,) of a matrix (m, n), k = min(m, n, _SKETCH).

    Subspace iteration from a random sketch (Halko, Martinsson and Tropp 2011, Alg. 4.4): what lies beyond the sketch is
    damped by the fourth power of its singular values' ratio, in a fifth of the time of a whole decomposition.
    """
    basis = _sketch(matrix.shape[0], min(*matrix.shape, _SKETCH))
    for _ in range(2):
        basis = np.linalg.qr(matrix @ (matrix.T @ basis))[0]
    within = basis.T @ matrix
    squares, u = np.linalg.eigh(within @ within.T)
    return basis @ u[:, ::-1], np.sqrt(np.maximum(squares[::-1], 0.0))


@cache
def _sketch(rows: int, columns: int) -> np.ndarray:
    return np.random.default_rng(0).standard_normal((rows, columns))


def _shares(found: NDArray[np.complex128], signals: np.ndarray, step: float) -> np.ndarray:
    """RMS that each pole contributes to `signals`, over the later half of the window; `found`: one of each conjugate
    pair.
    """
    times = step * np.arange(len(signals))
    envelope, angle = np.exp(np.clip(np.outer(times, found.real), -300, 300)), np.outer(times, found.imag)
    power = envelope**2
    size = np.sqrt(power.sum(axis=0))
    envelope /= size
    columns = np.hstack([envelope * np.cos(angle), envelope * np.sin(angle)])
    amplitude = np.hypot(*np.split(np.linalg.lstsq(columns, signals, rcond=1e-10)[0], 2)) / size[:, None]
    late = power[len(power) // 2 :].mean(axis=0)
    pairs = np.where(found.imag > 0, 0.5, 1.0)
    return pairs * np.sqrt(late) * np.linalg.norm(amplitude, axis=1)


# envelope ------------------------------------------------------------------------------------------------------------


def _envelope_growth(time: np.ndarray, level: np.ndarray, frequency: float) -> Growth | None:
    """Slope of the log of the period-averaged norm, from the earliest beginning that gives nearly the narrowest
    interval.
    """
    step = (time[-1] - time[0]) / (len(time) - 1)
    period = round(2.0 * np.pi / frequency / step) if frequency > 0 else len(time) // 10
    if not 2 <= period <= len(time) // 4:
        period = len(time) // 8
    power = np.concatenate([[0.0], np.cumsum(np.einsum("ij,ij->i", level, level))])
    mean = (power[period:] - power[:-period]) / period
    if np.any(mean <= 0):
        return None
    moments, log_norm = time[: len(mean)] + 0.5 * (period - 1) * step, 0.5 * np.log(mean)
    stride = max(1, len(mean) // 800)
    moments, log_norm = moments[::stride], log_norm[::stride]
    found = [_slope(moments, log_norm, begin, frequency) for begin in (0.0, 0.2, 0.4, 0.6)]
    narrowest = min(g.half_width for g in found)
    return next(g for g in found if g.half_width <= 1.5 * narrowest)


def _slope(moments: np.ndarray, log_norm: np.ndarray, begin: float, frequency: float, blocks: int = 6) -> Growth:
    """Least-squares slope with an interval from the slopes of six blocks.

    The interval is Student's (a least-squares slope of a random walk has 6/5 the variance of the mean block slope,
    and the beginning was chosen: hence the factor 1.3, measured to cover 92 % of random walks), cut to the range of
    the block slopes, which holds their median with 97 % whatever their distribution: other modes still dying out make
    a trend, not scatter.
    """
    first = int(begin * len(moments))
    t, y = moments[first:], log_norm[first:]
    rate = _line(t, y)
    edges = np.linspace(0, len(t) - 1, blocks + 1).astype(int)
    parts = np.diff(y[edges]) / np.diff(t[edges])
    half = max(1.3 * _interval(parts)[1], 1e-9)
    low, high = max(rate - half, min(parts.min(), rate - 1e-9)), min(rate + half, max(parts.max(), rate + 1e-9))
    return Growth(rate, float(low), float(high), frequency, (float(t[0]), float(t[-1])), "envelope")
