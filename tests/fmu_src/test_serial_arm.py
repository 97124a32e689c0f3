"""SerialArm in C: effects against numpy, energy, order, elastic joints, limits, inert rows, refusals, vector lanes."""

import ctypes
import itertools

import numpy as np
import pytest
from attrs import evolve
from scipy.integrate import solve_ivp

from cosim.arm import serial_dynamics as dynamics
from cosim.arm import serial_kinematics as kinematics
from cosim.arm.serial import JointKind, SerialModel, turn
from tests.support.model_harness import CompiledModel, compile_library
from tests.support.robots import apart, compiled, put, states


def made_arm(count: int, seed: int, slide: int | None = None) -> SerialModel:
    """An arm that no one built: any axes and frames, bodies of three point masses each, rotors; one joint may slide."""
    random = np.random.default_rng(seed)
    axes = random.standard_normal((count, 3))
    points, masses = random.uniform(-0.2, 0.2, (count, 3, 3)), random.uniform(0.2, 1.0, (count, 3))
    centre = np.einsum("ik,ika->ia", masses, points) / masses.sum(axis=1)[:, None]
    arms = points - centre[:, None]
    inertia = np.einsum("ik,ikc,ikc->i", masses, arms, arms)[:, None, None] * np.eye(3)
    return SerialModel(
        name="made",
        joints=[f"j{i + 1}" for i in range(count)],
        kinds=[JointKind.PRISMATIC if i == slide else JointKind.REVOLUTE for i in range(count)],
        rotation=[turn(rpy) for rpy in random.uniform(-3, 3, (count, 3))],
        origin=random.uniform(-0.3, 0.3, (count, 3)),
        axis=axes / np.linalg.norm(axes, axis=1)[:, None],
        mass=masses.sum(axis=1),
        centre=centre,
        inertia=inertia - np.einsum("ik,ika,ikb->iab", masses, arms, arms),
        lower=np.full(count, -2.5),
        upper=np.full(count, 2.5),
        effort=np.full(count, np.inf),
        speed=np.full(count, np.inf),
        viscous=np.zeros(count),
        coulomb=np.zeros(count),
        armature=random.uniform(0.0, 0.1, count),
        tip=random.uniform(-0.1, 0.1, 3),
        gravity=random.uniform(-10, 10, 3),
    )


def accelerations(arm: CompiledModel, q, dq, **inputs) -> np.ndarray:
    put(arm, q_link=q, dq_link=dq, q_motor=q, dq_motor=dq, **inputs)
    arm.rates()
    return arm["ddq"][: len(q)]


@pytest.mark.parametrize(("count", "slide"), [(1, None), (1, 0), (2, 1), (3, 0), (6, None), (7, 3), (12, 5)])
def test_c_and_numpy_agree_for_any_arm(count, slide):
    model = made_arm(count, count, slide)
    arm = compiled(model).start()
    cases = states(model, 20, 1)
    assert len(cases) == 20
    for q, dq, _, tau, f in cases:
        ddq = accelerations(arm, q, dq, tau=tau, f=f)
        arm.show()
        expected = dynamics.forward_dynamics(model, q, dq, tau, f)
        # solving M x = b loses M's condition number times 1e-16; two algorithms, so twice
        condition = np.linalg.cond(dynamics.mass_matrix(model, q))
        assert apart(ddq, expected) < 1e-14 * max(condition, 10)
        assert np.abs(arm["x"] - kinematics.tip_position(model, q)).max() < 1e-14
        assert np.abs(arm["dx"] - kinematics.tip_jacobian(model, q) @ dq).max() < 1e-13
        assert (arm["q"][:count] == q).all() and (arm["x_tip"] == arm["x"]).all()


def test_a_rotor_counts_by_the_square_of_its_gear():
    model = made_arm(3, 6)
    geared = compiled(model, rotor_inertia=model.armature / 2500, gear_ratio=[50.0, -50.0, 50.0]).start()
    q, dq = np.full(3, 0.3), np.full(3, -0.4)
    assert apart(accelerations(geared, q, dq, tau=0.3), accelerations(compiled(model).start(), q, dq, tau=0.3)) < 1e-14


def test_unused_rows_are_inert():
    model = made_arm(3, 5)
    arm = compiled(model, internal_steps=2.0)
    reference = compiled(model, internal_steps=2.0).start().run(50, 1e-3, watch=("q", "dq", "x"))
    for name in ("mass", "coulomb", "stribeck", "joint_compliance", "time_delay"):
        arm[name] = np.where(np.arange(12) < 3, arm[name], 1.0)
    arm["q_start"] = np.where(np.arange(12) < 3, arm["q_start"], 0.7)
    run = arm.start().run(50, 1e-3, watch=("q", "dq", "x", "tau_motor"))
    assert (run["q"][:, :3] == reference["q"][:, :3]).all() and (run["x"] == reference["x"]).all()
    assert (run["q"][:, 3:] == 0.7).all() and (run["dq"][:, 3:] == 0).all() and (run["tau_motor"][:, 3:] == 0).all()


@pytest.mark.parametrize("slide", [None, 2])
def test_free_motion_keeps_its_energy(slide):
    model = evolve(made_arm(7, 11, slide), armature=np.zeros(7))
    q, dq = np.linspace(-0.5, 0.5, 7), np.linspace(1, -1, 7)
    arm = compiled(model, q_start=q, dq_start=dq, internal_steps=8.0).start()
    run = arm.run(1000, 1e-3, watch=("q", "dq"))
    energy = dynamics.total_energy(model, run["q"][:, :7], run["dq"][:, :7])
    swing = np.ptp(dynamics.kinetic_energy(model, run["q"][:, :7], run["dq"][:, :7]))
    # RK4 at 125 us with joint rates of up to 30 rad/s: (h w)^4 = 2e-10 of what moves
    assert np.abs(energy - dynamics.total_energy(model, q, dq)).max() < 2e-9 * swing


def test_motion_agrees_with_scipy_and_is_of_fourth_order():
    model = made_arm(4, 21)
    q, dq, tau, f = np.full(4, 0.2), np.full(4, -0.5), np.linspace(-1, 1, 4), np.array([1.0, -2.0, 0.5])

    def rate(_, s):
        return np.concatenate([s[4:], dynamics.forward_dynamics(model, s[:4], s[4:], tau, f)])

    exact = solve_ivp(rate, (0, 0.2), np.concatenate([q, dq]), method="DOP853", rtol=1e-12, atol=1e-13).y[:4, -1]
    errors = []
    for steps in (1.0, 2.0, 4.0):
        arm = compiled(model, q_start=q, dq_start=dq, internal_steps=steps).start()
        end = arm.run(20, 1e-2, {"tau": np.pad(tau, (0, 8)), "f": f}, ("q",))["q"][-1, :4]
        errors.append(np.abs(end - exact).max())
    orders = [np.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert errors[-1] < 1e-7 and all(abs(order - 4) < 0.5 for order in orders), (errors, orders)


def test_effects_of_the_library_act_on_each_joint_by_itself():
    """What an effect takes from joint 2 is what it takes from the torque: two plants, one torque apart."""
    model = made_arm(3, 31)
    q, dq, t = np.array([0.3, -0.4, 0.2]), np.array([0.5, -0.8, 0.6]), 2.0
    tau = np.array([0.5, -0.7, 0.9])
    s = dq / np.sqrt(dq**2 + 0.01**2)
    required = {
        "viscous": dq,
        "coulomb": s,
        "stribeck": np.exp(-((np.abs(dq) / 0.1) ** 2)) * s,
        "coulomb_asymmetry": s**2,
        "viscous_asymmetry": np.abs(dq),
        "torque_offset": np.ones(3),
        "load_friction": np.abs(tau) * s,
        "position_friction_sin": np.sin(q) * s,
        "position_torque_cubic": q**3,
        "ripple_cos": np.cos(q),
        "quadratic_drag": dq * np.abs(dq),
    }
    plain = compiled(model).start()
    for name, unit in required.items():
        values = np.array([0.0, 0.05, 0.0])
        arm = compiled(model, **{name: values}).start()
        put(arm, q_link=q, dq_link=dq, q_motor=q, dq_motor=dq, tau=tau)
        arm.rates(t)
        assert apart(arm["ddq"][:3], accelerations(plain, q, dq, tau=tau - values * unit)) < 1e-12, name


def test_coupling_takes_from_one_joint_what_another_does():
    model = made_arm(5, 41)
    q, dq = np.linspace(-0.4, 0.4, 5), np.linspace(0.5, -0.7, 5)
    couplings = {
        "coupling_on": [2.0, 5.0],
        "coupling_from": [4.0, 1.0],
        "coupling_viscous": [0.1, 0.0],
        "coupling_coulomb": [0.0, 0.2],
        "coupling_stiffness": [0.3, 0.0],
    }
    arm = compiled(model)
    for name, values in couplings.items():
        arm[name] = np.pad(values, (0, 10))
    arm.start()
    taken = np.zeros(5)
    taken[1] = 0.1 * dq[3] + 0.3 * q[3]
    taken[4] = 0.2 * dq[0] / np.hypot(dq[0], 0.01)
    assert (
        apart(accelerations(arm, q, dq, tau=0.5), accelerations(compiled(model).start(), q, dq, tau=0.5 - taken))
        < 1e-12
    )


def test_payload_tilt_and_wall():
    model = made_arm(4, 51)
    q, dq = np.full(4, 0.3), np.full(4, 0.4)
    loaded = compiled(model, payload=0.8).start()
    mass = dynamics.mass_matrix(model, q)
    jacobian, h = kinematics.tip_jacobian(model, q), 1e-6
    rate = (kinematics.tip_jacobian(model, q + h * dq) - kinematics.tip_jacobian(model, q - h * dq)) / (2 * h)
    heavier = mass + 0.8 * jacobian.T @ jacobian
    bias = dynamics.bias_torque(model, q, dq) + 0.8 * jacobian.T @ (rate @ dq - model.gravity)
    assert apart(accelerations(loaded, q, dq), np.linalg.solve(heavier, -bias)) < 1e-8  # the rate is a difference

    a, b = 0.1, -0.2  # an arm that hangs straight: gravity leans by a towards x, b towards y
    upright = evolve(model, gravity=(0.0, 0.0, -9.81))
    up = np.array([np.sin(a), np.cos(a) * np.sin(b), np.cos(a) * np.cos(b)])
    tilted = compiled(upright, base_tilt=[a, b]).start()
    leaning = compiled(evolve(upright, gravity=-9.81 * up)).start()
    assert apart(accelerations(tilted, q, dq), accelerations(leaning, q, dq)) < 1e-13

    x = kinematics.tip_position(model, q)
    normal = np.array([1.0, 2.0, -1.0]) / np.sqrt(6)
    wall = compiled(
        model,
        contact_stiffness=500.0,
        contact_damping=3.0,
        contact_normal=2 * normal,
        contact_distance=normal @ x - 0.01,
    ).start()
    push = -normal * max(0.0, 500 * 0.01 + 3 * normal @ jacobian @ dq)
    assert apart(accelerations(wall, q, dq), accelerations(compiled(model).start(), q, dq, f=push)) < 1e-10
    wall.show()
    assert apart(wall["f_contact"], push) < 1e-12


def test_a_very_stiff_elastic_joint_is_the_rigid_arm():
    model = evolve(made_arm(3, 61), armature=np.array([0.02, 0.03, 0.05]))
    more = {"internal_steps": 40.0, "viscous": 0.2}
    rigid = compiled(model, **more).start()
    stiff = compiled(model, **more, joint_compliance=1e-6, joint_damping=20.0).start()
    ends = [arm.run(200, 1e-3, watch=("q",))["q"][-1, :3] for arm in (rigid, stiff)]
    assert np.abs(ends[0]).max() > 0.1
    assert np.abs(ends[0] - ends[1]).max() < 1e-3 * np.abs(ends[0]).max()  # bends by torque times 1e-6 rad/(N m)


def test_motors_stop_at_their_limits_and_commands_come_late():
    model = made_arm(3, 71)
    arm = compiled(model, torque_saturation=[1.0, 0.0, 2.0]).start()
    put(arm, tau=[5.0, 5.0, -5.0])
    arm.show()
    assert arm["tau_motor"][:3].tolist() == [1.0, 5.0, -2.0] and arm["saturated"] == 1
    tau, f = np.random.default_rng(1).uniform(-1, 1, (30, 12)), np.random.default_rng(2).uniform(-3, 3, (30, 3))
    before = np.maximum(np.arange(30) - 3, 0)  # three steps late; at first the first command
    late = compiled(model, time_delay=0.003).start().run(30, 1e-3, {"tau": tau, "f_command": f}, ("q",))
    prompt = compiled(model).start().run(30, 1e-3, {"tau": tau[before], "f_command": f[before]}, ("q",))
    assert np.abs(late["q"] - prompt["q"]).max() < 1e-15  # other order of additions only


def test_joint_limits_end_the_domain():
    model = made_arm(2, 81)
    arm = compiled(model, joint_limits=1.0, lower=-0.2, upper=0.2, internal_steps=2.0).start()
    run = arm.run(1000, 1e-3, watch=("q", "domain"))
    left = int(np.argmin(run["domain"][:, 0]))
    assert left > 5 and (np.abs(run["q"][:, :2]) <= 0.2).all() and (run["q"][left:] == run["q"][left]).all()


def test_in_device_impedance_pulls_the_tip():
    model = made_arm(6, 91)
    stiffness, damping, q, dq = (
        np.array([30.0, 40.0, 50.0]),
        np.array([1.0, 2.0, 3.0]),
        np.full(6, 0.2),
        np.full(6, 0.1),
    )
    target = np.array([0.1, 0.2, 0.3])
    arm = compiled(model, stiffness=stiffness, damping=damping).start()
    jacobian = kinematics.tip_jacobian(model, q)
    force = stiffness * (target - kinematics.tip_position(model, q)) - damping * (jacobian @ dq)
    found = accelerations(arm, q, dq, x_ref=target, f_command=[0.5, 0.6, 0.7])
    expected = dynamics.forward_dynamics(model, q, dq, jacobian.T @ (force + np.array([0.5, 0.6, 0.7])))
    assert apart(found, expected) < 1e-11


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"axis_x": 0.0, "axis_y": 0.0, "axis_z": 0.0}, "joint 1 = 0, 0, 0: expected a direction"),
        ({"mass": 0.0, **{f"inertia_{k}": 0.0 for k in ("xx", "yy", "zz")}}, "not positive definite"),
        (
            {"coupling_on": 2.0, "coupling_from": 2.0},
            "coupling_on[1] = 2, coupling_from[1] = 2: expected two different",
        ),
        ({"coupling_on": 2.0, "coupling_from": 4.0}, "expected two different joints of 1 .. 3"),
        ({"contact_stiffness": 10.0}, "contact_normal = 0, 0, 0"),
        ({"stribeck_exponent": 1.5}, "stribeck_exponent[1] = 1.5 is neither 1 nor 2"),
        ({"joint_compliance": 1e-3, "motor_inertia": 50.0}, "motor_inertia leaves links without positive definite"),
    ],
)
def test_arms_that_cannot_be_are_refused(values, words):
    arm = CompiledModel("SerialArm", **values)
    with pytest.raises(ValueError) as caught:
        arm.start()
    assert words in str(caught.value)


BODY = """
#include "SerialArm/serial.h"
#define N 5
#define IN (N * 20 + 3 * N + 9)
#define OUT (4 * N + 10)
static const double type[N] = {1, 3, 1, 2, 3};
static void everything(const real *in, real *out)
{
    real turned[9], armature[N], tau[N], ddq[N], dx[3];
    SerialLink link[N];
    SerialPose pose;
    SerialTip tip;
    for (int k = 0; k < 9; k++) turned[k] = real_of(k % 4 == 0 ? 1.0 : 0.0);
    for (int i = 0; i < N; i++) {
        SerialRow row;
        memcpy(&row, in + 20 * i, sizeof row);
        serial_link(&row, turned, &link[i]);
        armature[i] = in[20 * i + 19];
    }
    const real *q = in + 20 * N, *dq = q + N, *a = dq + N, *g = a + N, *f = g + 3, *offset = f + 3;
    serial_add_mass(&link[N - 1], f[0] * f[0], offset);
    serial_pose(N, type, link, q, &pose);
    serial_tip(N, type, &pose, offset, &tip);
    serial_velocity(N, &tip, dq, dx);
    serial_inverse(N, type, link, &pose, armature, g, dq, a, tau);
    const mask definite = serial_forward(N, type, link, &pose, armature, g, dq, tau, ddq);
    memcpy(out, tip.x, sizeof tip.x);
    memcpy(out + 3, dx, sizeof dx);
    memcpy(out + 6, tau, sizeof tau);
    memcpy(out + 6 + N, ddq, sizeof ddq);
    serial_torque_of_force(N, &tip, f, out + 6 + 2 * N);
    for (int i = 0; i < N; i++) out[6 + 3 * N + i] = link[i].inertia[4];
    out[OUT - 4] = choose(definite, real_of(1.0), real_of(0.0));
    for (int k = 1; k < 4; k++) out[OUT - k] = link[k].rotation[k];
}
"""
SCALAR = (
    BODY
    + """
void evaluate(const double *in, int n, double *out)
{ for (int i = 0; i < n; i++) everything(in + IN * i, out + OUT * i); }
"""
)
LANES = """
void evaluate(const double *in, int n, double *out)
{
    for (int i = 0; i < n; i += REAL_LANES) {
        real a[IN], b[OUT];
        for (int k = 0; k < IN; k++) for (int j = 0; j < REAL_LANES; j++) a[k][j] = in[IN * (i + j) + k];
        everything(a, b);
        for (int k = 0; k < OUT; k++) for (int j = 0; j < REAL_LANES; j++) out[OUT * (i + j) + k] = b[k][j];
    }
}
"""


def evaluate(source: str, rows: np.ndarray, flags: tuple[str, ...] = ()) -> np.ndarray:
    out = np.zeros((len(rows), 30))
    point = [a.ctypes.data_as(ctypes.c_void_p) for a in (rows, out)]
    compile_library(source, flags).evaluate(point[0], len(rows), point[1])
    return out


@pytest.mark.parametrize("lanes", [2, 4])
def test_lanes_have_the_bits_of_the_scalar_and_inverse_dynamics_undoes_forward(lanes):
    random = np.random.default_rng(1)
    rows = random.uniform(-1, 1, (200, 5 * 20 + 3 * 5 + 9))
    for i in range(5):  # masses and principal moments above zero, products small; some arms have none that can be
        rows[:, 20 * i + 9] = random.uniform(0.5, 2, 200)
        rows[:, 20 * i + 13 : 20 * i + 19] = random.uniform(-0.01, 0.01, (200, 6))
        rows[:, [20 * i + 13, 20 * i + 16, 20 * i + 18]] += 0.1
        rows[:, 20 * i + 19] = random.uniform(0, 0.1, 200)
    rows[::10, [13, 16, 18]] = -50.0  # link 1: moments below zero
    scalar = evaluate(SCALAR, rows)
    vector = evaluate(f"#define REAL_LANES {lanes}\n{BODY}{LANES}", rows, ("-Wno-psabi",))
    assert (scalar.view(np.uint64) == vector.view(np.uint64)).all()
    assert 0 < scalar[:, 26].mean() < 1
    good = scalar[:, 26] == 1
    accelerated = rows[:, 110:115]
    assert np.abs(scalar[good, 11:16] - accelerated[good]).max() < 1e-9
