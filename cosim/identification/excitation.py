"""Excitation of the PHANToM: ten sinusoids a joint from 0.11 to 5 rad/s (Taati 3.1), and a better choice of their
phases.

The better choice minimises the condition number of the scaled regressor over the motion. Every motion stays inside the
joint limits, the linkage's limits and, for a given parameter set, where M(q) is positive definite.
"""

from collections.abc import Sequence

import numpy as np
from attrs import evolve, field, frozen

from cosim.arm import dynamics
from cosim.arm.workspace import LINKED, Workspace, block_eigenvalue
from cosim.errors import InputError, Problem
from cosim.identification.regressor import friction_columns

LOWEST, HIGHEST, COUNT = 0.11, 5.0, 10  # rad/s, rad/s, sinusoids a joint (Taati 3.1)
CENTRE = (0.0, 0.40, 0.80)  # rad, where box, linkage and M > 0 (all columns of Table 1) leave the most room
REACH = (0.9, 0.62, 0.62)  # rad, largest excursion from the centre


@frozen(eq=False)
class Excitation:
    """q_ref_j(t) = centre_j + sum_k amplitude_jk sin(frequency_jk t + phase_jk).

    frequency [rad/s], amplitude [rad], phase [rad]: (3, 10); centre [rad]: (3,).
    """

    frequency: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    centre: np.ndarray = field(factory=lambda: np.array(CENTRE))

    def motion(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, dq, ddq (n, 3) at the times (n,) [s]."""
        angle = time[:, None, None] * self.frequency + self.phase
        sine, cosine = self.amplitude * np.sin(angle), self.amplitude * self.frequency * np.cos(angle)
        return self.centre + sine.sum(axis=2), cosine.sum(axis=2), -(self.frequency**2 * sine).sum(axis=2)

    def parameters(self) -> dict[str, list[float]]:
        """Start values of the FMU Excitation, joint 1's ten sinusoids first."""
        sums = {name: getattr(self, name).reshape(-1).tolist() for name in ("frequency", "amplitude", "phase")}
        return {"centre": self.centre.tolist(), **sums}


def frequencies(count: int = COUNT) -> np.ndarray:
    """(3, count) [rad/s] from 0.11 to 5, evenly spread on a logarithmic scale, moved a little from joint to joint.

    Joints that share frequencies move in fixed proportion and excite less.
    """
    grid = np.geomspace(LOWEST, HIGHEST, 3 * count)
    comb = np.stack([grid[j::3] for j in range(3)])
    comb[:, 0], comb[:, -1] = LOWEST, HIGHEST
    return comb


def taati(seed: int = 0, duration: float = 60.0, workspace: Workspace = LINKED) -> Excitation:
    """Equal amplitudes, random phases: the paper's recipe, made to fit the workspace."""
    rng = np.random.default_rng(seed)
    frequency = frequencies()
    start = Excitation(frequency, np.ones_like(frequency), rng.uniform(0, 2 * np.pi, frequency.shape))
    return fitted(start, duration, workspace)


def fitted(excitation: Excitation, duration: float, workspace: Workspace = LINKED) -> Excitation:
    """Amplitudes of each joint scaled so that the excursion is REACH, then all together until the workspace holds it.

    Raises InputError where even a tenth does not fit.
    """
    time = np.arange(0, duration, 0.02)
    swing = np.abs(excitation.motion(time)[0] - excitation.centre).max(axis=0)
    full = evolve(excitation, amplitude=excitation.amplitude * (np.array(REACH) / swing)[:, None])
    for share in np.linspace(1, 0.1, 19):
        smaller = evolve(full, amplitude=full.amplitude * share)
        if workspace.contains(smaller.motion(time)[0]).all():
            return smaller
    raise InputError(
        Problem("excitation", "a motion inside the workspace", f"centre {excitation.centre.tolist()} leaves it")
    )


def within_definite(excitation: Excitation, pi: np.ndarray, duration: float, margin: float = 0.3) -> Excitation:
    """The same excitation with smaller amplitudes until M(q) > 0 along it with a margin.

    M11 and the block's eigenvalue stay above `margin` times their values at the centre. Raises InputError if none fits.
    """
    time = np.arange(0, duration, 0.02)
    for share in np.linspace(1, 0.1, 19):
        smaller = evolve(excitation, amplitude=excitation.amplitude * share)
        q = np.vstack([smaller.centre, smaller.motion(time)[0]])
        yaw, block = dynamics.yaw_inertia(pi, q), block_eigenvalue(pi, q[:, 1] - q[:, 2])
        if yaw[0] > 0 and block[0] > 0 and yaw.min() > margin * yaw[0] and block.min() > margin * block[0]:
            return smaller
    raise InputError(Problem("excitation", "a motion with M(q) > 0", "none around the centre", "choose another centre"))


def condition_number(excitation: Excitation, duration: float) -> float:
    """Condition number of the scaled 14-column regressor over the motion."""
    time = np.arange(0, duration, 0.05)
    q, dq, ddq = excitation.motion(time)
    y = np.concatenate([dynamics.regressor(q, dq, ddq), friction_columns(dq, dynamics.COULOMB_VELOCITY)], axis=2)
    flat = y.reshape(-1, y.shape[2])
    return float(np.linalg.cond(flat / np.linalg.norm(flat, axis=0)))


def optimised(
    seed: int = 0, duration: float = 60.0, rounds: int = 200, plants: Sequence[np.ndarray] = ()
) -> Excitation:
    """Phases that lower the condition number, by seeded random search from the paper's recipe.

    M(q) > 0 along the motion for every pi (8,) of `plants`. Amplitudes stay equal: letting them fall lowers the number
    further and leaves a motion that is all slow.
    """
    rng = np.random.default_rng(seed)
    best = _inside(taati(seed, duration), plants, duration)
    score, width = condition_number(best, duration), 1.0
    for _ in range(rounds):
        turned = evolve(best, phase=best.phase + width * rng.normal(size=best.phase.shape))
        trial = _inside(turned, plants, duration)
        value = condition_number(trial, duration)
        better = value < score
        best, score = (trial, value) if better else (best, score)
        width = min(width * 1.3, 2.0) if better else max(width * 0.97, 0.05)
    return best


def _inside(excitation: Excitation, plants: Sequence[np.ndarray], duration: float) -> Excitation:
    """As large as the workspace and the plants' M(q) > 0 allow."""
    found = fitted(excitation, duration)
    for pi in plants:
        found = within_definite(found, pi, duration)
    return found
