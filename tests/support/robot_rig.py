"""A seven-joint arm in a laboratory, its equations pinocchio's: torques of a designed motion with friction, rotors,
offsets, noise of the amplifiers, angles as encoders give them.
"""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from attrs import frozen

from cosim.arm.serial import SerialModel
from tests.support.robots import PinocchioArm, reduced, robot_file

VISCOUS = np.array([1.2, 0.9, 0.8, 0.9, 0.4, 0.5, 0.3])
COULOMB = np.array([0.8, 0.7, 0.6, 0.7, 0.3, 0.35, 0.25])
OFFSET = np.array([0.2, -0.3, 0.1, 0.25, -0.1, 0.05, 0.08])
ROTOR = np.array([0.6, 0.6, 0.45, 0.45, 0.2, 0.2, 0.2])
NOISE = 0.05  # N m, of every torque
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

    def record(self, seed: int, duration: float = 40.0, rate: float = 100.0) -> dict[str, np.ndarray]:
        """Columns time, q1.., tau1.. of a motion of eight sinusoids a joint, inside the limits."""
        import pinocchio as pin

        random, n = np.random.default_rng(seed), self.model.count
        time = np.arange(0.0, duration, 1.0 / rate)
        frequency = np.geomspace(0.3, 5.0, 8) * random.uniform(0.9, 1.1, (n, 8))
        phase, size = random.uniform(0, 2 * np.pi, (n, 8)), random.uniform(0.5, 1.0, (n, 8)) / np.sqrt(frequency)
        angle = time[:, None, None] * frequency + phase
        swing = (size * np.sin(angle)).sum(axis=2)
        middle, half = (self.model.lower + self.model.upper) / 2, (self.model.upper - self.model.lower) / 2
        scale = np.minimum(0.8 * half, 1.2) / np.abs(swing).max(axis=0)
        q = middle + scale * swing
        dq = scale * (size * frequency * np.cos(angle)).sum(axis=2)
        ddq = -scale * (size * frequency**2 * np.sin(angle)).sum(axis=2)
        data = self.plant.model.createData()
        rigid = np.array([pin.rnea(self.plant.model, data, *row) for row in zip(q, dq, ddq, strict=True)])
        tau = rigid + ROTOR * ddq + VISCOUS * dq + COULOMB * np.sign(dq) + OFFSET
        tau += random.normal(0.0, NOISE, tau.shape)
        q = COUNTS * np.round(q / COUNTS)
        columns = {f"q{j + 1}": q[:, j] for j in range(n)} | {f"tau{j + 1}": tau[:, j] for j in range(n)}
        return {"time": time, **columns}


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
