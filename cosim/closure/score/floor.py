"""The noise floor of a recording: how far the torque differs between repeats of the same motion.

Where all joints repeat the same motion after a period P, no model of the motion can explain how the torque differs
between the repeats.

    floor = 100 sqrt(half the mean squared difference of neighbouring cycles) / RMS of the torque
"""

from collections.abc import Sequence

import numpy as np

from cosim.closure.model.model import Model
from cosim.closure.model.motion import SmoothedMotion
from cosim.closure.model.smoothing import convolve, kernel, noise_left, position_noise

SAME = 0.01  # RMS difference of two cycles of a joint, as a share of its own RMS about the mean
SHORTEST = 0.5  # s, shortest period


def floor(model: Model) -> tuple[float | None, ...]:
    """RMS% per joint by the run that repeats best, None where no run repeats its motion; filtered as in the model."""
    motion = model.setting.motion
    found = [cycles for a, b in motion.bounds if (cycles := _cycles(motion, a, b)) is not None]
    if not found:
        return (None,) * motion.joints
    each = np.array([_spread(cycles) for cycles in found])
    return tuple(float(v) for v in each.min(axis=0))


def from_sensors(model: Model) -> np.ndarray | None:
    """RMS (nj,) [N.m] that the white noise of torque and encoders leaves in the residual; None where the inertia is not
    known.
    """
    m, encoders = model.setting.motion, from_encoders(model)
    if encoders is None:
        return None
    return np.hypot(_white(m.commands) * noise_left(m.widths.total, m.sample), encoders)


def from_encoders(model: Model) -> np.ndarray | None:
    """RMS (nj,) [N.m] that the white noise of the encoders, differentiated twice or in recorded columns, leaves in the
    residual; None as `from_sensors`.
    """
    scene, m = model.scene, model.setting.motion
    if scene.device.recorded_columns:
        return _white([scene.rigid[a:b] for a, b in m.bounds]) * noise_left(m.widths.total, m.sample)
    if scene.rigid_slopes is None or not m.differentiated:
        return None
    inertia = np.array([np.sqrt(np.mean(scene.joint(j).slopes[2][j] ** 2)) for j in range(m.joints)])
    return inertia * m.angle_noise * noise_left(m.widths.total, m.sample, derivative=2)


def _white(runs: Sequence[np.ndarray]) -> np.ndarray:
    """Standard deviation (nj,) of the white part of signals (n, nj) of several runs."""
    return np.sqrt(np.mean([position_noise(x) ** 2 for x in runs], axis=0))


def _cycles(motion: SmoothedMotion, a: int, b: int) -> np.ndarray | None:
    """Filtered torque of the run's whole cycles (c, P, nj), c >= 2; None where the motion does not repeat."""
    length = period(motion.q[a:b], motion.step)
    if length is None:
        return None
    weights = kernel(motion.widths.second / motion.step)
    tau = convolve(motion.tau[a:b], weights)
    edge = len(weights)
    count = (len(tau) - 2 * edge) // length
    return tau[edge : edge + count * length].reshape(count, length, -1) if count >= 2 else None


def period(q: np.ndarray, step: float) -> int | None:
    """The number of rows after which the motion q (n, nj) repeats; None where it does not."""
    moved = q[:, np.ptp(q, axis=0) > 0]
    if moved.shape[1] == 0:
        return None
    difference = np.max([_difference(x) for x in (moved - moved.mean(axis=0)).T], axis=0)
    first = int(np.ceil(SHORTEST / step))
    difference = difference[: len(q) // 2 + 1]
    far = np.flatnonzero(difference[first:] > 0.3)
    if not len(far):
        return None
    start = first + int(far[0])
    inside = np.flatnonzero(
        (difference[start + 1 : -1] <= difference[start:-2]) & (difference[start + 1 : -1] < difference[start + 2 :])
    )
    good = [start + 1 + int(k) for k in inside if difference[start + 1 + k] < SAME]
    return good[0] if good else None


def _difference(x: np.ndarray) -> np.ndarray:
    """RMS of x(t + k) - x(t) over the RMS of x, for every k, by the autocorrelation."""
    n = len(x)
    spectrum = np.fft.rfft(x, 2 * n)
    cross = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    squares = np.concatenate([[0.0], np.cumsum(x**2)])
    k = np.arange(n)
    total = squares[n - k] + squares[n] - squares[k] - 2 * cross
    return np.sqrt(np.maximum(total, 0.0) / np.maximum(n - k, 1) / max(squares[n] / n, 1e-300))


def _spread(cycles: np.ndarray) -> np.ndarray:
    """RMS% (nj,) of a cycle, by the median over neighbouring pairs: the first cycle often starts from elsewhere."""
    within = np.median((np.diff(cycles, axis=0) ** 2).mean(axis=1), axis=0) / 2
    return 100 * np.sqrt(within / np.maximum((cycles**2).mean(axis=(0, 1)), 1e-300))
