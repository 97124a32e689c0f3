"""The arm against MuJoCo, an engine that we did not write: mass matrix, bias forces, kinematics, and two seconds of
motion.
"""

import mujoco
import numpy as np
import pytest
from attrs import evolve

from cosim.arm import dynamics, kinematics
from cosim.arm.counterbalance import GIMBAL, Counterweights, fitted
from cosim.arm.parameters import SET_NAMES, parameter_set, with_payload
from cosim.arm.segments import Segment, Segments, segment_pi
from cosim.arm.workspace import BOX, LINKED
from tests.support.engine_arm import RELATIVE, Engine, Load, pantograph, parallelogram

TIGHT = 1e-12
"""Relative to the largest entry over all states; the engine turns bodies by quaternions, some 1e-15 each."""
DUST = Segment(1e-9, 1e-9, 1e-9, 1e-9)
"""A body that hardly counts: MuJoCo needs some mass in every body that moves."""


def states(count=60, seed=11):
    rng = np.random.default_rng(seed)
    return BOX.sample(count, seed), rng.uniform(-5, 5, (count, 3))


def close(found, expected, tolerance=TIGHT):
    return np.max(np.abs(found - expected)) <= tolerance * np.max(np.abs(expected))


def observe(engine, q, dq):
    """M (n, 3, 3) and C dq + N (n, 3) of the engine at many states."""
    seen = []
    for pose, speed in zip(q, dq, strict=True):
        engine.place(pose, speed)
        seen.append((engine.mass(), engine.bias()))
    return np.array([m for m, _ in seen]), np.array([b for _, b in seen])


def model_bias(pi, q, dq):
    return dynamics.inverse_dynamics(pi, q, dq, np.zeros_like(q))


def test_parallelogram_closes():
    """The rod's far end stays on the forearm, though no constraint holds it there."""
    engine = Engine(parallelogram(Segments()))
    poses = BOX.sample(40, 1)
    assert len(poses) == 40
    for pose in poses:
        engine.place(pose)
        np.testing.assert_allclose(engine.at("on_rod"), engine.at("on_fore"), atol=1e-15)


def test_kinematics():
    engine = Engine(parallelogram(Segments()))
    origin = np.array([0.0, kinematics.L2, -kinematics.L1])
    poses = BOX.sample(60, 2)
    assert len(poses) == 60
    for pose in poses:
        engine.place(pose)
        linear, angular = engine.jacobians("tip")
        np.testing.assert_allclose(engine.at("tip") + origin, kinematics.forward(pose), atol=1e-15)
        np.testing.assert_allclose(linear, kinematics.jacobian(pose), atol=1e-15)
        np.testing.assert_allclose(angular, kinematics.angular_jacobian(pose), atol=1e-15)


def test_segment_set():
    q, dq = states()
    mass, bias = observe(Engine(parallelogram(Segments())), q, dq)
    pi = parameter_set("segment").pi
    assert close(dynamics.mass_matrix(pi, q), mass)
    assert close(model_bias(pi, q, dq), bias)


def test_payload_and_counterweights():
    """Bodies that MuJoCo adds by itself against pi changed by `with_payload` and `fitted`."""
    q, dq = states(seed=12)
    params, on_tip = parameter_set("segment"), Load(0.15, (0, -kinematics.L2, 0))
    mass, bias = observe(Engine(parallelogram(Segments(), on_fore=[on_tip])), q, dq)
    loaded = with_payload(params, 0.15).pi
    assert close(dynamics.mass_matrix(loaded, q), mass) and close(model_bias(loaded, q, dq), bias)
    weights = Counterweights(0.248, 0.091)
    arms = parallelogram(
        Segments(),
        on_upper=[Load(0.248, (0, 0, -weights.lever))],
        on_drive=[Load(0.091, (0, weights.lever, 0))],
        on_fore=[Load(GIMBAL.mass, (0, -GIMBAL.distance, 0))],
    )
    mass, bias = observe(Engine(arms), q, dq)
    balanced = fitted(params, GIMBAL, weights).pi
    assert close(dynamics.mass_matrix(balanced, q), mass) and close(model_bias(balanced, q, dq), bias)


def basis():
    """Eight arms, each with one thing heavy: their parameters span all eight dimensions."""
    bare = Segments(DUST, DUST, DUST, DUST, 1e-9)
    rod = 1e-3
    lever = Segment(0.2359, 11.09e-4, 10.06e-4, 0.591e-4)
    return [
        evolve(bare, base_yy=rod),
        evolve(bare, be=Segment(1e-9, rod, rod, 1e-9)),  # a rod along the upper arm
        evolve(bare, be=Segment(1e-9, rod, 1e-9, 1e-9)),  # a rotor about the pitch axis: armature
        evolve(bare, a=Segment(1e-9, rod, 1e-9, rod)),
        evolve(bare, df=Segment(1e-9, rod, 1e-9, 1e-9)),
        evolve(bare, a=Segment(0.05, 1e-9, 1e-9, 1e-9)),  # couples joints 2 and 3
        evolve(bare, be=lever),
        evolve(bare, df=Segment(0.1906, 7.11e-4, 0.629e-4, 6.246e-4)),
    ]


@pytest.fixture(scope="module")
def basis_seen():
    """What the engine says of each of the eight arms, and their parameters."""
    q, dq = states(seed=13)
    return (
        q,
        dq,
        [observe(Engine(parallelogram(arm)), q, dq) for arm in basis()],
        np.array([segment_pi(arm) for arm in basis()]),
    )


@pytest.mark.parametrize("name", SET_NAMES)
def test_every_parameter_set(basis_seen, name):
    """M and bias are linear in pi, so eight arms of the engine make every set, also those that no arm can have (M
    not > 0).
    """
    q, dq, seen, parameters = basis_seen
    pi = parameter_set(name).pi
    weights = np.linalg.solve(parameters.T, pi)
    np.testing.assert_allclose(weights @ parameters, pi, rtol=1e-11, atol=1e-16)
    mass = sum(w * m for w, (m, _) in zip(weights, seen, strict=True))
    bias = sum(w * b for w, (_, b) in zip(weights, seen, strict=True))
    assert close(dynamics.mass_matrix(pi, q), mass)
    assert close(model_bias(pi, q, dq), bias)


START = np.array([0.1, 0.4, 0.5]), np.array([0.8, -0.5, 0.6])
STEP, STEPS = 1e-3, 2000


def runge_kutta(acceleration, q, dq):
    """Motion (STEPS + 1, 6) by the classical fourth-order method."""
    state, path = np.concatenate([q, dq]), []

    def slope(s):
        return np.concatenate([s[3:], acceleration(s[:3], s[3:])])

    for _ in range(STEPS + 1):
        path.append(state)
        k1 = slope(state)
        k2 = slope(state + STEP / 2 * k1)
        k3 = slope(state + STEP / 2 * k2)
        k4 = slope(state + STEP * k3)
        state = state + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(path)


@pytest.fixture(scope="module")
def numpy_motion():
    """Two seconds of free fall under gravity from a moving start, numpy model."""
    params, zero = parameter_set("segment"), np.zeros(3)
    return runge_kutta(lambda q, dq: dynamics.forward_dynamics(params, q, dq, zero, zero), *START)


def test_motion_of_the_parallelogram(numpy_motion):
    """Same method, same step, the engine's M and bias: differences are rounding, grown by the motion."""
    engine = Engine(parallelogram(Segments()))

    def acceleration(q, dq):
        engine.place(q, dq)
        return np.linalg.solve(engine.mass(), -engine.bias())

    motion = runge_kutta(acceleration, *START)
    assert np.ptp(numpy_motion[:, :3], axis=0).min() > 0.3  # it really moves
    assert np.max(np.abs(motion - numpy_motion)) < 1e-11 * np.max(np.abs(numpy_motion))


def test_motion_stepped_by_the_engine(numpy_motion):
    """MuJoCo's own integrator on the three-hinge writing of the same arm."""
    pi = parameter_set("segment").pi
    model = pantograph(Segments(), tuple(pi[6:] / 9.81), STEP)
    q, dq = states(20, 14)
    mass, bias = observe(Engine(model), q, dq)
    assert close(dynamics.mass_matrix(pi, q), mass) and close(model_bias(pi, q, dq), bias)
    engine = Engine(model)
    engine.place(*START)
    back, path = np.linalg.inv(RELATIVE), []
    for _ in range(STEPS + 1):
        path.append(np.concatenate([back @ engine.data.qpos, back @ engine.data.qvel]))
        mujoco.mj_step(model, engine.data)
    assert np.max(np.abs(np.array(path) - numpy_motion)) < 1e-11 * np.max(
        np.abs(numpy_motion)
    )  # dust of 1e-15 kg m^2: 1e-12 of M


def test_engine_denies_the_printed_misprints():
    """The engine alone tells the signs apart: C32 and M22 as printed by Sallam are not its."""
    q, dq = states(seed=15)
    mass, bias = observe(Engine(parallelogram(Segments())), q, dq)
    pi, s = parameter_set("segment").pi, Segments()
    wrong_c = model_bias(pi, q, dq)
    wrong_c[:, 2] += pi[3] * np.cos(q[:, 1] - q[:, 2]) * dq[:, 1] ** 2
    m22 = (4 * s.be.xx + s.c.xx + kinematics.L1**2 * s.a.mass) / 4 + kinematics.L1**2 * s.c.mass
    assert not close(wrong_c, bias, 1e-3)
    assert abs(mass[0, 1, 1] / pi[4] - 1) < TIGHT < 0.03 < abs(m22 / mass[0, 1, 1] - 1)
    assert LINKED.contains(q).any()
