"""The list of phenomena with their forms, and on which machines each can be seen at all."""

from collections.abc import Callable

from tests.support.laboratory_c import drives, friction, outside, places
from tests.support.laboratory_c.additions import Addition
from tests.support.laboratory_c.scales import JointScales

Form = Callable[[JointScales], Addition]

FORMS: dict[str, tuple[Form, ...]] = {
    "stribeck": (friction.tustin, friction.gauss, friction.makkar),
    "coulomb_asymmetry": (friction.two_levels, friction.pawl),
    "viscous_asymmetry": (friction.two_coefficients, friction.check_valve),
    "quadratic_drag": (friction.square, friction.paddle, friction.laminar_first),
    "load_friction": (friction.share, friction.preloaded, friction.efficiency),
    "position_friction": (friction.bent_shaft, friction.worn_spot, friction.guide),
    "friction_drift": (friction.exponential_warming, friction.heated_by_losses, friction.oil_warming),
    "hysteresis": (friction.dahl, friction.bouc_wen, friction.slipping_springs),
    "position_torque": (places.return_spring, places.hose, places.two_leaves, places.over_centre),
    "torque_ripple": (places.one_order, places.harmonics, places.Commutation),
    "external_contact": (places.cushion, places.ball, places.Leaning, places.SoftPlane),
    "actuator_lag": (drives.first_order, drives.second_order),
    "time_delay": (drives.dead_time, drives.bus),
    "torque_gain": (drives.gain, drives.iron),
    "torque_deadband": (drives.threshold, drives.subtracted, drives.soft_threshold),
    "torque_saturation": (drives.hard_limit, drives.limit_by_speed, drives.soft_limit),
    "torque_offset": (drives.sensor_offset, drives.amplifier_offset),
    "encoder_offset": (places.ZeroOff,),
    "base_tilt": (places.tilt,),
    "payload": (places.weight, places.tool),
    "joint_elasticity": (drives.shaft, drives.strain_wave),
    "backlash": (drives.play, drives.spring_in_play),
    "joint_coupling": (places.belt, places.rubbing_gears, places.cable_over_both),
}
MANY = ("scara", "boom", "arm")
ANY = ("lift", "pendulum", *MANY)
WHERE: dict[str, tuple[str, ...]] = {
    "torque_offset": MANY,
    "coulomb_asymmetry": MANY,
    "joint_coupling": MANY,
    "base_tilt": ("scara", "boom"),
    "payload": ("scara", "boom"),
    "encoder_offset": ("scara", "boom", "arm"),
}
"""A fit of one joint takes up a constant, what differs by direction, weight, tilt and zero; a robot's a weight."""
TOLD = {drives.gain: "rigid", places.weight: "rigid", places.tool: "rigid"}
"""Forms that a fit of free columns takes up."""
JOINTS = {"encoder_offset": {"scara": (1,), "boom": (0,), "arm": (1, 2)}}
"""Where only some joints show it."""
OUTSIDE: tuple[Form, ...] = (*outside.OUTSIDE, *outside.WITH_NEIGHBOUR)


def machines(name: str, form: Form) -> tuple[str, ...]:
    """On which machines a form is drawn."""
    if form is places.SoftPlane or form in outside.WITH_NEIGHBOUR:
        return MANY
    if form in TOLD:
        return ("scara", "boom")
    return WHERE.get(name, ANY)
