"""References that an operator of such machines would choose: q(t) around `centre` within `reach`, at rest at t = 0."""

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, sosfiltfilt


def smooth_step(x):
    x = np.clip(x, 0, 1)
    return x**3 * (10 - 15 * x + 6 * x**2)


def multisine(rng, t, f):
    q = sum(
        rng.normal() / k * np.sin(2 * np.pi * f * k * t * rng.uniform(0.85, 1.15) + rng.uniform(0, 6.28))
        for k in (0.6, 1, 1.7, 2.6, 3.7)
    )
    return q / np.max(abs(q)) * smooth_step(t / 1.0)


def sine(rng, t, f):
    return np.sin(2 * np.pi * f * t) * smooth_step(t / 1.0)


def sweep(rng, t, f):
    rate = f * (3.0 - 0.5) / t[-1]
    return np.sin(2 * np.pi * (0.5 * f * t + rate * t**2 / 2)) * smooth_step(t / 1.0)


def wandering(rng, t, f):
    h = t[1] - t[0]
    q = sosfiltfilt(butter(3, 1.6 * f, fs=1 / h, output="sos"), rng.normal(size=len(t)))
    return q / np.max(abs(q)) * smooth_step(t / 1.0)


def way_points(rng, t, f, profile, rest):
    q, x, at = np.zeros_like(t), 0.0, 0.3
    while at < t[-1]:
        target = rng.uniform(-1, 1)
        if abs(target - x) < 0.5:
            target = (-1 if x > 0 else 1) * rng.uniform(0.5, 1)
        long = abs(target - x) * rng.uniform(0.35, 0.6) / f
        q += (target - x) * profile((t - at) / long)
        x, at = target, at + long + rng.uniform(0, rest)
    return q


def point_to_point(rng, t, f):
    return way_points(rng, t, f, smooth_step, 0.6)


def trapezoid(x, share=0.25):
    """Way by a trapezoidal speed with `share` of the time in each ramp."""
    x = np.clip(x, 0, 1)
    top = 1 / (1 - share)
    rise, fall = top * x**2 / (2 * share), 1 - top * (1 - x) ** 2 / (2 * share)
    return np.where(x < share, rise, np.where(x > 1 - share, fall, top * (x - share / 2)))


def trapezoids(rng, t, f):
    """With ramps of acceleration, as a drive's S-curve has them."""
    q = way_points(rng, t, f, trapezoid, 0.2)
    return uniform_filter1d(q, max(3, int(0.12 / f / (t[1] - t[0]))), mode="nearest")


def one_way(rng, t, f):
    """Always forwards, with a speed that swings; in units of reach."""
    speed = 1 + sum(0.28 * np.sin(2 * np.pi * f * k * t + rng.uniform(0, 6.28)) for k in (0.7, 1.3, 2.9))
    return np.cumsum(np.maximum(speed, 0.1) * smooth_step(t / 1.0)) * (t[1] - t[0]) * 2 * np.pi * f * 0.7


RICH = (multisine, multisine, wandering, point_to_point, trapezoids, sweep)
POOR = (sine,)


def reference(rng, form, t, centre, reach, f):
    """(3, N): q, dq, ddq."""
    q = centre + reach * form(rng, t, f)
    h = t[1] - t[0]
    v = np.gradient(q, h)
    return np.stack([q, v, np.gradient(v, h)])
