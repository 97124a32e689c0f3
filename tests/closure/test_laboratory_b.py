"""A laboratory for blind tests: its dynamics, its noise and its truth, without the tool that it will test."""

import json
import tomllib

import mujoco
import numpy as np
import pytest

from tests.support.laboratory_b import FORMS, generate
from tests.support.laboratory_b.chain import GRAVITY, six_joints, three_joints
from tests.support.laboratory_b.generation import HIDDEN_ON_AN_AXIS
from tests.support.laboratory_b.mechanism import Mechanism
from tests.support.laboratory_b.nominal import exact_rms, least_squares
from tests.support.laboratory_b.plant import simulate
from tests.support.laboratory_b.surroundings import OUTSIDE_ANYWHERE, OUTSIDE_TWO_JOINTS

QUICK = ("stribeck", "position_torque", "hysteresis", "backlash")


@pytest.mark.parametrize("draw", [three_joints, six_joints])
def test_columns_times_masses_are_mujoco_s_inverse_dynamics(draw):
    """Two writings of one model: Newton and Euler in the columns, MuJoCo from the same masses."""
    rng = np.random.default_rng(3)
    arm = draw(rng)
    n = len(arm.links)
    q, dq, ddq = rng.uniform(-2, 2, (3, 20, n))
    model = mujoco.MjModel.from_xml_string(arm.mjcf(0.001, (0.0, 0.0, -GRAVITY), None, None))
    model.dof_frictionloss[:] = 0
    data = mujoco.MjData(model)
    theirs = np.zeros((20, n))
    for k in range(20):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        theirs[k] = data.qfrc_inverse
    rotors = np.array([link.rotor for link in arm.links])
    ours = np.column_stack([arm.columns(j, q, dq, ddq) @ arm.parameters() for j in range(n)]) + rotors * ddq
    np.testing.assert_allclose(ours, theirs, atol=1e-5)  # MuJoCo's smallest friction level is 1e-6


@pytest.mark.parametrize("name", ["position_torque", "stribeck", "actuator_lag"])
def test_power_balance_of_a_joint(name):
    """Change of energy = work of motor, friction and effect; the steps' error is of first order in h = 0.25 to 2 ms."""
    recording = generate(4, "one", name, longest=8, joints=1)
    trace, e = recording.trace, recording.setup.experiment
    rows = np.flatnonzero(trace.run == 1)
    q, v = trace.q[rows, 0], trace.dq[rows, 0]
    force = trace.motor[rows] + trace.dry[rows] + trace.extra[rows] - e.viscous[0] * v
    power = force[:-1] * (v[:-1] + v[1:]) / 2
    energy = e.body.inertia * v**2 / 2 - e.body.weight * np.cos(q)
    assert abs(energy[-1] - energy[0] - power.sum() * e.step) < 0.01 * np.abs(power).sum() * e.step
    assert (trace.dry[rows][:-1] * v[1:] <= 0).all()


def test_power_balance_of_an_arm():
    """MuJoCo's energy against the work of all joints' torques; a spring that MuJoCo does not know pulls at one."""
    recording = generate(2, "one", "position_torque", longest=5, joints=3)
    e = recording.setup.experiment
    trace = simulate(e, recording.mechanism)
    arm, rows = e.body, np.flatnonzero(trace.run == 1)
    q, v, ddq = trace.q[rows], trace.dq[rows], trace.ddq[rows]
    rotors = np.array([link.rotor for link in arm.links])
    torque = np.column_stack([arm.columns(j, q, v, ddq) @ arm.parameters() for j in range(3)]) + rotors * ddq
    told = trace.motor[rows] + trace.dry[rows] + trace.extra[rows] - e.viscous[e.joint] * v[:, e.joint]
    np.testing.assert_allclose(
        torque[:, e.joint], told, atol=1e-3
    )  # MuJoCo's solver stops short of its limit where a joint starts to slip
    power = np.sum(torque[:-1] * (v[:-1] + v[1:]) / 2, axis=1)
    model = mujoco.MjModel.from_xml_string(arm.mjcf(e.step, (0.0, 0.0, -GRAVITY), None, None))
    data, energy = mujoco.MjData(model), []
    for k in (0, -1):
        data.qpos[:], data.qvel[:] = q[k], v[k]
        mujoco.mj_forward(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        energy.append(data.energy.sum())
    assert abs(energy[1] - energy[0] - power.sum() * e.step) < 0.01 * np.abs(power).sum() * e.step


def test_a_stiff_gear_is_a_rigid_one():
    """What flexing adds falls with the square of the stiffness or faster in the band that is looked at."""
    recording = generate(2, "one", "joint_elasticity", longest=6, joints=1)
    occurrence, e = recording.happened[0].occurrence, recording.setup.experiment
    cutoff = recording.setup.logger.cutoff
    left = [exact_rms(recording.model, simulate(e, occurrence.at(size)), cutoff) for size in (1.0, 0.25, 0.0625)]
    assert left[1] < left[0] / 2.5 and left[2] < left[1] / 2.5


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_least_squares_of_a_complete_joint_returns_what_was_put_in(seed):
    """Exact signals return the parameters; with noise of a percent they come back within four standard deviations."""
    recording = generate(seed, "complete", longest=12, joints=1)
    e, trace = recording.setup.experiment, recording.trace
    true = [e.body.inertia, 0.0, *([e.body.weight, 0.0] if e.body.weight else []), e.viscous[0], e.dry[0]]
    table = recording.model.table(trace.q, trace.dq, trace.ddq, trace.command[:, 0])
    table = table[recording.model.moving(trace.dq)]
    exact = least_squares(table)[1]
    np.testing.assert_allclose(exact, true, atol=0.01 * max(true))
    sigma = 0.01 * np.sqrt(np.mean(table[:, -1] ** 2))
    std = sigma * np.sqrt(np.diag(np.linalg.inv(table[:, :-1].T @ table[:, :-1])))
    table[:, -1] += sigma * np.random.default_rng(seed).standard_normal(len(table))
    assert (np.abs(least_squares(table)[1] - exact) < 4 * std).all()


@pytest.mark.parametrize("joints", [3, 6])
def test_least_squares_of_a_complete_arm_returns_its_friction(joints):
    recording = generate(1, "complete", longest=12, joints=joints)
    e, trace = recording.setup.experiment, recording.trace
    table = recording.model.table(trace.q, trace.dq, trace.ddq, trace.command[:, e.joint])
    residual, parameters = least_squares(table[recording.model.moving(trace.dq)])
    np.testing.assert_allclose(parameters[-2:], [e.viscous[e.joint], e.dry[e.joint]], rtol=0.03)
    assert np.sqrt(np.mean(residual**2)) < 0.01 * np.sqrt(np.mean(trace.command[:, e.joint] ** 2))


def test_a_seed_is_a_recording(tmp_path):
    texts = []
    for name in ("first", "again"):
        generate(7, "pair", longest=4, joints=1).write(tmp_path / name)
        texts.append([(tmp_path / name / file).read_bytes() for file in ("data.csv", "data.toml", "truth.json")])
    assert texts[0] == texts[1]
    generate(8, "pair", longest=4, joints=1).write(tmp_path / "other")
    assert (tmp_path / "other/data.csv").read_bytes() != texts[0][0]


@pytest.mark.parametrize(("kind", "joints"), [("complete", 6), ("outside", 3), ("pair", 1), ("one", 1)])
def test_the_description_names_columns_of_the_table(tmp_path, kind, joints):
    generate(5, kind, longest=5, joints=joints).write(tmp_path)
    told = tomllib.loads((tmp_path / "data.toml").read_text())
    with open(tmp_path / "data.csv") as file:
        header = file.readline().strip().split(",")
        table = np.loadtxt(file, delimiter=",")
    named = [told["columns"].pop("other", {})] + [v if isinstance(v, list) else [v] for v in told["columns"].values()]
    assert sorted(name for names in named for name in names) == sorted(header)
    assert table.shape[1] == len(header) and np.isfinite(table).all() and (np.diff(table[:, 0]) > 0).all()
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert len(truth["phenomena"]) == {"complete": 0, "pair": 2}.get(kind, 1)
    assert truth["shows"] >= 0 and (truth["shows"] == 0) == (kind == "complete")


@pytest.mark.parametrize("name", [x if x in QUICK else pytest.param(x, marks=pytest.mark.slow) for x in sorted(FORMS)])
def test_every_phenomenon_shows_about_as_much_as_is_asked(name):
    recording = generate(1, "one", name, strength=1.5, longest=8, joints=3 if name in HIDDEN_ON_AN_AXIS else 1)
    assert 0.75 < recording.shows < 3


@pytest.mark.slow
@pytest.mark.parametrize("form", [*OUTSIDE_ANYWHERE, *OUTSIDE_TWO_JOINTS])
def test_what_is_in_no_book_shows_too(form):
    joints = 3 if form in OUTSIDE_TWO_JOINTS else 1
    recording = generate(1, "outside", form.__name__, strength=1.5, longest=8, joints=joints)
    assert 0.5 < recording.shows < 3


def test_nothing_added_where_nothing_happens():
    recording = generate(3, "complete", longest=6)
    trace = simulate(recording.setup.experiment, Mechanism())
    np.testing.assert_array_equal(trace.command, recording.trace.command)
    assert recording.added == 0 and recording.floor > 0
