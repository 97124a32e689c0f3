"""A seven-joint arm in a laboratory, its equations pinocchio's: torques of a designed motion with friction, rotors,
offsets, noise of the amplifiers, angles as encoders give them.
"""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from attrs import frozen

from cosim.arm.serial import SerialModel
from tests.support.robot_joints import ROTOR, RigJoints
from tests.support.robots import PinocchioArm, reduced, robot_file

COUNTS = 2 * np.pi / 2**20  # rad, encoder


@frozen(eq=False)
class RobotRig:
    """The public Panda by pinocchio; `truth` (77,): parameters of its links in pinocchio's order, then rotors."""

    model: SerialModel
    plant: PinocchioArm

    @classmethod
    def panda(cls) -> "RobotRig":
        arm = reduced("panda")
        return cls(arm.model, PinocchioArm.of("panda", arm))

    @property
    def truth(self) -> np.ndarray:
        inertias = list(self.plant.model.inertias)[1:]
        return np.concatenate([*(body.toDynamicParameters() for body in inertias), ROTOR])

    def motion(self, random: np.random.Generator, duration: float = 40.0) -> "RigMotion":
        """A motion of eight sinusoids a joint, inside the limits."""
        n = self.model.count
        frequency = np.geomspace(0.3, 5.0, 8) * random.uniform(0.9, 1.1, (n, 8))
        phase, size = random.uniform(0, 2 * np.pi, (n, 8)), random.uniform(0.5, 1.0, (n, 8)) / np.sqrt(frequency)
        middle, half = (self.model.lower + self.model.upper) / 2, (self.model.upper - self.model.lower) / 2
        swing = RigMotion(frequency, phase, size, np.zeros(n))
        widest = np.abs(swing.at(np.arange(0.0, duration, 0.01))[0]).max(axis=0)
        return RigMotion(frequency, phase, size * (np.minimum(0.8 * half, 1.2) / widest)[:, None], middle)

    def torque(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, gravity: np.ndarray | None = None) -> np.ndarray:
        """Torque (n, 7) of the links without rotors, by pinocchio; gravity (3,) of another direction."""
        import pinocchio as pin

        model = self.plant.model
        if gravity is not None:
            model = model.copy()
            model.gravity.linear = gravity
        data = model.createData()
        return np.array([pin.rnea(model, data, *row) for row in zip(q, dq, ddq, strict=True)])

    def pushed(self, q: np.ndarray, stiffness: float, share: float, elevation: float) -> np.ndarray:
        """J^T f (n, 7) of a wall [N/m] that the tip meets beyond a share of its way along a normal."""
        import pinocchio as pin

        model, data, normal = (
            self.plant.model,
            self.plant.model.createData(),
            np.array([np.cos(elevation), 0.0, np.sin(elevation)]),
        )
        frame = model.getFrameId(self.plant.tip, pin.FrameType.BODY)
        depth, along = np.zeros(len(q)), np.zeros(q.shape)
        for k, pose in enumerate(q):
            jacobian = pin.computeFrameJacobian(model, data, pose, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
            depth[k] = normal @ data.oMf[frame].translation
            along[k] = normal @ jacobian
        depth -= np.quantile(depth, share)
        return -stiffness * np.maximum(depth, 0.0)[:, None] * along

    def record(
        self, seed: int, duration: float = 40.0, rate: float = 100.0, joints: RigJoints | None = None
    ) -> dict[str, np.ndarray]:
        """Columns time, q1.., tau1.. of the motion of a seed."""
        random = np.random.default_rng(seed)
        time, joints = np.arange(0.0, duration, 1.0 / rate), joints or RigJoints()
        q, tau = joints.recorded(self, self.motion(random, duration), time)
        tau = tau + random.normal(0.0, joints.noise, tau.shape)
        q = COUNTS * np.round(q / COUNTS)
        n = self.model.count
        columns = {f"q{j + 1}": q[:, j] for j in range(n)} | {f"tau{j + 1}": tau[:, j] for j in range(n)}
        return {"time": time, **columns}


@frozen(eq=False)
class RigMotion:
    """Sums of sinusoids about `middle` (n,): frequency [rad/s], phase, size [rad] (n, 8)."""

    frequency: np.ndarray
    phase: np.ndarray
    size: np.ndarray
    middle: np.ndarray

    def at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, dq, ddq (m, n) at times (m,)."""
        angle = time[:, None, None] * self.frequency + self.phase
        sine, cosine, w = np.sin(angle), np.cos(angle), self.frequency
        return (
            self.middle + (self.size * sine).sum(axis=2),
            (self.size * w * cosine).sum(axis=2),
            -(self.size * w**2 * sine).sum(axis=2),
        )


def described(folder: Path, columns: dict[str, np.ndarray], lines: Sequence[str] = ()) -> Path:
    """robot.csv and robot.toml of device "robot" in a folder; further lines at the top of the description."""
    file = folder / "robot.csv"
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out)
        writer.writerow(columns)
        writer.writerows(np.column_stack(list(columns.values())).tolist())
    count = sum(name.startswith("q") for name in columns)
    named = {role: [f"{role}{j + 1}" for j in range(count)] for role in ("q", "tau")}
    text = [f'device = "robot"\nurdf = "{robot_file("panda")}"', *lines, '[columns]\ntime = "time"']
    text += [f"{role} = {names}".replace("'", '"') for role, names in named.items()]
    file.with_suffix(".toml").write_text("\n".join(text) + "\n", encoding="utf-8")
    return file
