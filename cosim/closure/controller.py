"""The controller of a recorded run, found in the run itself: a proportional-derivative law from reference to torque.

    tau_k = kp (q_ref,k - q_k) + kd_ref D q_ref,k - kd L D q_k + offset + a sin q_k + b cos q_k

with D x_k = (x_k - x_{k-n}) / (n H), L a first-order low-pass or nothing; the last terms feed the weight forward.

Where this law gives back the recorded torque, the run can be replayed in closed loop. That is no circle: q_ref was
chosen by the experimenter, not by the plant. What the law leaves over (pulses added to the command) is a recorded
input of its own.
"""

import numpy as np
from attrs import frozen

from cosim.measured.recording import Recording, Run

SAMPLES = (1, 2, 3, 4)  # n of the velocity difference that are tried
CUTOFFS = (0.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0, 150.0, 200.0)  # Hz, of L; 0: none
CLOSE = 5.0  # %: a law that leaves more of the torque unexplained is not the recorded one
PULSES = 2.0  # %: less than this is noise, not an input of its own


@frozen
class RecordedController:
    """kp [N.m/rad], kd, kd_ref [N.m.s/rad], offset, weight_sin, weight_cos [N.m] of a joint (N, m of a prismatic one).

    samples: n of the difference; cutoff [Hz] of L, 0 none; `limit` the torque limit [N.m], 0 where the
    recording never rests at one; `left` the RMS% of torque that the law does not explain on the rows it was fitted on.
    """

    kp: float
    kd: float
    kd_ref: float
    offset: float
    weight_sin: float
    weight_cos: float
    samples: int
    cutoff: float
    limit: float
    left: float

    @property
    def gains(self) -> np.ndarray:
        """The six coefficients of the law, in the order of its equation."""
        return np.array([self.kp, self.kd, self.kd_ref, self.offset, self.weight_sin, self.weight_cos])

    def torque(self, q_ref: np.ndarray, q: np.ndarray, step: float) -> np.ndarray:
        """Torque (n,) of the law for a recorded reference and position (n,), before the limit."""
        return _columns(q_ref, q, step, self.samples, self.cutoff) @ self.gains

    def feed(self, q_ref: np.ndarray, q: np.ndarray, step: float) -> np.ndarray:
        """The terms (n,) beside kp (q_ref - q) - kd L D q: what a PD controller is fed forward."""
        return _columns(q_ref, q, step, self.samples, self.cutoff)[:, 2:] @ self.gains[2:]


def find_laws(recording: Recording) -> tuple[RecordedController, ...] | None:
    """One law a joint, all with the same differentiation, from the training rows; None without a reference or a fit."""
    runs = [run for run in recording.runs if run.train.any()]
    if not runs or any(run.q_ref is None for run in runs):
        return None
    plain = _best(runs, [(samples, 0.0) for samples in SAMPLES])
    slow = _best(runs, [(1, cutoff) for cutoff in CUTOFFS[1:]])
    best = slow if sum(law.left for law in slow) < 0.9 * sum(law.left for law in plain) else plain
    return best if max(law.left for law in best) < CLOSE else None


def _best(runs: list[Run], ways: list[tuple[int, float]]) -> tuple[RecordedController, ...]:
    joints = range(runs[0].q.shape[1])
    return min(
        (tuple(_fitted(runs, j, *way) for j in joints) for way in ways), key=lambda laws: sum(law.left for law in laws)
    )


def injected(law: RecordedController, run: Run, joint: int) -> np.ndarray:
    """Torque (n,) of a run that the law does not explain (pulses); zero where it is as small as on the fitted rows."""
    tau = run.tau[:, joint]
    rest = tau - law.torque(reference(run)[:, joint], run.q[:, joint], run.step)
    rest[: law.samples] = 0.0
    share = 100 * np.sqrt(np.mean(rest**2) / np.mean(tau**2))
    return rest if share > max(3 * law.left, PULSES) else np.zeros_like(rest)


def reference(run: Run) -> np.ndarray:
    """The recorded reference (n, nj) of a run that has one."""
    assert run.q_ref is not None, "a law is only found in recordings with a reference"
    return run.q_ref


def _columns(q_ref: np.ndarray, q: np.ndarray, step: float, samples: int, cutoff: float) -> np.ndarray:
    speed = low_passed(difference(q, step, samples), step, cutoff)
    return np.stack(
        [q_ref - q, -speed, difference(q_ref, step, samples), np.ones_like(q), np.sin(q), np.cos(q)], axis=1
    )


def low_passed(x: np.ndarray, step: float, cutoff: float) -> np.ndarray:
    """v_k = v_{k-1} + (1 - exp(-2 pi f H)) (x_k - v_{k-1}), from v = 0; x itself for f = 0."""
    from scipy.signal import lfilter

    keep = np.exp(-2 * np.pi * cutoff * step)
    return np.asarray(lfilter([1 - keep], [1, -keep], x)) if cutoff > 0 else x


def difference(x: np.ndarray, step: float, samples: int) -> np.ndarray:
    """D x_k = (x_k - x_{k-n}) / (n H) along the first axis; the signal rests before its first row."""
    past = np.concatenate([np.repeat(x[:1], samples, axis=0), x[:-samples]])
    return (x - past) / (samples * step)


def _fitted(runs: list[Run], joint: int, samples: int, cutoff: float) -> RecordedController:
    """Least squares on the rows that are off the limit; the terms beside the PD only where they are needed."""
    parts = [
        (_columns(reference(run)[:, joint], run.q[:, joint], run.step, samples, cutoff), run.tau[:, joint], run.train)
        for run in runs
    ]
    y = np.concatenate([y[samples:][train[samples:]] for y, _, train in parts])
    tau = np.concatenate([tau[samples:][train[samples:]] for _, tau, train in parts])
    limit = _limit(tau)
    free = np.abs(tau) < 0.999 * limit if limit else np.ones(len(tau), bool)
    best, least = np.zeros(6), np.inf
    for kept in ([0, 1], [0, 1, 2], [0, 1, 2, 3, 4, 5]):
        gains = np.zeros(6)
        gains[kept] = _solve(y[free][:, kept], tau[free])
        left = float(100 * np.sqrt(np.mean((tau - y @ gains)[free] ** 2) / np.mean(tau**2)))
        if least == np.inf or left < 0.9 * least - 0.01:
            best, least = gains, left
    kp, kd, kd_ref, offset, weight_sin, weight_cos = best.tolist()
    return RecordedController(kp, kd, kd_ref, offset, weight_sin, weight_cos, samples, cutoff, limit, least)


def _solve(y: np.ndarray, tau: np.ndarray) -> np.ndarray:
    scale = np.linalg.norm(y, axis=0)
    scale[scale == 0] = 1.0
    return np.linalg.lstsq(y / scale, tau, rcond=1e-10)[0] / scale


def _limit(tau: np.ndarray) -> float:
    """The largest torque, if the recording rests at it (0.1 % of the rows within 0.1 % of it); else 0."""
    top = np.abs(tau).max()
    return float(top) if np.mean(np.abs(tau) > 0.999 * top) > 1e-3 else 0.0
