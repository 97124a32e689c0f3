"""The contact force observer: the true force through L(s), its sign and frames, with and without the model."""

import numpy as np
import pytest
from scipy.signal import lfilter

import tests.support.arm_oracle as oracle
from tests.support.model_harness import CompiledModel

STEP, BANDWIDTH = 1e-3, 30.0


def axes(q):
    """Tool axes in the base frame: ez along the moving forearm's normal direction dx/dq3, ex across, ey = ez x ex."""
    jacobian = oracle.jacobian(q)
    ez, ex = jacobian[:, 2] / np.linalg.norm(jacobian[:, 2]), jacobian[:, 0] / np.linalg.norm(jacobian[:, 0])
    return np.column_stack([ex, np.cross(ez, ex), ez])


def test_tool_frame_is_that_of_taatis_eq_21():
    random = np.random.default_rng(1)
    for _ in range(20):
        q = oracle.random_pose(random)
        q[0] = abs(q[0])
        r, c, s = 0.215 * np.cos(q[1]) + 0.17 * np.sin(q[2]), np.cos(q[1] - q[2]), np.sin(q[1] - q[2])
        frame = axes(q) * np.array([np.sign(r), np.sign(r), 1])
        assert np.allclose(
            frame.T @ oracle.jacobian(q), [[r, 0, 0], [0, 0.215 * c, 0], [0, -0.215 * s, 0.17]], atol=1e-15
        )


def experiment(n: int = 3000):
    """The arm on its in-device spring under a hand's force (held over steps); the observer sees q, dq and the motors'
    torque."""
    t = np.arange(n) * STEP
    force = np.column_stack([1.0 * np.sin(6 * t), 0.8 * np.cos(4 * t), 0.9 * np.sin(8 * t + 1)])
    friction = {"viscous": [1e-3] * 3, "coulomb": [5e-3] * 3, "coulomb_velocity": [0.1] * 3}
    start, x_ref = np.array([0.1, 0.3, 0.5]), oracle.position([0.1, 0.3, 0.5])
    arm = CompiledModel(
        "PhantomArm",
        q_start=start,
        stiffness=[20.0] * 3,
        damping=[1.0] * 3,
        gravity_compensation=1,
        internal_steps=4,
        **friction,
    )
    arm["x_ref"] = x_ref
    run = arm.start().run(n, STEP, {"x_ref": x_ref, "f": force}, ("q", "dq", "tau_motor"))
    watcher = CompiledModel("ForceObserver", bandwidth=BANDWIDTH, **friction)
    watcher["q"], watcher["tau"] = start, oracle.bias(start, np.zeros(3))
    seen = watcher.start().run(
        n, STEP, {"q": run["q"], "dq": run["dq"], "tau": run["tau_motor"]}, ("f", "f_tool", "f_static", "valid")
    )
    return run, seen, force


def test_estimate_is_the_true_force_through_the_filter():
    """J' f_hat = L{J' f}: both sides filtered by scipy (held force, first order exact for steps)."""
    run, seen, force = experiment()
    poses = np.vstack([[0.1, 0.3, 0.5], run["q"]])
    decay = np.exp(-BANDWIDTH * STEP)
    middle = [
        0.5 * (oracle.jacobian(a) + oracle.jacobian(b)).T @ f for a, b, f in zip(poses, poses[1:], force, strict=False)
    ]
    torque = lfilter([1 - decay], [1, -decay], np.array(middle), axis=0)
    found = np.array([oracle.jacobian(q).T @ f for q, f in zip(run["q"], seen["f"], strict=True)])
    start = 800  # the filters start from different values: exp(-30 * 0.8) = 4e-11 remains
    # the observer joins samples by lines: H^2/12 times second derivatives of tau (0.3 N m at 10 rad/s plus friction's
    # reversals,
    # 5e-3 N m within 0.1 rad/s), so a few 1e-6 N m; the torques are 0.2 N m
    assert np.abs(found - torque)[start:].max() < 2e-5 and np.abs(torque).max() > 0.1


def test_sign_and_frames():
    _, seen, force = experiment()
    run, _, _ = experiment()
    slow = lfilter([1 - np.exp(-BANDWIDTH * STEP)], [1, -np.exp(-BANDWIDTH * STEP)], force, axis=0)
    for i in range(
        3
    ):  # positive correlation: the hand's force on the device, not the device's on the hand (Eq. 20 as printed)
        assert np.corrcoef(seen["f"][500:, i], slow[500:, i])[0, 1] > 0.95
    for k in range(0, 3000, 300):
        assert np.allclose(seen["f_tool"][k], axes(run["q"][k]).T @ seen["f"][k], atol=1e-13)


def test_the_model_is_worth_its_gravity():
    """At rest: without the model the estimate is off by J^-T N exactly, with it by nothing."""
    q, force = np.array([0.2, 0.4, 0.6]), np.array([0.3, -0.2, 0.1])
    tau = oracle.bias(q, np.zeros(3)) - oracle.jacobian(q).T @ force
    m = CompiledModel("ForceObserver", bandwidth=100.0)
    m["q"], m["tau"] = q, tau
    seen = m.start().run(10, STEP, {"q": q, "tau": tau}, ("f", "f_static", "f_static_tool"))
    assert np.abs(seen["f"][-1] - force).max() < 1e-14
    missing = np.linalg.solve(oracle.jacobian(q).T, oracle.bias(q, np.zeros(3)))
    assert np.abs(seen["f_static"][-1] - (force - missing)).max() < 1e-13 and np.abs(missing).max() > 0.05
    assert np.abs(axes(q).T @ seen["f_static"][-1] - seen["f_static_tool"][-1]).max() < 1e-13


def test_upside_down():
    q = np.array([0.2, 0.4, 0.6])
    m = CompiledModel("ForceObserver", mounting=2)
    m["q"], m["tau"] = q, -oracle.bias(q, np.zeros(3))
    assert np.abs(m.start()["f"]).max() < 1e-14


@pytest.mark.parametrize("q", [[0, 0.0, np.pi / 2], [0, np.pi / 2, 0.0]])
def test_singular_poses_hold_the_last_estimate(q):
    m = CompiledModel("ForceObserver")
    m["q"], m["tau"] = [0, 0.3, 0.4], [0.01, 0.02, 0.03]
    m.start()
    before = m["f"]
    seen = m.run(5, STEP, {"q": np.array(q), "tau": np.ones(3)}, ("f", "valid"))
    assert m["valid"] == 0 and (seen["f"][-1] == before).all()
