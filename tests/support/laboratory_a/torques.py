"""Torques that depend on the angle, on the surroundings, on another joint; an offset; what the mounting does."""

import numpy as np

from tests.support.laboratory_a.laws import ExperimentSizes, LaboratoryLaw, formula


def torque_offset(rng, s: ExperimentSizes):
    side = rng.choice([-1, 1])
    text = rng.choice(["A at the amplifier", "A of the current sensor"])
    return LaboratoryLaw("torque_offset", text, (), "A", "N.m", s.noise * side, formula(lambda a, n: a))


def position_torque(rng, s: ExperimentSizes):
    c, r = s.centre, s.reach
    met, w = c + r * rng.uniform(0.0, 0.5), r * rng.uniform(0.15, 0.4)
    forms = {
        "-A ((q - c)/r)^3, a cable loom that stiffens": lambda a, n: -a * ((n.q - c) / r) ** 3,
        "-A (q - c)/r, a return spring": lambda a, n: -a * (n.q - c) / r,
        "-2A max(q - met, 0)/r, a leaf spring": lambda a, n: -2 * a * np.maximum(n.q - met, 0) / r,
        "-A exp((q - c - r)/w), a rubber stop": lambda a, n: -a * np.exp(np.minimum((n.q - c - r) / w, 3)),
        "-A tanh((q - met)/w), a cable laid over": lambda a, n: -a * np.tanh((n.q - met) / w),
        "-A sin(2 (q - met)), a counterweight on a gear": lambda a, n: -a * np.sin(2 * (n.q - met)),
    }
    text = rng.choice(list(forms))
    fixed = {"c": (c, "rad"), "r": (r, "rad"), "met": (met, "rad"), "w": (w, "rad")}
    return LaboratoryLaw("position_torque", text, ("q",), "A", "N.m", 4 * s.noise, formula(forms[text]), fixed=fixed)


def torque_ripple(rng, s: ExperimentSizes):
    """Cogging: Hanselman 2006; fundamental, with second harmonic, or flattened by wide slots."""
    most = min(60.0, 60 / s.speed)
    order = max(4, round(rng.uniform(5 / s.reach, max(most, 8 / s.reach))))
    phase = rng.uniform(0, 6.28)
    forms = {
        "A sin(n q + phase)": lambda a, n: a * np.sin(order * n.q + phase),
        "A (sin(n q + phase) + 0.4 sin(2 n q))": lambda a, n: (
            a * (np.sin(order * n.q + phase) + 0.4 * np.sin(2 * order * n.q))
        ),
        "A tanh(2 sin(n q + phase))": lambda a, n: a * np.tanh(2 * np.sin(order * n.q + phase)),
    }
    text = rng.choice(list(forms))
    fixed = {"n": (float(order), "1/rad"), "phase": (phase, "rad")}
    return LaboratoryLaw("torque_ripple", text, ("q",), "A", "N.m", 1.4 * s.noise, formula(forms[text]), fixed=fixed)


def external_contact(rng, s: ExperimentSizes):
    """Hertz with Hunt and Crossley's damping (1975), Kelvin-Voigt that cannot pull, a hand, a bath in part of
    the range."""
    met, d = s.centre + s.reach * rng.uniform(0.1, 0.6), 0.3 * s.reach
    depth = lambda n: np.maximum(n.q - met, 0) / d  # noqa: E731
    start = s.duration * rng.uniform(0.15, 0.6)
    long = min(s.duration * rng.uniform(0.1, 0.25), 8.0)
    hand = lambda n: np.sin(np.pi * np.clip((n.t - start) / long, 0, 1)) ** 2  # noqa: E731
    forms = {
        "-A x^1.5 (1 + 0.5 v/v1), x = max(q - met, 0)/d": (
            ("q", "speed"),
            lambda a, n: -a * depth(n) ** 1.5 * np.maximum(1 + 0.5 * n.v / s.speed, 0),
        ),
        "-A max(x + 0.3 v/v1, 0) where x = (q - met)/d > 0": (
            ("q", "speed"),
            lambda a, n: -a * np.maximum(depth(n) + 0.3 * n.v / s.speed, 0) * np.minimum(depth(n) * 10, 1),
        ),
        "-2A sin^2 over some seconds, a hand": (("time",), lambda a, n: -2 * a * hand(n)),
        "-A v/v1 where q > met, a bath": (
            ("q", "speed"),
            lambda a, n: -2 * a * n.v / s.speed / (1 + np.exp(-(n.q - met) / (0.1 * d))),
        ),
    }
    text = rng.choice(list(forms))
    fixed = {"met": (met, "rad"), "d": (d, "rad"), "v1": (s.speed, "rad/s"), "start": (start, "s"), "long": (long, "s")}
    depends, f = forms[text]
    return LaboratoryLaw("external_contact", text, depends, "A", "N.m", 2.5 * s.noise, formula(f), fixed=fixed)


def joint_coupling(rng, s: ExperimentSizes):
    """A cable of the other joint over a pulley on this one: viscous, dry, elastic; a gear that it carries along."""
    v, a0, small = s.other_speed, s.other_acceleration, 0.05 * s.other_speed
    ratio = rng.choice([-1, 1]) * rng.uniform(0.3, 1)
    forms = {
        "-A dq_other/v1": (("dq_other",), lambda a, n: -a * n.other_v / v),
        "-A sgn(dq_other)": (("dq_other",), lambda a, n: -a * np.tanh(n.other_v / small)),
        "-A (dq + r dq_other)/v1, a pulley with grease": (
            ("dq_other", "speed"),
            lambda a, n: -a * (n.v + ratio * n.other_v) / v,
        ),
        "-A ddq_other/a1, coupled gears": (("ddq_other",), lambda a, n: -a * n.other_a / a0),
        "-A (q + r q_other)/r1, an elastic cable": (
            ("q_other", "q"),
            lambda a, n: -a * (n.q + ratio * n.other_q) / s.other_reach,
        ),
    }
    text = rng.choice(list(forms))
    depends, f = forms[text]
    fixed = {"v1": (v, "rad/s"), "a1": (a0, "rad/s^2"), "r1": (s.other_reach, "rad"), "r": (ratio, "")}
    return LaboratoryLaw("joint_coupling", text, depends, "A", "N.m", 1.5 * s.noise, formula(f), fixed=fixed)


def payload(rng, s: ExperimentSizes):
    """`box` is the square of the radius of gyration of the body about its centre."""
    box = rng.choice([0.0, 0.02**2, 0.05**2])
    size = 2 * s.noise / (s.lever * (9.81 * s.gravity + s.lever * s.acceleration))
    text = "a mass at the tip, " + ("a point" if box == 0 else "a box")
    return LaboratoryLaw(
        "payload",
        text,
        ("q", "acceleration"),
        "mass",
        "kg",
        size,
        lambda a, h: box,
        "payload",
        fixed={"gyration": (float(np.sqrt(box)), "m")},
    )


def base_tilt(rng, s: ExperimentSizes):
    azimuth = rng.uniform(-np.pi, np.pi)
    return LaboratoryLaw(
        "base_tilt",
        "gravity turned by A towards the azimuth",
        ("q",),
        "A",
        "rad",
        0.01,
        lambda a, h: azimuth,
        "tilt",
        limit=0.5,
        fixed={"azimuth": (azimuth, "rad")},
    )


def encoder_offset(rng, s: ExperimentSizes):
    side = rng.choice([-1, 1])
    return LaboratoryLaw(
        "encoder_offset",
        "measured q = true q + A",
        ("q",),
        "A",
        "rad",
        0.01 * side,
        lambda a, h: None,
        "encoder",
        limit=0.5,
    )
