"""The controller of a recorded run, found in the run itself: a proportional-derivative law from reference to torque.

    tau_k = kp (q_ref,k - q_k) + kd_ref D q_ref,k - kd D q_k + offset,   D x_k = (x_k - x_{k-n}) / (n H)

Where this law gives back the recorded torque, the run can be replayed in closed loop. That is no circle: q_ref was chosen
by the experimenter, not by the plant. What the law leaves over (pulses added to the command) is a recorded input of its own.
"""

import numpy as np
from attrs import frozen

from cosim.measured.recording import Recording, Run

SAMPLES = (1, 2, 3, 4)  # n of the velocity difference that are tried
CLOSE = 2.0  # %: a law that leaves more of the torque than this is not the recorded one


@frozen
class Law:
    """kp [N.m/rad], kd, kd_ref [N.m.s/rad], offset [N.m] of one joint (N, m of a prismatic one); n of the difference.

    `limit` is the largest torque that the recording holds [N.m], 0 where it was never held at it; `left` the RMS% of
    torque that the law does not give on the rows it was found on.
    """

    kp: float
    kd: float
    kd_ref: float
    offset: float
    samples: int
    limit: float
    left: float

    def torque(self, q_ref: np.ndarray, q: np.ndarray, step: float) -> np.ndarray:
        """Torque (n,) of the law on a recorded reference and position (n,), before the limit."""
        columns = _columns(q_ref, q, step, self.samples)
        return columns @ np.array([self.kp, self.kd_ref, self.kd, self.offset])


def find_law(recording: Recording, joint: int) -> Law | None:
    """The law of one joint from the training rows of all runs; None without a reference or where no law fits."""
    runs = [run for run in recording.runs if run.train.any()]
    if not runs or any(run.q_ref is None for run in runs):
        return None
    laws = [_fitted(runs, joint, samples) for samples in SAMPLES]
    best = min(laws, key=lambda law: law.left)
    return best if best.left < CLOSE else None


def injected(law: Law, run: Run, joint: int) -> np.ndarray:
    """Torque (n,) of a run that the law does not give: pulses, feed-forward; zero where it is as small as on the fitted rows."""
    tau = run.tau[:, joint]
    rest = tau - law.torque(run.q_ref[:, joint], run.q[:, joint], run.step)
    rest[: law.samples] = 0.0
    share = 100 * np.sqrt(np.mean(rest**2) / np.mean(tau**2))
    return rest if share > max(3 * law.left, CLOSE) else np.zeros_like(rest)


def _columns(q_ref: np.ndarray, q: np.ndarray, step: float, samples: int) -> np.ndarray:
    return np.stack([q_ref - q, difference(q_ref, step, samples), -difference(q, step, samples), np.ones_like(q)], axis=1)


def difference(x: np.ndarray, step: float, samples: int) -> np.ndarray:
    """D x_k = (x_k - x_{k-n}) / (n H) along the first axis; the signal rests before its first row."""
    past = np.concatenate([np.repeat(x[:1], samples, axis=0), x[:-samples]])
    return (x - past) / (samples * step)


def _fitted(runs: list[Run], joint: int, samples: int) -> Law:
    """Least squares on the rows that are off the limit, with reference and own velocity apart and, if as good, together."""
    parts = [(_columns(run.q_ref[:, joint], run.q[:, joint], run.step, samples), run.tau[:, joint], run.train) for run in runs]
    y = np.concatenate([y[samples:][train[samples:]] for y, _, train in parts])
    tau = np.concatenate([tau[samples:][train[samples:]] for _, tau, train in parts])
    limit = _limit(tau)
    free = np.abs(tau) < 0.999 * limit if limit else np.ones(len(tau), bool)
    gains = _solve(y[free], tau[free])
    left = 100 * np.sqrt(np.mean((tau - y @ gains)[free] ** 2) / np.mean(tau**2))
    simple = np.insert(_solve(y[free][:, [0, 2]], tau[free]), [1, 2], 0.0)
    rest = 100 * np.sqrt(np.mean((tau - y @ simple)[free] ** 2) / np.mean(tau**2))
    if rest < 1.1 * left + 0.01:
        gains, left = simple, rest
    kp, kd_ref, kd, offset = (float(value) for value in gains)
    return Law(kp, kd, kd_ref, offset, samples, limit, float(left))


def _solve(y: np.ndarray, tau: np.ndarray) -> np.ndarray:
    scale = np.linalg.norm(y, axis=0)
    scale[scale == 0] = 1.0
    return np.linalg.lstsq(y / scale, tau, rcond=1e-10)[0] / scale


def _limit(tau: np.ndarray) -> float:
    """The largest torque, if the recording rests at it (0.1 % of the rows within 0.1 % of it); else 0."""
    top = np.abs(tau).max()
    return float(top) if np.mean(np.abs(tau) > 0.999 * top) > 1e-3 else 0.0
