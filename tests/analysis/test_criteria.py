"""Criteria against the figures of PHYSICS.md 3 and against each other."""

import numpy as np
import pytest

from cosim.analysis.criteria import Coupling, closed_form, delay_sum, sallam_eq10
from cosim.analysis.damping import least_task_viscosity, task_viscosity
from cosim.analysis.passivity import port_passivity
from cosim.analysis.spectrum import abscissa, position_loop

PAPER = Coupling(0.25, 0.25, 0.09, 0.09)


def test_the_papers_gains_are_guaranteed_to_0_36_s_and_not_to_0_509_s():
    assert delay_sum(PAPER, 0.0, 0.0).max_delay == pytest.approx(0.36, rel=1e-12)
    assert sallam_eq10(PAPER, 0.0, 0.0).max_delay == pytest.approx(0.36 * np.sqrt(2.0), rel=1e-12)
    assert not sallam_eq10(PAPER, 0.0, 0.0).sufficient and delay_sum(PAPER, 0.0, 0.0).sufficient


def test_eq10_is_satisfied_by_a_loop_that_grows():
    assert sallam_eq10(PAPER, 0.45, 0.45).holds and not delay_sum(PAPER, 0.45, 0.45).holds
    rate = abscissa(position_loop((1.0, 1.0), (0.25, 0.25), (0.09, 0.09)).at(0.45))
    assert rate == pytest.approx(0.0101, abs=5e-5)


def test_the_sum_counts_not_how_it_is_split():
    assert delay_sum(PAPER, 0.7, 0.01).holds and not delay_sum(PAPER, 0.7, 0.03).holds


def test_a_side_without_damping_has_no_guarantee():
    assert delay_sum(Coupling(0.25, 0.25, 0.09, -0.01), 0.0, 0.0).max_delay == 0.0
    assert closed_form(1.0, 0.25, -0.01) == 0.0


def test_the_weakest_axis_decides():
    mixed = Coupling((0.25, 0.5), (0.25, 0.5), (0.09, 0.09), (0.09, 0.09))
    assert delay_sum(mixed, 0.0, 0.0).max_delay == pytest.approx(0.18)


def test_closed_form_falls_to_the_sum_condition_as_mass_grows():
    delays = [closed_form(mass, 0.25, 0.09) for mass in np.geomspace(0.0163, 1e7, 60)]
    assert closed_form(0.0162, 0.25, 0.09) == np.inf  # mu = 1/2
    assert np.all(np.diff(delays) < 0) and np.all(np.array(delays) > 0.36)
    # arccos(1 - 1/mu) mu / sqrt(2 mu - 1) = 1 + 1/(3 mu) + ...: at m = 1e7, mu = 3e8
    assert delays[-1] == pytest.approx(0.36, rel=1e-7)


def test_least_viscosity_is_the_minimum_of_random_poses():
    from cosim.arm.kinematics import radius
    from cosim.arm.workspace import Workspace

    rng = np.random.default_rng(4)
    viscous = np.array([2e-3, 1e-3, 3e-3])
    found = least_task_viscosity(viscous)
    poses = rng.uniform(Workspace().low, Workspace().high, (20000, 3))
    poses = poses[Workspace().contains(poses) & (np.abs(radius(poses)) > 0.05)]
    values = task_viscosity(viscous, poses)
    assert found.value <= values.min() + 1e-12
    assert found.value == pytest.approx(values.min(), rel=2e-2)
    assert task_viscosity(viscous, np.array(found.pose)) == pytest.approx(found.value)


def test_negative_identified_viscosity_subtracts():
    # UR at q = 0: q1 turns at r = l1 = 0.215 m, so f9 counts f9 / l1^2
    at_zero = task_viscosity(np.array([-2.08e-3, -1.28e-3, -0.18e-3]), np.zeros(3))
    assert at_zero == pytest.approx(-2.08e-3 / 0.215**2, rel=1e-12)
    assert least_task_viscosity(np.array([-2.08e-3, 0.0, 0.0])).value < 0.0


@pytest.mark.parametrize(("damping", "passive"), [(0.02, True), (-0.02, False)])
def test_port_of_a_damped_mass(damping, passive):
    mass, spring = 0.05, 2.0
    a, b, c = [[0, 1], [-spring / mass, -damping / mass]], [[0], [1 / mass]], [[0, 1]]
    found = port_passivity(a, b, c)
    assert found.passive is passive and found.damping == pytest.approx(damping, rel=1e-6)
