"""Adaptive synchronisation: the law in a second writing, Lyapunov's sum, where the arms come to rest."""

import numpy as np
import pytest

from cosim.arm.dynamics import coriolis_matrix, gravity_torque, mass_matrix
from cosim.arm.parameters import parameter_set
from tests.support.model_harness import CompiledModel
from tests.support.teleoperator import RELEASED, teleoperate, vector

PI = parameter_set("segment").pi
NAMES = ("q", "dq", "q_received", "dq_received")


@pytest.mark.parametrize("law", [1, 2])
def test_torque_and_adaptation_against_the_arm_model_in_numpy(law):
    """tau = g - lambda (M de + C e) + drive and estimate' = Gamma Phi' s, with matrices of cosim.arm, 50 states."""
    random = np.random.default_rng(law)
    slope, gain, damping = 3.0, 0.4, 0.2
    for _ in range(50):
        q, dq, far, speed = random.uniform(-0.6, 0.6, (4, 3))
        theta = random.standard_normal(8) * np.abs(PI)
        one = CompiledModel("AdaptiveController", law=law, slope=slope, gain=gain, damping=damping)
        one["estimate_start"] = theta
        for name, value in zip(NAMES, (q, dq, far, speed)):
            one[name] = value
        one.start().rates()
        e, de = (q - far, dq - speed) if law == 2 else (q, dq)

        def phi(p: np.ndarray) -> np.ndarray:
            return slope * (mass_matrix(p, q) @ de + coriolis_matrix(p, q, dq) @ e) - gravity_torque(p, q)

        s = dq + slope * e
        drive = -gain * s - damping * de if law == 2 else gain * (speed + slope * far - s)
        columns = np.column_stack([phi(unit) for unit in np.eye(8)])
        assert np.abs(one["tau"] - (drive - phi(theta))).max() < 1e-14
        assert np.abs(one["der_estimate"] - one["adaptation"] * (columns.T @ s)).max() < 1e-14


def settled(law: str, delay: float, stop: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Angles of both arms (n, 3), their estimates (n, 16), the step; gravity unknown, released from two poses."""
    given = RELEASED | {
        "controller_*.law": law,
        "controller_*.gain": 0.1,
        "controller_*.damping": 0.05,
        "controller_*.adaptation": [1e-3] * 6 + [0.5, 0.5],
        "arm_*.gravity_compensation": False,
        "arm_l.q_start": [0.0, 0.45, 0.6],
        "arm_r.q_start": [0.1, 0.3, 0.4],
        "channel_*.delay_mean": delay,
        "experiment.extrapolation": "linear",
    }
    result = teleoperate("AdaptiveController", given, stop)
    assert result.outcome.value == "bounded", result.message
    return vector(result, "arm_l.q"), vector(result, "arm_r.q"), vector(result, "arm_l.dq"), result.time[1]


@pytest.mark.parametrize("delay", [0.05, 0.4])
def test_errors_converge_over_a_constant_delay_without_knowing_the_arm(delay):
    """Nuno, Ortega and Basanez: both arms meet and rest, under gravity, with an estimate that began at nothing."""
    left, right, speed, _ = settled("nuno", delay, 12.0)
    apart = np.abs(left - right).max(axis=1)
    assert apart[-1] < 2e-3 < 0.02 < apart[0]
    assert np.abs(speed[-500:]).max() < 2e-3


def test_chopra_and_spong_lead_the_arms_to_zero_under_gravity():
    """They meet too, but only where the loaded joints are at q = 0: what their successors name as its limit."""
    left, right, _, _ = settled("chopra_spong", 0.05, 40.0)
    rest, _, _, _ = settled("nuno", 0.05, 12.0)
    assert np.abs(left - right)[-1].max() < 5e-3
    assert np.abs(left[-1, 1:]).max() < 0.02 < 0.1 < np.abs(rest[-1, 1:]).max()


def test_lyapunovs_sum_never_grows():
    """V' = - sum (K |s|^2 + B |de|^2 / 2) for constant delay; V from the simulated loop, exact arm, gravity on."""
    given = RELEASED | {
        "arm_*.gravity_compensation": False,
        "controller_*.gain": 0.1,
        "controller_*.damping": 0.05,
        "arm_l.q_start": [0.0, 0.45, 0.6],
        "arm_r.q_start": [0.1, 0.3, 0.4],
        "channel_*.delay_mean": 0.1,
        "experiment.extrapolation": "linear",
        "experiment.record": ["controller_*.estimate"],
    }
    result = teleoperate("AdaptiveController", given, 2.0)
    step, slope, damping, lag = 1e-3, 2.0, 0.05, 100
    gamma = np.array([1e-3] * 6 + [0.05, 0.05])
    total = np.zeros(len(result.time))
    for side, way in (("l", "rl"), ("r", "lr")):
        q, dq = vector(result, f"arm_{side}.q"), vector(result, f"arm_{side}.dq")
        far, estimate = vector(result, f"channel_{way}.y"), vector(result, f"controller_{side}.estimate")
        e = q - far[:, :3]
        s = dq + slope * e
        kinetic = np.array([0.5 * b @ mass_matrix(PI, a) @ b for a, b in zip(q, s)])
        unknown = 0.5 * ((PI - estimate) ** 2 / gamma).sum(axis=1)
        past = np.concatenate([np.zeros(lag), np.cumsum((dq**2).sum(axis=1))]) * step
        flight = 0.5 * damping * (past[lag:] - past[: len(q)])
        total += kinetic + unknown + 0.5 * slope * damping * (e**2).sum(axis=1) + flight
    assert total[-1] < 0.9 * total[0]
    assert np.diff(total[::20]).max() < 1e-3 * (total[0] - total[-1])
