"""Model-mediated: the wall is found, felt without delay, and a model that changes never pushes the hand."""

import numpy as np
import pytest

from tests.support.model_harness import CompiledModel
from tests.support.teleoperator import SIDES, teleoperate, vector

STEP = 1e-3


@pytest.mark.parametrize("stiffness", [200.0, 1000.0])
def test_the_wall_is_found(stiffness):
    """Normal along x; the place is known to the motion of a step, 0.2 mm, which makes the stiffness come out lower; the
    force of the model where the tip is, is that of the wall.
    """
    given = SIDES | {"arm_r.contact_stiffness": stiffness}
    result = teleoperate("ModelMediatedController", given, 4.0)
    normal, (offset, found) = (
        vector(result, "controller_r.sent[7]"),
        (vector(result, f"controller_r.sent[{k}]")[-1, 0] for k in (10, 11)),
    )
    assert normal[-1, 0] == pytest.approx(-1.0, abs=1e-12)
    assert -0.015 <= offset < -0.015 + 2e-4
    depth = offset + vector(result, "arm_r.x")[-1, 0]
    assert found * depth == pytest.approx(-vector(result, "arm_r.f_contact")[-1, 0], rel=1e-3)
    assert found == pytest.approx(stiffness * (depth - offset - 0.015) / depth, rel=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_a_model_that_changes_never_pushes_the_hand(seed):
    """Stiffness and place at random while a hand moves at random: it gets no energy, but what a held force of k d gives
    in a step, k dx^2 / 2 at most.
    """
    random = np.random.default_rng(seed)
    n = 6000
    t = np.arange(n)[:, None] * STEP
    place = 0.03 * np.sin(random.uniform(1.0, 9.0) * t) + 0.01 * np.sin(random.uniform(10.0, 30.0) * t)
    x = np.hstack([place, np.zeros((n, 2))])
    change = np.repeat(random.uniform(size=(n // 60, 2)), 60, axis=0)
    received = {
        "normal_received": np.tile([-1.0, 0.0, 0.0], (n, 1)),
        "offset_received": 0.03 * (change[:, :1] - 0.5),
        "wall_stiffness_received": 100.0 + 900.0 * change[:, 1:],
    }
    one = CompiledModel("ModelMediatedController", side=1, damping=0.0, rendered_damping=0.0).start()
    run = one.run(n, STEP, {"x": x} | received, ("f", "depth"))
    moved = np.diff(place[:, 0])
    energy = np.cumsum(run["f"][:-1, 0] * moved)
    leak = np.cumsum(0.5 * received["wall_stiffness_received"][:-1, 0] * moved**2)
    assert (energy <= leak + 1e-12).all()
    assert run["depth"].max() > 1e-3 and energy.min() < -1e-3


@pytest.mark.parametrize("delay", [0.02, 0.3])
def test_no_delay_destroys_it(delay):
    given = {"channel_*.delay_mean": delay, "controller_*.damping": 0.5}
    result = teleoperate("ModelMediatedController", SIDES | given, 5.0)
    late = np.abs(np.hstack([vector(result, "arm_l.dq")[-500:], vector(result, "arm_r.dq")[-500:]])).max()
    assert late < 1e-3


def test_before_the_first_contact_is_known_the_hand_goes_through():
    """What the method gives up: the hand passes the wall by its way in a round trip and feels it only from there."""
    deep = []
    for delay in (0.01, 0.15):
        result = teleoperate("ModelMediatedController", SIDES | {"channel_*.delay_mean": delay}, 3.0)
        deep.append(vector(result, "arm_l.x")[:, 0].max() - 0.015)
    assert deep[1] > 2 * deep[0] > 0.0
