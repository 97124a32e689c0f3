"""The time-domain passivity approach: observed energy is never negative, whatever is delayed and lost."""

import numpy as np
import pytest

from cosim.engine.master import Result
from tests.support.model_harness import CompiledModel
from tests.support.teleoperator import RELEASED, SIDES, teleoperate, vector

STEP = 1e-3
CHANNELS = {
    "constant": {"law": "constant", "delay_mean": 0.15},
    "sinusoidal": {"law": "sinusoidal", "delay_max": 0.3},
    "uniform": {"law": "uniform", "delay_max": 0.3, "delay_interval": 0.05},
    "random_walk": {"law": "random_walk", "delay_max": 0.3, "delay_interval": 0.001},
    "sawtooth": {"law": "sawtooth", "delay_max": 0.4},
    "square": {"law": "square", "delay_max": 0.3, "delay_period": 0.7},
}


def coupled(channel: dict[str, object], **more: object) -> Result:
    """A run over a channel, with more parameters of both controllers."""
    ways = {f"channel_*.{k}": v for k, v in channel.items()} | {f"controller_*.{k}": v for k, v in more.items()}
    return teleoperate("PassivityController", SIDES | ways, 3.0)


def observed(result: Result) -> np.ndarray:
    """Observed energies of both ports, (n, 2)."""
    return np.hstack([vector(result, f"controller_{side}.energy") for side in "lr"])


@pytest.mark.parametrize("semantics", ["time_delay", "transport_delay", "newest_packet", "packet_order"])
@pytest.mark.parametrize("law", CHANNELS)
def test_observed_energy_is_never_negative_under_any_delay_and_loss(law, semantics):
    """Bursts of loss on both ways. To rounding of the sums."""
    loss = {"semantics": semantics, "loss_to_bad": 0.02, "loss_to_good": 0.1}
    energy = observed(coupled(CHANNELS[law] | loss))
    assert energy.min() > -1e-15 and energy.max() > 1e-4


def test_without_the_controller_it_becomes_negative():
    assert observed(coupled(CHANNELS["constant"], active=False)).min() < -1e-3


@pytest.mark.parametrize("seed", range(4))
def test_against_an_adversary_by_separate_books(seed):
    """Motion and packets at random; the energy let out, from force and motion alone, stays below what came."""
    random = np.random.default_rng(seed)
    n = 2000
    given = {name: 0.1 * random.standard_normal((n, 3)) for name in ("x", "dx", "dx_received", "f_received")}
    came = np.maximum.accumulate(np.cumsum(1e-5 * random.random(n)) - 1e-4 * random.random(n)).clip(0.0)[:, None]
    shown = came - 1e-4 * random.random((n, 1))  # old packets among new ones
    known = np.maximum.accumulate(shown, axis=0)[:, 0].clip(0.0)
    local = CompiledModel("PassivityController", side=1, damping=0.3).start()
    f = local.run(n, STEP, given | {"energy_received": shown}, ("f",))["f"]
    out = np.cumsum(STEP * np.maximum((f * given["dx"]).sum(axis=1), 0.0))
    assert (out <= known + 1e-15).all() and out[-1] > 0.5 * known[-1]
    k, d = 50.0, 1.0
    remote = CompiledModel("PassivityController", side=2, damping=0.0, stiffness=k, derivative_gain=d).start()
    f = remote.run(n, STEP, given | {"energy_received": shown}, ("f",))["f"]
    desired, out = np.zeros(3), [0.0]
    for force, x, dx in zip(f, given["x"], given["dx"]):
        flow = (force - k * (desired - x)) / d + dx  # of f = K (x_d - x) + D (v - dx)
        desired = desired + STEP * flow
        out.append(out[-1] + STEP * max(float(force @ flow), 0.0))
    assert (np.array(out[1:]) <= known + 1e-12).all() and out[-1] > 0.5 * known[-1]


def test_a_reference_share_is_kept_back():
    result = coupled(CHANNELS["constant"], reference=0.3)
    kept = observed(result)
    came = np.maximum.accumulate(result.signals["channel_lr.y[7]"])
    assert (kept[1:, 1] >= 0.3 * came[:-1] - 1e-15).all() and came[-1] > 1e-4


def test_the_reference_position_drifts_and_a_first_motion_needs_the_local_damper():
    """Free motion of 30 mm over 150 ms: corrected velocities leave the remote tip behind; without correction none is
    left. With B = 0 locally no energy goes in, and nothing moves.
    """
    free = SIDES | {"channel_*.delay_mean": 0.15} | {k: v for k, v in RELEASED.items() if k.startswith("arm_r")}
    apart = []
    for active, damping in ((True, 1.0), (False, 1.0), (True, 0.0)):
        given = free | {"controller_*.active": active, "controller_l.damping": damping}
        result = teleoperate("PassivityController", given, 5.0)
        apart.append(vector(result, "arm_l.x")[-1, 0] - vector(result, "arm_r.x")[-1, 0])
    assert abs(apart[0]) > 1e-3 > 10 * abs(apart[1])
    assert apart[2] == pytest.approx(0.03, abs=1e-4)
