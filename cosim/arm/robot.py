"""A robot read from its URDF: the arm in it, what it is like, and all of that as plain data (robot.json)."""

from hashlib import sha256
from pathlib import Path

import numpy as np
from attrs import frozen

from cosim.arm.chain import pick_chain
from cosim.arm.reduction import ReducedArm, reduce_to_arm
from cosim.arm.serial import roll_pitch_yaw
from cosim.arm.serial_table import home
from cosim.arm.survey import ArmSurvey, survey
from cosim.arm.urdf import read_urdf


@frozen(eq=False)
class Robot:
    """The arm of a URDF file, and a survey of it."""

    source: Path
    arm: ReducedArm
    survey: ArmSurvey

    @property
    def name(self) -> str:
        """Of the files that are written: the stem of the URDF."""
        return self.source.stem


def read_robot(urdf: Path | str, base: str | None = None, tip: str | None = None) -> Robot:
    """The arm from link `base` to link `tip` of a URDF (see `pick_chain`). Raises InputError with every problem."""
    tree = read_urdf(urdf)
    arm = reduce_to_arm(tree, pick_chain(tree, base, tip))
    return Robot(Path(urdf), arm, survey(arm.model))


def robot_document(robot: Robot) -> dict[str, object]:
    """The content of robot.json: chain, joints, what was locked, doubts, ranges over the poses."""
    arm, model, seen = robot.arm, robot.arm.model, robot.survey
    return {
        "robot": model.name,
        "urdf": str(robot.source),
        "sha256": sha256(robot.source.read_bytes()).hexdigest(),
        "base": arm.chain.base,
        "tip": arm.chain.tip,
        "tip_found": arm.chain.why,
        "joints": [_joint(robot, i) for i in range(model.count)],
        "locked": [{"name": j.name, "position": j.position, "why": j.why} for j in arm.locked],
        "doubts": list(arm.doubts),
        "tip_offset": model.tip.tolist(),
        "gravity": model.gravity.tolist(),
        "mass": float(model.mass.sum()),
        "poses": seen.poses,
        "workspace": {"low": seen.tips.min(axis=0).tolist(), "high": seen.tips.max(axis=0).tolist()},
        "mass_matrix": {
            "diagonal_low": seen.lightest.tolist(),
            "diagonal_high": seen.heaviest.tolist(),
            "condition_of_scaled": list(seen.unevenness),
        },
        "gravity_torque": seen.gravity.tolist(),
    }


def _joint(robot: Robot, i: int) -> dict[str, object]:
    arm, model = robot.arm, robot.arm.model
    upper = np.triu_indices(3)
    return {
        "name": model.joints[i],
        "type": model.kinds[i].value,
        "origin": model.origin[i].tolist(),
        "rpy": (roll_pitch_yaw(model.rotation[i]) + 0.0).tolist(),
        "axis": model.axis[i].tolist(),
        "lower": finite(model.lower[i]),
        "upper": finite(model.upper[i]),
        "effort": finite(model.effort[i]),
        "speed": finite(model.speed[i]),
        "viscous": float(model.viscous[i]),
        "coulomb": float(model.coulomb[i]),
        "start": float(home(model)[i]),
        "links": list(arm.carried[i]),
        "mass": float(model.mass[i]),
        "centre": model.centre[i].tolist(),
        "inertia": model.inertia[i][upper].tolist(),
    }


def finite(value: float) -> float | None:
    """The number, None where it is infinite: where there is no limit."""
    return float(value) if np.isfinite(value) else None
