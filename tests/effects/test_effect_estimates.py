"""Parameters of effects from closed forms along a prescribed motion: no plant is simulated, and the equations are
written here.
"""

from functools import cache

import numpy as np
import pytest
from attrs import evolve

import tests.support.arm_oracle as oracle
from cosim.closure.closure import Options, close_loop
from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.families import hats
from cosim.closure.model.model import complete, with_choices, with_friction
from cosim.closure.model.motion import prepare, thinned
from cosim.closure.model.setting import formulate
from cosim.closure.score.errors import torque_error
from cosim.closure.score.screen import Screen, Screened
from cosim.closure.score.search import refined, resettled
from cosim.closure.verdict import intervals
from cosim.effects import BUILT_IN, EffectEstimate
from cosim.measured import Label, Recording, RecordingDescription, Run

SEED = 1
RATES = np.array(((0.7, 1.9, 3.1, 4.3), (0.9, 1.6, 2.9, 4.7), (0.8, 2.1, 3.4, 4.1)))
COULOMB, VISCOUS = np.array((0.025, 0.009, 0.009)), np.array((2e-3, 1.5e-3, 1e-3))
COUPLED, TURNS = (1e-3, 2e-3), 0.01  # N.m.s/rad and N.m on joint 1 from joint 2, and the speed over which that turns
STIFFNESS, DAMPING, PLACE = 5.0, 0.05, 0.07  # N/m, N.s/m, m
NORMAL = np.array((0.3, -0.2, 0.87**0.5))  # of the wall: between the directions that are tried first
LEVEL, SPEED = 6e-3, 0.15  # N.m, rad/s
DEAD = 1.8e-3  # N.m
SLOPE, CONSTANT = 0.02, 30.0  # 1/s, s: T the length of the recording, as the tool takes it


def motion(time):
    """q, dq, ddq (n, 3) of sums of sines."""
    size = np.array((0.3, 0.18, 0.18))[:, None] / np.arange(1, 5) ** 0.5
    phase = np.arange(12.0).reshape(3, 4) ** 2
    at = time[:, None, None] * RATES + phase
    q = (size * np.sin(at)).sum(axis=2) + np.array((0.0, 0.25, 0.35))
    return q, (size * RATES * np.cos(at)).sum(axis=2), -(size * RATES**2 * np.sin(at)).sum(axis=2)


def friction(dq):
    return VISCOUS * dq + COULOMB * np.tanh(dq / 0.05)


def coupling(time, q, dq, tau):
    return np.outer(COUPLED[0] * dq[:, 1] + COUPLED[1] * np.tanh(dq[:, 1] / TURNS), (1.0, 0.0, 0.0))


def wall(time, q, dq, tau):
    """J' n max(k d + c dd/dt, 0) of a wall before n.x = PLACE."""
    along = np.array([NORMAL @ oracle.jacobian(x) for x in q])
    depth, speed = np.array([NORMAL @ oracle.position(x) for x in q]) - PLACE, (along * dq).sum(axis=1)
    return along * np.where(depth > 0, np.maximum(STIFFNESS * depth + DAMPING * speed, 0.0), 0.0)[:, None]


def warming(time, q, dq, tau):
    return friction(dq) * (1, 0, 0) * SLOPE * CONSTANT * (1 - np.exp(-time / CONSTANT))[:, None]


def dead(time, q, dq, tau):
    """u - p of a command u with u - clip(u, -d, d) = p."""
    return np.sign(tau) * DEAD * (0, 0, 1)


@cache
def plain(seconds):
    """time, q, dq and the torque of the arm without an effect."""
    time = np.arange(0, seconds, 1e-3)
    q, dq, ddq = motion(time)
    rigid = np.array([oracle.mass(x) @ a + oracle.bias(x, v) for x, v, a in zip(q, dq, ddq, strict=True)])
    return time, q, dq, rigid + friction(dq)


def recorded(effect, seconds=30.0):
    time, q, dq, tau = plain(seconds)
    tau = tau + effect(time, q, dq, tau) + 1e-3 * np.random.default_rng(1).standard_normal(tau.shape)
    return Recording(RecordingDescription(), (Run("prescribed", time, q, tau, time >= seconds / 2),))


def low_speed(time, q, dq, tau):
    return np.outer(LEVEL * np.exp(-((dq[:, 0] / SPEED) ** 2)) * np.tanh(dq[:, 0] / 0.05), (1.0, 0.0, 0.0))


def whole_range(time, q, dq, tau):
    """The same curve falling over all speeds that are seen."""
    return np.outer(
        8 * LEVEL * np.exp(-((dq[:, 0] / (0.7 * np.abs(dq[:, 0]).max())) ** 2)) * np.tanh(dq[:, 0] / 0.05),
        (1.0, 0.0, 0.0),
    )


def half_range(time, q, dq, tau):
    """Between: its speed is two fifths of the largest one."""
    return np.outer(
        4 * LEVEL * np.exp(-((dq[:, 0] / (0.4 * np.percentile(np.abs(dq[:, 0]), 99))) ** 2)) * np.tanh(dq[:, 0] / 0.05),
        (1.0, 0.0, 0.0),
    )


def eddy(time, q, dq, tau):
    """Eddy currents: a drag that rises, and falls beyond a speed (Wouterse 1991)."""
    return np.outer(80e-3 * dq[:, 0] / (1 + (dq[:, 0] / 0.5) ** 2), (1.0, 0.0, 0.0))


def windage(time, q, dq, tau):
    """A drag by the cube of the speed."""
    return np.outer(8e-3 * dq[:, 0] ** 3, (1.0, 0.0, 0.0))


def square(time, q, dq, tau):
    return np.outer(20e-3 * dq[:, 0] * np.abs(dq[:, 0]), (1.0, 0.0, 0.0))


CASES = {
    "stribeck": (low_speed, (0,), {"stribeck[1]": LEVEL, "stribeck_velocity[1]": SPEED}),
    "joint_coupling": (coupling, (0,), {"coupling_viscous[1]": COUPLED[0], "coupling_coulomb[1]": COUPLED[1]}),
    "external_contact": (
        wall,
        (0, 1, 2),
        {
            "contact_stiffness": STIFFNESS,
            "contact_damping": DAMPING,
            **{f"contact_normal[{k + 1}]": float(x) for k, x in enumerate(NORMAL)},
            "contact_distance": PLACE,
        },
    ),
    "friction_drift": (warming, (0,), {"friction_drift[1]": SLOPE, "friction_drift_time[1]": CONSTANT}),
    "torque_deadband": (dead, (2,), {"torque_deadband[3]": DEAD}),
}


@pytest.mark.parametrize("name", CASES)
def test_parameters_are_in_their_intervals(name):
    make, joints, truth = CASES[name]
    recording = recorded(make)
    rows = prepare(recording)
    before = complete(formulate(recording, rows, thinned(rows)))
    effect = next(e for e in BUILT_IN if e.name == name)
    candidate = Screen(before, robust=False).of(effect, joints)
    assert isinstance(candidate, Screened)
    after = resettled(with_choices(before, (refined(candidate),)))
    choice, part = after.choices[0], after.coefficients(0)
    assert not effect.unphysical(
        EffectEstimate(after.fit.beta[part], after.fit.std[part], choice.theta, joints, after.scene)
    )
    values, interval = intervals(after, 0)
    for parameter, true in truth.items():
        label = Label.read(parameter)
        low, high = interval[label]
        assert low - 1e-3 * abs(true) <= true <= high + 1e-3 * abs(true), (parameter, values[label], low, high)
        assert high - low < 0.6 * abs(true), (
            parameter
        )  # the interval says something; a drift's slope is known to a quarter either way
    error = torque_error(before, after)
    assert error.after[joints[0]] < 0.5 * error.before[joints[0]]


def test_a_wall_acts_on_the_joints_that_feel_it():
    """One below pushes along the vertical, y, about which joint 1 turns; one before z is felt by all."""
    recording = recorded(wall, seconds=12.0)
    rows = prepare(recording)
    before = complete(formulate(recording, rows, thinned(rows)))
    effect = next(e for e in BUILT_IN if e.name == "external_contact")
    places = {(0.0, -1.0, 0.0): (1, 2), (0.0, 0.0, 1.0): (0, 1, 2)}
    tips = np.array([oracle.position(x) for x in motion(np.arange(0, 12, 0.05))[0]])
    for normal, joints in places.items():
        theta = (*normal, float(np.percentile(tips @ normal, 60)), 0.01)
        assert with_choices(before, (ChosenEffect(effect, (0, 1, 2), theta),)).acting(0) == joints


@pytest.mark.parametrize("law", [whole_range, eddy])
def test_a_curve_over_all_speeds_is_no_sure_stribeck(law):
    """A friction curve is needed; where the closest law is told beside it, its level is that of the family."""
    verdict = close_loop(recorded(law, 20.0), Options(replayed=False)).verdict
    assert all(f.level == "family" and "unknown" in f.aliases for f in verdict.findings)
    assert verdict.leftovers[0].signals == ("dq1",)


def test_a_curve_whose_end_is_hardly_seen_is_still_one_of_the_low_speeds():
    """It does as well as any friction curve over the speeds that are there."""
    (found,) = close_loop(recorded(half_range, 20.0), Options(replayed=False)).verdict.findings
    assert (found.name, found.joints) == ("stribeck", (1,))


def test_a_drag_of_another_power_is_no_sure_quadratic_one():
    """By the cube of the speed: a friction curve does better than the square; a true square needs no other."""
    cube, plain = (close_loop(recorded(law, 20.0), Options(replayed=False)).verdict for law in (windage, square))
    assert all("unknown" in f.aliases for f in cube.findings)
    assert "dq1" in cube.leftovers[0].signals
    assert [(f.name, f.doubts) for f in plain.findings] == [("quadratic_drag", ())]


def test_a_curve_of_the_low_speeds_is_called_stribeck_for_sure():
    verdict = close_loop(recorded(low_speed, 20.0), Options(replayed=False)).verdict
    assert [(f.name, f.joints) for f in verdict.findings] == [("stribeck", (1,))]
    assert "unknown" not in verdict.findings[0].aliases


def test_hats_hold_every_straight_line_and_go_straight_on():
    """Otherwise the model's own linear term, left to the rows beyond the last knot, would do anything there."""
    knots, x = np.array((-1.0, 0.2, 0.5, 3.0)), np.linspace(-5, 5, 101)
    np.testing.assert_allclose(hats(x, knots, straight_on=True) @ (2 * knots + 1), 2 * x + 1, atol=1e-12)
    np.testing.assert_allclose(hats(x, knots) @ (2 * knots + 1), 2 * np.clip(x, -1, 3) + 1, atol=1e-12)
    np.testing.assert_allclose(hats(x, knots).sum(axis=1), 1)


def test_columns_follow_the_friction_law_of_their_own_model():
    """Not that of a model with the same law whose columns were still those of the law before."""
    recording = recorded(low_speed, 6.0)
    rows = prepare(recording)
    choice = ChosenEffect(next(e for e in BUILT_IN if e.name == "position_friction"), (0,), (2.0,))
    first = with_choices(complete(formulate(recording, rows, thinned(rows))), (choice,))
    other = with_friction(first, 0, evolve(first.laws[0], width=3 * first.laws[0].width))
    np.testing.assert_array_equal(other.columns[0][0], first.columns[0][0])  # until it is asked for again
    again = with_choices(other, (choice,))
    np.testing.assert_array_equal(again.columns[0][0], again.formed_now(choice, again.scene)[0])
    assert np.abs(again.columns[0][0] - first.columns[0][0]).max() > 0.01
