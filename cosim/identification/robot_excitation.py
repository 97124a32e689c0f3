"""A motion that identifies a robot arm: sums of sinusoids inside its limits, their phases and shares chosen for a low
condition number of the base parameters' regressor.
"""

import numpy as np
from attrs import evolve

from cosim.arm import dynamics
from cosim.arm.base_parameters import BaseParameters, base_columns, base_parameters
from cosim.arm.serial import SerialModel
from cosim.arm.serial_dynamics import inverse_dynamics
from cosim.errors import InputError, Problem
from cosim.identification.excitation import COUNT, HIGHEST, LOWEST, Excitation
from cosim.identification.regressor import friction_columns

SHARE = 0.8
"""Of every limit (angle about the middle, speed, effort) that the motion may use: room for what a controller
overshoots, 20 % at a phase margin of about 50 degrees.
"""
TURN = np.pi
"""Reach [rad] to either side of joints without limits."""
_STEP = 0.05  # s between the states that are looked at: 25 in a period of the fastest sinusoid (5 rad/s)


def robot_excitation(model: SerialModel, duration: float = 60.0, seed: int = 0, rounds: int = 100) -> Excitation:
    """The best of a seeded random search. Raises InputError where no motion stays inside the limits.

    A (1+1) evolution strategy (Rechenberg 1973): each step is a random one, kept where it is better; steps grow after a
    success and shrink after a failure, by factors that keep their size where one in ten succeeds (0.1 log 1.3 = -0.9
    log 0.97). Phases are moved by a radian at first and never by more than two, beyond which a phase is any phase.
    """
    random, base = np.random.default_rng(seed), base_parameters(model)
    best = inside(model, _first(model, random), duration)
    score, width = condition_number(model, base, best, duration), 1.0
    for _ in range(rounds):
        moved = evolve(
            best,
            phase=best.phase + width * random.normal(size=best.phase.shape),
            amplitude=best.amplitude * np.exp(0.3 * width * random.normal(size=best.phase.shape)),
        )
        trial = inside(model, moved, duration)
        value = condition_number(model, base, trial, duration)
        best, score, width = (trial, value, min(1.3 * width, 2.0)) if value < score else (best, score, 0.97 * width)
    return best


def _first(model: SerialModel, random: np.random.Generator) -> Excitation:
    """Frequencies from 0.11 to 5 rad/s, moved from joint to joint; equal speeds, random phases."""
    grid = np.geomspace(LOWEST, HIGHEST, model.count * COUNT).reshape(COUNT, model.count).T
    middle = np.where(model.limited, 0.5 * (_finite(model.lower) + _finite(model.upper)), 0.0)
    return Excitation(grid, 1.0 / grid, random.uniform(0, 2 * np.pi, grid.shape), middle)


def _finite(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, 0.0)


def inside(model: SerialModel, excitation: Excitation, duration: float) -> Excitation:
    """The same motion as large as SHARE of every limit allows; efforts by the arm's own rigid body."""
    time = np.arange(0.0, duration, _STEP)
    room = np.where(model.limited, 0.5 * (_finite(model.upper) - _finite(model.lower)), TURN)
    q, dq, _ = excitation.motion(time)
    used = np.abs(q - excitation.centre).max(axis=0) / room, np.abs(dq).max(axis=0) / model.speed
    sized = evolve(excitation, amplitude=excitation.amplitude * (SHARE / np.maximum(*used))[:, None])
    for part in np.linspace(1.0, 0.1, 10):
        smaller = evolve(sized, amplitude=part * sized.amplitude)
        if (np.abs(inverse_dynamics(model, *smaller.motion(time))) <= SHARE * model.effort).all():
            return smaller
    raise InputError(
        Problem("excitation", "a motion that the motors can make", "none about the middle of the joints' ranges")
    )


def condition_number(model: SerialModel, base: BaseParameters, excitation: Excitation, duration: float) -> float:
    """Of the scaled base and friction columns over the motion, joints weighted alike."""
    q, dq, ddq = excitation.motion(np.arange(0.0, duration, 4 * _STEP))
    rigid = base_columns(model, base, q, dq, ddq)
    y = np.concatenate([rigid, friction_columns(dq, dynamics.COULOMB_VELOCITY)], axis=2)
    flat = y.reshape(-1, y.shape[2])
    return float(np.linalg.cond(flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-300)))
