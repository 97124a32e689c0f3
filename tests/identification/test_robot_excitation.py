"""Motions that identify a robot arm: inside its limits, better conditioned than where the search began."""

import numpy as np
import pytest
from attrs import evolve

from cosim.arm.base_parameters import base_parameters
from cosim.arm.published import panda
from cosim.arm.serial_dynamics import inverse_dynamics
from cosim.errors import InputError
from cosim.identification.robot_excitation import condition_number, robot_excitation

DURATION = 20.0


def test_it_stays_inside_the_limits_and_tells_more():
    model = panda()
    first, best = (robot_excitation(model, DURATION, seed=1, rounds=rounds) for rounds in (0, 15))
    q, dq, ddq = best.motion(np.arange(0.0, DURATION, 0.05))
    middle, half = (model.lower + model.upper) / 2, (model.upper - model.lower) / 2
    assert (np.abs(q - middle) <= 0.8 * half + 1e-9).all() and (np.abs(dq) <= 0.8 * model.speed + 1e-9).all()
    assert (np.abs(inverse_dynamics(model, q, dq, ddq)) <= 0.8 * model.effort + 1e-9).all()
    base = base_parameters(model)
    before, after = (condition_number(model, base, e, DURATION) for e in (first, best))
    assert after < 0.95 * before < 1000


def test_motors_that_cannot_hold_the_arm_are_told():
    weak = evolve(panda(), effort=0.01 * panda().effort)
    with pytest.raises(InputError, match="the motors can make"):
        robot_excitation(weak, DURATION, rounds=0)
