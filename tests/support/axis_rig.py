"""One joint with equations of its own: a prescribed motion, the torque that it takes, an encoder, noise; and what can
go wrong between the joint and the file.
"""

from pathlib import Path

import numpy as np
from attrs import evolve, frozen

TRUTH = {"inertia": 0.8, "viscous": 1.1, "coulomb": 0.6, "offset": 0.05}  # kg m^2, N m s/rad, N m, N m
COUNT = 2 * np.pi / 40000  # rad
NOISE = 0.02  # N m
DESCRIPTION = 'device = "axis"\njoint = "j"\n[columns]\ntime = "t"\nq = ["q"]\ntau = ["tau"]\n'


@frozen(eq=False)
class AxisLog:
    """Columns (n,) as a file has them, a random generator for what is done to them, and the true position (n,)."""

    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    rng: np.random.Generator
    clean: np.ndarray = np.zeros(0)

    def rows(self, keep: np.ndarray) -> "AxisLog":
        """Some rows, or another order of rows."""
        return evolve(self, t=self.t[keep], q=self.q[keep], tau=self.tau[keep])

    def write(self, path: Path, description: str = DESCRIPTION) -> Path:
        """The table as CSV with its description beside it."""
        np.savetxt(path, np.column_stack([self.t, self.q, self.tau]), "%.9g", ",", header="t,q,tau", comments="")
        path.with_suffix(".toml").write_text(description)
        return path


def recorded(seed: int, rate: float = 500.0, seconds: float = 24.0, size: float = 1.0) -> AxisLog:
    """A clean recording: a sum of sines of 0.2 to 1.6 Hz with random phases and sizes."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    w = 2 * np.pi * np.array([0.2, 0.33, 0.71, 1.13, 1.57]) * rng.uniform(0.9, 1.1, 5)
    a = size * rng.uniform(0.5, 1.0, 5) / w
    angle = w * t[:, None] + rng.uniform(0, 2 * np.pi, 5)
    q, dq, ddq = (a * np.sin(angle)).sum(1), (a * w * np.cos(angle)).sum(1), -(a * w**2 * np.sin(angle)).sum(1)
    j, b, c, d = TRUTH.values()
    tau = j * ddq + b * dq + c * np.sign(dq) + d + NOISE * rng.normal(size=len(t))
    return AxisLog(t, np.round(q / COUNT) * COUNT, tau, rng, q)


def dropped(x: AxisLog, strength: float) -> AxisLog:
    """Frames whose position reads zero: 2 to 8 of them, of 1 to 3 rows."""
    q = x.q.copy()
    for row in x.rng.choice(len(q) - 4, int(2 * strength), replace=False):
        q[row : row + x.rng.integers(1, 4)] = 0.0
    return evolve(x, q=q)


def spiked(x: AxisLog, strength: float) -> AxisLog:
    """Five single positions that are off by 0.1 rad times the strength."""
    q = x.q.copy()
    q[x.rng.choice(len(q), 5, replace=False)] += 0.1 * strength * x.rng.choice([-1, 1], 5)
    return evolve(x, q=q)


def overflowing(x: AxisLog, strength: float) -> AxisLog:
    """A counter whose range is a part of the motion."""
    span = np.ptp(x.q) * (0.8 - 0.15 * (strength - 1))
    return evolve(x, q=np.mod(x.q - x.q.min(), span))


def coded(x: AxisLog, strength: float) -> AxisLog:
    """-9999 in place of a torque."""
    tau = x.tau.copy()
    tau[x.rng.choice(len(tau), int(3 * strength), replace=False)] = -9999.0
    return evolve(x, tau=tau)


def clipped(x: AxisLog, strength: float) -> AxisLog:
    """The torque cut at its 95, 85 and 60 % quantile of size."""
    limit = float(np.quantile(np.abs(x.tau), {1: 0.95, 2: 0.85, 4: 0.6}[int(strength)]))
    return evolve(x, tau=np.clip(x.tau, -limit, limit))


def held(x: AxisLog, strength: float) -> AxisLog:
    """Every value repeated 2.5 times the strength: 2, 5 or 10 rows."""
    every = int(2.5 * strength)
    rows = np.arange(len(x.t)) // every * every
    return evolve(x, q=x.q[rows], tau=x.tau[rows])


def arriving(x: AxisLog, strength: float) -> AxisLog:
    """Stamps that say when a row arrived: late by up to 0.5 steps times the strength, in order."""
    step = x.t[1] - x.t[0]
    return evolve(x, t=np.maximum.accumulate(x.t + 0.5 * strength * step * x.rng.uniform(0, 1, len(x.t))))


def in_bursts(x: AxisLog, strength: float) -> AxisLog:
    """Rows stamped in groups of 4 times the strength."""
    group = int(4 * strength)
    return evolve(x, t=x.t[np.arange(len(x.t)) // group * group])


def set_back(x: AxisLog, strength: float) -> AxisLog:
    """A clock that is set back in the middle, by 0.01, 0.1 or 4 s."""
    t = x.t.copy()
    t[len(t) // 3 :] -= {1: 0.01, 2: 0.1, 4: 4.0}[int(strength)]
    return evolve(x, t=t)


def repeated(x: AxisLog, strength: float) -> AxisLog:
    """A block of 100 rows times the strength written twice, with stamps that go on."""
    n, size = len(x.t), int(100 * strength)
    start = int(x.rng.integers(n // 5, n // 2))
    rows = np.r_[: start + size, start : n - size]
    return evolve(x.rows(rows), t=x.t)


def in_degrees(x: AxisLog, strength: float) -> AxisLog:
    """Angles in degrees, of a motion that is larger by the strength."""
    return evolve(x, q=np.rad2deg(x.q) * strength, tau=x.tau + _stretched(x, strength))


def swapped(x: AxisLog, strength: float) -> AxisLog:
    """Position and torque in each other's column."""
    return evolve(x, q=x.tau, tau=x.q)


def filtered(x: AxisLog, strength: float) -> AxisLog:
    """The torque through a causal second-order low-pass of 40, 20 or 10 Hz."""
    from scipy.signal import butter, sosfilt

    sos = butter(2, 40 / strength, fs=1 / (x.t[1] - x.t[0]), output="sos")
    return evolve(x, tau=np.asarray(sosfilt(sos, x.tau)))


def dropped_otherwise(x: AxisLog, strength: float) -> AxisLog:
    """Frames of 1 to 4 rows without a position: NaN, -1 rad, 65535 counts, the value before, or 1000 rad."""
    q = x.q.copy()
    form = x.rng.integers(5)
    for row in x.rng.choice(np.arange(1, len(q) - 5), int(3 * strength), replace=False):
        stop = row + x.rng.integers(1, 5)
        q[row:stop] = (np.nan, -1.0, 65535 * COUNT, q[row - 1], 1000.0)[form]
    return evolve(x, q=q)


def wrapped_otherwise(x: AxisLog, strength: float) -> AxisLog:
    """A signed counter of 12, 11 or 10 bits, or angles from -180 to 180 degrees of a joint that turns that far."""
    offset = x.rng.uniform(0, 10)
    if x.rng.integers(2):
        far = 2 * np.pi * strength / np.ptp(x.q)
        return evolve(x, q=np.angle(np.exp(1j * (far * x.q + offset))), tau=x.tau + _stretched(x, far))
    span = COUNT * {1: 4096, 2: 2048, 4: 1024}[int(strength)]
    return evolve(x, q=np.mod(x.q + offset + span / 2, span) - span / 2)


def _stretched(x: AxisLog, far: float) -> np.ndarray:
    """Torque that a motion larger by `far` takes beside that of the motion, of the inertia and the viscous friction."""
    t = x.t
    dq = np.gradient(x.clean, t)
    return (far - 1) * (TRUTH["inertia"] * np.gradient(dq, t) + TRUTH["viscous"] * dq)


def wild_torques(x: AxisLog, strength: float) -> AxisLog:
    """Single torques that interference throws off, by 3 to 30 times the largest, or the converter's lowest code."""
    tau = x.tau.copy()
    rows = x.rng.choice(len(tau), int(4 * strength), replace=False)
    far = x.rng.uniform(3, 30, len(rows)) * x.rng.choice([-1, 1], len(rows)) * np.abs(tau).max()
    tau[rows] = far if x.rng.integers(2) else -32768 * 1e-3
    return evolve(x, tau=tau)


def clipped_otherwise(x: AxisLog, strength: float) -> AxisLog:
    """The torque cut on one side only, at different limits, or by an amplifier with the noise of a converter on top."""
    low, high = np.quantile(x.tau, {1: (0.02, 0.96), 2: (0.05, 0.9), 4: (0.15, 0.75)}[int(strength)])
    form = x.rng.integers(3)
    if form == 0:
        return evolve(x, tau=np.minimum(x.tau, high))
    if form == 1:
        return evolve(x, tau=np.clip(x.tau, low, high))
    noise = NOISE / 10 * x.rng.normal(size=len(x.tau))
    return evolve(x, tau=np.clip(x.tau, low, high) + noise)


def softly_limited(x: AxisLog, strength: float) -> AxisLog:
    """A torque that an amplifier bends, by 0.3, 2 and 10 % of its largest."""
    top = np.abs(x.tau).max()
    limit = top * {1: 3.3, 2: 1.7, 4: 0.95}[int(strength)]
    return evolve(x, tau=limit * np.tanh(x.tau / limit))


def held_otherwise(x: AxisLog, strength: float) -> AxisLog:
    """One side held, the other fresh; or both, for numbers of rows that vary."""
    every = int(2.5 * strength) + 1
    form = x.rng.integers(3)
    if form < 2:
        rows = np.arange(len(x.t)) // every * every
        return evolve(x, q=x.q[rows]) if form else evolve(x, tau=x.tau[rows])
    new = np.r_[True, x.rng.uniform(size=len(x.t) - 1) < 1 / every]
    rows = np.maximum.accumulate(np.where(new, np.arange(len(x.t)), 0))
    return evolve(x, q=x.q[rows], tau=x.tau[rows])


def arriving_otherwise(x: AxisLog, strength: float) -> AxisLog:
    """Stamps late by exponential times, in order, with a pause of the receiver; or bursts of random sizes."""
    step = x.t[1] - x.t[0]
    if x.rng.integers(2):
        late = 0.3 * strength * step * x.rng.exponential(size=len(x.t))
        return evolve(x, t=np.maximum.accumulate(x.t + late))
    last = np.r_[x.rng.uniform(size=len(x.t) - 1) < 1 / (3 * strength), True]
    ends = np.flatnonzero(last)
    return evolve(x, t=x.t[ends[np.searchsorted(ends, np.arange(len(x.t)))]])


def clock_otherwise(x: AxisLog, strength: float) -> AxisLog:
    """A clock set forward by 3 to 12 rows or by seconds, set back twice, or that runs fast and is set right again."""
    t, n = x.t.copy(), len(x.t)
    step = t[1] - t[0]
    form = x.rng.integers(3)
    if form == 0:
        t[n // 3 :] += {1: 3 * step, 2: 12 * step, 4: 3.0}[int(strength)]
    elif form == 1:
        t[n // 4 :] -= 0.004 * strength
        t[n // 2 :] -= 0.05 * strength
    else:
        t += 1e-3 * strength * np.mod(t, 6.0)  # set right every 6 s
    return evolve(x, t=t)


def repeated_otherwise(x: AxisLog, strength: float) -> AxisLog:
    """A block written again much later, with its old stamps or with stamps that go on."""
    n, size = len(x.t), int(60 * strength)
    start = int(x.rng.integers(n // 10, n // 5))
    later = int(x.rng.integers(n // 4, n // 2))
    rows = np.r_[:later, start : start + size, later:n]
    if x.rng.integers(2):
        return x.rows(rows)
    return evolve(x.rows(rows), t=(x.t[1] - x.t[0]) * np.arange(len(rows)))


def filtered_otherwise(x: AxisLog, strength: float) -> AxisLog:
    """A moving mean, a first-order lag, or a filter of zero phase on one side."""
    from scipy.signal import butter, lfilter, sosfiltfilt

    step = x.t[1] - x.t[0]
    form = x.rng.integers(4)
    if form == 0:
        rows = int(4 * strength)
        return evolve(x, tau=lfilter(np.ones(rows) / rows, 1, x.tau))
    if form == 1:
        pole = np.exp(-2 * np.pi * 30 / strength * step)
        return evolve(x, tau=lfilter([1 - pole], [1, -pole], x.tau))
    if form == 2:
        sos = butter(2, 40 / strength, fs=1 / step, output="sos")
        return evolve(x, tau=np.asarray(sosfiltfilt(sos, x.tau)))
    pole = np.exp(-2 * np.pi * 30 / strength * step)
    return evolve(x, q=lfilter([1 - pole], [1, -pole], x.q - x.q[0]) + x.q[0])


FAULTS = {
    "dropout": dropped,
    "spike": spiked,
    "overflow": overflowing,
    "sentinel": coded,
    "clipped": clipped,
    "held samples": held,
    "arrival": arriving,
    "bursts": in_bursts,
    "clock set back": set_back,
    "repeated block": repeated,
    "degrees": in_degrees,
    "swapped": swapped,
    "filter": filtered,
}
OTHER_FORMS = {
    "dropout": dropped_otherwise,
    "overflow": wrapped_otherwise,
    "sentinel": wild_torques,
    "clipped": clipped_otherwise,
    "soft limit": softly_limited,
    "held samples": held_otherwise,
    "arrival": arriving_otherwise,
    "clock": clock_otherwise,
    "repeated block": repeated_otherwise,
    "filter": filtered_otherwise,
}
"""The same kinds of faults in forms that are drawn at random, other than those that the rules were written for."""
STRENGTHS = (1.0, 2.0, 4.0)
