"""Four channels: transparent in the linear loop, to first order of the step in co-simulation, not with delay."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cosim.arm.dynamics import tip_inertia
from cosim.arm.parameters import parameter_set
from cosim.engine.master import run
from cosim.scenario import Scenario, load_scenario
from tests.support.model_harness import CompiledModel
from tests.support.teleoperator import teleoperate, vector

INPUTS = ("x", "dx", "f_ext", "x_received", "dx_received", "ddx_received", "f_received")
MASS, VISCOSITY = (0.06, 0.09), (0.3, 0.5)
SHARE = 0.6


def gains(side: int) -> dict[str, np.ndarray]:
    """Gains of the FMU's own law on axis 1: outputs f and ddx_sent by each input."""
    law = {"mass": MASS[side], "viscosity": VISCOSITY[side], "force_gain": (0.7, -0.4)[side], "stiffness": 40.0}
    one = CompiledModel("FourChannelController", derivative_gain=1.5, **law).start()
    found = {}
    for name in INPUTS:
        one[name] = [1.0, 0.0, 0.0]
        one.show()
        found[name] = np.array([one["f"][0], one["ddx_sent"][0]])
        one[name] = 0.0
    return found


@pytest.mark.parametrize("w", [0.1, 1.0, 10.0, 100.0])
def test_without_delay_the_hand_feels_the_wall_alone(w):
    """M s^2 x = f + f_ext - b s x on both sides, all exchanged at once: x_l = x_r and F_h = Z_e x, to rounding."""
    s = 1j * w
    wall, law = 300.0 + 2.0 * s, (gains(0), gains(1))
    # unknown: x_l, x_r, f_l, f_r, ddx_l, ddx_r for a hand's force of 1; f_ext,r = - wall x_r
    rows, right = np.zeros((6, 6), complex), np.zeros(6, complex)
    for i, j in ((0, 1), (1, 0)):
        own, g = np.zeros(6, complex), law[i]
        own[i] = -wall if i == 1 else 0.0
        other, push = (np.eye(6)[1] * -wall, 0.0) if i == 0 else (np.zeros(6), 1.0)
        rows[i, i] = MASS[i] * s**2 + VISCOSITY[i] * s
        rows[i, 2 + i] = -1.0
        rows[i] -= own
        right[i] = 1.0 if i == 0 else 0.0
        for row, k in ((2 + i, 0), (4 + i, 1)):
            rows[row, row] += 1.0
            rows[row, i] -= g["x"][k] + s * g["dx"][k]
            rows[row, j] -= g["x_received"][k] + s * g["dx_received"][k]
            rows[row, 4 + j] -= g["ddx_received"][k]
            rows[row] -= g["f_ext"][k] * own + g["f_received"][k] * other
            right[row] = g["f_ext"][k] * (1.0 if i == 0 else 0.0) + g["f_received"][k] * push
    x = np.linalg.solve(rows, right)
    rounding = 1e-13 * np.linalg.cond(rows)
    assert rounding < 1e-6
    assert abs(x[0] / x[1] - 1.0) < rounding
    assert abs(x[0] * wall - 1.0) < rounding


def tip_masses() -> np.ndarray:
    """Masses of the tip at q = 0 along x, y, z, (3,) kg: J M^-1 J' is diagonal there."""
    return 1.0 / np.diag(tip_inertia(parameter_set("segment").pi, np.zeros(3)))


def small_loop(step: float) -> Scenario:
    """The scenario at q = 0, where the tip's mass is diagonal, without delay: a hand led 10 um into a soft wall that
    begins at the tip.
    """
    mass = tip_masses()
    given = {
        "controller_*.model": "FourChannelController",
        "controller_*.mass": mass.tolist(),
        "controller_*.acceleration_share": SHARE,
        "controller_*.derivative_gain": 2.0,
        "controller_*.stiffness": 50.0,
        "channel_*.delay_mean": 0.0,
        "arm_*.q_start": 0.0,
        "arm_r.contact_distance": 0.0,
        "arm_r.contact_stiffness": 50.0,
        "arm_r.contact_damping": 10.0,
        "operator.reference": [1e-5, 0.0, 0.0],
        "experiment.step": step,
        "experiment.stop": 0.6,
        "experiment.record_every": 1,
    }
    return load_scenario("controllers").with_values(given)


def ideal(t: np.ndarray, mass: float) -> np.ndarray:
    """Tip position where hand, wall and the mass (1 - c) M are all there is.

    0.3 x_h'' = 50 (r - x_h) - 5 x_h' - p, p = 300 (x_h - x) + 3 (x_h' - x'), (1 - c) M x'' = p - 50 x - 10 x'.
    """

    def slope(_: float, y: np.ndarray) -> list[float]:
        hand, hand_speed, tip, speed = y
        grip = 300.0 * (hand - tip) + 3.0 * (hand_speed - speed)
        pull = 50.0 * (1e-5 - hand) - 5.0 * hand_speed - grip
        return [hand_speed, pull / 0.3, speed, (grip - 50.0 * tip - 10.0 * speed) / ((1.0 - SHARE) * mass)]

    return solve_ivp(slope, (0.0, t[-1]), [0.0] * 4, "Radau", t_eval=t, rtol=1e-10, atol=1e-17).y[2]


def test_co_simulation_comes_to_it_in_first_order_of_the_step():
    """A communication step in the way of the acceleration: the error halves with the step."""
    mass, errors = float(tip_masses()[0]), []
    for step in (1e-3, 5e-4, 2.5e-4):
        result = run(small_loop(step))
        tip = vector(result, "arm_l.x")[:, 0]
        errors.append(np.abs(tip - ideal(result.time, mass)).max() / tip.max())
    ratios = [a / b for a, b in pairwise(errors)]
    assert errors[0] < 0.05
    assert all(1.7 < ratio < 2.3 for ratio in ratios), (errors, ratios)


def test_the_full_share_does_not_bear_a_step_however_small():
    """a(k+1) = a(k) - (b/M) v(k): |z|^2 = 1 + b H / M, a growth of b/2M = 84 1/s for the dampers of 13 N s/m together.

    Dampers are in series with springs, so the true rate is lower; what counts is that it does not fall with the step.
    """
    rates = []
    for step in (1e-3, 5e-4):
        given = {"controller_*.acceleration_share": 1.0, "experiment.stop": 0.3}
        speed = np.abs(vector(run(small_loop(step).with_values(given)), "arm_l.dx")[:, 0])
        before, after = np.array_split(speed, 6)[3], np.array_split(speed, 6)[5]
        rates.append(np.log(after.max() / before.max()) / 0.1)
    assert 20.0 < rates[0] < 84.0
    assert rates[1] > 0.9 * rates[0]


@pytest.mark.parametrize(("delay", "rests"), [(0.0, True), (0.02, False)])
def test_delay_takes_its_stability(delay, rests):
    """Lawrence: the most transparent architecture bears the least delay. 20 ms each way, without acceleration."""
    result = teleoperate("FourChannelController", {"channel_*.delay_mean": delay}, 4.0)
    late = np.abs(vector(result, "arm_r.dq")[-500:]).max()
    assert late < 1e-3 if rests else late > 0.5
