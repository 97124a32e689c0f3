"""One joint: motion against scipy with every effect at once, conservation, and the units of a prismatic axis."""

import tomllib

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from tests.support.model_harness import SOURCES, CompiledModel

RIG = {
    "inertia": 0.8,
    "gravity_sin": 3.0,
    "gravity_cos": 0.5,
    "viscous": 0.4,
    "coulomb": 0.3,
    "coulomb_velocity": 0.2,
    "coulomb_form": 1.0,
    "stribeck": 0.2,
    "stribeck_velocity": 0.5,
    "coulomb_asymmetry": 0.05,
    "viscous_asymmetry": 0.03,
    "torque_offset": 0.1,
    "load_friction": 0.04,
    "position_friction_sin": 0.02,
    "position_friction_cos": 0.03,
    "position_torque": 0.2,
    "position_torque_quadratic": -0.1,
    "position_torque_cubic": 0.05,
    "position_torque_sin": 0.04,
    "position_torque_cos": -0.06,
    "ripple_sin": 0.05,
    "ripple_cos": 0.02,
    "ripple_order": 7.0,
    "hysteresis": 0.2,
    "hysteresis_length": 0.05,
    "hysteresis_exponent": 0.7,
    "quadratic_drag": 0.02,
    "friction_drift": 0.1,
    "friction_drift_time": 1.5,
    "torque_gain": 0.05,
    "actuator_lag": 0.02,
    "coupling_viscous": 0.3,
    "coupling_coulomb": 0.1,
    "coupling_velocity": 0.4,
    "coupling_stiffness": 0.2,
}


def torque(t: float) -> float:
    return 4.0 * np.sin(3.0 * t) + 2.0


def other(t: float) -> tuple[float, float]:
    return 0.5 * np.sin(2 * t), np.cos(2 * t)


def rig_rate(p: dict, h: float):
    """State (q, dq, z, lagged torque); inputs held over steps of h."""

    def sign(v):
        return np.tanh(v / p["coulomb_velocity"])

    def rate(t, s):
        q, v, z, tau = s
        held = np.floor(t / h + 1e-9) * h
        warmth = p["friction_drift_time"] * (1 - np.exp(-t / p["friction_drift_time"]))
        friction = (p["viscous"] * v + p["coulomb"] * sign(v)) * (1 + p["friction_drift"] * warmth)
        friction += (
            p["stribeck"] * np.exp(-((v / p["stribeck_velocity"]) ** 2)) * sign(v)
            + p["coulomb_asymmetry"] * sign(v) ** 2
        )
        friction += (
            p["viscous_asymmetry"] * abs(v) + p["quadratic_drag"] * v * abs(v) + p["load_friction"] * abs(tau) * sign(v)
        )
        friction += p["hysteresis"] * z + (
            p["position_friction_sin"] * np.sin(q) + p["position_friction_cos"] * np.cos(q)
        ) * sign(v)
        required = (
            p["torque_offset"]
            + p["position_torque"] * q
            + p["position_torque_quadratic"] * q**2
            + p["position_torque_cubic"] * q**3
        )
        required += p["position_torque_sin"] * np.sin(q) + p["position_torque_cos"] * np.cos(q)
        required += p["ripple_sin"] * np.sin(p["ripple_order"] * q) + p["ripple_cos"] * np.cos(p["ripple_order"] * q)
        q2, v2 = other(held)
        required += (
            p["coupling_viscous"] * v2
            + p["coupling_coulomb"] * v2 / np.hypot(v2, p["coupling_velocity"])
            + p["coupling_stiffness"] * q2
        )
        gravity = p["gravity_sin"] * np.sin(q) + p["gravity_cos"] * np.cos(q)
        command = (1 + p["torque_gain"]) * torque(held)
        return [
            v,
            (tau - friction - required - gravity) / p["inertia"],
            v * max(1 - z * np.sign(v), 0.0) ** p["hysteresis_exponent"] / p["hysteresis_length"],
            (command - tau) / p["actuator_lag"],
        ]

    return rate


def test_all_effects_together_against_scipy():
    h, n = 5e-3, 400
    t = np.arange(n) * h
    m = CompiledModel("AxisDrive", q_start=0.3, dq_start=-0.5, internal_steps=20, **RIG)
    m["tau"] = torque(0.0)
    q2, v2 = other(t)
    end = m.start().run(n, h, {"tau": torque(t), "q_other": q2, "dq_other": v2}, ("q", "dq", "z", "tau_motor"))
    state, rate = [0.3, -0.5, 0.0, 1.05 * torque(0.0)], rig_rate(RIG, h)
    for k in range(n):  # step by step: the held inputs jump there

        def inside(s, y, k=k):
            return rate(min(max(s, k * h), (k + 0.999999) * h), y)

        state = solve_ivp(inside, (k * h, (k + 1) * h), state, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    found = [end[name][-1, 0] for name in ("q", "dq", "z", "tau_motor")]
    # RK4 at 0.25 ms on rates up to 50 1/s: 2e-10; |dq| and |z| kinks at reversals are second order in the step: 1e-6
    assert np.abs(np.array(found) - state).max() < 2e-6


KNOTS = np.linspace(-0.4, 0.5, 10)
TABLES = [0.3, -0.2, 0.5, 0.1, 0.0, -0.4, 0.2, 0.2, -0.1, 0.6], [0.1, 0.0, -0.2, 0.3, 0.1, 0.2, -0.1, 0.0, 0.4, 0.2]
"""Values of a torque over the angle, and of a Coulomb level over it, at the knots [N.m]."""


def table(values):
    """The cubic that scipy puts through them: slopes by central differences, level at both ends and beyond."""
    slopes = np.gradient(values, KNOTS)
    slopes[[0, -1]] = 0.0
    curve = CubicHermiteSpline(KNOTS, values, slopes)
    return lambda q: curve(np.clip(q, KNOTS[0], KNOTS[-1]))


def with_table(**values) -> dict:
    arrays = dict(zip(("nameless_torque", "nameless_friction"), TABLES, strict=True))
    return {"nameless_from": KNOTS[0], "nameless_to": KNOTS[-1], **arrays, **values}


def test_the_nameless_torque_is_the_cubic_through_its_knots():
    """At the knots, between them, and constant beyond: read off the acceleration of an axis of unit inertia."""
    g, c = map(table, TABLES)
    for q in (*KNOTS, -0.7, -0.4 + 1e-9, -0.23, 0.031, 0.4999999, 0.9):
        m = CompiledModel("AxisDrive", q_start=q, dq_start=0.3, **with_table(coulomb_velocity=0.2)).start()
        m.rates()
        assert m["ddq"][0] == pytest.approx(-g(q) - c(q) * 0.3 / np.hypot(0.3, 0.2), abs=1e-15)


def test_motion_with_a_nameless_torque_against_scipy():
    """Out of the table on both sides and back. RK4 at 1 ms across knots, where the second derivative jumps: 1e-8."""
    g, c = map(table, TABLES)

    def rate(t, s):
        q, v = s
        return [v, 0.2 - g(q) - c(q) * v / np.hypot(v, 0.2) - 0.1 * v - 2.0 * q]

    given = with_table(viscous=0.1, position_torque=2.0, coulomb_velocity=0.2, internal_steps=5)
    run = CompiledModel("AxisDrive", q_start=0.9, **given).start().run(800, 5e-3, {"tau": 0.2}, ("q",))
    times = np.arange(1, 801) * 5e-3
    exact = solve_ivp(rate, (0, 4), [0.9, 0.0], "DOP853", times, rtol=1e-11, atol=1e-13, max_step=0.01)
    assert exact.y[0].min() < KNOTS[0] and exact.y[0].max() > KNOTS[-1]
    assert np.abs(run["q"][:, 0] - exact.y[0]).max() < 1e-8


@pytest.mark.parametrize("ends", [(0.0, 0.0), (0.5, -0.4)])
def test_a_table_without_a_width_is_absent_to_the_bit(ends):
    given = with_table(nameless_from=ends[0], nameless_to=ends[1], **RIG)
    with_it, without = (CompiledModel("AxisDrive", q_start=0.3, **x).start() for x in (given, RIG))
    a, b = (m.run(200, 5e-3, {"tau": 1.0}, ("q", "dq")) for m in (with_it, without))
    assert (a["q"] == b["q"]).all() and (a["dq"] == b["dq"]).all()


def test_pendulum_keeps_its_energy():
    m = CompiledModel("AxisDrive", inertia=0.05, gravity_sin=1.5, q_start=2.0, internal_steps=4).start()
    run = m.run(5000, 1e-3, watch=("q", "dq"))
    energy = 0.025 * run["dq"] ** 2 - 1.5 * np.cos(run["q"])
    assert np.abs(energy - energy[0]).max() < 1e-8 * 1.5


def test_elastic_axis_has_the_two_mass_frequencies():
    """Free-free two-mass: w = sqrt(k (1/Jm + 1/Jl)); a torque input excites it; frequency from the relative motion."""
    inertia, motor, compliance = 1.0, 0.3, 1e-3
    m = CompiledModel(
        "AxisDrive", inertia=inertia, motor_inertia=motor, joint_compliance=compliance, internal_steps=20
    ).start()
    run = m.run(2000, 1e-3, {"tau": 1.0}, ("q_link", "q_motor"))
    stretch = (run["q_motor"] - run["q_link"])[:, 0]
    w = np.sqrt(1 / compliance * (1 / motor + 1 / (inertia - motor)))
    t = np.arange(1, 2001) * 1e-3
    exact = (
        compliance * (inertia - motor) / inertia * (1 - np.cos(w * t))
    )  # constant acceleration 1/inertia, at rest at t = 0
    assert np.abs(stretch - exact).max() < 1e-6 * compliance * w * 2  # phase error w^5 h^4 t / 120
    assert run["q_link"][-1, 0] == pytest.approx(0.5 * 4 / inertia, abs=2 * compliance)


def test_external_torque_and_command_are_worth_the_same():
    t = np.arange(200) * 1e-3
    a = CompiledModel("AxisDrive", **{k: v for k, v in RIG.items() if k in ("inertia", "viscous", "coulomb")}).start()
    b = CompiledModel("AxisDrive", **{k: v for k, v in RIG.items() if k in ("inertia", "viscous", "coulomb")}).start()
    x, y = a.run(200, 1e-3, {"tau": torque(t)}, ("q",)), b.run(200, 1e-3, {"f": torque(t)}, ("q",))
    assert np.abs(x["q"] - y["q"]).max() < 1e-14


def test_whole_step_delay_limits_and_deadband():
    u = 3.0 * np.random.default_rng(1).standard_normal(300)
    late = CompiledModel(
        "AxisDrive", time_delay=8e-3, torque_saturation=2.0, torque_deadband=0.5, torque_gain=0.1
    ).start()
    now = CompiledModel("AxisDrive").start()
    shifted = np.concatenate([np.full(8, u[0]), u[:-8]]) * 1.1
    delivered = np.clip(shifted - np.clip(shifted, -0.5, 0.5), -2, 2)
    a, b = late.run(300, 1e-3, {"tau": u}, ("q", "saturated")), now.run(300, 1e-3, {"tau": delivered}, ("q",))
    assert np.abs(a["q"] - b["q"]).max() < 1e-15 and 0 < a["saturated"].mean() < 1


def test_runaway_is_frozen_not_infinite():
    m = CompiledModel("AxisDrive", inertia=1e-3, position_torque=-1e6, q_start=1e-3).start()
    run = m.run(2000, 1e-3, watch=("q", "dq", "domain"))
    assert np.isfinite(run["q"]).all() and run["domain"][-1] == 0 and np.abs(run["q"]).max() < 1e6


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"joint_compliance": 0.1, "motor_inertia": 2.0}, ["motor_inertia = 2", "(0, 1)"]),
        ({"backlash": 0.1, "motor_inertia": 1.0}, ["motor_inertia = 1", "(0, 1)"]),
    ],
)
def test_impossible_parameters(parameters, words):
    with pytest.raises(ValueError) as problem:
        CompiledModel("AxisDrive", **parameters).start()
    assert all(word in str(problem.value) for word in words)


def test_the_joint_table_and_its_c_list_agree():
    header = (SOURCES / "shared" / "joint.h").read_text()
    listed = header.split("#define JOINT_PARAMETERS(F)")[1].split("/* clang-format on")[0]
    names = [v["name"] for v in tomllib.loads((SOURCES / "shared" / "joint.toml").read_text())["variable"]]
    assert [word[2:-1] for word in listed.replace("\\", " ").split()] == names
