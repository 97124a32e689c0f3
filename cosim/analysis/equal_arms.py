"""A scenario with one arm on both sides, at the poses at which it is looked at."""

from collections.abc import Sequence

import numpy as np
from attrs import evolve

from cosim.analysis.linearisation import at_pose
from cosim.arm.serial import SerialModel
from cosim.arm.serial_kinematics import tip_position
from cosim.arm.serial_table import arm_values, home
from cosim.errors import InputError, Problem
from cosim.scenario import Component, Scenario, joints_of, start_values
from cosim.signals import stem

_SHARED = ("gravity_compensation", "stiffness", "damping", "internal_steps")
"""What a scenario says of an arm that is not the arm's own: how it is set up. All else is the URDF's."""
_HOMES = ("x_home", "x_ref_home")
_MIDDLE = 0.9
"""Poses lie in this part of each joint's range, so that a motion has room before a limit."""


def with_arm(scenario: Scenario, model: SerialModel) -> Scenario:
    """The scenario with the arm in place of its local and its remote one; controllers of any arm get its joints.

    Raises InputError where the scenario has not two arms.
    """
    if scenario.arms is None:
        advice = "components arm_l and arm_r, or [teleoperation] with the names of both"
        raise InputError(Problem(scenario.name, "two arms that face each other", "none", advice))
    table, components = arm_values(model), dict(scenario.components)
    for name in scenario.arms:
        old = components[name]
        kept = {key: value for key, value in start_values(old).items() if stem(key) in _SHARED}
        components[name] = Component(model="SerialArm", step_multiple=old.step_multiple, parameters=table | kept)
    for name, component in components.items():
        if component.model == "ArmController":
            components[name] = evolve(component, parameters={**component.parameters, "joints": model.count})
    return evolve(scenario, components=components)


def standing_at(scenario: Scenario, model: SerialModel, pose: Sequence[float]) -> Scenario:
    """The scenario with both arms at rest at the pose (n,) [rad]; places that tips belong to are the tip's there."""
    tip = tip_position(model, np.asarray(pose, dtype=float)).tolist()
    moved, components = at_pose(scenario, pose), dict[str, Component]()
    for name, component in moved.components.items():
        homes = dict.fromkeys((key for key in _HOMES if key in component.parameters), tip)
        components[name] = evolve(component, parameters={**component.parameters, **homes}) if homes else component
    return evolve(moved, components=components)


def looked_at_poses(scenario: Scenario, model: SerialModel, count: int, seed: int = 1) -> np.ndarray:
    """The pose that the scenario starts its SerialArm at, or the arm's own start, then random ones (count, n) [rad]."""
    first, low, high = home(model), model.lower, model.upper
    local = scenario.components[scenario.arms[0]] if scenario.arms else Component()
    if local.model == "SerialArm" and joints_of(local) == model.count:
        given = start_values(local).get("q_start")
        first = np.array(given, dtype=float) if isinstance(given, (list, tuple)) else first
    random = model.poses(count - 1, seed)
    middle = np.where(model.limited, 0.5 * (np.where(model.limited, low, 0) + np.where(model.limited, high, 0)), 0.0)
    return np.vstack([first, middle + _MIDDLE * (random - middle)])
