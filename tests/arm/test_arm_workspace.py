"""Workspace limits and the definiteness of M over them."""

import numpy as np
import pytest

from cosim.arm.dynamics import mass_matrix, yaw_inertia
from cosim.arm.kinematics import radius
from cosim.arm.parameters import SET_NAMES, parameter_set
from cosim.arm.workspace import BOX, LINKED, definite_map, definiteness, outline
from cosim.errors import InputError


def test_limits_are_the_published_ones():
    inside = np.deg2rad([[0, 0, 0], [89, 114, 50], [0, -57, -25], [0, 60, 0], [0, 0, 54]])
    outside = np.deg2rad([[91, 0, 0], [0, 116, 60], [0, 0, -26], [0, 66, 0], [0, 0, 56]])
    assert LINKED.contains(inside).all() and not LINKED.contains(outside).any()
    assert BOX.contains(outside).tolist() == [False, False, False, True, True]


def test_the_axis_lies_inside():
    """r = 0 is inside the linked workspace, so runs need a domain exit."""
    r = radius(LINKED.sample(4000, 1))
    assert r.min() < -0.02 and r.max() > 0.2


def test_clip_stays_inside_and_leaves_inner_poses():
    q = np.random.default_rng(2).uniform(-4, 4, (500, 3))
    assert LINKED.contains(LINKED.clip(q) * (1 - 1e-15)).mean() > 0.5  # a limit met exactly may miss by rounding
    inner = LINKED.sample(100, 3)
    np.testing.assert_array_equal(LINKED.clip(inner), inner)


@pytest.mark.parametrize("name", SET_NAMES)
@pytest.mark.parametrize("workspace", [LINKED, BOX], ids=["linked", "box"])
def test_minimum_is_global(name, workspace):
    """No random pose lies below the reported minimum, the pose attains it, and the bound closes to rounding."""
    pi = parameter_set(name).pi
    found = definiteness(pi, workspace)
    q = workspace.sample(20000, 4)
    assert yaw_inertia(pi, q).min() >= found.least_yaw - 1e-15
    assert yaw_inertia(pi, np.array([0.0, *found.pose])) == pytest.approx(found.least_yaw, rel=1e-12)
    assert 0 <= found.least_yaw - found.bound <= 1e-9 * np.abs(pi[:4]).sum()
    least = np.linalg.eigvalsh(mass_matrix(pi, q)[:, 1:, 1:])[:, 0].min()
    assert found.least_block <= least + 1e-16 < found.least_block + 2e-5
    assert found.positive == bool(np.linalg.eigvalsh(mass_matrix(pi, q)).min() > 0)


def test_published_minima():
    """PHYSICS.md 1: M11 over box and linkage, 1e-3 kg m^2."""
    least = {name: definiteness(parameter_set(name).pi).least_yaw * 1e3 for name in SET_NAMES}
    published = {"UR": -0.20, "GCW": -2.2, "FS": -1.7, "USD": -0.8, "USD+GCW": -2.2}
    for name, value in published.items():
        assert least[name] == pytest.approx(value, abs=0.05)
    assert least["segment"] > 1.4 and least["piecewise"] > 1.4


def test_map_agrees_with_eigenvalues():
    pi = parameter_set("FS").pi
    q2, q3, values = definite_map(pi, LINKED, 41)
    i, j = 20, 15
    assert np.isfinite(values[i, j])
    assert values[i, j] == pytest.approx(np.linalg.eigvalsh(mass_matrix(pi, np.array([0, q2[i], q3[j]])))[0], rel=1e-12)
    assert np.isnan(values[0, -1])


def test_outline_is_closed_and_inside():
    edge = outline()
    inset = edge * 0.999 + 0.001 * np.array([0.0, 0.5, 0.8])
    assert LINKED.contains(inset).all()
    assert np.abs(edge[0] - edge[-1]).max() < 1e-12


def test_bad_pi_is_bad_input():
    with pytest.raises(InputError, match="8 finite numbers"):
        definiteness(np.array([1.0, np.nan]))
