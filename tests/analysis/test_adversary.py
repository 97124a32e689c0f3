"""Destroying laws: a worst case that can be written down by hand, constant delays, and simulation of the law."""

import numpy as np
import pytest

from cosim.analysis import adversary
from cosim.analysis.adversary import DelayLaw, coarser, destroying_law, under
from cosim.analysis.criteria import closed_form
from cosim.analysis.sampled_loop import SampledLoop
from cosim.analysis.slow_laws import slow_law
from cosim.errors import InputError
from tests.support.tip_loops import TipSide, axis_loop, difference_loop

STEP = 0.002


def side(mass: float) -> TipSide:
    return TipSide(mass, stiffness=0.25, damping=0.09)


def held_peak(tip: TipSide, delay: float, step: float) -> tuple[float, float]:
    """Next extreme of the tips' distance from 1 at rest, and its time [s], when the delay shows the peak while it can.

    Written down without the search: after a peak the delay grows with time, so that the peak stays in sight, up to its
    bound; then it stays there until the motion turns. m e'' + B e' + K e = -K e(t - min(t, T)).
    """
    past, v, late = [1.0], 0.0, round(delay / step)
    while len(past) < 3 or v < 0.0:
        force = -tip.stiffness * (past[max(len(past) - 1 - late, 0)] + past[-1]) - tip.damping * v
        past.append(past[-1] + step * v + step**2 / (2 * tip.mass) * force)
        v += step / tip.mass * force
    return past[-1], (len(past) - 1) * step


def grown(loop: SampledLoop, law: DelayLaw, periods: int) -> float:
    """Growth rate [1/s] of a simulation under a law: ln of the largest distance, last period against four before."""
    ages = np.tile(law.ages, periods)
    steps, period = ages.shape[1], law.ages.shape[1]
    x, state = np.zeros((loop.channels, steps + 1)), np.linspace(1.0, 0.5, len(loop.transition))
    for k in range(steps):
        w = np.array([x[c, max(k - ages[c, k], 0)] - x[c, k] for c in range(loop.channels)])
        x[:, k + 1] = x[:, k] + loop.moved @ state + loop.moved_now @ w
        state = loop.transition @ state + loop.drive @ w
    distance = np.abs(np.diff(x, axis=1)).max(axis=0)
    early, late = periods - 5, periods - 1
    tops = [distance[turn * period : (turn + 1) * period].max() for turn in (early, late)]
    return float(np.log(tops[1] / tops[0]) / ((late - early) * period * law.step))


def test_constant_delay_has_the_boundary_of_the_closed_form():
    """Under a constant delay the Floquet multiplier crosses one at T*, half a step earlier by the hold."""
    tip = side(0.144)
    boundary = closed_form(tip.mass, tip.stiffness, tip.damping) - 0.5 * STEP
    loop = difference_loop(tip, STEP)
    rates = [
        under(loop, np.full((1, 5), k)).growth_rate for k in (round(boundary / STEP) - 1, round(boundary / STEP) + 1)
    ]
    assert rates[0] < 0.0 < rates[1]


def test_growth_of_many_motions_that_grow_alike():
    """Seven pairs of eigenvalues within 0.6 % of one another, as an arm of many joints has: powers do not part them."""
    random, sizes = np.random.default_rng(3), np.linspace(0.984, 0.99, 7)
    turn = np.linalg.qr(random.normal(size=(14, 14)))[0]
    whole = np.zeros((14, 14))
    for k, (size, angle) in enumerate(zip(sizes, np.linspace(0.1, 1.3, 7))):
        c, s = size * np.cos(angle), size * np.sin(angle)
        whole[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[c, -s], [s, c]]
    motion, gain = adversary.grown(turn @ whole @ turn.T)
    assert gain == pytest.approx(0.99, rel=1e-9)
    assert np.linalg.norm((turn.T @ motion)[:12]) < 1e-6


def test_a_law_on_the_distance_is_the_same_law_both_ways():
    rng = np.random.default_rng(3)
    ages = np.repeat(rng.integers(0, 60, (1, 8)), 15, axis=1)
    tip = side(0.051)
    both = under(axis_loop(tip, tip, 0.01), np.vstack([ages, ages]))
    assert both.growth_rate >= under(difference_loop(tip, 0.01), ages).growth_rate - 1e-9


def test_search_finds_the_held_peak():
    """The smallest bound agrees, to a step, with that of the law written down by hand; and it grows in simulation."""
    tip = side(0.144)
    loop = difference_loop(tip, STEP)
    law = destroying_law(loop, (0,), 180, 210)
    assert law is not None and law.growth_rate > 0.0
    bounds = np.arange(0.370, 0.400, STEP)
    by_hand = next(t for t in bounds if abs(held_peak(tip, t, STEP)[0]) > 1.0)
    assert abs(law.ages.max() - round(by_hand / STEP)) <= 1
    assert law.max_delay < closed_form(tip.mass, tip.stiffness, tip.damping) - STEP
    assert grown(loop, law, 100) == pytest.approx(law.growth_rate, abs=1e-5)  # other modes have died out by then


def test_a_slow_law_stays_within_its_slope_and_comes_no_later_than_a_constant_delay():
    """51 g, steps of 4 ms: the law found changes by its slope at most, grows, and its bound is that of a constant delay
    at the latest.
    """
    tip, step = side(0.051), 0.004
    loop = difference_loop(tip, step)
    constant = int(np.ceil(closed_form(tip.mass, tip.stiffness, tip.damping) / step))
    for slope in (0.05, 0.9):
        law = slow_law(loop, (0,), slope, 80, constant + 2)
        assert law is not None and law.growth_rate > 0.0 and law.ages.max() <= constant
        twice = np.tile(law.ages[0], 3)
        for k in range(1, law.ages.shape[1]):
            assert np.abs(twice[k:] - twice[:-k]).max() <= slope * k + 1.0 + 1e-9
    assert slow_law(loop, (0,), 0.05, 80, 89) is None


def test_nothing_destroys_a_loop_below_the_delay_sum():
    """B / K = 0.36 s is sufficient for every law (Nuno et al. 2009)."""
    tip = side(0.051)
    assert destroying_law(difference_loop(tip, 0.004), (0,), 40, 88) is None


def test_coarser_steps_are_steps_together():
    """With w held, ten steps of the loop are one step of the coarser one: response at the lowest frequency."""
    loop = axis_loop(side(0.051), side(0.1), STEP)
    slow = np.array([1e-5])
    np.testing.assert_allclose(coarser(loop, 10).increments(10 * slow), 10 * loop.increments(slow), rtol=1e-3)
    np.testing.assert_allclose(coarser(loop, 10).transition, np.linalg.matrix_power(loop.transition, 10), rtol=1e-12)


def test_trace_repeats_the_law():
    law = DelayLaw([[0, 1, 2], [5, 5, 4]], STEP, 1.2)
    expected = [[0, 0, 5], [1, 1, 5], [2, 2, 4], [3, 0, 5]]
    np.testing.assert_allclose(law.trace(0.006), np.array(expected) * STEP)
    assert law.max_delay == pytest.approx(0.010) and law.growth_rate == pytest.approx(np.log(1.2) / 0.006)


def test_bad_laws_and_sides_are_named():
    with pytest.raises(InputError, match="2 channels"):
        under(axis_loop(side(0.1), side(0.1), STEP), [[1, 2, 3]])
    with pytest.raises(InputError, match="mass > 0"):
        TipSide(0.0, 0.25, 0.09)
