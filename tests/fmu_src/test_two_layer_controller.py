"""Two layers: the books of energy close to rounding under any delay and loss; the tank grants no more than it has."""

import numpy as np
import pytest

from tests.support.model_harness import CompiledModel
from tests.support.teleoperator import teleoperate, vector

CHANNELS = [
    {"law": "constant", "delay_mean": 0.1},
    {"law": "uniform", "delay_max": 0.3, "delay_interval": 0.05, "semantics": "packet_order"},
    {"law": "square", "delay_max": 0.2, "semantics": "newest_packet", "loss_to_bad": 0.05, "loss_to_good": 0.2},
    {"law": "sawtooth", "delay_max": 0.3, "semantics": "transport_delay", "loss_good": 0.3},
]


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda c: c["law"])
@pytest.mark.parametrize("level", [0.0, 300.0])
def test_energy_is_accounted_for_whatever_the_channel_does(channel, level):
    """tanks + energy given to the arms + what is on its way = the initial energy; on its way is never less than 0."""
    ways = {f"channel_*.{k}": v for k, v in channel.items()}
    given = {"controller_l.level_gain": level, "controller_*.initial_energy": 0.05}
    result = teleoperate("TwoLayerController", ways | given, 3.0)
    tank, spent, sent = (
        [vector(result, f"controller_{side}.{name}")[:, 0] for side in "lr"] for name in ("tank", "spent", "sent[7]")
    )
    came = [np.maximum.accumulate(vector(result, f"channel_{way}.y[7]")[:, 0]) for way in ("rl", "lr")]
    books = []
    for lag in (0, 1):  # a packet is in the books of its receiver at this step or the next, by the order of stepping
        known = [np.concatenate([np.zeros(lag), c[: len(c) - lag]]) for c in came]
        books.append(sum(tank) + sum(spent) + sent[0] - known[1] + sent[1] - known[0] - 0.1)
        assert min((sent[0] - known[1]).min(), (sent[1] - known[0]).min()) > -1e-15
    assert min(np.abs(b).max() for b in books) < 1e-13
    assert max(np.abs(s).max() for s in spent) > 1e-4


@pytest.mark.parametrize("seed", range(3))
def test_no_more_is_given_than_the_tank_holds(seed):
    """Smooth random motion, held forces: the tank goes below zero by what the velocity changes in a step at most."""
    random = np.random.default_rng(seed)
    n, step = 4000, 1e-3
    t = np.arange(n + 1)[:, None] * step
    rate, phase = random.uniform(1.0, 8.0, 3), random.uniform(0.0, 6.0, 3)
    x, dx = 0.02 * np.sin(rate * t + phase), 0.02 * rate * np.cos(rate * t + phase)
    goal = 0.05 * np.sin(random.uniform(2.0, 9.0, 3) * t[1:])
    tank = CompiledModel("TwoLayerController", initial_energy=0.002, transfer=0.0, stiffness=100.0)
    tank["x"] = x[0]
    run = tank.start().run(n, step, {"x": x[1:], "dx": dx[1:], "x_received": goal}, ("tank", "f", "spent"))
    most = np.abs(run["f"]).max() * np.sqrt(3.0) * 0.02 * rate.max() ** 2 * step**2
    assert run["tank"].min() > -most
    given = np.concatenate([[0.0], np.cumsum((run["f"][:-1] * np.diff(x[1:], axis=0)).sum(axis=1))])
    assert np.abs(given - run["spent"][:, 0]).max() < 1e-15
    assert given.max() < 0.002 + most and given.max() > 0.0005


def test_without_energy_there_is_no_force_and_the_level_controller_finds_some():
    """Empty tanks grant nothing: the remote arm stays. The local damper fills them from the hand, and it follows."""
    apart = []
    for level in (0.0, 500.0):
        given = {"controller_l.level_gain": level, "arm_r.contact_stiffness": 0.0, "arm_r.contact_damping": 0.0}
        result = teleoperate("TwoLayerController", given, 4.0)
        apart.append(vector(result, "arm_l.x")[-1, 0] - vector(result, "arm_r.x")[-1, 0])
    assert apart[0] == pytest.approx(0.03, abs=1e-4)
    assert abs(apart[1]) < 1e-3


def test_it_stays_stable_where_its_transparency_layer_alone_does_not():
    """The same spring across 0.3 s, with little damping to the ground: alone it runs away, with tanks not."""
    given = {"channel_*.delay_mean": 0.3, "controller_*.damping": 0.02, "controller_*.derivative_gain": 0.0}
    alone = teleoperate("PDLikeController", given, 8.0)
    both = teleoperate("TwoLayerController", given | {"controller_l.level_gain": 100.0}, 8.0)
    late = [np.abs(vector(r, "arm_r.dq")[-1000:]).max() for r in (alone, both)]
    assert late[0] > 5.0 > 0.5 > late[1]
