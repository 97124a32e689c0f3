"""Taati 4.3: identified parameters track better than piecewise ones and stay stable to higher gains."""

import numpy as np
import pytest

from cosim.engine.master import run
from cosim.identification.ladder import gain_ladder, limit
from cosim.report.applications import tracking
from cosim.scenario import load_scenario


def errors(values):
    """RMS tracking error of joint 3 and mean error at the end of the half pulses, both over the pulse of 0.2 rad, per
    loop."""
    result = run(load_scenario("inverse-dynamics").with_values(values))
    phase = np.mod(result.time, 2.0)
    late = (phase > 1.6) & (phase < 1.98) & (result.time > 2)
    found = []
    for name in ("controller", "controller_piecewise"):
        reference, q = tracking(result, name)
        error = (q - reference)[:, 2] / 0.2
        found += [np.sqrt((error**2).mean()), np.abs(error[late]).mean()]
    return found


@pytest.mark.parametrize(
    ("configuration", "proportional", "derivative"),
    [("UR", 625.0, 35.0), ("UR", 1200.0, 80.0), ("USD+GCW", 100.0, 14.0)],
    ids=["Fig. 14", "Fig. 15", "Fig. 16"],
)
def test_identified_parameters_track_better(configuration, proportional, derivative):
    values = {
        "arm*.parameter_set": configuration,
        "controller.parameter_set": configuration,
        "controller*.proportional_gain": proportional,
        "controller*.derivative_gain": derivative,
    }
    rms, rest, rms_piecewise, rest_piecewise = errors(values)
    assert rms < 0.8 * rms_piecewise and rest < 0.2 * rest_piecewise


def test_steady_error_of_the_piecewise_parameters_is_that_of_the_paper():
    # Fig. 14: about 25 % of the pulse at Kp = 625 with the piecewise parameters (gravity g8 too small by a third)
    assert 0.18 < errors({})[3] < 0.30


def test_identified_parameters_hold_to_higher_gains():
    """In a loop that is 12 ms late. The piecewise d1 is twice the plant's: joint 1's true gain is 1.5 times the
    nominal one."""
    identified, piecewise = gain_ladder("UR"), gain_ladder("piecewise")
    assert limit(identified) > 1.2 * limit(piecewise) > 0
    assert limit(identified) >= 1200  # the paper's highest gain
