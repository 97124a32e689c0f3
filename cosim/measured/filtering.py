"""Differentiation and low-pass filters for recorded motion; every filter here has a name and a delay that is stated.

The same low-pass filter is applied to both sides of the equation of motion (Taati 3.1). Acceleration is never formed
by itself: with P the momentum columns, F{dP/dt} is the filter's own derivative of P, exact for products too ("total
derivatives", PHYSICS.md 4; Taati Eqs. 13-14; Hsu et al. 1987).
"""

from abc import ABC, abstractmethod
from functools import lru_cache

import numpy as np
from attrs import field, frozen

from cosim.measured.recording import Recording, Run

NYQUIST = 0.45  # of the sampling rate: a low-pass beyond has nothing left to do
MOST_POWER = 0.95  # of the power of dq lies below its bandwidth


class LowPass(ABC):
    """A linear low-pass filter along the first axis of an array with an even step [s]."""

    @abstractmethod
    def low(self, signal: np.ndarray, step: float) -> np.ndarray:
        """F{x}, same shape."""

    @abstractmethod
    def rate(self, signal: np.ndarray, step: float) -> np.ndarray:
        """F{dx/dt}, same shape, without differentiating x."""

    @abstractmethod
    def at(self, share: float) -> "LowPass":
        """The same filter with a share of its cutoff."""

    @abstractmethod
    def settle(self, step: float) -> tuple[int, int]:
        """Number of rows at the start and at the end that the filter's transient makes unusable."""

    @abstractmethod
    def spread(self, step: float) -> tuple[int, int]:
        """Number of rows before and after a jump over which the filter spreads it."""

    @abstractmethod
    def memory(self, step: float) -> tuple[int, int]:
        """Number of rows before and after one on which its filtered value, and that of its rate, depends: all others
        change it by less than rounding does.
        """

    @abstractmethod
    def decimation(self, step: float) -> int:
        """The factor by which the filtered signal may be decimated without aliasing."""


@frozen
class FirstOrder(LowPass):
    """Taati's L(s) = omega / (omega + s), causal; exact for signals that are linear between samples."""

    omega: float = 10.0  # rad/s

    def __str__(self) -> str:
        return f"L(s) = w/(w + s) with w = {self.omega:.3g} rad/s"

    def low(self, signal: np.ndarray, step: float) -> np.ndarray:
        from scipy.signal import lfilter

        x = self.omega * step
        pole = np.exp(-x)
        gain = (1 - pole) / x  # first-order hold: y+ = pole y + (gain - pole) u + (1 - gain) u+
        state = (gain - pole) * signal[:1] + pole * signal[:1]
        tail, _ = lfilter([1 - gain, gain - pole], [1, -pole], signal[1:], axis=0, zi=state)
        return np.concatenate([signal[:1], tail])

    def rate(self, signal: np.ndarray, step: float) -> np.ndarray:
        return self.omega * (signal - self.low(signal, step))

    def at(self, share: float) -> "FirstOrder":
        return FirstOrder(share * self.omega)

    def settle(self, step: float) -> tuple[int, int]:
        return int(np.ceil(12 / (self.omega * step))), 0

    def spread(self, step: float) -> tuple[int, int]:
        return 0, int(np.ceil(5 / (self.omega * step)))

    def memory(self, step: float) -> tuple[int, int]:
        return int(np.ceil(40 / (self.omega * step))), 0  # exp(-40) is below rounding

    def decimation(self, step: float) -> int:
        return max(int(0.2 / (self.omega * step)), 1)


@frozen
class ZeroPhase(LowPass):
    """Butterworth low-pass run forwards and backwards: no delay, half the amplitude at `cutoff` [Hz]."""

    cutoff: float
    order: int = 4

    def __str__(self) -> str:
        return f"a Butterworth low-pass of {self.cutoff:.3g} Hz (order {self.order}, zero phase)"

    def low(self, signal: np.ndarray, step: float) -> np.ndarray:
        from scipy.signal import sosfiltfilt

        if self.cutoff * step >= NYQUIST:
            return np.array(signal, float)
        sos = _butterworth(self.order, self.cutoff, round(step, 12))
        pad = min(len(signal) - 1, self.settle(step)[0])
        return sosfiltfilt(sos, signal, axis=0, padtype="odd", padlen=pad)

    def rate(self, signal: np.ndarray, step: float) -> np.ndarray:
        return derivative(self.low(signal, step), step)

    def at(self, share: float) -> "ZeroPhase":
        return ZeroPhase(share * self.cutoff, self.order)

    def settle(self, step: float) -> tuple[int, int]:
        rows = int(np.ceil(3.0 / (self.cutoff * step)))
        return rows, rows

    def spread(self, step: float) -> tuple[int, int]:
        rows = int(np.ceil(0.6 / (self.cutoff * step)))
        return rows, rows

    def memory(self, step: float) -> tuple[int, int]:
        rows = int(np.ceil(20 / (self.cutoff * step)))  # its slowest pole falls by exp(-2.4) in 1 / cutoff
        return rows, rows

    def decimation(self, step: float) -> int:
        return max(int(0.2 / (self.cutoff * step)), 1)


@frozen
class Window(LowPass):
    """Weighted mean over a Hann window of length 1 / `cutoff` [Hz]: no delay, half the amplitude at `cutoff`.

    The window is finite, so a row does not depend on samples outside it: rows that are left out have no influence.
    """

    cutoff: float

    def __str__(self) -> str:
        return (
            f"a Hann window of {1e3 / self.cutoff:.3g} ms (zero phase, half "
            f"amplitude at {self.cutoff:.3g} Hz, finite reach)"
        )

    def low(self, signal: np.ndarray, step: float) -> np.ndarray:
        from scipy.signal import oaconvolve

        half = self.half(step)
        if half < 1 or len(signal) < 2 * half + 3:
            return np.array(signal, float)
        weights = np.hanning(2 * half + 3)[1:-1]
        shape = (len(weights), *([1] * (signal.ndim - 1)))
        ends = np.concatenate(
            [2 * signal[:1] - signal[half:0:-1], signal, 2 * signal[-1:] - signal[-2 : -half - 2 : -1]]
        )
        return oaconvolve(ends, (weights / weights.sum()).reshape(shape), mode="valid", axes=0)

    def rate(self, signal: np.ndarray, step: float) -> np.ndarray:
        return derivative(self.low(signal, step), step)

    def half(self, step: float) -> int:
        """Rows to either side of the middle one."""
        return max(round(0.5 / (self.cutoff * step)) - 1, 0)

    def at(self, share: float) -> "Window":
        return Window(share * self.cutoff)

    def settle(self, step: float) -> tuple[int, int]:
        return self.half(step) + 3, self.half(step) + 3

    def spread(self, step: float) -> tuple[int, int]:
        return self.half(step) + 3, self.half(step) + 3

    def memory(self, step: float) -> tuple[int, int]:
        return self.spread(step)

    def decimation(self, step: float) -> int:
        return max(int(0.2 / (self.cutoff * step)), 1)


@lru_cache(maxsize=32)
def _butterworth(order: int, cutoff: float, step: float) -> np.ndarray:
    from scipy.signal import butter

    return np.asarray(butter(order, cutoff, fs=1 / step, output="sos"))


def derivative(signal: np.ndarray, step: float) -> np.ndarray:
    """Central difference of fourth order along the first axis, second order at the ends; no delay."""
    if len(signal) < 5:
        return np.gradient(signal, step, axis=0)
    slope = np.gradient(signal, step, axis=0)
    slope[2:-2] = (signal[:-4] - 8 * signal[1:-3] + 8 * signal[3:-1] - signal[4:]) / (12 * step)
    return slope


@frozen(eq=False)
class FilteredMotion:
    """A run with its velocity: time (n,), q, dq, tau (n, nj) in SI; `velocity` says how dq was made.

    tau went through the same filter as q.
    """

    run: Run
    q: np.ndarray
    dq: np.ndarray
    tau: np.ndarray
    velocity: str = field(default="")

    @property
    def time(self) -> np.ndarray:
        """Time stamps (n,) [s]."""
        return self.run.time

    @property
    def step(self) -> float:
        """Sampling period [s]."""
        return self.run.step

    def part(self, rows: slice) -> "FilteredMotion":
        """Some rows in succession, without copies."""
        return FilteredMotion(self.run.part(rows), self.q[rows], self.dq[rows], self.tau[rows], self.velocity)


def differentiated(run: Run, low_pass: LowPass) -> FilteredMotion:
    """q and tau through the same low-pass, q differentiated; a recorded dq is not used."""
    q = low_pass.low(run.q, run.step)
    how = f"q and tau through {low_pass}, central differences"
    return FilteredMotion(run, q, derivative(q, run.step), low_pass.low(run.tau, run.step), how)


def as_recorded(run: Run) -> FilteredMotion:
    """The recorded dq as it stands: where regressor columns were made with it, another one would not fit them."""
    assert run.dq is not None, "the caller has seen that the run has a recorded velocity"
    return FilteredMotion(run, run.q, run.dq, run.tau, "as recorded")


def motion(recording: Recording, run: Run, low_pass: LowPass) -> FilteredMotion:
    """The motion of a run: q differentiated, or the recorded dq where the model's columns were recorded with it."""
    if recording.device.recorded_columns and run.dq is not None:
        return as_recorded(run)
    return differentiated(run, low_pass)


def bandwidth(recording: Recording) -> float:
    """Frequency [Hz] below which MOST_POWER of dq lies: the fastest joint, the middle one of the runs."""
    found = []
    for run in recording.runs:
        dq = differentiated(run, ZeroPhase(0.1 / run.step)).dq
        power = np.abs(np.fft.rfft(dq * np.hanning(len(dq))[:, None], axis=0)) ** 2
        share = np.cumsum(power, axis=0) / np.maximum(power.sum(axis=0), 1e-300)
        found.append(
            np.fft.rfftfreq(len(dq), run.step)[(share < MOST_POWER).sum(axis=0).clip(max=len(share) - 1)].max()
        )
    return float(np.median(found))


def near_reversal(dq: np.ndarray, step: float, spread: tuple[int, int], threshold: float) -> np.ndarray:
    """True for samples within `spread` rows of an instant at which dq (n,) changes sign or is below `threshold`.

    Around them the sign of a measured velocity is not the sign of the true one (PHYSICS.md 4).
    """
    slow = np.abs(dq) < threshold
    slow[1:] |= np.signbit(dq[1:]) != np.signbit(dq[:-1])
    return widened(slow, spread)


def widened(rows: np.ndarray, spread: tuple[int, int]) -> np.ndarray:
    """Rows (n,) within `spread` rows before and after the marked ones (n,): where a filter of that reach sees them."""
    before, after = spread
    edges = np.zeros(len(rows) + 1)
    instants = np.flatnonzero(rows)
    np.add.at(edges, np.maximum(instants - before, 0), 1)
    np.add.at(edges, np.minimum(instants + after + 1, len(rows)), -1)
    return np.cumsum(edges)[:-1] > 0
