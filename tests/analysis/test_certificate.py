"""Certificates: the multipliers' inequality on random laws, the checker on falsified files, known loops as oracles."""

import json
from fractions import Fraction

import attrs
import numpy as np
import pytest

from cosim.analysis.certificate import Certificate, Multiplier, certificate_of
from cosim.analysis.criteria import closed_form
from cosim.analysis.delay_grid import DelayGrid, uniform_grid
from cosim.analysis.proof import positive_definite, proven
from cosim.analysis.response import Response
from cosim.analysis.sampled_loop import SampledLoop
from cosim.errors import InputError
from tests.support.tip_loops import TipSide, axis_loop, difference_loop

SIDE = TipSide(mass=0.051, stiffness=0.25, damping=0.09)
STEP = 0.001


@pytest.fixture(scope="module")
def certificate() -> Certificate:
    """Equal sides of 51 g, independent laws up to 0.395 s (delay sum: 0.360 s)."""
    from cosim.analysis.multiplier import certify

    found = certify([axis_loop(SIDE, SIDE, STEP)], uniform_grid(395, 8))
    assert found is not None
    return found[0]


def simulated(loop: SampledLoop, ages: np.ndarray, drive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x (channels, k) and w of the loop under given ages (channels, k), driven by an addition to w; at rest before."""
    steps = ages.shape[1]
    x, w = np.zeros((loop.channels, steps + 1)), np.zeros((loop.channels, steps))
    state = np.zeros(len(loop.transition))
    for k in range(steps):
        w[:, k] = [x[c, max(k - ages[c, k], 0)] - x[c, k] for c in range(loop.channels)]
        push = w[:, k] + drive[:, k]
        x[:, k + 1] = x[:, k] + loop.moved @ state + loop.moved_now @ push
        state = loop.transition @ state + loop.drive @ push
    return x, w


def test_loop_without_delay_is_the_arm_between_springs():
    """w = 0: the distance of the tips follows m e'' + B e' + 2 K e = 0, held forces apart (first order in the step)."""
    poles = np.roots([SIDE.mass, SIDE.damping, 2 * SIDE.stiffness])
    found = np.linalg.eigvals(difference_loop(SIDE, 1e-5).transition)
    np.testing.assert_allclose(np.sort_complex(np.log(found) / 1e-5), np.sort_complex(poles), rtol=1e-4)


def test_pair_holds_the_distance_and_both_velocities():
    """The free pair's modes are those of the distance and the damped common motion."""
    both = np.linalg.eigvals(axis_loop(SIDE, SIDE, STEP).transition)
    alone = [*np.linalg.eigvals(difference_loop(SIDE, STEP).transition), 1 - SIDE.damping * STEP / SIDE.mass]
    np.testing.assert_allclose(np.sort_complex(both), np.sort_complex(np.array(alone)), rtol=1e-9)


def test_a_grid_bounds_the_distance_from_the_chord():
    """On random signals and random laws sum r^2 <= R sum (Delta^2 x)^2, with R not more than 100 times what is seen."""
    rng = np.random.default_rng(1)
    grid = DelayGrid([0], [[0, 9, 17, 24]])
    most = 0.0
    for smooth in (1, 3, 8):
        x = np.convolve(rng.standard_normal(3000), np.ones(smooth), "same")
        x[:100] = x[-100:] = 0.0
        bend = np.sum((x[2:] - 2 * x[1:-1] + x[:-2]) ** 2)
        chords = [np.abs(x[30 - d : len(x) - d] - chord(x, d)) for d in range(25)]
        most = max(most, np.sum(np.max(chords, axis=0) ** 2) / bend)
    assert most <= float(grid.rests()[0]) <= 100 * most


def chord(x: np.ndarray, d: int) -> np.ndarray:
    knots = np.array([0, 9, 17, 24])
    k = max(np.searchsorted(knots, d, "right") - 1, 0)
    if k == 3:
        return x[30 - 24 : len(x) - 24]
    part = (d - knots[k]) / (knots[k + 1] - knots[k])
    return (1 - part) * x[30 - knots[k] : len(x) - knots[k]] + part * x[30 - knots[k + 1] : len(x) - knots[k + 1]]


def test_positive_definite_is_exact():
    third = Fraction(1, 3)
    assert positive_definite([[third, third], [third, third + Fraction(1, 10**40)]])
    assert not positive_definite([[third, third], [third, third]])
    assert not positive_definite([[third, third], [third, third - Fraction(1, 10**40)]])


def test_certificate_is_proven_and_survives_as_text(certificate):
    assert certificate.max_delay == pytest.approx(0.395) and proven(certificate).holds
    assert certificate_of(json.loads(json.dumps(certificate.to_dict()))) == certificate


def test_multiplier_is_never_negative_on_what_a_law_makes(certificate):
    """The inequality of the theorem, summed in the time domain for random laws, on a signal made by the loop."""
    rng = np.random.default_rng(2)
    grid, multiplier = certificate.grid, certificate.multipliers[0]
    for interval in (1, 40, 400):
        ages = np.repeat(rng.integers(0, grid.most + 1, (2, 4000 // interval)), interval, axis=1)
        drive = np.zeros_like(ages, dtype=float)
        drive[:, 500:900] = rng.standard_normal((2, 400))
        x, w = simulated(certificate.loop, ages, drive)
        x = x[:, :-1]
        x = np.pad(x, ((0, 0), (1000, 0)))
        w = np.pad(w, ((0, 0), (1000, 0)))
        for c in range(2):
            k = np.arange(1000, x.shape[1])
            rows = np.array([*(w[c, k - lift] for lift in grid.lifts), *(x[c, k - p] - x[c, k] for p in grid.points)])
            form = np.einsum("ik,ij,jk->", rows, multiplier.form, rows)
            rest = float(multiplier.rests @ np.array(grid.rests(), dtype=float)) * np.sum(np.diff(x[c], 2) ** 2)
            assert form + rest >= 0.0


@pytest.mark.parametrize(
    ("falsify", "condition"),
    [
        (lambda m: Multiplier(-m.form, m.rests), "concave"),
        (lambda m: Multiplier(m.form - 0.1 * np.eye(len(m.form)), m.rests), "no delay law"),
        (lambda m: Multiplier(m.form + 0.1 * np.eye(len(m.form)), 1e3 + m.rests), "frequency"),
    ],
)
def test_a_falsified_certificate_is_refused(certificate, falsify, condition):
    wrong = attrs.evolve(certificate, multipliers=[falsify(m) for m in certificate.multipliers])
    failed = [check.condition for check in proven(wrong).checks if not check.holds]
    assert any(condition in name for name in failed)


def test_a_certificate_of_another_loop_is_refused(certificate):
    """The same multipliers on half the damping: the constant delay itself destroys that loop."""
    loose = attrs.evolve(SIDE, damping=0.045)
    assert closed_form(loose.mass, loose.stiffness, loose.damping) < certificate.max_delay
    assert not proven(attrs.evolve(certificate, loop=axis_loop(loose, loose, STEP))).holds


def test_no_certificate_beyond_the_boundary_of_constant_delays():
    """144 g: a constant 0.390 s each way destroys the loop, so no multiplier may serve 0.392 s."""
    from cosim.analysis.multiplier import certify

    heavy = attrs.evolve(SIDE, mass=0.144)
    assert closed_form(heavy.mass, heavy.stiffness, heavy.damping) == pytest.approx(0.390, abs=5e-4)
    assert certify([difference_loop(heavy, STEP)], uniform_grid(392, 8)) is None


def test_a_law_that_changes_slowly_is_always_between_the_knots_that_are_looked_at():
    """Random laws, rounded to whole steps: both ages lie in segments whose corners are among the choices."""
    rng = np.random.default_rng(4)
    for slope in (0.05, 0.4, 1.5):
        grid = uniform_grid(100, 5, {2: 1}, slope)
        choices = set(grid._choices())
        assert len(choices) < 36 if slope < 1.0 else len(choices) <= 36
        for _ in range(20):
            law, pace = [float(rng.integers(0, 101))], 0.0
            for _ in range(400):
                pace = slope * float(rng.choice([-1.0, 1.0])) if rng.integers(40) == 0 else pace
                law.append(float(np.clip(law[-1] + pace, 0.0, 100.0)))
            ages = np.rint(law).astype(int)
            for k in range(grid.lifts[1], len(ages)):
                cell = [min(int(ages[k - lift]) // 20, 4) for lift in grid.lifts]
                assert {(cell[0] + i, cell[1] + j) for i in (0, 1) for j in (0, 1)} <= choices
    assert len(uniform_grid(100, 5, {2: 1})._choices()) == 36


@pytest.mark.slow
def test_laws_that_change_slowly_are_proven_where_any_law_is_not():
    """51 g, 0.424 s: at any speed there is no certificate of this family, at 0.1 s a second there is."""
    from cosim.analysis.multiplier import certify

    loop = difference_loop(SIDE, 0.004)
    found = certify([loop], uniform_grid(106, 8, {4: 1}, 0.1))
    assert found is not None and proven(found[0]).holds
    assert certify([loop], uniform_grid(106, 8, {4: 1})) is None
    any_speed = attrs.evolve(found[0], grid=attrs.evolve(found[0].grid, slope=None))
    assert not proven(any_speed).holds
    assert certificate_of(json.loads(json.dumps(found[0].to_dict()))) == found[0]


def test_bad_grids_name_every_problem():
    with pytest.raises(InputError) as error:
        DelayGrid([0, 5, 3], [[0, 4], [0, 4, 4], [0, 5]])
    assert len(error.value.problems) == 3


def test_sides_that_differ_have_a_multiplier_each():
    """A hand on the local side: proven beyond the delay sum, for independent laws, with two multipliers."""
    from cosim.analysis.multiplier import certify

    held = attrs.evolve(SIDE, ground_stiffness=0.5, ground_damping=0.05)
    found = certify([axis_loop(held, SIDE, STEP)], uniform_grid(420, 8))
    assert found is not None and found[0].uses == (0, 1)
    assert proven(found[0]).holds


def test_loops_of_other_masses_share_their_multipliers():
    """Two axes of an arm: one search, a certificate of each, proven apart; heavier than both is not covered."""
    from cosim.analysis.multiplier import certify

    light = attrs.evolve(SIDE, mass=0.033)
    found = certify([axis_loop(side, side, STEP) for side in (SIDE, light)], uniform_grid(395, 8))
    assert found is not None and found[0].multipliers == found[1].multipliers
    assert all(proven(certificate).holds for certificate in found)
    heavy = attrs.evolve(SIDE, mass=0.4)
    assert closed_form(heavy.mass, heavy.stiffness, heavy.damping) < found[0].max_delay
    assert not proven(attrs.evolve(found[0], loop=axis_loop(heavy, heavy, STEP))).holds


@pytest.mark.parametrize("w", [0.003, 0.1, 1.0, 2.5])
def test_enclosures_of_form_and_slope_hold_what_floats_say(certificate, w):
    """On an interval about w, against the form in numpy and its difference quotient."""
    response = Response(certificate)
    middle, reach = response._interval(Fraction(w) - Fraction(1, 10**7), Fraction(w) + Fraction(1, 10**7))
    value, slope = response._form(middle + reach, response._increments(middle + reach))
    exact = form_of(certificate, w)
    quotient = (form_of(certificate, w + 1e-5) - form_of(certificate, w - 1e-5)) / 2e-5
    apart = [[abs(found[i, j] - complex(expected[i, j])) for found, expected in ((value, exact), (slope, quotient))]
             for i, j in np.ndindex(2, 2)]  # fmt: skip
    sizes = np.array([np.abs(exact).max(), np.abs(quotient).max()])
    assert np.all(np.array([[float(one.abs_lower()) for one in row] for row in apart]) <= 1e-6 * sizes)
    assert np.all(np.array([[float(one.rad()) for one in row] for row in apart]) < 0.1 * sizes)


def form_of(certificate, w):
    """F(w) by numpy, (2, 2)."""
    loop, grid = certificate.loop, certificate.grid
    moved, z = loop.increments([w])[0], np.exp(1j * w)
    back = -np.array([np.sum(z ** -np.arange(1, point + 1)) for point in grid.points])
    total = np.zeros((2, 2), complex)
    for c, multiplier in enumerate(certificate.multipliers[g] for g in certificate.uses):
        late = z ** -np.array(grid.lifts, dtype=float)
        phi = np.vstack([np.outer(late, np.eye(2)[c]), np.outer(back, moved[c])])
        bend = (1.0 - 1.0 / z) * moved[c]
        rest = float(multiplier.rests @ np.array(grid.rests(), dtype=float))
        total += phi.conj().T @ multiplier.form @ phi + rest * np.outer(bend.conj(), bend)
    return total


def test_where_the_loop_is_quiet_the_form_is_negative_whatever_the_phases(certificate):
    """The bound by sizes alone agrees with the form on the way, and does not hold where the loop answers."""
    response = Response(certificate)

    def quiet(low, high):
        return response._quiet(low, high, response._increments(sum(response._interval(low, high)))[0])

    assert quiet(Fraction(1), Fraction(3, 2)) and quiet(Fraction(3), Fraction(22, 7))
    assert not quiet(Fraction(1, 100), Fraction(1, 80))
    for w in np.linspace(1.0, 1.5, 50):
        assert np.linalg.eigvalsh(form_of(certificate, w)).max() < 0.0
