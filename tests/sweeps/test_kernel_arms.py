"""Serial arms in the batch kernel: the bits of the FMUs lane by lane, whatever the arms, and how sweeps use it."""

import re

import numpy as np
import pytest
from attrs import evolve

from cosim.engine.master import run
from cosim.engine.outcome import Outcome
from cosim.fmu import open_system
from cosim.scenario import load_scenario
from cosim.signals import stem
from cosim.sweeps import kernel
from cosim.sweeps.evaluate import EVALUATORS, _signals, check, cosimulation, setup, simulation
from cosim.sweeps.lane_refusal import lane_refusal
from cosim.sweeps.points import Point
from cosim.sweeps.pool import Here, Task

RECORD = [
    *("arm_l.q", "arm_l.dq", "arm_r.q", "arm_r.x_tip", "arm_r.dx", "arm_r.tau_motor", "arm_r.saturated"),
    "arm_l.saturated",
    *("arm_r.f_contact", "controller_l.f", "controller_r.tau", "channel_lr.y", "operator.f"),
]
HANDED = """
format = 1
title = "Two arms of three joints, one of which slides, a hand and a wall"
description = "The remote arm follows tip to tip and meets a wall."
connections = [
    "arm_l.x_tip -> operator.x", "arm_l.dx_tip -> operator.dx", "operator.f -> arm_l.f",
    "arm_l.x -> channel_lr.u", "channel_lr.y -> controller_r.x_ref",
    "arm_r.x -> controller_r.x", "arm_r.dx -> controller_r.dx", "controller_r.f -> arm_r.f_command",
    "arm_r.x -> channel_rl.u", "channel_rl.y -> controller_l.x_ref",
    "arm_l.x -> controller_l.x", "arm_l.dx -> controller_l.dx", "controller_l.f -> arm_l.f_command",
    "arm_r.x_tip -> environment.x", "arm_r.dx_tip -> environment.dx", "environment.f -> arm_r.f",
]
[experiment]
stop = 0.6
step = 0.001
[components.operator]
model = "Operator"
[components.operator.parameters]
hand_mass = 0.5
hand_stiffness = 200.0
hand_damping = 20.0
grip_stiffness = 500.0
grip_damping = 5.0
reference = [0.9, 0.0, 0.0]
reference_amplitude = [0.1, 0.05, 0.05]
reference_frequency = 1.0
[components.environment]
model = "Environment"
parameters = { surface = "wall", normal = [-1.0, 0.0, 0.0], offset = -0.91, stiffness = 1000.0, damping = 2.0 }
"""
CONTROLLER = """
[components.controller_{side}]
model = "ArmController"
parameters = {{ joints = 3, stiffness = 100.0, damping = 10.0 }}
[components.channel_{way}]
model = "PacketChannel"
parameters = {{ delay_mean = 0.02, interpolation = "linear" }}
"""
SLIDING = """
[components.arm_{side}]
model = "SerialArm"
[components.arm_{side}.parameters]
joints = 3
joint_type = [1, 1, 3]
axis_x = [0.0, 0.0, 1.0]
axis_y = [0.0, 1.0, 0.0]
axis_z = [1.0, 0.0, 0.0]
origin_roll = [0.0, 0.2, -0.1]
rotor_inertia = [2e-5, 1e-5, 0.0]
gear_ratio = [100.0, 80.0, 1.0]
gravity_compensation = true
viscous = 0.05
"""


@pytest.fixture(scope="module")
def handed(tmp_path_factory):
    """Path of the scenario with hand and wall."""
    path = tmp_path_factory.mktemp("arms") / "handed.toml"
    sides = "".join(
        CONTROLLER.format(side=side, way=way) + SLIDING.format(side=side) for side, way in (("l", "rl"), ("r", "lr"))
    )
    path.write_text(HANDED + sides)
    return str(path)


def same(name, stop, *values, record=RECORD):
    """Results of scenarios that differ in the given values, each of which has the bits of its co-simulation."""
    base = load_scenario(name).with_values({"experiment.stop": stop, "experiment.record_every": 1})
    scenarios = [base.with_values(one) for one in values]
    with open_system(base) as system:
        wirings = [system.wiring(scenario) for scenario in scenarios]
        there = {stem(signal) for signal in wirings[0].signals}
        record = [name for name in record if name in there]
        assert [lane_refusal(wiring, record) for wiring in wirings] == [None] * len(wirings)
        found = kernel.run_batch(wirings, record)
        for scenario, result in zip(scenarios, found, strict=True):
            expected = run(scenario, system, record=record)
            assert (result.outcome, result.stopped_at) == (expected.outcome, expected.stopped_at)
            assert list(result.signals) == list(expected.signals)
            for signal, got in result.signals.items():
                assert got.tobytes() == expected.signals[signal].tobytes(), signal
    return found


def each(values, joints="arm_*"):
    return {f"{joints}.{name}": value for name, value in values.items()}


def test_the_shipped_example_of_seven_joints():
    """Beside other gains, delays of every kind, a payload, a leaning base, a wall, motors at their limits."""
    wall = {"contact_stiffness": 500.0, "contact_damping": 2.0, "contact_distance": 0.3, "contact_normal[1]": 2.0}
    slow = {"channel_*.law": "random_walk", "channel_*.delay_min": 0.01, "channel_*.delay_max": 0.06}
    found = same(
        "panda",
        0.3,
        {"controller_*.joint_stiffness": 30.0, "controller_*.joint_damping": 2.0},
        slow | {"channel_*.interpolation": "hold", "arm_r.payload": 0.7},
        {"arm_*.base_tilt": [0.2, -0.1], "arm_l.gravity_compensation": False},
        each(wall, "arm_r"),
        {"arm_*.torque_saturation[1]": 8.9, "arm_r.q_start[1]": 0.2, "arm_*.coulomb": 0.3, "arm_*.viscous": 0.4},
        {"arm_l.q_start[4]": -0.07, "arm_l.dq_start[4]": 1.0},
    )
    assert np.any(found[3].signals["arm_r.f_contact[1]"] != 0.0)
    assert set(found[4].signals["arm_r.saturated"]) == {0.0, 1.0}
    assert found[5].outcome is Outcome.DOMAIN_EXIT
    assert {r.outcome for r in found[:5]} == {Outcome.BOUNDED}


def test_a_phantom_leads_an_arm_of_seven_joints():
    """Tip to tip, with packets that overtake each other and are lost in some lanes, and a motor at its limit."""
    lossy = {"channel_*.semantics": "newest_packet", "channel_*.law": "uniform", "channel_*.delay_max": 0.06}
    found = same(
        "phantom-panda",
        0.3,
        *(
            lossy | {"channel_*.delay_interval": 0.015, "channel_*.seed": k, "channel_*.loss_good": 0.1 * k}
            for k in (1, 2)
        ),
        lossy | {"channel_*.semantics": "packet_order", "controller_r.stiffness": 200.0, "arm_l.coulomb": 0.002},
        {"arm_l.torque_saturation": [0.001, 0.0, 0.1], "operator.amplitude": [2.0, 1.0, 1.0], "arm_l.stribeck": 0.001},
    )
    assert set(found[3].signals["arm_l.saturated"]) == {0.0, 1.0}
    assert set(found[0].signals["arm_l.saturated"]) == {0.0}


def test_three_joints_with_a_hand_and_a_wall(handed):
    found = same(
        handed,
        0.6,
        {},
        {"environment.surface": "free", "arm_r.viscous": [0.1, 0.0, 2.0]},
        {"operator.hand_mass": 0.0, "operator.amplitude": [1.0, 0.5, 0.0]},
        {"controller_*.stiffness": 60.0, "arm_l.gravity": [1.0, 0.0, -9.0]},
    )
    assert np.abs(found[0].signals["operator.f[1]"]).max() > 1.0
    assert np.abs(found[0].signals["arm_r.tau_motor[3]"]).max() > 1.0


EFFECTS = [
    {},
    {"stribeck": 0.4, "stribeck_velocity": 0.05, "stribeck_exponent": 1, "coulomb": 0.2, "coulomb_form": 1},
    {"hysteresis": 0.3, "hysteresis_length": 0.02, "stribeck": 0.2, "coulomb": 0.2, "torque_gain": 0.1},
    {"hysteresis": 0.3, "hysteresis_ratio": 3.0, "hysteresis_tilt": 0.4, "torque_deadband": 0.02},
    {"hysteresis": 0.2, "hysteresis_exponent": 0.7, "quadratic_drag": 0.1, "viscous_asymmetry": 0.1},
    {"position_torque_sin": 0.3, "position_friction_cos": 0.1, "coulomb": 0.1, "torque_offset": 0.05},
    {"position_torque": 1.0, "position_torque_quadratic": 0.2, "position_torque_cubic": -0.3, "ripple_sin": 0.1},
    {"load_friction": 0.05, "coulomb_asymmetry": 0.1, "friction_drift": 0.5, "friction_drift_time": 1.0},
    {"stop_stiffness": 50.0, "stop_damping": 0.5, "stop_angle": 0.05, "coulomb": 0.1, "coulomb_form": 2},
    {"torque_saturation": [40.0, 40.0, 5.0], "stribeck": 0.2},
    {"coupling_viscous[1]": 0.3, "coupling_coulomb[1]": 0.2, "coulomb": 0.1, "coupling_velocity[1]": 0.1},
    {"coupling_stiffness[2]": 2.0, "coupling_coulomb[2]": 0.2, "coulomb": 0.2},
]
EFFECTS += [
    {"actuator_lag": [0.01, 0.0, 0.02], "coulomb": 0.1, "coupling_stiffness[1]": 0.2},
    {"joint_compliance": [2e-4, 0.0, 1e-6], "joint_damping": 0.5, "torque_saturation": 30.0},
    {"backlash": [2e-3, 0.0, 0.0], "motor_inertia": [0.05, 0.0, 0.0], "encoder_resolution": 1e-3},
    {"encoder_offset": [0.01, -0.02, 0.001], "encoder_resolution": [0.0, 1e-3, 0.0], "viscous": 0.2},
]
"""Those of elastic and late joints, and encoders."""
COUPLED = {"coupling_on": [1, 3, 0], "coupling_from": [2, 1, 0]}


def test_effects_of_each_joint_in_lanes_of_their_own(handed):
    """Coupled arms, whose lanes go together, beside others."""
    lanes = [each(effect | (COUPLED if "coupling" in "".join(effect) else {})) for effect in EFFECTS]
    found = same(handed, 0.4, *lanes)
    assert len({result.signals["arm_r.q[2]"][-1] for result in found}) == len(EFFECTS)


def test_rows_that_are_not_used_stay_as_they_are(tmp_path):
    """Arms whose FMU has room for twelve joints, of which it has one."""
    path = tmp_path / "room.toml"
    path.write_text(
        'format = 1\ntitle = "t"\ndescription = "d"\nconnections = ["arm.q -> own.q", "arm.dq -> own.dq", '
        '"own.tau -> arm.tau"]\n[experiment]\nstop = 0.1\nstep = 0.001\n[components.arm]\nmodel = "SerialArm"\n'
        '[components.own]\nmodel = "ArmController"\n'
    )
    starts = [[0.1 * i * (-1) ** i for i in range(12)], [-0.0] * 12]
    found = same(str(path), 0.1, *({"arm.q_start": q} for q in starts), record=["arm.q", "arm.dq", "own.tau"])
    assert np.all(found[0].signals["arm.q[12]"] == starts[0][11])


def test_a_sweep_runs_it_and_leaves_no_motor_at_its_limit_out_of_account():
    """The verdicts of the FMUs; with a level a run ends before its time, but not on what came after a limit was met."""
    task = Task(EVALUATORS["simulation"], "panda", {"experiment.stop": 3.0, "operator.amplitude": [0.0, 10.0, 0.0]})
    points = [Point((), (("arm_l.torque_saturation[1]", limit),)) for limit in (20.0, 2.0)]
    assert check(task, points[0]).startswith("batch kernel")
    assert "arm_r.saturated" in _signals(setup(task, points[0]).wiring)
    whole, early = simulation(task, points), simulation(evolve(task, sign_level=0.95), points)
    for ours, theirs in zip(whole, cosimulation(task, points), strict=True):
        assert evolve(ours, numbers=theirs.numbers) == theirs
    assert [found.numbers["simulated_time"] < 3.0 for found in early] == [True, False]
    assert evolve(early[1], numbers=whole[1].numbers) == whole[1]


NO_INERTIA = {f"arm_l.inertia_{k}[7]": 0.0 for k in ("xx", "xy", "xz", "yy", "yz", "zz")}
NO_INERTIA |= {"arm_l.mass[7]": 0.0, "arm_l.rotor_inertia[7]": 0.0}


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("panda", NO_INERTIA, "M(q_start) is not positive definite"),
        ("panda", {"arm_r.stiffness": 1e9}, "stiffness and damping are too fast"),
        ("panda", {"arm_r.actuator_lag[2]": 1e-5}, "actuator_lag[2] = 1e-05 s is too short"),
        ("panda", {"arm_l.joint_compliance[1]": 1e-9}, "is too stiff for the internal step"),
        ("sallam-stable", {"arm_l.pi[1]": -0.1}, "M(q_start) is not positive definite"),
        ("sallam-stable", {"arm_r.damping": 1e4}, "stiffness and damping are too fast"),
    ],
)
def test_what_an_fmu_refuses_at_its_start_it_says_itself(name, values, words):
    """A point among others that the kernel runs: it fails with the words of the FMU, the others do not."""
    points = [Point((), tuple(values.items())), Point((), ())]
    task = Task(EVALUATORS["simulation"], name, {"experiment.stop": 0.5})
    found = {p.key: results[k] for ps, results in Here().answers(task, points, 2) for k, p in enumerate(ps)}
    assert words in found[points[0].key].message and found[points[0].key].outcome == "failed"
    assert found[points[1].key].outcome != "failed"


def test_an_impedance_inside_the_device_of_a_serial_arm():
    """Beside arms without one."""
    soft = {"arm_r.stiffness": 400.0, "arm_r.damping": 20.0, "arm_r.x_ref": [0.35, 0.0, 0.6]}
    same("phantom-panda", 0.2, {}, soft, soft | {"arm_r.coulomb": 0.2, "arm_r.stiffness[2]": 0.0})


REFUSED = {
    "arm_r: its time_delay[1] is 0.01": {"arm_r.time_delay[1]": 0.01},
    "arm_l: one of its axes has no direction": {"arm_l.axis_z[2]": 0.0},
    "arm_r: one of its couplings is not of two joints": {"arm_r.coupling_on[1]": 2, "arm_r.coupling_from[1]": 2},
    "arm_r: its contact_normal is zero": {"arm_r.contact_stiffness": 100.0},
    "channel_lr: its deadband[1] is 0.1": {"channel_lr.deadband[1]": 0.1},
}


def test_refusals_in_words():
    base = load_scenario("panda")
    with open_system(base) as system:
        for words, values in REFUSED.items():
            found = lane_refusal(system.wiring(base.with_values(values)), RECORD[:2])
            assert found is not None and re.fullmatch(re.escape(words), found)
