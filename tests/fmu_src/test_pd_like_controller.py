"""PD+d: the law, P+d as its special case, the exact condition for constant delay, the bound on the velocity gain."""

import numpy as np
import pytest

from cosim.analysis.spectrum import DelaySystem, abscissa
from tests.support.model_harness import CompiledModel
from tests.support.teleoperator import RELEASED, teleoperate, vector

STEP = 1e-3


def motion(seed: int, n: int = 200) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    names = ("x", "dx", "q", "dq", "x_received", "dx_received", "q_received", "dq_received")
    return {name: random.standard_normal((n, 3)) for name in names}


@pytest.mark.parametrize("space", [1, 2])
def test_without_velocities_it_is_the_controller_of_the_papers_to_the_bit(space):
    given, gains = (
        motion(1),
        {"stiffness": [1.0, 2.0, 3.0], "damping": 0.3, "joint_stiffness": 0.7, "joint_damping": 0.1},
    )
    none = {"derivative_gain": 0.0, "joint_derivative_gain": 0.0}
    pd = CompiledModel("PDLikeController", space=space, **gains, **none).start().run(200, STEP, given, ("f", "tau"))
    own = {k: v for k, v in given.items() if "received" not in k}
    own |= {"x_ref": given["x_received"], "q_ref": given["q_received"]}
    p = CompiledModel("PLikeController", space=space, **gains).start().run(200, STEP, own, ("f", "tau"))
    assert (pd["f"] == p["f"]).all() and (pd["tau"] == p["tau"]).all() and pd["f tau".split()[space - 1]].any()


def worst(k: float, d: float, delay: float) -> tuple[float, float, float]:
    """B of the exact condition B + D >= max of |g|, g(a) = D cos a - K T sin(a)/a; where |g| is greatest for a >= 0.2
    (smaller a belong to masses without end); the sign of g there.
    """
    a = np.linspace(1e-3, 20 * np.pi, 400_000)
    g = d * np.cos(a) - k * delay * np.sin(a) / a
    at = int(np.argmax(np.where(a < 0.2, 0.0, np.abs(g))))
    return float(np.abs(g).max()) - d, float(a[at]), float(np.sign(g[at]))


def rate(mass: float, k: float, d: float, b: float, delay: float, sign: float) -> float:
    """Greatest growth rate of m x'' + (B + D) x' + K x = sign (K x + D x')(t - T): equal sides moving with or against
    each other.
    """
    own = np.array([[0.0, 1.0], [-k / mass, -(b + d) / mass]])
    other = sign * np.array([[0.0, 0.0], [k / mass, d / mass]])
    return abscissa(DelaySystem((own, other), (0.0, delay)))


CASES = [(50.0, 0.5, 0.05), (50.0, 3.0, 0.05), (200.0, 2.5, 0.02)]


@pytest.mark.parametrize(("k", "d", "delay"), CASES)
def test_the_exact_condition_for_constant_delay(k, d, delay):
    """A root i w, a = w T, wants B + D = +-g and m = (K -+ (K cos a + D w sin a)) / w^2.

    With B + D above the greatest |g| no mass has one; 3 % below, the mass that belongs to the greatest grows.
    """
    least, a, sign = worst(k, d, delay)
    w = a / delay
    mass = (k - sign * (k * np.cos(a) + d * w * np.sin(a))) / w**2
    assert least > 0.0 and mass > 0.0
    assert rate(mass, k, d, 1.03 * least, delay, sign) < 1e-7
    assert rate(mass, k, d, 0.97 * least, delay, sign) > 1e-4


def test_without_velocities_it_is_the_sum_condition():
    """D = 0: B = K T, which is 4 B B = (T + T)^2 K K; the papers' T^2 + T^2 would allow K T / sqrt 2."""
    assert worst(50.0, 0.0, 0.05)[0] == pytest.approx(50.0 * 0.05, rel=1e-6)
    printed = 50.0 * 0.05 / np.sqrt(2.0)
    assert max(rate(m, 50.0, 0.0, 1.05 * printed, 0.05, -1.0) for m in (0.5, 2.0)) > 1e-3


def test_much_damping_between_the_arms_needs_little_to_the_ground():
    """B = (K T)^2 / (2 pi^2 D) for D well above K T: |g| near a = pi, where D cos a bends as D (a - pi)^2 / 2."""
    k, delay = 50.0, 0.05
    for d in (10.0, 40.0):
        assert worst(k, d, delay)[0] == pytest.approx((k * delay) ** 2 / (2 * np.pi**2 * d), rel=0.1)


@pytest.mark.parametrize(("gamma", "passive"), [(1.0, False), (np.sqrt(0.7), True)])
def test_the_velocity_gain_is_bounded_by_the_rate_of_the_delay(gamma, passive):
    """Motion like itself: dx = (t + c)^(-1/2) is seen (1 - r)^(-1/2) times larger over a delay T0 + r t, c = T0/r.

    The damper between the arms then feeds energy in where gamma > sqrt(1 - r), here r = 0.3.
    """
    n, first, rate = 1000, 0.01, 0.3
    t = np.arange(1, n + 1) * STEP
    speed = np.repeat((t + first / rate)[:, None] ** -0.5, 3, axis=1)
    sent = np.zeros((n, 12))
    sent[:, 3:6] = speed
    law = {"law": 5, "delay_min": first, "delay_max": first + rate, "delay_period": 1.0, "interpolation": 2}
    come = CompiledModel("PacketChannel", **law).start().run(n, STEP, {"u": sent}, ("y",))["y"][:, 3:6]
    gains = {"stiffness": 0.0, "damping": 0.0, "derivative_gain": 1.0, "velocity_gain": gamma}
    force = (
        CompiledModel("PDLikeController", **gains).start().run(n, STEP, {"dx": speed, "dx_received": come}, ("f",))["f"]
    )
    taken = np.cumsum(-(force * speed)[:, 0]) * STEP
    assert (taken[-1] > 0.0) == passive
    assert passive or taken[-1] < -0.1


@pytest.mark.parametrize(("damping", "settles"), [(3.0, True), (0.3, False)])
def test_on_the_arms_inside_and_outside_of_the_condition(damping, settles):
    """K = 50 N/m, D = 0, T = 50 ms, two arms without hand and wall: B = K T = 2.5 N s/m."""
    given = {"controller_*.derivative_gain": 0.0, "controller_*.damping": damping, "channel_*.delay_mean": 0.05}
    result = teleoperate("PDLikeController", RELEASED | given | {"arm_l.dq_start": [0.05, 0.05, 0.05]}, 3.0)
    speed = np.linalg.norm(np.hstack([vector(result, "arm_l.dq"), vector(result, "arm_r.dq")]), axis=1)
    late, early = speed[-300:].max(), speed[300:600].max()
    assert late < 0.1 * early if settles else late > 2 * early
