"""Taati's two applications as shipped: inverse dynamics control (4.3) and contact force estimation (4.4)."""

import numpy as np
from scipy.signal import lfilter

from cosim.engine.master import run
from cosim.scenario import load_scenario


def settled_error(*overrides: str) -> float:
    """Joint 3's error just before the pulse of 0.2 rad turns at 10 s, as a share of the pulse."""
    result = run(load_scenario("inverse-dynamics", overrides))
    k = int(np.searchsorted(result.time, 9.9))
    return abs(result.vector("arm.q")[k, 2] - 0.9) / 0.2


def test_identified_parameters_track_better_than_piecewise_ones():
    """Taati's observation 1: 20 % error with the identified parameters, 25 % with the piecewise ones (stiction
    included)."""
    identified, piecewise = settled_error(), settled_error("controller.parameter_set=piecewise")
    # what is left with the plant's own parameters is creep under half of the friction; the piecewise gravity is off by
    # 36 mN m:
    # 36e-3 / (M33 Kp) = 36e-3 sin(0.95) / (0.95e-3 * 625) = 49 mrad or 25 %, M33 of the controller's model being within
    # 5 %
    assert identified < 0.01
    assert abs(piecewise - 0.25) < 0.03


def test_observer_with_the_model_sees_the_hands_force():
    result = run(load_scenario("contact-force"))
    decay = np.exp(-62.83185307179586 * 1e-3)
    force = lfilter([1 - decay], [1, -decay], result.vector("operator.f"), axis=0)[2000:]

    def share(name: str) -> np.ndarray:
        return np.sqrt(((result.vector(name)[2000:] - force) ** 2).mean(axis=0) / (force**2).mean(axis=0))

    # 1 ms of age between force and torque turns a 0.25 Hz sine by 0.16 %
    assert (share("observer.f") < 2e-3).all()
    # without the model: gravity of about 0.05 to 0.3 N and 10 to 25 mN m of friction stand in the estimate; the wrong
    # set's gravity too
    assert (share("observer.f_static") > 0.05).all() and share("observer_ur.f").max() > 0.2
