"""The inverse dynamics controller: its law in numpy, and the linear error that an exact model leaves."""

import numpy as np

import tests.support.arm_oracle as oracle
from tests.support.model_harness import CompiledModel

FRICTION = {"viscous": [1e-3, 2e-3, -1e-3], "coulomb": [0.02, 0.01, 0.009]}


def test_its_law():
    random = np.random.default_rng(1)
    gains = {"proportional_gain": [100.0, 625, 1200], "derivative_gain": [14.0, 35, 80]}
    for mounting, sign in ((1, 1), (2, -1)):
        pi = oracle.PI * np.array([1] * 6 + [sign] * 2)
        m = CompiledModel(
            "InverseDynamicsController", mounting=mounting, friction_fraction=0.5, **FRICTION, **gains
        ).start()
        for _ in range(50):
            q, dq, q_ref, dq_ref, ddq_ref = oracle.random_pose(random), *random.uniform(-1, 1, (4, 3))
            m.run(1, 1e-3, {"q": q, "dq": dq, "q_ref": q_ref, "dq_ref": dq_ref, "ddq_ref": ddq_ref})
            wanted = ddq_ref + np.array([14, 35, 80]) * (dq_ref - dq) + np.array([100, 625, 1200]) * (q_ref - q)
            friction = FRICTION["viscous"] * dq + FRICTION["coulomb"] * dq / np.sqrt(dq**2 + 1e-4)
            expected = oracle.mass(q, pi) @ wanted + oracle.bias(q, dq, pi) + 0.5 * friction
            assert np.abs(m["tau"] - expected).max() < 1e-13 * np.abs(expected).max() + 1e-15


def test_torque_limit():
    m = CompiledModel("InverseDynamicsController", torque_limit=[0.01, 0.0, 1e3]).start()
    m.run(1, 1e-3, {"q_ref": [1.0, 1.0, 1.0]})
    assert m["tau"][0] == 0.01 and m["tau"][1] > 0.1 and m["limited"] == 1


def closed_loop(step: float, **model) -> np.ndarray:
    """Error of a step command of 0.2 rad over 0.3 s, controller and arm alternating."""
    n = round(0.3 / step)
    start, goal = np.array([0.1, 0.3, 0.4]), np.array([0.3, 0.5, 0.2])
    arm = CompiledModel("PhantomArm", q_start=start, **model).start()
    control = CompiledModel("InverseDynamicsController", friction_fraction=1.0, **model)
    control["q"], control["q_ref"] = start, goal
    control.start()
    errors = []
    for _ in range(n):
        arm.run(1, step, {"tau": control["tau"]})
        control.run(1, step, {"q": arm["q"], "dq": arm["dq"], "q_ref": goal})
        errors.append(goal - arm["q"])
    return np.array(errors)


def test_an_exact_model_leaves_a_linear_decoupled_error():
    """e'' + 35 e' + 625 e = 0 in every joint; sampling at H moves it by order H, so halving H halves the difference."""
    apart = []
    for step in (1e-3, 5e-4):
        t = np.arange(1, round(0.3 / step) + 1) * step
        w = np.sqrt(625 - 17.5**2)
        exact = np.exp(-17.5 * t) * (np.cos(w * t) + 17.5 / w * np.sin(w * t))
        error = closed_loop(step, viscous=[2e-3] * 3) / np.array([0.2, 0.2, -0.2])
        apart.append(np.abs(error - exact[:, None]).max())
    assert apart[0] < 35e-3 and 1.7 < apart[0] / apart[1] < 2.3, apart
