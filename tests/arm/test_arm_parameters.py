"""Parameter sets as printed, mounting, payload, counterweights."""

import numpy as np
import pytest
from attrs import evolve

from cosim.arm.counterbalance import GCW_WEIGHT, GIMBAL, Counterweights, balancing_weights, fitted, gravity_parameters
from cosim.arm.dynamics import gravity_torque, mass_matrix, potential_energy
from cosim.arm.kinematics import L1, L2, forward, jacobian
from cosim.arm.parameters import SET_NAMES, Mounting, ParameterSet, mounted, parameter_set, with_payload
from cosim.arm.workspace import LINKED
from cosim.errors import InputError

TABLE1 = """
    2.78   1.42   3.40   1.02   1.20    3.04
    1.09   1.35   4.43   2.16   1.61    3.29
   -0.40  -0.40  -1.17  -0.76  -0.51   -0.73
    0.91   0.69   9.23   3.00   0.65    9.19
    2.41   2.08   7.54   3.47   2.85    6.37
    0.91   0.95   3.55   1.13   1.28    3.15
  -16.30 -19.23  26.92  46.84  21.24  -16.59
  -73.80 -109.96 46.52 -69.08 108.75 -112.45
    0     -2.08  -2.71  -0.91  -1.35   -0.10
    0     -1.28   0.10  -0.32  -0.14    0.54
    0     -0.18   1.13   0.43   0.91    0.73
    0     25.89  26.22  27.06  26.08   24.35
    0      9.19   8.35   9.34   8.24    7.28
    0      9.08   9.04  10.00   8.09    8.71
"""


def test_table_1_as_printed():
    """All 14 rows of Taati Table 1, typed in twice independently (here by rows, in the module by columns)."""
    printed = np.array([[float(word) for word in line.split()] for line in TABLE1.strip().splitlines()])
    found = np.stack([parameter_set(name).vector for name in SET_NAMES[1:]], axis=-1)
    np.testing.assert_allclose(found * 1e3, printed, rtol=1e-14)


def test_sets_say_where_they_come_from():
    assert SET_NAMES == ("segment", "piecewise", "UR", "GCW", "FS", "USD", "USD+GCW")
    assert all(parameter_set(name).source for name in SET_NAMES)


def test_unknown_set_is_bad_input():
    with pytest.raises(InputError, match="did you mean 'GCW'"):
        parameter_set("GWC")
    with pytest.raises(InputError, match="8 finite numbers"):
        ParameterSet("mine", [1, 2, 3])


def test_sets_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        parameter_set("segment").pi[0] = 1.0
    assert parameter_set("segment") == parameter_set("segment")


def test_upside_down_turns_gravity_only():
    params = parameter_set("segment")
    down = mounted(params, Mounting.UPSIDE_DOWN)
    q = LINKED.sample(20, 1)
    np.testing.assert_array_equal(gravity_torque(down.pi, q), -gravity_torque(params.pi, q))
    np.testing.assert_array_equal(mass_matrix(down.pi, q), mass_matrix(params.pi, q))
    assert mounted(down, Mounting.UPRIGHT) == params


def test_identified_sets_are_used_as_printed():
    assert mounted(parameter_set("USD"), Mounting.UPSIDE_DOWN) == parameter_set("USD")
    with pytest.raises(InputError, match="identified"):
        mounted(parameter_set("USD"), Mounting.UPRIGHT)


@pytest.mark.parametrize("mounting", list(Mounting))
def test_payload_is_a_mass_at_the_tip(mounting):
    """T grows by m |dx|^2 / 2 and V by m g y: M by m J^T J, N by J^T (0, m g, 0)."""
    params, mass = mounted(parameter_set("segment"), mounting), 0.15
    loaded, q = with_payload(params, mass), LINKED.sample(50, 2)
    jac = jacobian(q)
    extra = mass * np.swapaxes(jac, -1, -2) @ jac
    np.testing.assert_allclose(mass_matrix(loaded.pi, q) - mass_matrix(params.pi, q), extra, atol=1e-16)
    lift = potential_energy(loaded.pi, q) - potential_energy(params.pi, q)
    height = forward(q)[:, 1] - L2
    np.testing.assert_allclose(lift, mass * mounting.gravity * height, atol=1e-15)


def test_counterweights_are_masses_on_levers():
    """Positions by hand: -L_cb along the upper arm and along the forearm's direction, seen from the shoulder."""
    params, weights = parameter_set("segment"), Counterweights(0.2, 0.1, 0.07)
    bare = fitted(params, evolve(GIMBAL, mass=0.0), weights)
    q2, q3 = LINKED.sample(20, 3)[:, 1:].T
    q = np.stack([np.zeros(20), q2, q3], axis=-1)
    yaw = 0.2 * (0.07 * np.cos(q2)) ** 2 + 0.1 * (0.07 * np.sin(q3)) ** 2
    np.testing.assert_allclose((mass_matrix(bare.pi, q) - mass_matrix(params.pi, q))[:, 0, 0], yaw, atol=1e-17)
    height = -0.2 * 0.07 * np.sin(q2) + 0.1 * 0.07 * np.cos(q3)
    lift = potential_energy(bare.pi, q) - potential_energy(params.pi, q)
    np.testing.assert_allclose(lift, 9.81 * height, atol=1e-15)


def test_balance_leaves_no_gravity():
    for name in ("segment", "UR", "USD"):
        params = parameter_set(name)
        balanced = fitted(params, GIMBAL, balancing_weights(params, GIMBAL))
        np.testing.assert_allclose(balanced.pi[6:], 0, atol=1e-16)


def test_fitted_gravity_is_taati_eqs_16_and_17():
    params = parameter_set("UR")
    np.testing.assert_allclose(
        fitted(params, GIMBAL, GCW_WEIGHT).pi[6:], gravity_parameters(params, GIMBAL, GCW_WEIGHT), rtol=1e-13
    )
    g7 = params.pi[6] - 9.81 * 0.216 * 0.07 + 9.81 * 0.09 * L1
    assert fitted(params, GIMBAL, GCW_WEIGHT).pi[6] == pytest.approx(g7, rel=1e-13)


def test_gimbal_as_physics_explains_the_gcw_column():
    """Taati checks g7 and g8 only; the same masses also move d2, d4 and d5 of UR to within 12 % of the identified
    GCW column.
    """
    predicted, identified = fitted(parameter_set("UR"), GIMBAL, GCW_WEIGHT).pi, parameter_set("GCW").pi
    for index in (1, 3, 4):
        assert predicted[index] == pytest.approx(identified[index], rel=0.12)
