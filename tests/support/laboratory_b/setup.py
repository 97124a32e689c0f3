"""Draws an experiment: a body, its friction, a controller, motions and a logger."""

from dataclasses import dataclass

import numpy as np

from tests.support.laboratory_b.chain import SerialArm, six_joints, three_joints
from tests.support.laboratory_b.logger import LabLogger
from tests.support.laboratory_b.motions import RICH, Motion, one_way, poor
from tests.support.laboratory_b.plant import LabExperiment, Pendulum, ServoLoop

Rng = np.random.Generator


@dataclass(frozen=True)
class LabSetup:
    experiment: LabExperiment
    logger: LabLogger
    motions: tuple[str, ...]


def lengths(rng: Rng, total: float) -> list[float]:
    """One recording, or two or three runs."""
    runs = int(rng.choice([1, 1, 2, 3]))
    return [total / runs] * runs


def rich_motion(rng: Rng) -> Motion:
    return RICH[int(rng.integers(len(RICH)))]


def logger_of(rng: Rng, step: float, every: int, counts: float) -> LabLogger:
    rate = 1 / (every * step)
    cutoff = min(rng.uniform(12, 25), 0.2 * rate)
    corner = None if rng.integers(2) else min(rng.uniform(5, 40), 0.2 * rate)
    return LabLogger(every, step, counts, cutoff, corner)


def axis_setup(rng: Rng, longest: float) -> LabSetup:
    """A gear motor with a weight on a lever; sometimes the axis is vertical."""
    inertia = float(np.exp(rng.uniform(np.log(0.02), np.log(0.4))))
    weight = inertia * (2 * np.pi * rng.uniform(0.5, 1.2)) ** 2 if rng.random() < 0.75 else 0.0
    reach, speed = rng.uniform(0.7, 1.8), rng.uniform(2.0, 6.0)
    scale = 0.6 * weight + 6 * inertia
    dry, viscous = scale * rng.uniform(0.06, 0.25), scale * rng.uniform(0.03, 0.15) / speed
    step, every, total = LOGGERS[int(rng.integers(len(LOGGERS)))]
    total = min(total * rng.uniform(0.7, 1.0), longest)
    bandwidth, periods = 2 * np.pi * rng.uniform(2.5, 5.0), max(1, round(0.001 / step))
    kp = inertia * bandwidth**2
    loop = ServoLoop(
        np.array([kp]),
        np.array([kp * rng.choice([0.0, 1.0])]),
        np.array([2 * 0.8 * inertia * bandwidth]),
        float(rng.choice([0.0, 0.5, 0.9])) if weight else 0.0,
        periods,
    )
    turning, lazy = not weight and rng.random() < 0.3, rng.random() < 0.06
    references, names = [], []
    centre = rng.uniform(-0.4, 0.4)
    for seconds in lengths(rng, total):
        motion = one_way if turning else poor if lazy else rich_motion(rng)
        references.append(centre + motion(rng, np.arange(0, seconds, step), reach, speed)[:, None])
        names.append(motion.__name__)
    counts = 2 * np.pi / float(rng.choice([40000, 65536, 131072, 524288, 4194304]))
    experiment = LabExperiment(
        Pendulum(inertia, weight), 0, 0, np.array([dry]), np.array([viscous]), loop, step, tuple(references), counts
    )
    return LabSetup(experiment, logger_of(rng, step, every, counts), tuple(names))


LOGGERS = (
    (0.00025, 1, 11.0),
    (0.0005, 1, 20.0),
    (0.0005, 2, 40.0),
    (0.0005, 4, 45.0),
    (0.0005, 5, 45.0),
    (0.0005, 10, 45.0),
    (0.001, 4, 90.0),
    (0.002, 5, 180.0),
)
"""Step of the simulation [s], steps a row, longest recording [s]: 4 kHz for 11 s to 100 Hz for 3 min."""


def arm_setup(rng: Rng, joints: int, joint: int, longest: float) -> LabSetup:
    arm = three_joints(rng) if joints == 3 else six_joints(rng)
    step, centre = 0.001, rng.uniform(-0.5, 0.5, joints)
    inertia, gravity = at_pose(arm, centre)
    bandwidth = 2 * np.pi * rng.uniform(2.5, 4.0)
    kp = inertia * bandwidth**2
    scale = 0.6 * gravity + 4 * inertia
    dry, viscous = scale * rng.uniform(0.06, 0.2, joints), scale * rng.uniform(0.03, 0.12, joints) / 2
    ki = kp * rng.choice([0.0, 0.5])
    every = int(rng.choice([1, 2]))
    loop = ServoLoop(kp, ki, 1.6 * inertia * bandwidth, float(rng.choice([0.7, 0.9, 1.0])), every)
    references, names = [], []
    for seconds in lengths(rng, min(rng.uniform(12, 26), longest)):
        motion, t = rich_motion(rng), np.arange(0, seconds, step)
        moves = [motion(rng, t, rng.uniform(0.5, 1.0), rng.uniform(1.0, 2.5)) for _ in range(joints)]
        references.append(centre + np.column_stack(moves))
        names.append(motion.__name__)
    counts = 2 * np.pi / float(rng.choice([65536, 131072, 1048576]))
    neighbour = joint - 1 if joint else 1
    experiment = LabExperiment(arm, joint, neighbour, dry, viscous, loop, step, tuple(references), counts)
    return LabSetup(experiment, logger_of(rng, step, int(rng.choice([1, 2, 4, 5, 10])), counts), tuple(names))


def at_pose(arm: SerialArm, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inertia of each joint at a pose and the size of its torque of gravity."""
    n, p = q.size, arm.parameters()
    still = np.zeros((1, n))
    gravity = np.array([(arm.columns(j, q[None], still, still) @ p)[0] for j in range(n)])
    pushed = [(arm.columns(j, q[None], still, np.eye(n)[j : j + 1]) @ p)[0] for j in range(n)]
    return np.array(pushed) - gravity + [link.rotor for link in arm.links], np.abs(gravity)
