"""Identities of the arm's kinematics: Jacobians by complex step, inverse round trip, singular poses."""

import numpy as np
import pytest

from cosim.arm import kinematics as k
from cosim.arm.workspace import BOX, LINKED, SingularityKind, singularity

STEP = 1e-30
"""Complex step: no difference is taken, so the derivative is exact to rounding."""


def complex_jacobian(function, q):
    """df/dq (n, m, 3) of a function of q (n, 3) by complex step."""
    return np.stack([function(q + 1j * STEP * axis).imag / STEP for axis in np.eye(3)], axis=-1)


def test_tip_rests_at_the_origin():
    np.testing.assert_allclose(k.forward(np.zeros(3)), 0, atol=1e-17)


def test_jacobian_is_the_derivative():
    q = BOX.sample(300, 1)
    np.testing.assert_allclose(k.jacobian(q), complex_jacobian(k.forward, q), atol=1e-16)


def test_jacobian_by_finite_differences():
    """Central differences: error h^2/6 |x'''| + eps |x| / h, about 1e-11 at h = 6e-6."""
    q, h = BOX.sample(50, 2), 6e-6
    differences = np.stack([(k.forward(q + h * a) - k.forward(q - h * a)) / (2 * h) for a in np.eye(3)], axis=-1)
    np.testing.assert_allclose(k.jacobian(q), differences, atol=5e-11)


def test_jacobian_rate_is_the_derivative_along_the_motion():
    q, dq = BOX.sample(100, 3), np.random.default_rng(3).uniform(-5, 5, (100, 3))
    np.testing.assert_allclose(k.jacobian_rate(q, dq), k.jacobian(q + 1j * STEP * dq).imag / STEP, atol=1e-15)


def test_determinant():
    q = BOX.sample(100, 4)
    expected = k.L1 * k.L2 * k.radius(q) * np.cos(q[:, 1] - q[:, 2])
    np.testing.assert_allclose(np.linalg.det(k.jacobian(q)), expected, atol=1e-16)
    np.testing.assert_allclose(np.linalg.det(k.tool_jacobian(q)), expected, atol=1e-16)


def test_angular_jacobian_is_the_turning_of_the_tool():
    q = BOX.sample(100, 5)
    for joint, axis in enumerate(np.eye(3)):
        skew = (k.orientation(q + 1j * STEP * axis).imag / STEP) @ np.swapaxes(k.orientation(q), -1, -2)
        omega = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
        np.testing.assert_allclose(k.angular_jacobian(q)[:, :, joint], omega, atol=1e-15)


@pytest.mark.parametrize(("inverse", "sign"), [(k.inverse, 1), (k.inverse_behind, -1)])
def test_inverse_round_trip(inverse, sign):
    """q -> x -> q on either side of the axis; the angle's error is eps / |det J|, so poses near a singularity are
    left out.
    """
    q = LINKED.sample(20000, 6)
    q = q[sign * k.radius(q) > 0.01]
    assert len(q) > 50
    np.testing.assert_allclose(inverse(k.forward(q)), q, atol=2e-13)
    np.testing.assert_allclose(k.forward(inverse(k.forward(q))), k.forward(q), atol=1e-15)


def test_out_of_reach_is_nan():
    assert np.all(np.isnan(k.inverse([0.5, 0.5, 0.5])))
    q = k.inverse(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(q[0], 0, atol=1e-15)
    assert np.all(np.isnan(q[1]))


def test_singularities_are_reported():
    """r = 0 lies inside box and linkage (far back and up), the stretched arm only inside the box."""
    back = np.deg2rad(110)
    axis = np.array([0.3, back, np.pi - np.arcsin(-k.L1 / k.L2 * np.cos(back))])
    assert LINKED.contains(axis)
    assert singularity(axis).kind is SingularityKind.AXIS
    assert singularity(axis).smallest < 1e-16
    line = np.array([0.0, 0.0, np.pi / 2])
    assert singularity(line).kind is SingularityKind.STRETCHED
    assert BOX.contains(line) and not LINKED.contains(line)
    assert singularity(np.array([0.0, np.pi / 2, 0.0])).kind is SingularityKind.BOTH
    regular = singularity(np.array([0.0, 0.3, 0.4]))
    assert regular.kind is SingularityKind.NONE
    assert regular.determinant == pytest.approx(np.linalg.det(k.jacobian(np.array([0.0, 0.3, 0.4]))), rel=1e-12)
