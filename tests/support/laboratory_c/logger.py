"""What is logged of a run: counted places, the drive's torque with noise, columns that the student computed."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter

from tests.support.laboratory_c.additions import Addition, does
from tests.support.laboratory_c.arrays import Array
from tests.support.laboratory_c.judgement import Signals, cutoff, low_pass
from tests.support.laboratory_c.setup import ExperimentPlan
from tests.support.laboratory_c.simulation import SimulatedRun


@dataclass(frozen=True)
class Logger:
    """Noise of the torque, (n,) [N m or N]; `corner` [Hz] colours it; `lsb` is the step of the current's converter."""

    noise: Array
    corner: float | None
    lsb: Array
    with_speed: bool
    seed: int

    def noises(self, rows: int, rate: float, run: int) -> Array:
        rng = np.random.default_rng([self.seed, run])
        white = rng.standard_normal((rows + 200, len(self.noise)))
        if self.corner:
            keep = float(np.exp(-2 * np.pi * self.corner / rate))
            white = np.asarray(lfilter([np.sqrt(1 - keep**2)], [1, -keep], white, axis=0))
        return white[200:] * self.noise


def draw_logger(rng: np.random.Generator, runs: list[Signals]) -> Logger:
    """Noise of 0.4 to 4 % of the torque, one in three coloured."""
    load = np.sqrt(np.mean(np.concatenate([s.torque for s in runs]) ** 2, axis=0))
    noise = load * float(np.exp(rng.uniform(np.log(0.004), np.log(0.04))))
    corner = float(np.exp(rng.uniform(np.log(15), np.log(60)))) if rng.random() < 0.33 else None
    return Logger(
        noise, corner, load * 2.0 ** -float(rng.integers(8, 12)), bool(rng.random() < 0.4), int(rng.integers(2**31))
    )


def integral(x: Array) -> Array:
    return np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)])


def between(x: Array, at: Array) -> Array:
    """Rows of x at fractions of an index, straight lines."""
    k = np.floor(at).astype(int)
    share = (at - k)[:, None]
    return x[k] * (1 - share) + x[np.minimum(k + 1, len(x) - 1)] * share


def exact(experiment: ExperimentPlan, run: SimulatedRun, additions: list[Addition]) -> Signals:
    """Without any noise: places and speeds at the stamps as the encoders see them, torque and acceleration as means
    over the time between two rows about the stamp.
    """
    every, step = experiment.every, experiment.step
    at = np.arange(every, len(run.q) - every, every).astype(float)
    sums = integral(run.torque)
    torque = (between(sums, at + every / 2) - between(sums, at - every / 2)) / every
    a = (between(run.v, at + every / 2) - between(run.v, at - every / 2)) / (every * step)
    q, v = run.q[at.astype(int)].copy(), run.v[at.astype(int)]
    for addition in additions:
        j = addition.joint
        if does(addition, "reading"):
            q[:, j] = [addition.reading(x) for x in q[:, j].tolist()]
            if addition.name == "unknown":  # an error that moves also shows in the derivatives
                rate = 1 / (every * step)
                v, a = v.copy(), a.copy()
                v[:, j] = np.gradient(q[:, j]) * rate
                a[:, j] = np.gradient(v[:, j]) * rate
        if does(addition, "reported"):
            torque[:, j] = [addition.reported(x) for x in torque[:, j].tolist()]
    return Signals(run.start + at * step, q, v, a, torque)


@dataclass(frozen=True)
class Logged:
    """Raw columns of a run, and the signals that the student makes of them."""

    t: Array
    q: Array
    torque: Array
    speed: Array
    filtered: Signals


def logged(experiment: ExperimentPlan, logger: Logger, s: Signals, number: int) -> Logged:
    count = np.array(experiment.count)
    q = np.round(s.q / count) * count
    torque = s.torque + logger.noises(len(s.t), experiment.rate, number)
    torque = np.round(torque / logger.lsb) * logger.lsb
    rng = np.random.default_rng([logger.seed, number, 1])
    speed = s.v + rng.standard_normal(s.v.shape) * 2e-3 * np.sqrt(np.mean(s.v**2, axis=0))
    return Logged(s.t, q, torque, speed, student(experiment, s.t, q, torque, None))


def student(experiment: ExperimentPlan, t: Array, q: Array, torque: Array, corner: float | None) -> Signals:
    """Places through a low pass both ways (`corner` [Hz], well above the fit's), derivatives of splines."""
    smooth = low_pass(experiment, q, corner or min(3 * cutoff(experiment), 0.42 * experiment.rate))
    spline = make_interp_spline(t, smooth, k=5)
    return Signals(t, smooth, spline(t, 1), spline(t, 2), torque)
