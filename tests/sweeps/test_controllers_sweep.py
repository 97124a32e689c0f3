"""The shipped comparison of controllers: every choice fits the scenario, gains keep the rules that its page gives."""

from collections.abc import Mapping

import numpy as np
import pytest

from cosim.arm.dynamics import tip_mass
from cosim.arm.parameters import parameter_set
from cosim.sweeps.campaign import every_choice, task_of
from cosim.sweeps.evaluate import cosimulation, setup
from cosim.sweeps.spec import load_sweep
from tests.benchmarks.controllers import FREQUENCY, controllers, in_the_hand

SPEC = load_sweep("controllers")
POINTS = every_choice(SPEC)
DELAY, STEP, STIFFNESS = 0.05, 1e-3, 50.0


@pytest.mark.parametrize("where", POINTS, ids=lambda p: " ".join(map(str, p.entries[:4])))
def test_every_choice_fits_the_scenario(where):
    wiring = setup(task_of(SPEC), where).wiring
    assert sum(link.source.component.startswith("channel") for link in wiring.links) >= 6
    assert not [warning for warning in wiring.warnings if "nothing feeds" in warning]


def chosen(label: str) -> Mapping[str, object]:
    """What a controller's choice sets, `controller_*.` left out."""
    choice = next(c for c in SPEC.axis("controller").choices if c.label == label)
    return {path.rpartition(".")[2]: value for path, value in choice.set.items()}


def test_gains_keep_the_rules_for_fifty_milliseconds():
    """P+d and PD+d: 4 B B > (T + T)^2 K K; gamma^2 <= 1 - dT/dt; position-force: 2 T share K < B."""
    for label in ("P+d", "PD+d"):
        assert 4 * chosen(label)["damping"] ** 2 > (2 * DELAY) ** 2 * STIFFNESS**2
    fastest = DELAY / float(SPEC.set["channel_*.delay_interval"])
    assert chosen("PD+d")["velocity_gain"] ** 2 <= 1.0 - fastest
    force = chosen("position-force")
    assert 2 * DELAY * force["force_gain"] * STIFFNESS < force["damping"]


def test_the_hand_feels_of_p_plus_d_what_its_equations_say():
    """One axis of two arms of mass m, 0.5 Hz: F/x = m s^2 + B s + K - (K e)^2 / (m s^2 + B s + K), e = exp(-s T).

    T is the channel's delay and the communication step that a sample waits for; the arms move little, so m stays.
    """
    mass = float(tip_mass(parameter_set("segment").pi, np.array([0.0, 0.3, 0.4]), np.array([1.0, 0.0, 0.0])))
    values = controllers()["P+d"]
    s = 2j * np.pi * FREQUENCY
    own = mass * s**2 + float(str(values["controller_*.damping"])) * s + STIFFNESS
    force = own - (STIFFNESS * np.exp(-s * (DELAY + STEP))) ** 2 / own
    damping, spring, _ = in_the_hand(values)
    assert damping == pytest.approx((force / s).real, rel=1e-3)
    assert spring == pytest.approx(force.real, rel=1e-2)


def test_a_point_is_carried_out():
    """The first point, P+d at the least delay without hand and wall: at rest soon."""
    (result,) = cosimulation(task_of(SPEC), [POINTS[0]])
    assert result.outcome == "converged" and np.isfinite(result.growth_rate)
