"""References that somebody gives to a joint: arrays at the control rate, at rest at the start."""

from collections.abc import Callable

import numpy as np
from scipy.signal import butter, sosfiltfilt

Array = np.ndarray
Motion = Callable[[np.random.Generator, Array, float, float], Array]
"""(rng, t, reach [rad], speed [rad/s]) -> reference about 0 [rad]."""


def faded(t: Array, r: Array, seconds: float = 0.6) -> Array:
    """From rest: the reference grows in as a half cosine."""
    return r * 0.5 * (1 - np.cos(np.pi * np.clip(t / seconds, 0, 1)))


def trapezoids(rng: np.random.Generator, t: Array, reach: float, speed: float) -> Array:
    """Moves between random angles with a trapezoid of speed, and pauses between them."""
    r, now, where = np.zeros_like(t), 0.0, 0.0
    while now < t[-1]:
        to = rng.uniform(-reach, reach)
        top = speed * rng.uniform(0.3, 1.0)
        ramp = rng.uniform(0.08, 0.3)
        distance = abs(to - where)
        top = min(top, distance / ramp)
        cruise = distance / top - ramp
        s = t - now
        v = top * (np.clip(s / ramp, 0, 1) - np.clip((s - ramp - cruise) / ramp, 0, 1))
        r += np.sign(to - where) * np.cumsum(v) * (t[1] - t[0])
        where = to
        now += 2 * ramp + cruise + rng.choice([0.0, 0.1, 0.4])
    return np.clip(r, -1.2 * reach, 1.2 * reach)


def smooth_moves(rng: np.random.Generator, t: Array, reach: float, speed: float) -> Array:
    """From point to point by the polynomial of least jerk."""
    r, now, where = np.zeros_like(t), 0.0, 0.0
    while now < t[-1]:
        to = rng.uniform(-reach, reach)
        length = max(1.9 * abs(to - where) / (speed * rng.uniform(0.4, 1)), 0.15)
        s = np.clip((t - now) / length, 0, 1)
        r += (to - where) * s**3 * (10 - 15 * s + 6 * s**2)
        where, now = to, now + length + rng.choice([0.0, 0.2])
    return r


def multisine(rng: np.random.Generator, t: Array, reach: float, speed: float) -> Array:
    base = rng.uniform(0.08, 0.15)
    orders = np.sort(rng.choice(np.arange(1, 15), size=5, replace=False))
    r = sum(np.sin(2 * np.pi * base * n * t + rng.uniform(0, 2 * np.pi)) / n**0.7 for n in orders)
    return faded(t, bounded(t, np.asarray(r), reach, speed))


def sweep(rng: np.random.Generator, t: Array, reach: float, speed: float) -> Array:
    """A sine whose frequency rises; its amplitude falls so that the speed stays within its limit."""
    low, high = rng.uniform(0.1, 0.3), rng.uniform(1.0, 3.0)
    rate = low * (high / low) ** (t / t[-1])
    phase = 2 * np.pi * np.cumsum(rate) * (t[1] - t[0])
    return faded(t, np.minimum(reach, speed / (2 * np.pi * rate)) * np.sin(phase))


def wandering(rng: np.random.Generator, t: Array, reach: float, speed: float) -> Array:
    """White noise behind a low pass, scaled to the range."""
    settling = int(4 / (t[1] - t[0]))
    sos = butter(3, rng.uniform(0.5, 1.3), fs=1 / (t[1] - t[0]), output="sos")
    r = sosfiltfilt(sos, rng.standard_normal(t.size + 2 * settling))[settling:-settling]
    return faded(t, bounded(t, r, reach, speed))


def joystick(rng: np.random.Generator, t: Array, reach: float, speed: float) -> Array:
    """Somebody steers the speed by hand: pushes, holds and lets go; he turns back near the ends."""
    v, k, r = np.zeros_like(t), 0, 0.0
    step = t[1] - t[0]
    while k < t.size:
        n = int(rng.uniform(0.3, 1.5) / step)
        push = rng.choice([0.0, 1.0, 1.0, 1.0]) * rng.uniform(0.15, 1.0) * speed
        sign = -np.sign(r) if abs(r) > 0.5 * reach else rng.choice([-1.0, 1.0])
        push = min(push, (reach - sign * r) / (n * step))
        v[k : k + n] = sign * push
        r += sign * push * n * step
        k += n
    hand = butter(2, 2.0, fs=1 / step, output="sos")
    return faded(t, sosfiltfilt(hand, np.cumsum(v) * step))


def one_way(rng: np.random.Generator, t: Array, reach: float, speed: float) -> Array:
    """Turns on in one direction; the speed goes up and down."""
    v = speed * (0.45 + 0.3 * np.sin(2 * np.pi * rng.uniform(0.15, 0.4) * t) + 0.2 * np.sin(2 * np.pi * 0.9 * t))
    return np.cumsum(faded(t, v)) * (t[1] - t[0]) * rng.choice([-1.0, 1.0])


def poor(rng: np.random.Generator, t: Array, reach: float, speed: float) -> Array:
    """One slow sine, nothing else."""
    f = rng.uniform(0.1, 0.25)
    return faded(t, min(0.5 * reach, speed / 8 / f) * np.sin(2 * np.pi * f * t))


def bounded(t: Array, r: Array, reach: float, speed: float) -> Array:
    """The same shape within the range and the speed."""
    return r / max(np.abs(r).max() / reach, np.abs(np.gradient(r, t)).max() / speed)


RICH: tuple[Motion, ...] = (trapezoids, smooth_moves, multisine, sweep, wandering, joystick)
