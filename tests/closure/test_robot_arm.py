"""The loop closed on a seven-joint arm from its URDF, against a rig whose equations are pinocchio's: a coupling between
two joints named, written into the arm's FMU, replayed; what effects need of the arm.

Rates over many recordings: `python -m tests.support.robot_study`.
"""

import fmpy
import numpy as np
import pytest
from attrs import evolve

from cosim.arm.base_parameters import all_parameters, base_columns, base_parameters
from cosim.arm.identified import identified_arm
from cosim.arm.serial_dynamics import inverse_dynamics
from cosim.closure.closure import Closure, Options, close_loop
from cosim.closure.drive import SerialDrive
from cosim.effects import library
from cosim.effects.moving_arm import SerialGeometry
from cosim.effects.surroundings import pair_number, pair_of
from cosim.measured.label import Label
from cosim.report.closure import save
from tests.support.robot_joints import FRICTION, hidden
from tests.support.robot_rig import RobotRig
from tests.support.robot_study import recorded, rig

ON, FROM, SIZE = 6, 1, 4.0
LOOKED_FOR = ("joint_coupling", "stribeck", "torque_offset", "encoder_offset", "base_tilt", "external_contact")


@pytest.fixture(scope="module")
def closure() -> Closure:
    """Twenty seconds of an arm whose joint 6 is pulled by the motion of joint 1."""
    joints, truth = hidden("joint_coupling", SIZE, 103)
    assert truth == {"joint_coupling": {ON}}
    effects = tuple(e for e in library() if e.name in LOOKED_FOR)
    return close_loop(recorded(103, joints, duration=20.0), Options(effects=effects))


def test_a_coupling_is_named_between_its_joints(closure):
    (found,) = closure.verdict.findings
    assert (found.name, found.joints, found.choice.theta[0]) == ("joint_coupling", (ON,), FROM - 1)
    assert found.level == "law" and not found.aliases
    number = pair_number(7, ON - 1, FROM - 1)
    true = {"viscous": 0.1 * SIZE * FRICTION[ON - 1], "coulomb": 0.04 * SIZE * FRICTION[ON - 1]}
    for name, value in true.items():
        low, high = found.interval[Label(f"coupling_{name}", number)]
        assert low < value < high and high - low < value
    assert closure.error is not None and closure.error.after[ON - 1] < 0.05 * closure.error.before[ON - 1]


def test_it_is_replayed_as_a_co_simulation(closure):
    """The FMU of the arm with its identified table, without and with the coupling, guided along the recorded path."""
    replay = closure.replay
    assert replay is not None and replay.kind == "guided"
    assert replay.after[ON - 1] < 0.25 * replay.before[ON - 1]
    assert max(replay.after) < 5 and max(replay.position_after) < 2e-3


def test_its_fmu_holds_the_coupling(closure, tmp_path):
    save(closure, tmp_path)
    described = fmpy.read_model_description(tmp_path / "fmi3" / "SerialArm.fmu")
    starts = {v.name: v.start for v in described.modelVariables}
    assert (int(starts["coupling_on[1]"]), int(starts["coupling_from[1]"])) == (ON, FROM)
    assert int(starts["coupling_on[2]"]) == 0 and "coupling_on[8]" not in starts
    assert float(starts["coupling_viscous[1]"]) == pytest.approx(0.1 * SIZE * FRICTION[ON - 1], rel=0.1)
    assert 'model = "SerialArm"' in (tmp_path / "effects.toml").read_text()
    assert "joint_coupling" in (tmp_path / "report.html").read_text()


def test_pairs_have_numbers():
    """With three joints those of the FMU PhantomArm."""
    assert [pair_of(3, k) for k in range(1, 7)] == [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)]
    every = [(i, j) for i in range(7) for j in range(7) if i != j]
    assert [pair_number(7, *pair) for pair in every] == list(range(1, 43))
    assert [pair_of(7, k) for k in range(1, 43)] == every


def test_more_couplings_than_an_fmu_has_room_for_are_told():
    drive = SerialDrive(rig().model)
    labels = {Label("coupling_viscous", k): float(k) for k in range(1, 9)}
    values = drive.start_values(labels)
    assert values["coupling_viscous"] == [float(k) for k in range(1, 8)]
    assert values["coupling_from"] == [2, 3, 4, 5, 6, 7, 1]
    assert "not for 8" in drive.lacks(labels) and not drive.lacks(list(labels)[:7])


def states(arm: RobotRig, count: int = 40) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random, q = np.random.default_rng(4), arm.model.poses(count, 5)
    return q, random.normal(size=q.shape), random.normal(size=q.shape)


def test_a_table_has_the_base_parameters_that_were_identified():
    """Also where they are far from the URDF's: torques agree with those of the columns; masses stay."""
    model, (q, dq, ddq) = rig().model, states(rig())
    base = base_parameters(model)
    values = base.of(all_parameters(model)) * np.random.default_rng(6).uniform(0.7, 1.3, len(base.kept))
    found = identified_arm(model, values)
    expected = base_columns(model, base, q, dq, ddq) @ values
    assert np.abs(inverse_dynamics(found, q, dq, ddq) - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.array_equal(found.mass, model.mass)


class Moved:
    """The motion that a geometry is asked along."""

    def __init__(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> None:
        self.q, self.dq, self.ddq = q, dq, ddq


def test_a_payload_and_a_tilt_need_the_torques_that_pinocchio_says():
    """A mass welded to the tip; the derivative of gravity's torques by a lean of the vertical, by differences."""
    import pinocchio as pin

    arm, (q, dq, ddq) = rig(), states(rig())
    geometry = SerialGeometry(arm.model)
    loaded = RobotRig(arm.model, evolve(arm.plant, model=arm.plant.model.copy()))
    place = pin.SE3(np.eye(3), np.asarray(arm.model.tip))
    loaded.plant.model.appendBodyToJoint(arm.model.count, pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3))), place)
    more = loaded.torque(q, dq, ddq) - arm.torque(q, dq, ddq)
    assert np.abs(geometry.payload_torque(Moved(q, dq, ddq), 9.81) - more).max() < 1e-10 * np.abs(more).max()

    pi, still, lean = base_parameters(arm.model).of(all_parameters(arm.model)), np.zeros_like(q), 1e-6
    tilted = geometry.tilt_torque(q, pi)
    for k, pull in enumerate(((lean, 0.0, 1.0), (0.0, lean, 1.0))):
        level = arm.torque(q, still, still)
        slope = (arm.torque(q, still, still, -9.81 * np.array(pull)) - level) / lean
        found = np.stack([tilted[j][:, k] for j in range(7)], axis=1)
        assert np.abs(found - slope).max() < 1e-6 * np.abs(slope).max()
    assert geometry.idle(0) and not geometry.idle(1) and not geometry.balanced(pi)
