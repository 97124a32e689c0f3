"""Device "robot": all joints of an arm fitted together, against a rig whose equations are pinocchio's."""

import json

import numpy as np
import pytest
from attrs import evolve

import cosim
from cosim.arm.base_parameters import (
    all_parameters,
    base_columns,
    base_mass_matrix,
    base_parameters,
    whole_regressor,
)
from cosim.arm.serial import turn
from cosim.arm.serial_dynamics import mass_matrix
from cosim.arm.serial_kinematics import tip_position
from cosim.errors import InputError
from cosim.identification.identification import identify
from cosim.identification.method import adjusted, suggested
from tests.identification.tx40 import CATALOGUE, PUBLISHED, arm, entered
from tests.support.paths import SHARED
from tests.support.robot_joints import COULOMB, OFFSET, VISCOUS
from tests.support.robot_rig import RobotRig, described

LABELS = 48 + 3 * 7


@pytest.fixture(scope="module")
def rig():
    return RobotRig.panda()


def truth(rig: RobotRig) -> np.ndarray:
    """The first LABELS parameters; what follows them is zero: the rig's friction has the sign of dq."""
    return np.concatenate([base_parameters(rig.model).of(rig.truth), VISCOUS, COULOMB, OFFSET])


def covered(rig: RobotRig, folder, seed: int) -> np.ndarray:
    """Which of the true parameters lie in their 95 % intervals, in a recording of its own."""
    found = identify(cosim.read(described(folder, rig.record(seed)))).parameters[:LABELS]
    return np.array([p.interval[0] <= v <= p.interval[1] for p, v in zip(found, truth(rig), strict=True)])


def test_base_parameters_are_what_torques_show(rig):
    """43 of the links (Gaz et al. 2019 find as many for the Panda) and the five rotors that no link stands for."""
    model, random = rig.model, np.random.default_rng(2)
    base = base_parameters(model)
    assert len(base.kept) == 43 + 5
    q = model.poses(50, 9)
    dq, ddq = random.normal(size=(2, *q.shape))
    whole, kept = whole_regressor(model, q, dq, ddq) @ rig.truth, base_columns(model, base, q, dq, ddq)
    assert np.abs(kept @ base.of(rig.truth) - whole).max() < 1e-12 * np.abs(whole).max()
    flat = kept.reshape(-1, len(base.kept))
    assert np.linalg.matrix_rank(flat / np.linalg.norm(flat, axis=0), tol=1e-6) == len(base.kept)
    mass = base_mass_matrix(model, base, base.of(all_parameters(model)), q)
    assert np.abs(mass - mass_matrix(model, q)).max() < 1e-12 * np.abs(mass).max()


def test_true_parameters_lie_in_their_intervals(rig, tmp_path):
    """Of 2 x 69 intervals of 95 %: 115 or fewer would come once in a million."""
    inside = np.concatenate([covered(rig, tmp_path, seed) for seed in (1, 2)])
    assert inside.size == 2 * LABELS and inside.sum() > 115


def test_what_identify_tells(rig, tmp_path):
    file = described(tmp_path, rig.record(3), ['joints = ["' + '", "'.join(rig.model.joints) + '"]'])
    told = cosim.identify(file).to_dict()
    assert told["device"] == "robot" and told["joints"] == list(rig.model.joints)
    assert told["rank"] >= LABELS and told["condition_number"] < 1000
    assert len(told["rms_percent"]["held_out"]) == 7 and max(told["rms_percent"]["held_out"]) < 8
    assert told["mass_matrix_positive_definite"]
    assert "Iyy[2]" in told["grouped"]["Izz[1]"]
    essential = set(told["essential"])
    assert {"Izz[1]", "rotor[7]", "viscous[4]", "coulomb[7]", "my[4]"} <= essential and len(essential) < LABELS


def identified(file, physical: bool):
    recording = cosim.read(file)
    return identify(recording, adjusted(suggested(recording), None, None, None, False, physical))


def test_the_lengths_of_the_real_arm_are_those_of_another_table():
    ours, (a, alpha, d, zero) = arm(), np.array(CATALOGUE).T
    theirs = evolve(
        ours,
        rotation=[turn((roll, 0.0, 0.0)) @ turn((0.0, 0.0, yaw)) for roll, yaw in zip(alpha, zero, strict=True)],
        origin=np.stack([a, -np.sin(alpha) * d, np.cos(alpha) * d], axis=1),
        tip=np.zeros(3),
    )
    q = np.random.default_rng(1).uniform(-2, 2, (20, 6))
    upright = np.array([0.0, np.pi / 2, -np.pi / 2, 0.0, 0.0, 0.0])
    assert np.abs(tip_position(ours, q) - tip_position(theirs, q + upright)).max() < 1e-14


@pytest.mark.needs("data")
def test_a_real_arm_entered_whole(tmp_path):
    """TX40, all six joints: viscous friction of the joints before the wrist and the rotors that show by themselves are
    the published ones, of another program on this recording.
    """
    source = SHARED / "staubli_tx40"
    told = cosim.identify(entered(source, tmp_path)).to_dict()
    published = json.loads((source / "dataset.json").read_text(encoding="utf-8"))["published"]
    interval = {p["name"]: p["interval"] for p in told["parameters"]}
    for ours, joints in (("viscous", (1, 2, 3, 4)), ("rotor", (3, 4, 5, 6))):
        for j in joints:
            low, high = interval[f"{ours}[{j}]"]
            assert low < published[PUBLISHED[ours]][j - 1] < high, (ours, j)
    assert max(told["rms_percent"]["held_out"][:4]) < 10 < min(told["rms_percent"]["held_out"][4:])


@pytest.mark.slow
def test_physical_parameters_on_little_data(rig, tmp_path):
    """Eight seconds: plain least squares is far off in places; with bodies and the URDF's prior it is nearer."""
    file = described(tmp_path, rig.record(4, duration=8.0))
    true = truth(rig)
    size = np.abs(true) + 0.01
    off = {
        physical: np.array([p.value for p in identified(file, physical).parameters[:LABELS]]) - true
        for physical in (False, True)
    }
    assert np.sqrt(np.mean((off[True] / size) ** 2)) < np.sqrt(np.mean((off[False] / size) ** 2))


def test_what_is_wrong_with_a_description_is_named(rig, tmp_path):
    columns = rig.record(5, duration=2.0)
    for lines, words in (
        (['joints = ["panda_joint1"]'], "the joints from panda_link0"),
        (['tip = "panda_link7"', 'base = "nowhere"'], "--base"),
        (['[units]\ntau = "A"'], "torques, since joints of one arm"),
    ):
        file = described(tmp_path, columns, lines)
        with pytest.raises(InputError, match=words):
            cosim.read(file)
    file = described(tmp_path, columns)
    description = file.with_suffix(".toml")
    description.write_text(description.read_text().replace("urdf = ", "joint = "), encoding="utf-8")
    with pytest.raises(InputError, match="the URDF of device 'robot'"):
        cosim.read(file)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_coverage_over_a_hundred_recordings(rig, tmp_path):
    inside = np.concatenate([covered(rig, tmp_path, 100 + seed) for seed in range(100)])
    print(f"\n{inside.mean():.4f} of {inside.size} intervals hold the true value")
    assert 0.90 < inside.mean() < 0.99
