"""Elastic joints, backlash and lag: the link's simulation against scipy's integrator, and effects of the FMU found in
its recording.

The FMU has two masses of its own (fmu_src/PhantomArm); the tool sees a rigid arm's recording and simulates what its
link did behind the encoder. Size, motor's inertia and damping have to come back.
"""

import ctypes
from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from build_fmus.library import library_path, vectors
from cosim.closure.closure import Options, close_loop
from cosim.closure.score.screen import Screen
from cosim.effects import library
from cosim.effects.transmission import behind
from cosim.engine.master import run
from cosim.fmu import open_system
from cosim.measured import AxisDevice, Label, Recording, RecordingDescription, Run
from cosim.scenario import load_scenario


def simulated(h, along, lanes):
    """twist, transmitted (n, lanes) of links with lanes of the numbers of fmu_src/link/link.c."""
    n, lanes = len(along[0]), np.array(lanes, float)
    twist, transmitted = np.empty((2, n, len(lanes)))
    address = [
        x.ctypes.data_as(ctypes.c_void_p) for x in (*map(np.ascontiguousarray, along), lanes, twist, transmitted)
    ]
    ctypes.CDLL(str(library_path("link", vectors()[1]))).links_behind(n, ctypes.c_double(h), len(lanes), *address)
    return twist, transmitted


@pytest.mark.parametrize("gap", [0.0, 0.02])
def test_the_link_follows_its_differential_equation(gap):
    h, n, stiffness, damping = 1e-3, 3000, 6.0, 0.012
    time = np.arange(n) * h
    mass, drag = 2e-3 * (1 + 0.3 * np.sin(2 * time)), 1e-3 * np.cos(3 * time)
    spring, torque = 0.1 * np.sin(time), 0.05 * np.sin(7 * time) + 0.01
    motor, acceleration = 5e-4, 0.3 * np.cos(5 * time)
    start = torque[0] / stiffness + gap / 2
    lane = (motor, 1e-6, 1.0, stiffness, damping, gap, start, 0.0, 20)
    other = (0.0, 1e-6, 0.0, 2 * stiffness, damping, 0.0, 0.01, 0.0, 5)
    twists, contacts = simulated(
        h, (mass + motor, drag, spring, torque + motor * acceleration, acceleration), [other, lane, other]
    )
    twist, transmitted = twists[:, 1], contacts[:, 1]

    def contact(t, rate):
        beyond = t - np.clip(t, -gap / 2, gap / 2)
        return stiffness * beyond + damping * rate * (beyond != 0 or gap == 0)

    def rates(now, x):
        m, d, k, u = (np.interp(now, time, y) for y in (mass, drag, spring, torque))
        return x[1], (u - d * x[1] - k * x[0] - contact(*x)) / m

    found = solve_ivp(rates, (0, time[-1]), (start, 0.0), t_eval=time, rtol=1e-9, atol=1e-12, max_step=h)
    assert np.abs(twist - found.y[0]).max() < 0.01 * np.abs(found.y[0]).max()
    expected = [contact(*x) for x in found.y.T]
    assert np.abs(transmitted - expected).max() < 0.02 * np.abs(expected).max()


def test_a_link_has_the_same_bits_alone_and_beside_links_of_more_steps():
    h, n = 2e-3, 2000
    time = np.arange(n) * h
    along = (
        3e-3 + 1e-3 * np.sin(time),
        1e-4 * np.cos(time),
        0.01 * np.sin(time),
        0.05 * np.sin(7 * time),
        0.3 * np.cos(5 * time),
    )
    lanes = [(5e-4, 1e-4, 1.0, 4.0 + k, 0.01, 0.01 * (k % 3), 0.001 * k, 0.0, 1.0 + 3 * k) for k in range(11)]
    together = simulated(h, along, lanes)
    for k, lane in enumerate(lanes):
        assert all(
            np.array_equal(both[:, k], one[:, 0])
            for both, one in zip(together, simulated(h, along, [lane]), strict=True)
        )


def test_noise_of_the_encoder_is_no_elastic_joint():
    """A link's lag smooths the noise in the acceleration: it left less than the sensors do and was named on a rigid
    axis.
    """
    random, time = np.random.default_rng(0), np.arange(0, 12, 0.002)
    speeds, sizes = np.array([2.0, 5.1, 11.0]), np.array([1.2, 0.4, 0.03])
    phase = np.outer(time, speeds) + random.uniform(0, 6, 3)
    q, dq, ddq = np.sin(phase) @ sizes, np.cos(phase) @ (sizes * speeds), -np.sin(phase) @ (sizes * speeds**2)
    tau = (
        0.05 * ddq + 0.3 * np.sin(q) + 0.04 * dq + 0.1 * np.tanh(dq / 0.02) + 0.004 * random.standard_normal(len(time))
    )
    seen = q + 1e-5 * random.standard_normal(len(time))
    run = Run("rigid", time, seen[:, None], tau[:, None], np.arange(len(time)) >= len(time) // 2)
    found = close_loop(Recording(RecordingDescription(AxisDevice(pendulum=True)), (run,)), Options(replayed=False))
    assert found.verdict.answer.value == "model_complete"


@lru_cache
def closed(name: str, runs: int = 1):
    """What close-loop says of 40 s of the identification experiment on an arm with hidden parameters, cut into runs."""
    changes = {"experiment.stop": 40.0} | {f"arm.{k}": v for k, v in HIDDEN[name].items()}
    scenario = load_scenario("identification").with_values(changes)
    with open_system(scenario) as system:
        result = run(scenario, system)
    time = np.asarray(result.time)
    held = np.arange(len(time)) >= len(time) // 2
    parts = [
        Run(f"arm{k}", *(x[rows] for x in (time, result.vector("arm.q"), result.vector("controller.tau"), held)))
        for k, rows in enumerate(np.array_split(np.arange(len(time)), runs))
    ]
    return close_loop(Recording(RecordingDescription(), tuple(parts)), Options(replayed=False))


HIDDEN = {
    "joint_elasticity": {
        Label("joint_compliance", 1): 0.15,
        Label("motor_inertia", 1): 1e-3,
        Label("joint_damping", 1): 6e-3,
    },
    "backlash": {Label("backlash", 1): 0.01},
    "actuator_lag": {Label("actuator_lag", 2): 0.02},
}


@pytest.mark.parametrize("name", list(HIDDEN))
def test_an_effect_between_command_and_link_comes_back_from_the_fmus_recording(name):
    found = closed(name)
    assert [f.name for f in found.verdict.findings] == [name]
    finding, joint = found.verdict.findings[0], next(iter(HIDDEN[name])).index
    assert finding.joints == (joint,)
    assert found.error.after[joint - 1] < 0.5 * found.error.before[joint - 1]
    for label, truth in HIDDEN[name].items():
        if label.name != "joint_damping":  # the encoder's noise at the resonance damps
            low, high = finding.interval[label]
            assert low <= truth <= high, (label, truth, low, high)
            assert finding.parameters[label] == pytest.approx(truth, rel=0.15)


def test_an_elastic_joint_is_named_from_runs_that_start_in_motion():
    whole, cut = (found.verdict.findings for found in (closed("joint_elasticity"), closed("joint_elasticity", 4)))
    assert [f.name for f in cut] == ["joint_elasticity"]
    label = Label("joint_compliance", 1)
    assert cut[0].parameters[label] == pytest.approx(whole[0].parameters[label], rel=0.05)


def test_a_heavily_damped_link_stays_stable():
    model = closed("joint_elasticity").before
    column = behind(model.scene, 0, ((100.0, 6.0, 0.9),))[0][0]
    # c t' + k t = torque: heavily damped, it follows with a time constant 2 z / w; what the column holds is that
    # filter's error
    assert 0 < np.std(column[:, 0]) < 2 * np.std(model.scene.rigid[:, 0])


def test_a_link_that_gravity_pulls_off_its_spring_is_no_column():
    model = closed("actuator_lag").before
    columns = behind(model.scene, 2, ((0.5, 0.01, 0.9),))[0]
    assert all(np.isfinite(x).all() for x in columns.values())
    screen = Screen(model, robust=False)
    assert screen.added({1: np.full((len(screen.fitted), 1), np.nan)}, library()[0]) is None
