"""The filter of the residuals: Gaussian kernels of finite length, the same on both sides of the equation.

A recording is first smoothed by a short kernel K, which also gives the derivatives: q_s = K q, dq = K' q, ddq = K'' q,
tau_s = K tau (exactly the derivative of the smoothed signal). Regressor columns are then formed and everything is
smoothed again by F and thinned out. Columns that are sharp functions of the motion (a sign of velocity) get K as well,
so both sides have passed K F.
"""

import numpy as np
from attrs import frozen

REACH = 4.0  # a kernel ends at this many standard deviations


def kernel(width: float) -> np.ndarray:
    """Gaussian weights of standard deviation `width` [samples], odd length, sum 1; width 0 gives (1)."""
    half = int(np.ceil(REACH * width))
    t = np.arange(-half, half + 1)
    weights = np.exp(-0.5 * (t / max(width, 1e-9)) ** 2)
    return weights / weights.sum()


def slope_kernel(width: float) -> np.ndarray:
    """Weights that give the derivative per sample of the smoothed signal; exact on parabolas."""
    half = max(int(np.ceil(REACH * width)), 1)
    t = np.arange(-half, half + 1)
    weights = t * np.exp(-0.5 * (t / width) ** 2)
    return weights / (t * weights).sum()


def curve_kernel(width: float) -> np.ndarray:
    """Weights that give the second derivative per sample squared of the smoothed signal; exact on cubics."""
    half = max(int(np.ceil(REACH * width)), 2)
    t = np.arange(-half, half + 1)
    gauss = np.exp(-0.5 * (t / width) ** 2)
    weights = (t**2 - (t**2 * gauss).sum() / gauss.sum()) * gauss
    return weights / (0.5 * t**2 * weights).sum()


def convolve(x: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Correlate each column of x (n, ...) with symmetric-support weights; ends are held."""
    from scipy.ndimage import correlate1d

    return correlate1d(np.asarray(x, float), weights, axis=0, mode="nearest")


@frozen
class Widths:
    """Standard deviations [s] of K (`first`) and F (`second`)."""

    first: float
    second: float

    @property
    def total(self) -> float:
        """Standard deviation of K and F together [s]."""
        return float(np.hypot(self.first, self.second))

    @property
    def support(self) -> float:
        """Half of the length of K and F together [s]: nearer to an end, a filtered value leans on what is not there."""
        return REACH * (self.first + self.second)

    @property
    def cutoff(self) -> float:
        """Frequency [Hz] at which K F passes half the power."""
        return float(np.sqrt(np.log(2.0)) / (2 * np.pi * self.total))


TOTALS = (0.006, 0.010, 0.015, 0.025, 0.040, 0.060)  # s, the choices
NOISE_SHARE = 0.02  # of the RMS of the acceleration that may be noise of the position


def position_noise(q: np.ndarray) -> np.ndarray:
    """Standard deviation of the white part of each position signal q (n, nj), from its sixth differences.

    Sixth differences pass 924 times the variance of white noise and almost nothing of a motion sampled finely.
    """
    return np.sqrt(np.mean(np.diff(np.asarray(q), n=6, axis=0) ** 2, axis=0) / 924.0)


def noise_left(width: float, step: float, derivative: int = 0) -> float:
    """Standard deviation of white noise of one, sampled every `step` s, in a derivative (0 to 2) behind a Gaussian of
    `width` s.
    """
    root = np.sqrt(np.pi)
    return float(
        np.sqrt((step / (2 * root * width), step / (4 * root * width**3), 3 * step / (8 * root * width**5))[derivative])
    )


def choose_widths(q_runs: list[np.ndarray], step: float) -> Widths:
    """The shortest smoothing for which position noise stays under `NOISE_SHARE` of the acceleration, over all
    joints.
    """
    noise = np.sqrt(np.mean([position_noise(q) ** 2 for q in q_runs], axis=0))
    floor = max(TOTALS[0], 3.0 * step)
    choices = [t for t in TOTALS if t >= floor] or [floor]

    def quiet(total: float) -> bool:
        made = noise * noise_left(total, step, derivative=2)
        weights = curve_kernel(total / step)
        moved = np.sqrt(np.mean(np.concatenate([convolve(q, weights) for q in q_runs]) ** 2, axis=0)) / step**2
        return bool((made <= NOISE_SHARE * np.maximum(moved, 1e-12)).all())

    total = next(filter(quiet, choices), choices[-1])
    first = max(total / 2, 1.5 * step)
    return Widths(first, float(np.sqrt(max(total**2 - first**2, (0.5 * total) ** 2))))
