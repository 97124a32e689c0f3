"""Which arms the batch kernel does not have: start values that its laws leave out, or that the FMUs refuse."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from cosim.signals import stem
from cosim.sweeps.lane import LaneComponent

_RIGID = {
    *("internal_steps", "gravity_compensation", "payload", "base_tilt", "viscous", "coulomb", "coulomb_velocity"),
    *("contact_stiffness", "contact_damping", "contact_normal", "contact_distance", "q_start", "dq_start"),
    *("tau", "f", "f_command", "x_ref", "stiffness", "damping"),
    *("coulomb_form", "stribeck", "stribeck_velocity", "stribeck_exponent", "coulomb_asymmetry", "viscous_asymmetry"),
    *("torque_offset", "load_friction", "position_friction_sin", "position_friction_cos", "position_torque"),
    *("position_torque_quadratic", "position_torque_cubic", "position_torque_sin", "position_torque_cos"),
    *("ripple_sin", "ripple_cos", "ripple_order", "hysteresis", "hysteresis_length", "hysteresis_exponent"),
    *("hysteresis_ratio", "hysteresis_tilt", "quadratic_drag", "friction_drift", "friction_drift_time"),
    *("torque_gain", "torque_deadband", "torque_threshold"),
    *("stop_stiffness", "stop_damping", "stop_angle", "stop_side"),
    *("coupling_viscous", "coupling_coulomb", "coupling_stiffness", "coupling_velocity"),
}
"""What may differ from the table in the kernel's arms."""
_PHANTOM = _RIGID | {"pi", "mounting", "workspace_limits", "torque_saturation"}
_TABLE = {
    *("joints", "joint_type", "origin_x", "origin_y", "origin_z", "origin_roll", "origin_pitch", "origin_yaw"),
    *("axis_x", "axis_y", "axis_z", "mass", "centre_x", "centre_y", "centre_z", "rotor_inertia", "gear_ratio"),
    *("inertia_xx", "inertia_xy", "inertia_xz", "inertia_yy", "inertia_yz", "inertia_zz", "lower", "upper"),
    *("joint_limits", "gravity", "tip", "coupling_on", "coupling_from"),
}
_MOTORS = {
    *("torque_saturation", "actuator_lag", "joint_compliance", "motor_inertia", "joint_damping", "backlash"),
    *("encoder_resolution", "encoder_offset"),
}
_SERIAL = _RIGID | _TABLE | _MOTORS
_CHOSEN = {"stribeck_exponent": (1.0, 2.0), "coulomb_form": (0.0, 1.0, 2.0), "stop_side": (-1.0, 1.0)}
"""The numbers that the arms take for them."""


def unfit_phantom(part: LaneComponent) -> str | None:
    """Why the kernel cannot run a PHANToM; None where it can."""
    return _outside(part, _PHANTOM) or _without_normal(part)


def unfit_serial(part: LaneComponent) -> str | None:
    """Why the kernel cannot run a serial arm; None where it can."""
    return _outside(part, _SERIAL) or _without_normal(part) or _unfit_table(part)


def _outside(part: LaneComponent, law: Collection[str]) -> str | None:
    variables = part.description.variables
    for name, value in part.starts.items():
        kind = stem(name)
        if (kind not in law and value != variables[name].start) or value not in _CHOSEN.get(kind, (value,)):
            return f"its {name} is {value!r}"
    return None


def _without_normal(part: LaneComponent) -> str | None:
    if part.number("contact_stiffness") > 0 and not any(part.number(f"contact_normal[{i}]") for i in (1, 2, 3)):
        return "its contact_normal is zero"
    return None


def _unfit_table(part: LaneComponent) -> str | None:
    """What the FMU refuses of a table before it computes; what it refuses then, the kernel leaves to it."""
    joints = int(part.number("joints"))

    def column(name: str) -> np.ndarray:
        return np.array([part.number(f"{name}[{i + 1}]") for i in range(joints)])

    axis = np.array([column(f"axis_{k}") for k in "xyz"]).T
    lengths = np.abs(axis).sum(axis=1)
    if not np.all((lengths > 1e-6) & (lengths < 1e6)):
        return "one of its axes has no direction"
    ends = zip(*([part.number(name) for name in part.elements([f"coupling_{end}"])] for end in ("on", "from")))
    if not all((0 < on <= joints and 0 < by <= joints and on != by) or on == by == 0 for on, by in ends):
        return "one of its couplings is not of two joints"
    return None
