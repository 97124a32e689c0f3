"""Every controller of ours in the batch kernel: the bits of the FMUs lane by lane."""

import tomllib

import pytest
from attrs import evolve

from cosim.fmu import open_system
from cosim.scenario import load_scenario
from cosim.sweeps.evaluate import _batch_key
from cosim.sweeps.lane_refusal import lane_refusal
from tests.support.paths import ROOT
from tests.sweeps.test_kernel_arms import same

CHOICES = {
    choice["label"]: choice["set"]
    for choice in tomllib.loads((ROOT / "cosim/sweeps/shipped/controllers.toml").read_text())["axes"][0]["choices"]
}
"""The controllers of the shipped sweep, each with the values of its paper's rule."""
SURROUNDINGS = [
    {"channel_*.law": "recorded", "controller_*.damping": 0.0},
    {"arm_r.contact_stiffness": 0.0, "arm_r.contact_damping": 0.0, "arm_l.dq_start": [0.1, -0.2, 0.1]},
    {"channel_*.law": "uniform", "channel_*.delay_max": 0.05, "channel_*.semantics": "newest_packet"},
    {"controller_*.damping": 0.1, "arm_r.contact_stiffness": 3000.0, "operator.reference[1]": 0.08},
]


def recorded(name):
    """All outputs of the controllers, and what the arms and channels do."""
    components = load_scenario(name).components
    outputs = ["f", "tau", "sent", "energy", "tank", "spent", "depth", "dissipated", "limited", "saturated"]
    control = [f"{c}.{output}" for c in components if c.startswith("controller") for output in outputs]
    return control + [f"{c}.{output}" for c in components for output in ("q", "dq", "y") if c[:4] != "cont"]


@pytest.mark.parametrize("label", CHOICES)
def test_controllers_of_the_field(label):
    """A hand, packets, a wall; with dampers, delays and walls of their own in every lane."""
    swapped = {"controller_l.side": "remote", "controller_r.side": "local"}
    others = [*SURROUNDINGS, swapped] if "controller_l.side" in CHOICES[label] else SURROUNDINGS
    lanes = [CHOICES[label] | more for more in others]
    found = same("controllers", 0.6, *lanes, record=[*recorded("controllers"), "arm_r.f_contact"])
    assert len({result.signals["arm_l.q[2]"].tobytes() for result in found}) == len(lanes)


def test_inverse_dynamics():
    """Beside other gains, torques at their limit, an arm that hangs, friction of the model."""
    hanging = {f"{name}_piecewise.mounting": "upside_down" for name in ("arm", "controller")}
    same(
        "inverse-dynamics",
        0.3,
        {},
        {"controller*.proportional_gain": 1200.0, "controller*.derivative_gain": 80.0, "controller.torque_limit": 0.1},
        hanging | {"arm_piecewise.parameter_set": "piecewise", "controller.coulomb": 0.02},
        record=recorded("inverse-dynamics"),
    )


PD = """
format = 1
title = "A PD controller holds an arm that a hand pushes"
description = "Sampled, with differences of angles for a velocity."
connections = [
    "operator.f -> arm.f", "excitation.q_ref -> controller.q_ref", "excitation.dq_ref -> controller.dq_ref",
    "arm.q -> controller.q", "arm.dq -> controller.dq", "controller.tau -> arm.tau",
]
[experiment]
stop = 0.3
step = 0.001
extrapolation = "hold"
[components.operator]
model = "Operator"
parameters = { amplitude = [1.0, 0.6, 0.8], frequency = 2.0 }
[components.arm]
model = "PhantomArm"
parameter_set = "FS"
parameters = { q_start = [0.0, 0.4, 0.8] }
[components.controller]
model = "PDController"
parameters = { kp = 8.0, kd = 0.1, difference_samples = 8 }
[components.excitation]
model = "Excitation"
parameters = { centre = [0.0, 0.4, 0.8], square_amplitude = [0.05, 0.0, 0.05], square_period = 0.1 }
"""


def test_pd_control(tmp_path):
    """Velocities measured, differenced and filtered beside each other, late and limited commands."""
    path = tmp_path / "pd.toml"
    path.write_text(PD)
    same(
        str(path),
        0.3,
        {},
        {"controller.velocity": "input", "controller.tau_ff": 0.01},
        {"controller.velocity_cutoff": 30.0, "controller.torque_limit": [0.05, 0.1, 0.0]},
        {"controller.delay_samples": 3, "controller.command_scale": 0.9, "controller.difference_samples": 4},
        record=recorded(str(path)),
    )


def test_a_loop_that_closes_without_delay_at_the_start():
    """What the outputs are then depends on how often they are passed on to the inputs."""
    waves = {"controller_*.model": "WaveController", "controller_*.impedance": 1.0, "arm_l.dq_start": [1e-6, 8e-7, 0.0]}
    same("controllers", 0.05, waves, waves | {"controller_*.impedance": 2.0}, record=recorded("controllers"))


def test_packets_that_arrive_after_the_end_of_the_run():
    late = {"channel_*.law": "constant", "channel_*.delay_mean": 1.0, "channel_*.semantics": "newest_packet"}
    found = same("sallam-stable", 0.3, late, late | {"channel_*.delay_mean": 0.1}, record=["arm_l.q", "channel_lr.y"])
    assert not found[0].signals["channel_lr.y[1]"][2:].any() and found[1].signals["channel_lr.y[1]"].any()


def test_points_with_other_connections_are_no_lanes_of_one_call():
    """As arms of other numbers of joints have; lanes are laid out as the first of them."""
    scenario = load_scenario("panda")
    with open_system(scenario) as system:
        wiring = system.wiring(scenario)
    assert _batch_key(evolve(wiring, links=(*wiring.links,))) == _batch_key(wiring)
    assert _batch_key(evolve(wiring, links=wiring.links[:-1])) != _batch_key(wiring)


def test_a_recorded_delay_that_a_channel_cannot_hold_is_left_to_the_channel():
    values = {"experiment.stop": 9.0, "channel_*.law": "recorded", "channel_*.delay": 9.0}
    scenario = load_scenario("sallam-stable").with_values(values)
    with open_system(scenario) as system:
        assert "does not fit its buffer" in (lane_refusal(system.wiring(scenario), ["arm_l.q"]) or "")
