"""EMPS (Janot, Gautier, Brunot 2019): the published identification reproduced, then the same rows with better
preprocessing."""

import pytest

from cosim.identification.identification import identify, unexcited
from cosim.identification.idim import idim
from cosim.measured import read

PUBLISHED = (95.1089, 203.5034, 20.3935, -3.1648)  # M [kg], Fv [N s/m], Fc [N], offset [N] (dataset.json)
ERRORS = (4.0834, 5.9824)  # % on train and test (dataset.json)


@pytest.fixture(scope="module")
def emps(shared_data):
    folder = shared_data / "emps"
    data = read([folder / "emps_train.csv"], test=[folder / "emps_test_pulses.csv"], description=folder / "emps.toml")
    found = identify(data)
    return found, idim(data, found.params[:4])


def test_published_parameters_and_errors_are_reproduced(emps):
    # to the digits printed: 0.1 points were asked for
    _, reference = emps
    assert reference.published.params == pytest.approx(PUBLISHED, abs=6e-5)
    assert (reference.published.train, reference.published.held_out) == pytest.approx(ERRORS, abs=6e-5)


def test_better_preprocessing_predicts_the_test_run_better(emps):
    """On the authors' own rows and band: fitted away from reversals, held-out error below theirs; in our band far
    below."""
    found, reference = emps
    assert reference.other.held_out < reference.published.held_out
    assert found.rms_held_out[0] < 4.5 and found.rms_held_out_all[0] < 4.5
    assert found.rms_train[0] < 3.5


def test_the_hold_of_the_digital_controller_is_a_quarter_of_the_test_error(emps):
    """The force column is a command held for 1 ms; as its mean over a sample either side it is half a sample later.

    That alone, same filters, same rows: from 5.98 % to 4.6 % on the pulses, whose band reaches the 40 Hz of the
    decimation.
    """
    _, reference = emps
    assert reference.recentred.held_out < 4.7 and reference.recentred.train < reference.published.train


def test_published_values_lie_in_the_honest_intervals_and_not_in_the_white_ones(emps):
    """The white-noise standard deviation would put the published viscosity and friction many of its own widths away."""
    found, _ = emps
    for parameter, value in zip(found.parameters[1:4], PUBLISHED[1:], strict=True):
        assert parameter.interval[0] <= value <= parameter.interval[1], parameter
        assert abs(parameter.value - value) > 3 * parameter.std_white
    assert found.parameters[0].value == pytest.approx(PUBLISHED[0], rel=0.01)
    assert unexcited(found) == () and found.positive_definite
