"""Reference motions: arrays over the controller's ticks, each joint its own."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from tests.support.laboratory_c.arrays import Array


@dataclass(frozen=True)
class Room:
    """Where a joint may move and how fast [rad, rad/s, rad/s^2 or m]."""

    low: float
    high: float
    speed: float
    acceleration: float


Draw = Callable[[np.random.Generator, Array, Room], Array]


def fitted(shape: Array, t: Array, room: Room, share: float) -> Array:
    """A shape moved and scaled into the room, into `share` of it at most, within speed and acceleration."""
    step = t[1] - t[0]
    shape = shape - shape.mean()
    v = np.gradient(shape, step)
    peak = max(
        np.abs(shape).max() / ((room.high - room.low) / 2 * share),
        np.abs(v).max() / room.speed,
        np.abs(np.gradient(v, step)).max() / room.acceleration,
    )
    return (room.low + room.high) / 2 + shape / peak


def smoothed(x: Array, width: float) -> Array:
    """Under a bell of that many ticks, so long that accelerations do not see its ends."""
    return np.asarray(gaussian_filter1d(x, width, mode="nearest", truncate=7.0))


def multisine(rng: np.random.Generator, t: Array, room: Room) -> Array:
    base, count = rng.uniform(0.05, 0.15), int(rng.integers(4, 10))
    orders = np.sort(rng.choice(np.arange(1, 28), count, replace=False))
    orders[0] = rng.integers(1, 3)
    waves = np.sin(2 * np.pi * base * np.outer(t, orders) + rng.uniform(0, 2 * np.pi, count)) / orders ** rng.uniform(
        0.6, 1.2
    )
    return fitted(waves.sum(1), t, room, 0.95)


def point_to_point(rng: np.random.Generator, t: Array, room: Room) -> Array:
    """Trapezoids of speed between drawn places, rounded, with rests."""
    return moves(rng, t, room, round_over=0.03, rest=(0.05, 0.5))


def least_jerk(rng: np.random.Generator, t: Array, room: Room) -> Array:
    """Like it, rounded over so much that hardly a part of constant speed is left."""
    return moves(rng, t, room, round_over=0.12, rest=(0.0, 0.25))


def moves(rng: np.random.Generator, t: Array, room: Room, round_over: float, rest: tuple[float, float]) -> Array:
    out, step = np.empty(len(t)), float(t[1] - t[0])
    at, k = float(rng.uniform(room.low, room.high)), 0
    while k < len(t):
        to = float(rng.uniform(room.low, room.high))
        speed, acceleration = room.speed * rng.uniform(0.2, 1.0), room.acceleration * rng.uniform(0.3, 0.8)
        way = abs(to - at)
        speed = min(speed, np.sqrt(way * acceleration))
        ramp = speed / acceleration
        whole = ramp + way / max(speed, 1e-9)
        s = np.arange(int((whole + rng.uniform(*rest)) / step) + 1) * step
        up = np.minimum(s, ramp)
        down = np.clip(s - (whole - ramp), 0, ramp)
        gone = acceleration * up**2 / 2 + speed * np.clip(s - ramp, 0, None) - acceleration * down**2 / 2
        gone = np.where(s >= whole, way, gone)
        out[k : k + len(s)] = (at + np.sign(to - at) * gone)[: len(t) - k]
        at, k = to, k + len(s)
    return smoothed(out, round_over / step)


def wandering(rng: np.random.Generator, t: Array, room: Room) -> Array:
    """Noise through a smooth low pass of 0.3 to 1.5 Hz."""
    step = float(t[1] - t[0])
    width = 1 / (2 * np.pi * rng.uniform(0.3, 1.5)) / step
    return fitted(smoothed(rng.standard_normal(len(t)), width), t, room, 0.95)


def sweep(rng: np.random.Generator, t: Array, room: Room) -> Array:
    """A sine from slow to fast, its size falls as its frequency grows."""
    low, high = rng.uniform(0.08, 0.2), rng.uniform(1.0, 3.5)
    s = t / t[-1]
    rate = low * (high / low) ** s
    phase = 2 * np.pi * np.cumsum(rate) * (t[1] - t[0])
    return fitted(np.sin(phase + rng.uniform(0, 6)) / (1 + (rate / 0.35) ** rng.uniform(0.8, 1.5)), t, room, 0.95)


def strokes(rng: np.random.Generator, t: Array, room: Room) -> Array:
    """To and fro over most of the range, every stroke at a speed of its own."""
    step, width = float(t[1] - t[0]), 0.06
    low, high = room.low + 0.1 * (room.high - room.low), room.high - 0.1 * (room.high - room.low)
    speeds = room.speed * np.exp(rng.uniform(np.log(0.12), 0.0, 400))
    corners = np.concatenate([[0.0], np.cumsum((high - low) * rng.uniform(0.6, 1.0, 400) / speeds)])
    ends = np.where(np.arange(401) % 2, high, low) + rng.uniform(-0.08, 0.08, 401) * (high - low)
    return smoothed(np.interp(t, corners, ends), width / step)


def slow(rng: np.random.Generator, t: Array, room: Room) -> Array:
    """Poor: one or two slow sines."""
    f = rng.uniform(0.08, 0.35)
    return fitted(np.sin(2 * np.pi * f * t) + rng.uniform(0, 0.6) * np.sin(2 * np.pi * 2.7 * f * t + 1), t, room, 0.9)


def turning(rng: np.random.Generator, t: Array, room: Room) -> Array:
    """One way only, faster and slower."""
    step = float(t[1] - t[0])
    speed = smoothed(rng.standard_normal(len(t)), 0.25 / step)
    speed = room.speed * (0.5 + 0.42 * np.tanh(speed / speed.std()))
    return room.low + np.cumsum(speed) * step


def from_rest(t: Array, motions: list[Array]) -> Array:
    """(ticks, joints): the motions begin at rest, their time runs ever faster for the first half second."""
    warped = np.where(t < 0.5, t**2, t - 0.25)
    return np.column_stack([CubicSpline(t, motion)(warped) for motion in motions])


MOTIONS: dict[str, Draw] = {
    "multisine": multisine, "point_to_point": point_to_point, "least_jerk": least_jerk, "wandering": wandering,
    "sweep": sweep, "strokes": strokes, "slow": slow,
}  # fmt: skip
LIKELY = (0.26, 0.18, 0.14, 0.16, 0.12, 0.1, 0.04)
