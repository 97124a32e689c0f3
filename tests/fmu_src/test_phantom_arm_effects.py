"""Every effect of the arm: its torque against the formula in numpy, and no change of a bit where it is zero."""

import tomllib

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import tests.support.arm_oracle as oracle
from tests.support.contract import EFFECTS
from tests.support.model_harness import SOURCES, CompiledModel

A, B, C = np.array([0.011, -0.007, 0.013]), np.array([0.004, 0.009, -0.006]), np.array([0.3, 0.2, 0.4])
TAU = np.array([0.05, -0.08, 0.03])


def sign(dq, v=0.01):
    return dq / np.sqrt(dq**2 + v**2)


def ddq(parameters: dict, q, dq, t: float = 0.0, z=(0, 0, 0)) -> np.ndarray:
    m = CompiledModel("PhantomArm", **parameters).start()
    m["q_link"] = m["q_motor"] = q
    m["dq_link"] = m["dq_motor"] = dq
    m["z"], m["z_short"], m["z_long"], m["tau"] = z, -np.asarray(z), 0.5 * np.asarray(z), TAU
    m.rates(t)
    return m["ddq"]


def pairs(values, other):
    """Required torque on i from other[j]; values in the order 12, 13, 21, 23, 31, 32."""
    matrix = np.zeros((3, 3))
    matrix[[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]] = values
    return matrix @ other


STOPS = np.array([0.1, 0.5, -9.0])  # rad


def stops(q, v):
    """Stops of the first joint at larger angles, of the second at smaller ones; the third has none."""
    side, stiffness = np.array([1.0, -1.0, 1.0]), np.array([5.0, 6.0, 0.0])
    depth = side * (q - STOPS)
    return side * np.where(
        (depth > 0) & (stiffness > 0), np.maximum(stiffness * depth + np.abs(A) * side * v, 0.0), 0.0
    )


SIX = np.array([1.0, 2, 3, 4, 5, 6]) * 1e-3
REQUIRED = {  # parameters, required torque of (q, dq, t, z)
    "viscous": ({"viscous": A}, lambda q, v, t, z: A * v),
    "coulomb": ({"coulomb": A, "coulomb_velocity": C}, lambda q, v, t, z: A * sign(v, C)),
    "coulomb, forms": (
        {"coulomb": A, "coulomb_velocity": C, "coulomb_form": [0, 1, 2]},
        lambda q, v, t, z: A * np.array([sign(v, C)[0], np.tanh(v / C)[1], 2 / np.pi * np.arctan(v / C)[2]]),
    ),
    "stribeck": ({"stribeck": A, "stribeck_velocity": C}, lambda q, v, t, z: A * np.exp(-((v / C) ** 2)) * sign(v)),
    "stribeck, exponent 1": (
        {"stribeck": A, "stribeck_velocity": C, "stribeck_exponent": 1.0},
        lambda q, v, t, z: A * np.exp(-np.abs(v) / C) * sign(v),
    ),
    "coulomb_asymmetry": ({"coulomb_asymmetry": A}, lambda q, v, t, z: A * sign(v) ** 2),
    "viscous_asymmetry": ({"viscous_asymmetry": A}, lambda q, v, t, z: A * np.abs(v)),
    "torque_offset": ({"torque_offset": A}, lambda q, v, t, z: A),
    "load_friction": ({"load_friction": C}, lambda q, v, t, z: C * np.abs(TAU) * sign(v)),
    "position_friction": (
        {"position_friction_sin": A, "position_friction_cos": B},
        lambda q, v, t, z: (A * np.sin(q) + B * np.cos(q)) * sign(v),
    ),
    "position_torque": (
        {
            "position_torque": A,
            "position_torque_quadratic": B,
            "position_torque_cubic": C,
            "position_torque_sin": B,
            "position_torque_cos": C,
        },
        lambda q, v, t, z: A * q + B * q**2 + C * q**3 + B * np.sin(q) + C * np.cos(q),
    ),
    "external_contact of one joint": (
        {
            "stop_stiffness": [5.0, 6.0, 0.0],
            "stop_damping": np.abs(A),
            "stop_angle": STOPS,
            "stop_side": [1.0, -1.0, 1.0],
        },
        lambda q, v, t, z: stops(q, v),
    ),
    "torque_ripple": (
        {"ripple_sin": A, "ripple_cos": B, "ripple_order": [12, 7.5, 40]},
        lambda q, v, t, z: A * np.sin([12, 7.5, 40] * q) + B * np.cos([12, 7.5, 40] * q),
    ),
    "hysteresis": ({"hysteresis": A}, lambda q, v, t, z: A * z),
    "hysteresis, elements": (
        {"hysteresis": A, "hysteresis_ratio": [2.0, 3.0, 4.0], "hysteresis_tilt": [0.2, -0.4, 1.0]},
        lambda q, v, t, z: A * (-np.array([0.8, 1.4, 0]) + 1 + 0.5 * np.array([1.2, 0.6, 2])) / 3 * z,
    ),
    "quadratic_drag": ({"quadratic_drag": A}, lambda q, v, t, z: A * v * np.abs(v)),
    "friction_drift": (
        {"viscous": A, "coulomb": B, "friction_drift": C},
        lambda q, v, t, z: (A * v + B * sign(v)) * (1 + C * t),
    ),
    "friction_drift that comes to rest": (
        {"viscous": A, "coulomb": B, "friction_drift": C, "friction_drift_time": [40, 3, 0]},
        lambda q, v, t, z: (A * v + B * sign(v)) * (1 + C * [40 * (1 - np.exp(-t / 40)), 3 * (1 - np.exp(-t / 3)), t]),
    ),
    "joint_coupling": (
        {"coupling_viscous": SIX, "coupling_coulomb": 2 * SIX, "coupling_stiffness": 3 * SIX},
        lambda q, v, t, z: pairs(SIX, v) + pairs(2 * SIX, sign(v)) + pairs(3 * SIX, q),
    ),
    "joint_coupling, its own speed": (
        {"coupling_coulomb": SIX, "coupling_velocity": [0.3] * 6},
        lambda q, v, t, z: pairs(SIX, sign(v, 0.3)),
    ),
    "joint_coupling, forms": (
        {"coupling_coulomb": SIX, "coulomb_velocity": C, "coulomb_form": [1, 1, 0]},
        lambda q, v, t, z: pairs(SIX, [*np.tanh(v / C)[:2], sign(v, C)[2]]),
    ),
    "torque_gain": ({"torque_gain": C}, lambda q, v, t, z: -C * TAU),
    "torque_saturation": (
        {"torque_saturation": [0.02, 0.03, 0.5]},
        lambda q, v, t, z: TAU - np.clip(TAU, [-0.02, -0.03, -0.5], [0.02, 0.03, 0.5]),
    ),
    "torque_deadband, larger ones whole": (
        {"torque_threshold": [0.01, 0.02, 0.05]},
        lambda q, v, t, z: np.where(np.abs(TAU) > [0.01, 0.02, 0.05], 0.0, TAU),
    ),
    "torque_deadband": (
        {"torque_deadband": [0.01, 0.02, 0.05]},
        lambda q, v, t, z: np.clip(TAU, [-0.01, -0.02, -0.05], [0.01, 0.02, 0.05]),
    ),
}


@pytest.mark.parametrize("name", REQUIRED)
def test_torque_of_the_effect(name):
    parameters, required = REQUIRED[name]
    random = np.random.default_rng(7)
    for _ in range(20):
        q, dq, t, z = (
            oracle.random_pose(random),
            random.uniform(-1, 1, 3),
            random.uniform(0, 30),
            random.uniform(-1, 1, 3),
        )
        found = oracle.mass(q) @ (ddq({}, q, dq, t, z) - ddq(parameters, q, dq, t, z))
        # accelerations of up to 1e2 rad/s2 carry 1e-14, times inertias of 3e-3
        assert np.abs(found - required(q, dq, t, z)).max() < 1e-14


def test_payload_is_a_mass_at_the_tip():
    random = np.random.default_rng(8)
    for mounting, g in ((1, 9.81), (2, -9.81)):
        pi = oracle.PI * np.array([1] * 6 + [np.sign(g)] * 2)
        for _ in range(20):
            q, dq = oracle.random_pose(random), random.uniform(-2, 2, 3)
            jacobian = oracle.jacobian(q)
            # dJ/dt dq along the motion, by central differences of the complex-step Jacobian: h^2/6 |J'''| dq^3 = 1e-10
            rate = (oracle.jacobian(q + 1e-5 * dq) - oracle.jacobian(q - 1e-5 * dq)) @ dq / 2e-5
            mass = oracle.mass(q, pi) + 0.05 * jacobian.T @ jacobian
            force = TAU - oracle.bias(q, dq, pi) - 0.05 * jacobian.T @ (rate + np.array([0, g, 0]))
            assert np.allclose(
                ddq({"payload": 0.05, "mounting": mounting}, q, dq), np.linalg.solve(mass, force), rtol=1e-7, atol=1e-7
            )


def test_base_tilt_turns_gravity():
    """Against the weights of the four segments at their centres, under gravity turned by scipy."""
    tilt = [0.2, -0.35]
    up = (
        Rotation.from_euler("ZX", [tilt[0], -tilt[1]]).inv().apply([0, 1, 0])
    )  # base turned about z by a, then about its own x by -b
    assert up[0] == pytest.approx(np.sin(tilt[0])) and np.sign(up[2]) == np.sign(tilt[1])

    def potential(q):
        upper = np.array([np.sin(q[0]) * np.cos(q[1]), np.sin(q[1]), np.cos(q[0]) * np.cos(q[1])])
        fore = np.array([np.sin(q[0]) * np.sin(q[2]), -np.cos(q[2]), np.cos(q[0]) * np.sin(q[2])])
        centres = [
            (0.0202, 0.215 * upper + 0.085 * fore),
            (0.0249, 0.1075 * upper + 0.0325 * fore),
            (0.2359, -0.0368 * upper),
            (0.1906, -0.0527 * fore),
        ]
        return 9.81 * sum(mass * (up @ r) for mass, r in centres)

    random = np.random.default_rng(9)
    for _ in range(20):
        q = oracle.random_pose(random)
        torque = oracle.gradient(potential, q)
        assert np.abs(oracle.mass(q) @ ddq({"base_tilt": tilt}, q, np.zeros(3)) - (TAU - torque)).max() < 1e-12


def test_undeclared_wall_pushes_only_inside_and_never_pulls():
    normal, k, c = np.array([0.6, 0.0, 0.8]), 300.0, 5.0
    m = CompiledModel(
        "PhantomArm", contact_stiffness=k, contact_damping=c, contact_normal=2 * normal, contact_distance=0.01
    ).start()
    random, touched = np.random.default_rng(10), 0
    for _ in range(100):
        q, dq = oracle.random_pose(random), random.uniform(-1, 1, 3)
        m["q_link"], m["dq_link"], m["tau"] = q, dq, TAU
        m.rates()
        m.show()
        depth = normal @ oracle.position(q) - 0.01
        push = max(0.0, k * depth + c * normal @ oracle.jacobian(q) @ dq) if depth > 0 else 0.0
        touched += push > 0
        assert np.allclose(m["f_contact"], -push * normal, rtol=1e-12, atol=1e-12)
        assert np.allclose(m["ddq"], oracle.acceleration(q, dq, TAU, -push * normal), rtol=1e-9, atol=1e-9)
    assert 10 < touched < 90


def test_encoders():
    q, resolution, offset = np.array([0.12345678, -0.3, 0.7]), np.array([1.2e-4, 0, 1.4e-4]), np.array([0, 0.01, -0.02])
    m = CompiledModel("PhantomArm", q_start=q, encoder_resolution=resolution, encoder_offset=offset).start()
    assert abs(m["q"][0] / 1.2e-4 - round(q[0] / 1.2e-4)) < 1e-9 and abs(m["q"][0] - q[0]) <= 0.6e-4
    assert m["q"][1] == q[1] + 0.01 and abs(m["q"][2] - 0.68) <= 0.7e-4
    assert np.abs(m["x"] - oracle.position(m["q"])).max() < 1e-15
    assert np.abs(m["x_tip"] - oracle.position(q)).max() < 1e-15


def commands(n: int, seed: int = 11) -> np.ndarray:
    return 0.02 * np.random.default_rng(seed).standard_normal((n, 3))


def test_delay_of_whole_steps_shifts_the_command_to_the_bit():
    u = commands(300)
    delayed = CompiledModel("PhantomArm", gravity_compensation=1, time_delay=[3e-3, 0, 17e-3]).start()
    shifted = CompiledModel("PhantomArm", gravity_compensation=1, torque_saturation=[1e9] * 3).start()
    v = u.copy()
    v[:, 0] = np.concatenate([np.full(3, u[0, 0]), u[:-3, 0]])
    v[:, 2] = np.concatenate([np.full(17, u[0, 2]), u[:-17, 2]])
    a, b = (m.run(300, 1e-3, {"tau": w}, ("q", "dq")) for m, w in ((delayed, u), (shifted, v)))
    assert (a["q"] == b["q"]).all() and (a["dq"] == b["dq"]).all()


def test_delay_of_a_part_of_a_step_keeps_the_impulse():
    """2.4 steps at 1 ms against 24 at 0.1 ms with the same held commands: velocities agree to the step's second
    order."""
    u = commands(200)
    coarse = (
        CompiledModel("PhantomArm", gravity_compensation=1, time_delay=[2.4e-3] * 3)
        .start()
        .run(200, 1e-3, {"tau": u}, ("dq",))
    )
    fine = CompiledModel("PhantomArm", gravity_compensation=1, time_delay=[2.4e-3] * 3).start()
    held = fine.run(2000, 1e-4, {"tau": np.repeat(u, 10, axis=0)}, ("dq",))["dq"][9::10]
    without = CompiledModel("PhantomArm", gravity_compensation=1).start().run(200, 1e-3, {"tau": u}, ("dq",))
    error, size = np.abs(coarse["dq"] - held).max(), np.abs(without["dq"] - held).max()
    # at 1 ms the delayed pulse edges fall inside steps: at t_n the velocities are those of full pulses plus 0.4 of the
    # edge
    # that the mean already holds; what is left is the products of velocity and position within a step
    assert error < 2e-3 * size


def test_commanded_tip_force_is_delayed_with_the_torque():
    f = commands(100) * 10
    now = CompiledModel("PhantomArm", gravity_compensation=1, torque_saturation=[1e9] * 3).start()
    late = CompiledModel("PhantomArm", gravity_compensation=1, time_delay=[4e-3] * 3).start()
    shifted = np.vstack([np.tile(f[0], (4, 1)), f[:-4]])
    a, b = now.run(100, 1e-3, {"f_command": shifted}, ("q",)), late.run(100, 1e-3, {"f_command": f}, ("q",))
    assert (a["q"] == b["q"]).all()
    force = CompiledModel("PhantomArm", gravity_compensation=1).start().run(100, 1e-3, {"f": shifted}, ("q",))
    assert np.abs(force["q"] - a["q"]).max() < 1e-13  # the same J' f, added in another order


def test_lag_follows_its_exponential():
    m = CompiledModel("PhantomArm", gravity_compensation=1, actuator_lag=[0.01, 0.02, 0.0], internal_steps=2).start()
    run = m.run(50, 1e-3, {"tau": [0.01, 0.02, 0.03]}, ("tau_motor",))
    base = np.array([0.0, oracle.PI[6], 0.0])  # N(0) that the start command already holds
    t = np.arange(1, 51)[:, None] * 1e-3
    exact = np.array([0.01, 0.02]) * (1 - np.exp(-t / np.array([0.01, 0.02])))
    moved = np.abs(run["tau_motor"][:, :2] - base[:2] - exact)
    # RK4: (h/T)^5/120 per step, T/h steps: 5e-8 of 0.01; N(q) moves by 1e-4 rad * 0.016
    assert moved.max() < 3e-5 and moved[:5].max() < 1e-6


def two_mass(p: dict):
    """State (q_l, dq_l, q_m, dq_m) of an arm with every joint elastic, in numpy: motors' shares taken out of M."""
    compliance, inertia, damping, gap = (
        np.asarray(p.get(n, [0.0] * 3)) for n in ("joint_compliance", "motor_inertia", "joint_damping", "backlash")
    )

    def rate(_, s):
        ql, vl, qm, vm = s.reshape(4, 3)
        beyond = (qm - ql) - np.clip(qm - ql, -gap / 2, gap / 2)
        spring = beyond / compliance + damping * (vm - vl) * ((gap == 0) | (beyond != 0))
        al = np.linalg.solve(oracle.mass(ql) - np.diag(inertia), spring - oracle.bias(ql, vl))
        am = (TAU - 2e-3 * vm - spring) / inertia
        return np.concatenate([vl, al, vm, am])

    return rate


@pytest.mark.parametrize("gap", [0.0, 0.02])
def test_elastic_joints_agree_with_a_stiff_solver(gap):
    p = {
        "joint_compliance": [0.5, 0.3, 0.4],
        "motor_inertia": [8e-4, 7e-4, 3e-4],
        "joint_damping": [1e-3, 2e-3, 1e-3],
        "backlash": [gap] * 3,
    }
    q = np.array([0.1, 0.3, 0.4])
    m = CompiledModel("PhantomArm", q_start=q, viscous=[2e-3] * 3, internal_steps=40, **p).start()
    end = m.run(150, 1e-3, {"tau": TAU}, ("q_link", "q", "dq", "dq_link"))
    start = np.concatenate([q, np.zeros(3), q, np.zeros(3)])
    exact = (
        solve_ivp(
            two_mass(p), (0, 0.15), start, method="Radau", rtol=1e-9, atol=1e-11, max_step=1e-3 if gap else np.inf
        )
        .y[:, -1]
        .reshape(4, 3)
    )
    found = np.array([end[n][-1] for n in ("q_link", "dq_link", "q", "dq")])
    # smooth: Radau's rtol over the motion; with a gap every contact costs both solvers the damper's jump within one
    # step
    assert np.abs(found - exact)[[0, 2]].max() < (2e-5 if gap else 1e-7)
    assert np.abs(found - exact)[[1, 3]].max() < (2e-3 if gap else 1e-5)
    assert np.abs(end["q"] - end["q_link"]).max() > 0.01  # the effect is there


def test_stiff_joint_moves_like_a_rigid_one():
    """motor_inertia is a share of pi: as the compliance goes to zero the rigid arm comes back."""
    rigid = (
        CompiledModel("PhantomArm", viscous=[5e-3] * 3, gravity_compensation=1, internal_steps=40)
        .start()
        .run(200, 1e-3, {"tau": TAU}, ("q",))
    )
    apart = []
    for compliance in (1e-2, 1e-3):
        m = CompiledModel(
            "PhantomArm",
            viscous=[5e-3] * 3,
            gravity_compensation=1,
            internal_steps=40,
            joint_compliance=[compliance] * 3,
            motor_inertia=[5e-4] * 3,
            joint_damping=[2e-2] * 3,
        ).start()
        apart.append(np.abs(m.run(200, 1e-3, {"tau": TAU}, ("q",))["q"] - rigid["q"]).max())
    assert apart[1] < 0.2 * apart[0] < 0.05


def test_an_effect_found_alone_makes_a_model():
    """close-loop finds a compliance or a gap, not the motor's inertia: what is not given is chosen."""
    push = {"tau": [0.01, 0.01, 0.01]}
    rigid = (
        CompiledModel("PhantomArm", gravity_compensation=1, viscous=[5e-3] * 3)
        .start()
        .run(1000, 1e-3, push, ("q",))["q"]
    )
    for alone, most in (
        ({"joint_compliance": [0, 0, 0.3]}, [0, 0, 0.03]),
        ({"backlash": [0.02, 0.03, 0.04]}, [0.01, 0.015, 0.02]),
    ):
        m = CompiledModel("PhantomArm", gravity_compensation=1, viscous=[5e-3] * 3, **alone).start()
        run = m.run(1000, 1e-3, push, ("q", "q_link", "domain"))
        stretch = np.abs(run["q"] - run["q_link"]).max(axis=0)
        assert run["domain"].all() and np.abs(run["q"] - rigid).max() < 0.1
        # compliance: 0.3 rad/(N m) under gravity of 0.074 N m sin q3 and the push; gap: half of it, and its
        # sides give 0.08 N m / (M33/3 500^2) = 1 mrad, twice that at an impact
        assert (stretch <= 1.1 * np.array(most)).all() and (stretch >= 0.5 * np.array(most)).all(), stretch


@pytest.mark.parametrize(
    ("exponent", "law"),
    [
        (1.0, lambda d: 1 - np.exp(-d)),
        (0.5, lambda d: 1 - np.maximum(1 - d / 2, 0) ** 2),
        (0.0, lambda d: np.minimum(d, 1)),
    ],
)
def test_hysteresis_is_dahls(exponent, law):
    """A slow stroke, the solution of Dahl's law from rest on the way out; bounded where |dq| h is many lengths."""
    form = {"hysteresis_exponent": [exponent] * 3}
    m = CompiledModel(
        "PhantomArm",
        gravity_compensation=1,
        hysteresis=[1e-4] * 3,
        hysteresis_length=[0.005] * 3,
        internal_steps=4,
        viscous=[2e-2] * 3,
        **form,
    ).start()
    run = m.run(100, 1e-3, {"tau": [0.01, 0, 0]}, ("q", "z", "dq"))
    q, z = run["q"][:, 0], run["z"][:, 0]
    assert q[-1] > 0.01 and np.abs(z - law(q / 0.005)).max() < (
        2e-3 if exponent == 0 else 1e-5
    )  # a corner within a step
    wild = CompiledModel(
        "PhantomArm", hysteresis=[1e-3] * 3, hysteresis_length=[1e-5] * 3, dq_start=[3, 3, -3], **form
    ).start()
    assert np.abs(wild.run(300, 1e-3, watch=("z",))["z"]).max() <= 1.001


RICH = {
    "viscous": [1e-3] * 3,
    "coulomb": [5e-3] * 3,
    "stribeck": [2e-3] * 3,
    "hysteresis": [1e-3] * 3,
    "torque_saturation": [1.0] * 3,
    "torque_offset": [1e-3] * 3,
    "gravity_compensation": 1,
    "coupling_viscous": [1e-4] * 6,
    "payload": 0.01,
}
COMPANIONS = {
    "stribeck_velocity": 0.7,
    "ripple_order": 9.0,
    "hysteresis_length": 0.5,
    "hysteresis_exponent": 0.5,
    "friction_drift_time": 5.0,
    "coupling_velocity": 0.3,
    "hysteresis_ratio": 2.0,
    "hysteresis_tilt": 0.5,
    "contact_distance": -5.0,
    "motor_inertia": 1e-4,
    "joint_damping": 0.1,
    "contact_damping": 3.0,
    "stop_damping": 0.1,
    "stop_angle": -5.0,
    "stop_side": -1.0,
    "contact_normal": 1.0,
    "encoder_resolution": -1.0,
    "torque_saturation": -2.0,
}


def bits(parameters: dict) -> np.ndarray:
    m = CompiledModel("PhantomArm", q_start=[0.1, 0.3, 0.4], **parameters).start()
    run = m.run(100, 1e-3, {"tau": commands(100), "f": [0.01, 0.02, -0.01]}, ("q", "dq", "x", "dx", "tau_motor"))
    return np.hstack(list(run.values())).view(np.uint64)


def test_an_absent_effect_changes_no_bit():
    plain = {"viscous": [1e-3] * 3, "coulomb": [5e-3] * 3}
    # a limit that is never reached takes the path of all effects; the sums must be the plain ones
    assert (bits(plain) == bits(plain | {"torque_saturation": [1e9] * 3})).all()
    for name, value in COMPANIONS.items():
        assert (bits(plain) == bits(plain | {name: value})).all(), name
        if name not in RICH and name not in (
            "stribeck_velocity",
            "hysteresis_length",
            "hysteresis_exponent",
            "hysteresis_ratio",
        ):
            assert (bits(RICH) == bits(RICH | {name: value})).all(), name


def effect_parameters() -> list[str]:
    """Parameters of the two tables that belong to an effect and are zero by default."""
    tables = [
        tomllib.loads((SOURCES / name).read_text())["variable"]
        for name in ("PhantomArm/model.toml", "shared/joint.toml")
    ]
    return [
        v["name"] for t in tables for v in t if v.get("group", "").startswith("effect:") and v.get("start", 0.0) == 0.0
    ]


def test_every_effect_of_the_contract_is_there_and_zero():
    tables = [
        tomllib.loads((SOURCES / name).read_text())["variable"]
        for name in ("PhantomArm/model.toml", "shared/joint.toml")
    ]
    groups = {v["group"].removeprefix("effect:") for t in tables for v in t if v.get("group", "").startswith("effect:")}
    assert groups == set(EFFECTS)
    assert len(effect_parameters()) >= len(EFFECTS)


@pytest.mark.parametrize(
    "name",
    sorted(
        set(effect_parameters())
        - {
            "contact_damping",
            "coupling_velocity",
            "contact_distance",
            "contact_normal",
            "motor_inertia",
            "joint_damping",
        }
        - {"hysteresis_ratio", "hysteresis_tilt"}
    ),
)
def test_every_effect_does_something(name):
    """So that the tests of absence cannot pass on a parameter that nothing reads."""
    amount = {
        "torque_saturation": 1e-3,
        "contact_stiffness": 50.0,
        "joint_compliance": 0.1,
        "friction_drift": 10.0,
    }.get(name, 5e-3)
    needed = {
        "contact_stiffness": {"contact_normal": [0, 1.0, 0], "contact_distance": -1.0},
        "joint_compliance": {"motor_inertia": [1e-4] * 3},
        "friction_drift_time": {"friction_drift": [10.0] * 3},
        "stop_stiffness": {"stop_angle": [-1.0] * 3},
        "stop_damping": {"stop_stiffness": [1.0] * 3, "stop_angle": [-1.0] * 3},
        "stop_angle": {"stop_stiffness": [1.0] * 3},
    }.get(name, {})
    plain = {"viscous": [1e-3] * 3, "coulomb": [5e-3] * 3}
    assert (bits(plain) != bits(plain | needed | {name: amount})).any()
