"""What the logger keeps: counts, a noisy current, every n-th step, and a student's derivatives."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from tests.support.laboratory_b.nominal import NominalModel, least_squares, rms, settled
from tests.support.laboratory_b.plant import ExactTrace

Array = np.ndarray


@dataclass(frozen=True)
class LabLogger:
    every: int
    step: float  # of the simulation [s]
    counts: float  # [rad]
    cutoff: float  # of the student's low pass, forwards and backwards [Hz]
    corner: float | None  # of coloured noise [Hz]; None: white

    @property
    def rate(self) -> float:
        return 1 / (self.every * self.step)

    def noise(self, rng: np.random.Generator, rows: int) -> Array:
        """Noise of RMS 1."""
        white = rng.standard_normal(rows)
        if self.corner is None:
            return white
        keep = np.exp(-2 * np.pi * self.corner / self.rate)
        coloured = lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.standard_normal(rows))
        return 0.8 * coloured + 0.6 * white


@dataclass(frozen=True)
class LoggedTrace:
    """One row a sample: q, dq, ddq are (rows, joints), tau is the described joint's [N m]."""

    t: Array
    run: Array
    q: Array  # as counted
    smooth: Array  # by the student
    dq: Array
    ddq: Array
    tau: Array
    middle: Array  # False at the ends of runs, where the low pass has not settled

    def floor(self, model: NominalModel) -> tuple[float, Array]:
        """RMS that the ordinary model leaves of the logged signals [N m], and its parameters."""
        use = self.middle & model.moving(self.dq)
        residual, parameters = least_squares(model.table(self.smooth, self.dq, self.ddq, self.tau)[use])
        return rms(residual), parameters


def logged(logger: LabLogger, trace: ExactTrace, joint: int, zeros: tuple[float, float], noise: Array) -> LoggedTrace:
    """`zeros` of encoder [rad] and current sensor [N m] at the described joint; `noise` [N m] a row."""
    thin = trace.thinned(logger.every)
    true = thin.q.copy()
    true[:, joint] += zeros[0]
    q = np.round(true / logger.counts) * logger.counts
    smooth, dq, ddq = q.copy(), np.zeros_like(q), np.zeros_like(q)
    sos, h = butter(2, logger.cutoff, fs=logger.rate, output="sos"), 1 / logger.rate
    for run in np.unique(thin.run):
        rows = np.flatnonzero(thin.run == run)
        smooth[rows] = sosfiltfilt(sos, q[rows], axis=0)
        dq[rows] = np.gradient(smooth[rows], h, axis=0)
        ddq[rows] = np.gradient(dq[rows], h, axis=0)
    tau = thin.command[:, joint] + zeros[1] + noise[: len(q)]
    return LoggedTrace(thin.t, thin.run, q, smooth, dq, ddq, tau, settled(thin.run, h))
