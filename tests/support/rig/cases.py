"""Cases: an effect of the library at a size, on a joint, as the fields of a rig's plant. Sizes 1, 2, 4 double each
other.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from tests.support.rig.plant import ALGEBRAIC, SEGMENT, SIGN, TANH, RigPlant

COULOMB = np.array((25e-3, 9e-3, 9e-3))
VISCOUS = np.array((2.0e-3, 1.5e-3, 1.0e-3))
SIZES = (0.25, 0.5, 1.0, 2.0, 4.0)


@dataclass
class Case:
    """A plant with what is hidden in it: effect name -> joints (empty: complete)."""

    label: str
    plant: RigPlant
    truth: dict = field(default_factory=dict)
    size: float = 0.0
    declared: bool = False


def only(joint, value):
    """(3,) zero but for one joint (1-based)."""
    out = np.zeros(3)
    out[joint - 1] = value
    return out


def pair(i, j, value):
    """(9,) zero but for the torque on joint i from joint j (1-based)."""
    out = np.zeros(9)
    out[3 * (i - 1) + j - 1] = value
    return out


NORMALS = np.array(((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.6, 0.0, 0.8)))


def _fc(j):
    return COULOMB[j - 1]


# name -> (joint, size) -> fields of Plant. Size 1 is meant to be near what a good tool can still see.
EFFECTS = {
    "stribeck": lambda j, a: dict(stribeck=only(j, 0.15 * a * _fc(j)), stribeck_velocity=np.full(3, 0.25)),
    "coulomb_asymmetry": lambda j, a: dict(
        coulomb_up=only(j, 0.04 * a * _fc(j)), coulomb_down=only(j, -0.04 * a * _fc(j))
    ),
    "viscous_asymmetry": lambda j, a: dict(viscous_up=only(j, 0.5e-3 * a), viscous_down=only(j, -0.1e-3 * a)),
    "torque_offset": lambda j, a: dict(offset=only(j, 0.04 * a * _fc(j))),
    "load_friction": lambda j, a: dict(load=only(j, 0.05 * a)),
    "position_friction": lambda j, a: dict(friction_wave=only(j, 0.15 * a)),
    "position_torque": lambda j, a: dict(spring=only(j, 2e-3 * a), spring_cubic=only(j, 1e-3 * a)),
    "torque_ripple": lambda j, a: dict(ripple=only(j, 0.5e-3 * a), ripple_order=np.full(3, 26.0)),
    "hysteresis": lambda j, a: dict(presliding=only(j, 0.2 * a * _fc(j)), presliding_length=np.full(3, 0.03)),
    "quadratic_drag": lambda j, a: dict(drag=only(j, 0.6e-3 * a)),
    "actuator_lag": lambda j, a: dict(lag=only(j, 3e-3 * a)),
    "time_delay": lambda j, a: dict(delay=only(j, 3e-3 * a)),
    "torque_gain": lambda j, a: dict(gain=only(j, -0.05 * a)),
    "torque_saturation": lambda j, a: dict(limit_share=only(j, 0.015 * a)),
    "torque_deadband": lambda j, a: dict(deadband=only(j, 0.1 * a * _fc(j))),
    "joint_elasticity": lambda j, a: dict(compliance=only(j, {1: 0.06, 2: 0.06, 3: 0.12}[j] * a), law=TANH, width=0.02),
    "backlash": lambda j, a: dict(compliance=only(j, 0.02), gap=only(j, 0.01 * a), law=TANH, width=0.02),
    "payload": lambda j, a: dict(payload=0.004 * a),
    "base_tilt": lambda j, a: dict(tilt=np.array((0.02, 0.015)) * a),
    "encoder_offset": lambda j, a: dict(encoder_offset=only(j, 0.03 * a)),
    "friction_drift": lambda j, a: dict(warm_up=only(j, 0.1 * a)),
    "external_contact": lambda j, a: dict(
        wall_normal=NORMALS[j - 1], wall_stiffness=2.5 * a, wall_damping=0.05, wall_share=0.85
    ),
    "joint_coupling": lambda j, a: dict(
        couple_viscous=pair(j, j % 3 + 1, 0.5e-3 * a), couple_coulomb=pair(j, j % 3 + 1, 0.04 * a * _fc(j))
    ),
}
# what the residual depends on: one of these sets, of the joint with the effect; without numbers any joint
OUTSIDE = {
    "hum": (lambda j, a: dict(hum=only(j, 1e-3 * a)), ({"time"},)),
    "drag_at_angle": (lambda j, a: dict(drag_at_angle=only(j, 4e-3 * a)), ({"q", "dq"},)),
    "cross": (lambda j, a: dict(cross=only(j, 1e-3 * a)), ({"dq1", "dq2"},)),
    "touch": (lambda j, a: dict(touch=only(j, 2e-3 * a)), ({"time"},)),
    "wander": (lambda j, a: dict(wander=only(j, 1e-3 * a)), ({"time"},)),
    "eddy": (lambda j, a: dict(eddy=only(j, 10e-3 * a), eddy_velocity=np.full(3, 0.5)), ({"dq"},)),
    "fading_gain": (lambda j, a: dict(fading_gain=only(j, {1: 8.0, 2: 3.0, 3: 3.0}[j] * a)), ({"tau"},)),
    "eccentric": (lambda j, a: dict(eccentric=only(j, 0.01 * a)), ({"q", "tau"},)),
    "squeeze": (lambda j, a: dict(squeeze=only(j, 0.15 * a)), ({"q", "dq"},)),
    "sticky": (lambda j, a: dict(sticky=only(j, 0.05 * a)), ({"time"},)),
    "loaded_ripple": (
        lambda j, a: dict(loaded_ripple=only(j, 0.01 * a), ripple_order=np.full(3, 26.0)),
        ({"q", "tau"},),
    ),
    "windage": (lambda j, a: dict(windage=only(j, 1e-3 * a)), ({"dq"},)),
    "crosstalk": (lambda j, a: dict(crosstalk=only(j, 0.02 * a)), ({"tau"},)),
    "sag": (lambda j, a: dict(sag=only(j, 1e-3 * a)), ({"time"},)),
    "lost_counts": (lambda j, a: dict(lost_counts=only(j, 0.01 * a)), ({"time"},)),
    "bumper": (lambda j, a: dict(bumper=only(j, 0.02 * a)), ({"q"},)),
    "flywheel": (lambda j, a: dict(flywheel=only(j, 0.08e-3 * a)), ({"tau"}, {"history of q"})),
}
ARM_WIDE = ("payload", "base_tilt", "external_contact")
DECLARED = ("payload", "torque_gain")
JOINTS = {"encoder_offset": (2, 3), "backlash": (1, 3)}
UNIDENTIFIABLE = ("payload", "torque_gain")  # unless the parameters are declared


def base(seed):
    """A complete arm with friction of its own: laws, widths and levels vary with the seed."""
    random = np.random.default_rng(seed)
    law = (TANH, ALGEBRAIC, SIGN, TANH)[seed % 4]
    width = (0.01, 0.02, 0.01, 0.05)[(seed // 4) % 4]
    pi = SEGMENT * random.uniform(0.9, 1.1, 8)
    coulomb = COULOMB * random.uniform(0.8, 1.2, 3)
    return RigPlant(pi=pi, law=law, width=width, coulomb=coulomb, viscous=VISCOUS * random.uniform(0.5, 1.5, 3))


def complete(seed):
    """Nothing hidden."""
    return Case("complete", base(seed))


def hidden(name, size, seed):
    """One effect of the library; the joint goes round with the seed."""
    joints = JOINTS.get(name, (1, 2, 3))
    joint = joints[seed % len(joints)]
    truth = {name: {1, 2, 3} if name in ARM_WIDE else {joint}}
    plant = replace(base(seed), **EFFECTS[name](joint, size))
    return Case(name, plant, truth, size, declared=name in DECLARED)


PLAIN = {
    "stribeck": ("stribeck", "stribeck_velocity"),
    "torque_offset": ("offset",),
    "load_friction": ("load",),
    "quadratic_drag": ("drag",),
    "actuator_lag": ("lag",),
    "time_delay": ("delay",),
    "torque_gain": ("gain",),
    "torque_deadband": ("deadband",),
    "joint_elasticity": ("compliance",),
    "backlash": ("gap",),
    "encoder_offset": ("encoder_offset",),
}
LABELS = {
    "offset": "torque_offset",
    "load": "load_friction",
    "drag": "quadratic_drag",
    "lag": "actuator_lag",
    "delay": "time_delay",
    "gain": "torque_gain",
    "deadband": "torque_deadband",
    "compliance": "joint_compliance",
    "gap": "backlash",
}


COUPLED = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))  # joints of the FMU's coupling_*[1..6]


def true_parameters(case):
    """FMU parameters of a hidden effect, for effects whose law is that of the FMU."""
    p, name, joint = case.plant, case.label, min(next(iter(case.truth.values()))) - 1
    at, to = f"[{joint + 1}]", (joint + 1) % 3
    other, coupled = 3 * joint + to, f"[{COUPLED.index((joint, to)) + 1}]"
    if name in PLAIN:
        return {LABELS.get(field, field) + at: getattr(p, field)[joint] for field in PLAIN[name]}
    amplitude, order = p.ripple[joint], p.ripple_order[joint]
    level = p.coulomb[joint] * p.friction_wave[joint]
    known = {
        "coulomb_asymmetry": {"coulomb_asymmetry" + at: (p.coulomb_up - p.coulomb_down)[joint] / 2},
        "viscous_asymmetry": {"viscous_asymmetry" + at: (p.viscous_up - p.viscous_down)[joint] / 2},
        "torque_ripple": {
            "ripple_sin" + at: amplitude * np.cos(p.ripple_phase[joint]),
            "ripple_cos" + at: amplitude * np.sin(p.ripple_phase[joint]),
            "ripple_order" + at: order,
        },
        "position_friction": {
            "position_friction_sin" + at: level * np.sin(p.friction_phase[joint]),
            "position_friction_cos" + at: level * np.cos(p.friction_phase[joint]),
        },
        "friction_drift": {"friction_drift" + at: p.warm_up[joint] / p.warm_time},
        "payload": {"payload": p.payload},
        "base_tilt": {"base_tilt[1]": p.tilt[0], "base_tilt[2]": p.tilt[1]},
        "external_contact": {"contact_stiffness": p.wall_stiffness, "contact_damping": p.wall_damping},
        "joint_coupling": {
            "coupling_viscous" + coupled: p.couple_viscous[other],
            "coupling_coulomb" + coupled: p.couple_coulomb[other],
        },
    }
    return known.get(name, {})


def two(first, second, size, seed):
    """Two effects of the library on joints of their own or the same one, by the seed."""
    one = hidden(first, size, seed)
    joints = JOINTS.get(second, (1, 2, 3))
    joint = joints[(seed // 3) % len(joints)]
    plant = replace(one.plant, **EFFECTS[second](joint, size))
    truth = {**one.truth, second: {1, 2, 3} if second in ARM_WIDE else {joint}}
    return Case(f"{first}+{second}", plant, truth, size)


def outside(name, size, seed):
    """An effect that no library has."""
    make, _ = OUTSIDE[name]
    joint = seed % 3 + 1
    return Case(name, replace(base(seed), **make(joint, size)), {"unknown": {joint}}, size)
