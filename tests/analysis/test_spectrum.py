"""Own spectrum against the closed form and two outside packages (tdcpy, qpmr: GPL, test-only) on random loops."""

import numpy as np
import pytest
import qpmr
import tdcpy

from cosim.analysis.criteria import closed_form
from cosim.analysis.spectrum import (
    DelayFamily,
    DelaySystem,
    abscissa,
    chebyshev,
    count_right,
    max_delay,
    position_loop,
    root_rate,
    roots,
)


def random_sides(rng, equal):
    """Mass, stiffness, damping of both sides: mu from 0.52 to 100, six decades of time scales."""
    lanes = 1 if equal else 2
    stiffness, damping = 10 ** rng.uniform(-1, 2, lanes), 10 ** rng.uniform(-1, 1, lanes)
    mass = 10 ** rng.uniform(np.log10(0.52), 2, lanes) * damping**2 / stiffness
    return tuple(np.broadcast_to(part, 2) for part in (mass, stiffness, damping))


def outside(system, above, discretization=30):
    """Roots by tdcpy with Im >= 0, the ones its Newton left unconverged dropped by the residual of the characteristic
    matrix.
    """
    delays, index = np.unique(system.delays, return_inverse=True)
    stacked = np.stack(
        [sum(system.matrices[i] for i in np.flatnonzero(index == k)) for k in range(len(delays))], axis=2
    )
    with np.errstate(all="ignore"):
        found, _ = tdcpy.roots(tdcpy.RDDE(stacked, delays), r=above, discretization=discretization)
    norm = max(np.linalg.norm(matrix, 2) for matrix in system.matrices)
    found = [s for s in found if abs(s) < 1e3 * norm]
    small = [np.linalg.svd(system.characteristic(s), compute_uv=False)[-1] < 1e-10 * (norm + abs(s)) for s in found]
    return np.array(found, complex)[np.array(small, bool)]


def _deviation(system, rate, scale, nodes):
    """Deviation of tdcpy's rightmost root, the neutral one left out, on a discretisation of its: from some guesses its
    Newton
    runs to another root, and one is then missing (1 of 1000 loops; the other discretisation finds it)."""
    theirs = outside(system, min(rate, 0.0) - 0.1 * scale, nodes)
    return abs(theirs[np.abs(theirs) > 1e-6 * scale].real.max() - rate) / max(1.0, scale)


def compare(rng, count, equal):
    """Largest deviation of abscissa from tdcpy's, relative to the size of the rightmost root."""
    worst = 0.0
    for _ in range(count):
        mass, stiffness, damping = random_sides(rng, equal)
        family = position_loop(mass, stiffness, damping)
        delay = max_delay(family) * rng.uniform(0.2, 3.0)
        system = family.at(delay)
        own = roots(system)
        scale = np.abs(own).max()
        rate = abscissa(system)
        found = _deviation(system, rate, scale, 30)
        worst = max(worst, found if found < 1e-9 else _deviation(system, rate, scale, 60))
    return worst


def closed_form_deviation(rng, count):
    """Largest relative deviation of max_delay from the closed form, and of tdcpy's from it (its root near the axis, one
    Newton step).
    """
    own, theirs = 0.0, 0.0
    for _ in range(count):
        mass, stiffness, damping = random_sides(rng, True)
        exact = closed_form(mass[0], stiffness[0], damping[0])
        family = position_loop(mass, stiffness, damping)
        own = max(own, abs(max_delay(family) / exact - 1.0))
        frequency = damping[0] / mass[0] * np.sqrt(2 * mass[0] * stiffness[0] / damping[0] ** 2 - 1)
        found = outside(family.at(exact), -0.2 * frequency)
        root = found[np.argmin(np.abs(found - 1j * frequency))]
        theirs = max(theirs, abs(root.real / root_rate(family, exact, root).real) / exact)
    return own, theirs


def test_abscissa_agrees_with_tdcpy_to_1e_9():
    assert compare(np.random.default_rng(1), 60, equal=False) < 1e-9


def test_boundary_agrees_with_the_closed_form_and_tdcpy_to_1e_9():
    own, theirs = closed_form_deviation(np.random.default_rng(2), 60)
    assert own < 1e-9 and theirs < 1e-9


@pytest.mark.slow
def test_a_thousand_random_loops():
    rng = np.random.default_rng(3)
    assert compare(rng, 1000, equal=False) < 1e-9
    assert max(closed_form_deviation(rng, 1000)) < 1e-9


def test_abscissa_agrees_with_qpmr():
    """A root finder of another kind (contours of Re and Im of the quasi-polynomial), for 12 loops."""
    rng = np.random.default_rng(5)
    for _ in range(12):
        mass, stiffness, damping = random_sides(rng, False)
        family = position_loop(mass, stiffness, damping)
        delay = max_delay(family) * rng.uniform(0.5, 2.0)
        rate, own = abscissa(family.at(delay)), roots(family.at(delay))
        width = 1.5 * np.abs(own[:4].imag).max()
        polynomial = np.polymul(*([mass[k], damping[k], stiffness[k]] for k in (0, 1)))[::-1]
        coupling = [-stiffness[0] * stiffness[1], 0, 0, 0, 0]
        left = rate - 0.2 * width
        with np.errstate(all="ignore"):
            found, _ = qpmr.qpmr(
                np.array([polynomial, coupling]),
                np.array([0, 2 * delay]),
                region=[left, max(rate, 0) + width, -0.01 * width, width],
                ds=width / 100,
            )
        found = found[np.abs(found) > 1e-6 * width]
        assert found.real.max() == pytest.approx(rate, abs=1e-9 * max(1.0, width))


def test_no_root_right_of_the_abscissa_by_the_argument_principle():
    rng = np.random.default_rng(6)
    for _ in range(6):
        family = position_loop(*random_sides(rng, False))
        system = family.at(max_delay(family) * rng.uniform(0.3, 4.0))
        own = roots(system)
        line = abscissa(system) + 1e-4 * np.abs(own).max()
        expected = 1 if line < 0 else 0  # the neutral root at zero
        assert count_right(system, line) == expected


def test_chebyshev_differentiates_polynomials_exactly():
    nodes, matrix = chebyshev(8)
    assert np.allclose(matrix @ nodes**7, 7 * nodes**6, atol=1e-12)


def test_scalar_equation_with_known_root():
    """x' = -a x(t - 1) crosses at a = pi / 2 (Hayes 1950)."""
    system = DelaySystem([[[0.0]], [[-np.pi / 2]]], [0.0, 1.0])
    assert abs(abscissa(system)) < 1e-13
    assert roots(system)[0] == pytest.approx(1j * np.pi / 2, abs=1e-13)


def test_only_the_sum_of_the_delays_counts():
    mass, stiffness, damping = random_sides(np.random.default_rng(7), False)
    family = position_loop(mass, stiffness, damping)
    total = 2.4 * max_delay(family)
    rates = []
    for share in (0.1, 0.5, 0.9):
        shifted = DelayFamily(family.fixed, DelaySystem(family.channel.matrices, (share * total, (1 - share) * total)))
        rates.append(abscissa(shifted.at(0.0)))
    assert np.ptp(rates) < 1e-10 * max(1.0, abs(rates[0]))


def test_an_added_age_shifts_the_boundary_by_itself():
    mass, stiffness, damping = (0.06, 0.06), (0.25, 0.25), (0.09, 0.09)
    late = position_loop(mass, stiffness, damping, added=(0.0005, 0.0005))
    assert max_delay(late) == pytest.approx(closed_form(0.06, 0.25, 0.09) - 0.0005, rel=1e-12)


def test_stable_for_every_delay_below_mu_one_half():
    assert max_delay(position_loop((0.0161, 0.0161), (0.25, 0.25), (0.09, 0.09))) == np.inf


def test_three_axes_have_the_boundary_of_the_heaviest_direction():
    rng = np.random.default_rng(8)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    mass = turn @ np.diag([0.03, 0.05, 0.11]) @ turn.T
    eye = np.eye(3)
    found = max_delay(position_loop((mass, mass), (0.25 * eye, 0.25 * eye), (0.09 * eye, 0.09 * eye)))
    assert found == pytest.approx(closed_form(0.11, 0.25, 0.09), rel=1e-10)
