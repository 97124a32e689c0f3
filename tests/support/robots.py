"""The arms of ten public URDFs (package example-robot-data), as pinocchio has them, and our SerialArm with their
numbers.
"""

from importlib.metadata import distribution
from pathlib import Path

import numpy as np
from attrs import frozen

from cosim.arm.chain import pick_chain
from cosim.arm.reduction import ReducedArm, reduce_to_arm
from cosim.arm.serial import SerialModel
from cosim.arm.serial_table import arm_values
from cosim.arm.urdf import read_urdf
from tests.support.model_harness import CompiledModel
from tests.support.needs import require

ROBOTS = {
    "panda": "panda_description/urdf/panda.urdf",
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "tiago": "tiago_description/robots/tiago.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "z1": "z1_description/urdf/z1.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
    "talos_left_arm": "talos_data/robots/talos_left_arm.urdf",
}


def robot_file(name: str) -> Path:
    """The URDF of one of ROBOTS."""
    require("robots")
    package = distribution("example-robot-data")
    return Path(str(package.locate_file("cmeel.prefix/share/example-robot-data/robots"))) / ROBOTS[name]


def reduced(name: str) -> ReducedArm:
    tree = read_urdf(robot_file(name))
    return reduce_to_arm(tree, pick_chain(tree))


@frozen(eq=False)
class PinocchioArm:
    """The same URDF read and reduced by pinocchio: off-chain joints locked where ours are."""

    model: object
    tip: str

    @classmethod
    def of(cls, name: str, arm: ReducedArm) -> "PinocchioArm":
        require("robots")
        import pinocchio as pin

        full = pin.buildModelFromUrdf(str(robot_file(name)))
        pose = pin.neutral(full)
        for joint in arm.locked:
            _put(full, pose, full.getJointId(joint.name), joint.position)
        off = [full.getJointId(joint) for joint in full.names[1:] if joint not in arm.model.joints]
        model = pin.buildReducedModel(full, off, pose) if off else full
        assert list(model.names[1:]) == list(arm.model.joints)
        return cls(model, arm.chain.tip)

    def pose(self, q: np.ndarray) -> np.ndarray:
        """Pinocchio's coordinates: cosine and sine at continuous joints."""
        import pinocchio as pin

        found = pin.neutral(self.model)
        for i, value in enumerate(q):
            _put(self.model, found, i + 1, value)
        return found

    def ask(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> dict[str, np.ndarray]:
        """Mass matrix, torque of the motion, bias, gravity, regressor, tip and its Jacobian at one state."""
        import pinocchio as pin

        model, data, at, rest = self.model, self.model.createData(), self.pose(q), np.zeros_like(q)
        upper = np.triu(pin.crba(model, data, at))
        found = {
            "mass": upper + np.triu(upper, 1).T,
            "torque": pin.rnea(model, data, at, dq, ddq).copy(),
            "bias": pin.nonLinearEffects(model, data, at, dq).copy(),
            "gravity": pin.rnea(model, data, at, rest, rest).copy(),
            "regressor": pin.computeJointTorqueRegressor(model, data, at, dq, ddq).copy(),
        }
        frame = model.getFrameId(self.tip, pin.FrameType.BODY)
        pin.framesForwardKinematics(model, data, at)
        found["x"] = data.oMf[frame].translation.copy()
        found["jacobian"] = pin.computeFrameJacobian(model, data, at, frame, pin.LOCAL_WORLD_ALIGNED)[:3].copy()
        return found

    def forward(self, q: np.ndarray, dq: np.ndarray, tau: np.ndarray, f: np.ndarray) -> np.ndarray:
        """ddq by pinocchio's articulated bodies, the tip's force as J^T f."""
        import pinocchio as pin

        torque = tau + self.ask(q, dq, np.zeros_like(q))["jacobian"].T @ f
        return pin.aba(self.model, self.model.createData(), self.pose(q), dq, torque).copy()


def _put(model, pose: np.ndarray, joint: int, value: float) -> None:
    there = model.joints[joint]
    pose[there.idx_q : there.idx_q + there.nq] = [value] if there.nq == 1 else [np.cos(value), np.sin(value)]


def compiled(model: SerialModel, **more) -> CompiledModel:
    """SerialArm in C with the numbers of an arm, motors without limits; `more` by joint or for all."""
    arm = CompiledModel("SerialArm")
    values = arm_values(model) | {"torque_saturation": 0.0, "joint_limits": 0.0} | more
    for name, value in values.items():
        arm[name] = padded(arm, name, value)
    return arm


def padded(arm: CompiledModel, name: str, value) -> np.ndarray:
    """The variable with its first entries replaced, since the table has room for twelve joints."""
    found, given = arm[name], np.atleast_1d(value)
    found[: found.size if given.size == 1 else given.size] = given
    return found


def put(arm: CompiledModel, **values) -> None:
    for name, value in values.items():
        arm[name] = padded(arm, name, value)


def states(model: SerialModel, count: int, seed: int) -> list[tuple[np.ndarray, ...]]:
    """Random q inside the limits, dq, ddq, tau, f."""
    random, n = np.random.default_rng(seed), model.count
    return [
        (q, *random.uniform(-2, 2, (2, n)), random.uniform(-5, 5, n), random.uniform(-10, 10, 3))
        for q in model.poses(count, seed)
    ]


def apart(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference over the largest entry."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())
