"""The arm's rigid body in C against energies, finite identities, scipy, and itself at another step."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import tests.support.arm_oracle as oracle
from tests.support.model_harness import CompiledModel

RANDOM_STATES = 200
USD = [1.20e-3, 1.61e-3, -0.51e-3, 0.65e-3, 2.85e-3, 1.28e-3, 21.24e-3, 108.75e-3]  # Taati's Table 1, column USD


def accelerations(m: CompiledModel, q, dq, **inputs) -> np.ndarray:
    """ddq that the C plant gives at one state."""
    m["q_link"], m["dq_link"] = q, dq
    m["q_motor"], m["dq_motor"] = q, dq
    for name, value in inputs.items():
        m[name] = value
    m.rates(0.0)
    return m["ddq"]


def states(seed: int):
    random = np.random.default_rng(seed)
    for _ in range(RANDOM_STATES):
        yield (
            oracle.random_pose(random),
            random.uniform(-5, 5, 3),
            random.uniform(-0.3, 0.3, 3),
            random.uniform(-3, 3, 3),
        )


def test_default_parameters_are_the_segment_set():
    # printed with ten decimals of 1e-3, so half a unit of 1e-13
    assert np.abs(CompiledModel("PhantomArm")["pi"] - oracle.PI).max() < 1e-13


def test_accelerations_follow_from_the_energies():
    m = CompiledModel("PhantomArm").start()
    for q, dq, tau, f in states(1):
        expected = oracle.acceleration(q, dq, tau, f)
        # condition of M (about 10) times rounding of the terms before they cancel
        size = np.abs(np.linalg.inv(oracle.mass(q))).max() * (np.abs(oracle.bias(q, dq)).max() + 1.0)
        assert np.abs(accelerations(m, q, dq, tau=tau, f=f) - expected).max() < 1e-13 * size


def test_tip_and_its_velocity():
    m = CompiledModel("PhantomArm").start()
    for q, dq, _, _ in states(2):
        m["q_link"], m["dq_link"] = q, dq
        m.show()
        assert np.abs(m["x"] - oracle.position(q)).max() < 1e-15
        assert np.abs(m["dx"] - oracle.jacobian(q) @ dq).max() < 1e-14
        assert (m["x_tip"] == m["x"]).all() and (m["dx_tip"] == m["dx"]).all() and (m["q"] == q).all()


def test_mounting_and_gravity_compensation():
    for mounting, sign in ((1, 1), (2, -1)):
        pi = oracle.PI * np.array([1] * 6 + [sign] * 2)
        free = CompiledModel("PhantomArm", mounting=mounting).start()
        compensated = CompiledModel("PhantomArm", mounting=mounting, gravity_compensation=1).start()
        for q, dq, tau, f in list(states(3))[:50]:
            expected = oracle.acceleration(q, dq, tau, f, pi)
            assert np.allclose(accelerations(free, q, dq, tau=tau, f=f), expected, rtol=1e-12, atol=1e-9)
            rest = accelerations(compensated, q, np.zeros(3), tau=0.0, f=0.0)
            assert np.abs(rest).max() < 1e-12  # N cancels to rounding: 0.07 N m * 1e-16 / 1e-3 kg m2


def test_motion_agrees_with_scipy():
    q, dq = np.array([0.1, 0.3, 0.4]), np.array([1.0, -0.5, 0.8])
    tau, f = np.array([2e-3, -3e-3, 4e-3]), np.array([0.01, -0.02, 0.015])
    m = CompiledModel("PhantomArm", q_start=q, dq_start=dq, internal_steps=8).start()
    end = m.run(1000, 1e-3, {"tau": tau, "f": f}, ("q", "dq"))

    def rate(_, s):
        return np.concatenate([s[3:], oracle.acceleration(s[:3], s[3:], tau, f)])

    exact = solve_ivp(rate, (0, 1), np.concatenate([q, dq]), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    # RK4 at 125 us with motions of 10 rad/s: (h w)^4 = 2e-12 of the amplitude, and scipy's 1e-12
    assert np.abs(end["q"][-1] - exact[:3]).max() < 1e-10
    assert np.abs(end["dq"][-1] - exact[3:]).max() < 1e-9


def test_integration_is_of_fourth_order():
    ends = []
    for internal in (1, 2, 4, 8):
        m = CompiledModel(
            "PhantomArm",
            q_start=[0.1, 0.3, 0.4],
            dq_start=[3.0, -2.0, 4.0],
            viscous=[2e-3] * 3,
            internal_steps=internal,
        )
        ends.append(m.start().run(60, 1 / 150, watch=("q",))["q"][-1])
    differences = [np.abs(a - b).max() for a, b in itertools.pairwise(ends)]
    orders = np.log2(np.array(differences[:-1]) / differences[1:])
    assert np.all(np.abs(orders - 4) < 0.3), orders  # the next term is h times smaller


FREE = np.array([0.2, 0.3, 0.5]), np.array([2.0, 1.0, -2.0])


def test_free_motion_keeps_its_energy():
    q, dq = FREE
    m = CompiledModel("PhantomArm", q_start=q, dq_start=dq, internal_steps=4).start()
    run = m.run(2000, 1e-3, watch=("q", "dq"))
    drift = [oracle.energy(a, b) - oracle.energy(q, dq) for a, b in zip(run["q"], run["dq"], strict=True)]
    assert np.abs(drift).max() < 1e-9


def coriolis(q, dq, sign: float, pi=oracle.PI) -> np.ndarray:
    """C dq with the sign of C32 as a number: -1 is right, +1 is Sallam's print."""
    d2 = -2 * pi[1] * np.sin(2 * q[1]) - pi[3] * np.sin(q[1]) * np.sin(q[2])
    d3 = -2 * pi[2] * np.sin(2 * q[2]) + pi[3] * np.cos(q[1]) * np.cos(q[2])
    k = pi[3] / 2 * np.cos(q[1] - q[2])
    c = [
        [(d2 * dq[1] + d3 * dq[2]) / 2, d2 * dq[0] / 2, d3 * dq[0] / 2],
        [-d2 * dq[0] / 2, 0, k * dq[2]],
        [-d3 * dq[0] / 2, sign * k * dq[1], 0],
    ]
    return np.array(c) @ dq


@pytest.mark.parametrize(("sign", "keeps"), [(-1.0, True), (1.0, False)])
def test_energy_decides_the_sign_of_sallams_c32(sign, keeps):
    q, dq = FREE

    def rate(s):
        gravity = np.array([0, oracle.PI[6] * np.cos(s[1]), oracle.PI[7] * np.sin(s[2])])
        return np.concatenate([s[3:], np.linalg.solve(oracle.mass(s[:3]), -coriolis(s[:3], s[3:], sign) - gravity)])

    end = oracle.rk4(rate, np.concatenate([q, dq]), 5e-4, 4000)
    drift = abs(oracle.energy(end[:3], end[3:]) - oracle.energy(q, dq))
    assert drift < 1e-9 if keeps else drift > 1e-4, drift


def test_friction_and_work_close_the_energy_balance():
    """E(t) - E(0) = work of tau and f - friction's, integrated beside the state by numpy."""
    m = CompiledModel(
        "PhantomArm",
        q_start=[0.1, 0.2, 0.4],
        viscous=[1e-3, 2e-3, 1e-3],
        coulomb=[5e-3] * 3,
        coulomb_velocity=0.1,
        internal_steps=4,
    ).start()
    f, tau = np.array([0.02, 0.05, -0.01]), np.array([0.0, 0.02, 0.07])
    run = m.run(1000, 1e-3, {"tau": tau, "f": f}, ("q", "dq"))
    q, dq = (np.vstack([np.atleast_2d(first), run[n]]) for n, first in (("q", [0.1, 0.2, 0.4]), ("dq", [0.0] * 3)))
    friction = m["viscous"] * dq + m["coulomb"] * dq / np.sqrt(dq**2 + 0.01)
    power = np.array([(tau + oracle.jacobian(a).T @ f - c) @ b for a, b, c in zip(q, dq, friction, strict=True)])
    work = (np.trapezoid if hasattr(np, "trapezoid") else np.trapz)(power, dx=1e-3)  # noqa: NPY201
    gained = oracle.energy(q[-1], dq[-1]) - oracle.energy(q[0], dq[0])
    bound = (
        1e-6 / 12 * np.abs(np.gradient(np.gradient(power, 1e-3), 1e-3)).max() * 2
    )  # trapezoid rule: T h^2/12 max|P''|
    assert abs(gained - work) < bound < 0.01 * abs(work)


def test_in_device_impedance():
    stiffness, damping = np.array([100.0, 150.0, 200.0]), np.array([1.0, 2.0, 3.0])
    m = CompiledModel("PhantomArm", stiffness=stiffness, damping=damping).start()
    for q, dq, tau, _ in list(states(5))[:50]:
        force = stiffness * (np.array([0.01, 0.02, -0.03]) - oracle.position(q)) - damping * (oracle.jacobian(q) @ dq)
        expected = oracle.acceleration(q, dq, tau, force)
        assert np.allclose(accelerations(m, q, dq, tau=tau, x_ref=[0.01, 0.02, -0.03]), expected, rtol=1e-11)


def test_identified_columns_end_the_domain_instead_of_blowing_up():
    m = CompiledModel("PhantomArm", pi=USD, q_start=[0.0, 0.5, 0.5], internal_steps=2).start()
    run = m.run(4000, 1e-3, {"tau": [0.0, 0.03, -0.1]}, ("q", "dq", "domain"))
    left = np.argmin(run["domain"][:, 0])
    assert run["domain"][0] == 1 and run["domain"][left] == 0
    assert np.isfinite(run["q"]).all() and np.isfinite(run["dq"]).all()
    assert (run["domain"][left:] == 0).all() and (run["q"][left:] == run["q"][left]).all()
    assert oracle.mass(run["q"][left], USD)[0, 0] > 0  # the frozen state is the last inside
    assert m.start()["domain"] == 1


def test_workspace_limits_end_the_domain_where_asked():
    limits = {"workspace_limits": 1, "gravity_compensation": 1}
    for q, dq in (([1.5, 0.3, 0.4], [2.0, 0, 0]), ([0, 1.0, 0.0], [0, 3.0, 0]), ([0, 0.0, 0.9], [0, 0, 2.0])):
        free = CompiledModel("PhantomArm", q_start=q, dq_start=dq, gravity_compensation=1).start()
        bound = CompiledModel("PhantomArm", q_start=q, dq_start=dq, **limits).start()
        assert free.run(200, 1e-3, watch=("domain",))["domain"].all()
        run = bound.run(200, 1e-3, watch=("q", "domain"))
        assert run["domain"][0] == 1 and run["domain"][-1] == 0
        q_end = np.degrees(run["q"][-1])
        assert abs(q_end[0]) <= 90 and q_end[1] - q_end[2] <= 65 and q_end[2] - q_end[1] <= 55


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"pi": [1e-3, 1e-3, -1e-3, 1e-3, 1e-3, -1e-3, 0, 0]}, ["pi", "positive definite", "M33 = -0.001"]),
        ({"backlash": [0, 0, 1e-3], "motor_inertia": [0, 0, 1e-3]}, ["motor_inertia[3] = 0.001", "(0, 0.000931886)"]),
        ({"joint_compliance": [0.1] * 3, "motor_inertia": [1e-4, 5e-3, 1e-4]}, ["motor_inertia[2] = 0.005", "(0, "]),
        ({"coulomb_form": [0, 1, 0.5]}, ["coulomb_form[3] = 0.5", "none of 0 (algebraic), 1 (tanh), 2 (atan)"]),
        ({"stribeck_exponent": [2, 1.5, 2]}, ["stribeck_exponent[2] = 1.5", "neither 1 nor 2"]),
        ({"contact_stiffness": 100.0}, ["contact_normal", "contact_stiffness = 100"]),
    ],
)
def test_impossible_parameters_are_named_with_value_and_range(parameters, words):
    with pytest.raises(ValueError) as problem:
        CompiledModel("PhantomArm", **parameters).start()
    assert all(word in str(problem.value) for word in words), problem.value
    assert len(str(problem.value)) < 190  # fits its buffer


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"actuator_lag": [0, 1e-4, 0]}, ["actuator_lag[2] = 0.0001", "0.0005 s", "internal_steps to 11"]),
        (
            {"joint_compliance": [1e-4] * 3, "motor_inertia": [1e-4] * 3},
            ["joint_compliance[1] = 0.0001", "internal_steps"],
        ),
        ({"damping": [90.0] * 3, "internal_steps": 1}, ["damping", "internal step of 0.001 s", "internal_steps to 2"]),
        ({"time_delay": [0, 0, 0.6]}, ["time_delay = 0.6", "512 commands", "0.512 s", "0.001 s"]),
    ],
)
def test_what_the_step_cannot_carry_is_refused(parameters, words):
    with pytest.raises(ValueError) as problem:
        CompiledModel("PhantomArm", gravity_compensation=1, **parameters).start().run(1000, 1e-3)
    assert all(word in str(problem.value) for word in words), problem.value
