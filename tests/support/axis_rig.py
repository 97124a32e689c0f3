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
    """Columns (n,) as a file has them, and a random generator for what is done to them."""

    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    rng: np.random.Generator

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
    return AxisLog(t, np.round(q / COUNT) * COUNT, tau, rng)


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
    """Angles in degrees, faster with the strength."""
    return evolve(x, q=np.rad2deg(x.q) * strength)


def swapped(x: AxisLog, strength: float) -> AxisLog:
    """Position and torque in each other's column."""
    return evolve(x, q=x.tau, tau=x.q)


def filtered(x: AxisLog, strength: float) -> AxisLog:
    """The torque through a causal second-order low-pass of 40, 20 or 10 Hz."""
    from scipy.signal import butter, sosfilt

    sos = butter(2, 40 / strength, fs=1 / (x.t[1] - x.t[0]), output="sos")
    return evolve(x, tau=np.asarray(sosfilt(sos, x.tau)))


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
STRENGTHS = (1.0, 2.0, 4.0)
