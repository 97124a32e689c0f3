"""Wave variables: the energy of a channel is that of the waves in flight, matched ports do not reflect, the filter."""

import numpy as np
import pytest

from tests.support.model_harness import CompiledModel
from tests.support.teleoperator import RELEASED, teleoperate, vector

STEP, IMPEDANCE = 1e-3, 2.0


def waves(given: dict[str, object], stop: float) -> tuple[np.ndarray, ...]:
    """Sent to the right, come there, sent to the left, come there, each (n, 3), N."""
    result = teleoperate("WaveController", given, stop)
    names = ("controller_l.sent", "channel_lr.y", "controller_r.sent", "channel_rl.y")
    right, there, left, here = (vector(result, name) for name in names)
    return right, there, left, here


def energy(right: np.ndarray, there: np.ndarray, left: np.ndarray, here: np.ndarray) -> np.ndarray:
    """What went into the channel less what came out [J]: H / 4b sum (|sent|^2 - |come|^2)."""
    power = sum((sent**2 - come**2).sum(axis=1) for sent, come in ((right, there), (left, here)))
    return np.cumsum(power) * STEP / (4 * IMPEDANCE)


def lag(sent: np.ndarray, come: np.ndarray) -> int:
    """Steps by which every sample comes later, exactly."""
    fits = [n for n in range(2000) if (come[n:] == sent[: len(sent) - n]).all() and sent[: len(sent) - n].any()]
    return fits[0]


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.7])
def test_the_energy_of_a_channel_is_that_of_the_waves_in_flight(delay):
    """(1/4b) int_(t-T)^t |w|^2, which is never negative: passive for a constant delay of any size. To rounding."""
    right, there, left, here = waves({"channel_*.delay_mean": delay}, 3.0)
    found = energy(right, there, left, here)
    flight = np.zeros(len(found))
    for sent, come in ((right, there), (left, here)):
        n = lag(sent, come)
        assert n in (round(delay / STEP), round(delay / STEP) + 1)
        total = np.concatenate([np.zeros(n), np.cumsum((sent**2).sum(axis=1))])
        flight += (total[n:] - total[: len(found)]) * STEP / (4 * IMPEDANCE)
    total = (right**2).sum() * STEP / (4 * IMPEDANCE)
    assert total > 1e-4
    assert np.abs(found - flight).max() < 1e-12 * total
    assert found.min() > -1e-12 * total


def test_a_varying_delay_loses_the_theorem():
    """A delay that grows by r stretches a wave to 1/(1 - r) of its length: r/(1 - r) of its energy comes out too much.

    r = 0.3, a wave of 0.3 s; rounding to samples is one of 300 at either end.
    """
    sent = np.zeros((1000, 12))
    sent[50:350, :3] = 1.0
    law = {"law": 5, "delay_min": 0.01, "delay_max": 0.31, "delay_period": 1.0, "interpolation": 2}
    come = CompiledModel("PacketChannel", **law).start().run(1000, STEP, {"u": sent}, ("y",))["y"]
    nothing = np.zeros((1000, 3))
    found = energy(sent[:, :3], come[:, :3], nothing, nothing)
    in_all = (sent**2).sum() * STEP / (4 * IMPEDANCE)
    assert found[-1] == pytest.approx(-0.3 / 0.7 * in_all, rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_a_matched_port_sends_nothing_back(seed):
    """A locked arm, no spring: D = b reflects nothing; another D reflects (b - D)/(b + D) of the wave."""
    come = np.random.default_rng(seed).standard_normal((50, 3))
    for d in (IMPEDANCE, 0.5, 7.0):
        port = CompiledModel("WaveController", impedance=IMPEDANCE, derivative_gain=d, stiffness=0.0).start()
        back = port.run(50, STEP, {"wave_received": come}, ("wave_sent",))["wave_sent"]
        assert np.abs(back - (IMPEDANCE - d) / (IMPEDANCE + d) * come).max() < 1e-14


def test_power_through_the_port_is_that_of_its_waves():
    """f dx_p = (w_in^2 - w_out^2) / 4b whatever spring, damper and motion."""
    random = np.random.default_rng(1)
    come, dx = random.standard_normal((2, 300, 3))
    port = CompiledModel("WaveController", impedance=IMPEDANCE, stiffness=80.0, derivative_gain=0.7).start()
    run = port.run(300, STEP, {"wave_received": come, "dx": dx}, ("f", "wave_sent"))
    speed = (come + run["wave_sent"]) / (2 * IMPEDANCE)
    assert np.abs(run["f"] * speed - (come**2 - run["wave_sent"] ** 2) / (4 * IMPEDANCE)).max() < 1e-12


def test_the_filter_is_of_first_order():
    """A step of the wave on a locked, matched port: f = (1 - exp(-bandwidth t)) / 2.

    Runge-Kutta 4 errs by 0.2^5/120 of what is left, each step: 5 exp(-1) of that at most after five.
    """
    port = CompiledModel("WaveController", impedance=2.0, derivative_gain=2.0, stiffness=0.0, bandwidth=200.0).start()
    f = port.run(100, STEP, {"wave_received": np.ones((100, 3))}, ("f",))["f"][:, 0]
    assert np.abs(f - 0.5 * (1 - np.exp(-200.0 * np.arange(1, 101) * STEP))).max() < 4e-6


@pytest.mark.parametrize(("model", "dies_out"), [("WaveController", True), ("PDLikeController", False)])
def test_released_arms_over_a_long_delay(model, dies_out):
    """0.3 s each way, K = 50 N/m, B = 0.2 N s/m: a spring across the channel makes motion grow, one at a port not."""
    given = {"channel_*.delay_mean": 0.3, "controller_*.damping": 0.2, "arm_l.dq_start": [0.02, 0.02, 0.02]}
    more = {"controller_*.derivative_gain": 0.0} if model == "PDLikeController" else {}
    result = teleoperate(model, RELEASED | given | more, 6.0)
    speed = np.abs(np.hstack([vector(result, "arm_l.dq"), vector(result, "arm_r.dq")])).max(axis=1)
    assert (speed[-600:].max() < 0.3 * speed[600:1200].max()) == dies_out
