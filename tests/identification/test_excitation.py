"""The excitation: Taati's frequencies, inside the workspace, M > 0 for every column of Table 1, well conditioned."""

import numpy as np
import pytest

from cosim.arm import dynamics
from cosim.arm.parameters import parameter_set
from cosim.arm.workspace import LINKED, block_eigenvalue
from cosim.errors import InputError
from cosim.identification.excitation import (
    Excitation,
    condition_number,
    fitted,
    frequencies,
    optimised,
    taati,
    within_definite,
)

TIME = np.arange(0, 60, 0.005)


def test_ten_sinusoids_from_0_11_to_5_rad_a_second():
    comb = frequencies()
    assert comb.shape == (3, 10) and comb.min() == 0.11 and comb.max() == 5.0 and (np.diff(comb, axis=1) > 0).all()


def test_derivatives_are_those_of_the_motion():
    q, dq, ddq = taati(3).motion(TIME)
    h = TIME[1]
    # central differences: (5 h)^2 / 6 of the amplitude's rate
    assert np.abs((q[2:] - q[:-2]) / (2 * h) - dq[1:-1]).max() < 2e-4 * np.abs(dq).max()
    assert np.abs((dq[2:] - dq[:-2]) / (2 * h) - ddq[1:-1]).max() < 2e-4 * np.abs(ddq).max()


@pytest.mark.parametrize("seed", range(6))
def test_every_seed_stays_in_the_workspace_with_linkage(seed):
    assert LINKED.contains(taati(seed).motion(TIME)[0]).all()


def test_a_centre_outside_is_refused():
    start = taati(0)
    with pytest.raises(InputError, match="inside the workspace"):
        fitted(Excitation(start.frequency, start.amplitude, start.phase, np.array([0.0, 1.9, 0.0])), 20.0)


@pytest.mark.parametrize("name", ["UR", "GCW", "FS", "USD", "USD+GCW"])
def test_m_stays_positive_definite_with_margin(name):
    pi = parameter_set(name).pi
    q = within_definite(taati(0), pi, 60.0).motion(TIME)[0]
    assert dynamics.yaw_inertia(pi, q).min() > 0 and block_eigenvalue(pi, q[:, 1] - q[:, 2]).min() > 0


def test_optimising_lowers_the_condition_number():
    start, better = taati(1, 30.0), optimised(1, 30.0, rounds=25)
    assert condition_number(better, 30.0) < condition_number(start, 30.0)
    assert LINKED.contains(better.motion(np.arange(0, 30, 0.005))[0]).all()


@pytest.mark.parametrize("name", ["identification", "identification-optimised"])
def test_shipped_scenarios_hold_an_excitation_inside_the_workspace(name):
    from cosim.scenario import load_scenario

    values = load_scenario(name).components["excitation"].parameters
    sums = {key: np.reshape(values[key], (3, 10)) for key in ("frequency", "amplitude", "phase")}
    shipped = Excitation(**sums, centre=np.array(values["centre"], float))
    q = shipped.motion(TIME)[0]
    assert LINKED.contains(q).all() and condition_number(shipped, 60.0) < 9
    for column in ("UR", "GCW", "FS", "USD", "USD+GCW"):
        assert dynamics.yaw_inertia(parameter_set(column).pi, q).min() > 0
