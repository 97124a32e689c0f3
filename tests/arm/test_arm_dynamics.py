"""Identities of the arm's dynamics: skew symmetry, energy balance, tip mass, friction."""

import numpy as np
import pytest
from attrs import evolve

from cosim.arm import dynamics as dyn
from cosim.arm import kinematics
from cosim.arm.parameters import SET_NAMES, parameter_set
from cosim.arm.workspace import LINKED

STEP = 1e-30


@pytest.mark.parametrize("name", SET_NAMES)
def test_mass_rate_is_coriolis_plus_transpose(name):
    pi, q = parameter_set(name).pi, LINKED.sample(100, 1)
    dq = np.random.default_rng(1).uniform(-5, 5, (100, 3))
    coriolis = dyn.coriolis_matrix(pi, q, dq)
    rate = dyn.mass_matrix(pi, q + 1j * STEP * dq).imag / STEP
    np.testing.assert_allclose(coriolis + np.swapaxes(coriolis, -1, -2), rate, atol=1e-15 * np.abs(rate).max() * 10)
    mass = dyn.mass_matrix(pi, q)
    assert np.array_equal(mass, np.swapaxes(mass, -1, -2))


def test_gravity_is_the_slope_of_the_potential():
    pi, q = parameter_set("GCW").pi, LINKED.sample(50, 2)
    slope = np.stack([dyn.potential_energy(pi, q + 1j * STEP * axis).imag / STEP for axis in np.eye(3)], axis=-1)
    np.testing.assert_allclose(dyn.gravity_torque(pi, q), slope, atol=1e-16)


def test_forward_undoes_inverse():
    """M^-1 (tau - ...) gives back ddq; the loss is eps times cond(M), below 100 here."""
    params, q = parameter_set("segment"), LINKED.sample(200, 3)
    rng = np.random.default_rng(3)
    dq, ddq, f = rng.uniform(-5, 5, (200, 3)), rng.uniform(-50, 50, (200, 3)), rng.uniform(-5, 5, (200, 3))
    tau = dyn.inverse_dynamics(params.pi, q, dq, ddq) - np.einsum("nji,nj->ni", kinematics.jacobian(q), f)
    np.testing.assert_allclose(dyn.forward_dynamics(params, q, dq, tau, f), ddq, atol=50 * 1e-13)


def test_full_regressor_holds_friction():
    params, q = parameter_set("UR"), LINKED.sample(100, 4)
    rng = np.random.default_rng(4)
    dq, ddq = rng.uniform(-5, 5, (100, 3)), rng.uniform(-50, 50, (100, 3))
    for velocity in (0.0, 0.01):
        expected = dyn.inverse_dynamics(params.pi, q, dq, ddq) + dyn.friction_torque(params, dq, velocity)
        found = dyn.full_regressor(q, dq, ddq, velocity) @ params.vector
        np.testing.assert_allclose(found, expected, atol=1e-15)
    assert dyn.full_regressor(q[0], dq[0], ddq[0]).shape == (3, 14)


def push(t):
    """Motor torque and tip force of the energy test."""
    return 0.05 * np.array([np.sin(3 * t), np.cos(2 * t), -np.sin(4 * t)]), 0.2 * np.array(
        [np.cos(t), np.sin(2 * t), 0.3]
    )


def rate(params, t, state):
    """d/dt of (q, dq, work of motors, work of the tip force, heat of friction)."""
    q, dq = state[:3], state[3:6]
    tau, f = push(t)
    ddq = dyn.forward_dynamics(params, q, dq, tau, f, 0.5)
    heat = dyn.friction_torque(params, dq, 0.5) @ dq
    return np.concatenate([dq, ddq, [tau @ dq, f @ (kinematics.jacobian(q) @ dq), heat]])


def imbalance(params, steps):
    """Energy gained minus work done plus heat [J] after 1 s of RK4, and the energy that was moved [J]."""
    h, state = 1.0 / steps, np.array([0.1, 0.3, 0.5, 0.5, -0.4, 0.3, 0.0, 0.0, 0.0])
    before = dyn.total_energy(params.pi, state[:3], state[3:6])
    for i in range(steps):
        t = i * h
        k1 = rate(params, t, state)
        k2 = rate(params, t + h / 2, state + h / 2 * k1)
        k3 = rate(params, t + h / 2, state + h / 2 * k2)
        k4 = rate(params, t + h, state + h * k3)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    gained = dyn.total_energy(params.pi, state[:3], state[3:6]) - before
    return gained - state[6] - state[7] + state[8], np.abs(state[6:]).max()


def test_energy_balance_closes_with_the_integrator():
    """Energy gained = work of motors + work at the tip - heat, to the error of RK4: 16 times less for half the step.

    Viscous, and Coulomb smoothed over 0.5 rad/s so that the order of the method can be seen.
    """
    params = parameter_set("segment")
    params = evolve(params, viscous=(0.002, 0.003, 0.001), coulomb=(0.02, 0.01, 0.01))
    errors = [abs(imbalance(params, steps)[0]) for steps in (100, 200, 400)]
    moved = imbalance(params, 400)[1]
    assert moved > 1e-3
    assert errors[2] < 1e-8 * moved
    assert 10 < errors[0] / errors[1] < 25 and 10 < errors[1] / errors[2] < 25


def test_a_wrong_coriolis_sign_would_show(monkeypatch):
    """The balance above fails by far when C32 has the printed sign."""
    correct = dyn.coriolis_matrix

    def printed(pi, q, dq):
        c = correct(pi, q, dq)
        c[..., 2, 1] *= -1
        return c

    monkeypatch.setattr(dyn, "coriolis_matrix", printed)
    error, moved = imbalance(parameter_set("segment"), 200)
    assert abs(error) > 1e-4 * moved


def test_tip_mass_is_force_over_acceleration():
    """At rest, without gravity and friction, a unit force along n accelerates the tip by n^T a = 1 / mass."""
    params = parameter_set("segment")
    free = evolve(params, pi=params.pi * np.array([1, 1, 1, 1, 1, 1, 0, 0]))
    q = LINKED.sample(50, 5)
    q = q[np.abs(kinematics.radius(q)) > 0.05]
    rng = np.random.default_rng(5)
    n = rng.normal(size=(len(q), 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    ddq = dyn.forward_dynamics(free, q, np.zeros_like(q), np.zeros_like(q), n)
    acceleration = np.einsum("ni,nij,nj->n", n, kinematics.jacobian(q), ddq)
    np.testing.assert_allclose(dyn.tip_mass(params.pi, q, n), 1 / acceleration, rtol=1e-10)
    mass, heaviest = dyn.heaviest_direction(params.pi, q)
    np.testing.assert_allclose(dyn.tip_mass(params.pi, q, heaviest), mass, rtol=1e-9)
    assert np.all(mass >= dyn.tip_mass(params.pi, q, n) * (1 - 1e-12))


def test_smooth_direction_tends_to_the_sign():
    dq = np.array([-1.0, -0.01, 0.0, 0.01, 1.0])
    np.testing.assert_allclose(dyn.direction(dq, 0.0), [-1, -1, 0, 1, 1])
    np.testing.assert_allclose(dyn.direction(dq, 0.01), [-0.99995, -np.sqrt(0.5), 0, np.sqrt(0.5), 0.99995], atol=1e-8)


def test_leading_axes_broadcast():
    """One call for a grid of poses and a row of parameter vectors gives what single calls give, bit for bit."""
    q = LINKED.sample(10, 6).reshape(2, 5, 3)
    dq = np.random.default_rng(6).uniform(-5, 5, (2, 5, 3))
    pis = np.stack([parameter_set(name).pi for name in ("segment", "UR")])[:, None, :]
    mass, coriolis = dyn.mass_matrix(pis, q), dyn.coriolis_matrix(pis, q, dq)
    solved = dyn.solve_mass(pis, q, dq)
    assert mass.shape == coriolis.shape == (2, 5, 3, 3)
    for i, j in np.ndindex(2, 5):
        np.testing.assert_array_equal(mass[i, j], dyn.mass_matrix(pis[i, 0], q[i, j]))
        np.testing.assert_allclose(coriolis[i, j], dyn.coriolis_matrix(pis[i, 0], q[i, j], dq[i, j]), rtol=1e-15)
        np.testing.assert_allclose(mass[i, j] @ solved[i, j], dq[i, j], rtol=1e-11)
    assert dyn.regressor(q, dq, dq).shape == (2, 5, 3, 8)
    assert kinematics.jacobian(q).shape == (2, 5, 3, 3)
