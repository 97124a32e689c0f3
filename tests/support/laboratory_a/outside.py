"""Things that stand in no book of effects; their names say on which logged signals they depend."""

import numpy as np

from tests.support.laboratory_a.laws import ExperimentSizes, LaboratoryLaw, formula


def other_angle(rng, s: ExperimentSizes):
    k, phase = rng.uniform(1, 2.5) / s.other_reach, rng.uniform(0, 6.28)
    return LaboratoryLaw(
        "unknown:q_other",
        "-A (1 + cos(k q_other + phase)) sgn v",
        ("q_other", "direction"),
        "A",
        "N.m",
        2 * s.noise,
        formula(lambda a, n: -a * (1 + np.cos(k * n.other_q + phase)) * s.sign(n.v)),
        fixed={"k": (k, "1/rad"), "phase": (phase, "rad")},
    )


def room_temperature(rng, s: ExperimentSizes):
    """A torque by the room's temperature, which is logged or not."""
    logged = rng.random() < 0.7
    period, phase = s.duration * rng.uniform(0.3, 0.9), rng.uniform(0, 6.28)
    room = lambda t: 22 + 2 * np.sin(2 * np.pi * t / period + phase) + 0.3 * np.sin(11 * t / period)  # noqa: E731
    word = "temperature" if logged else "time"
    return LaboratoryLaw(
        f"unknown:{word}",
        "A (temperature - 22)/2",
        (word,),
        "A",
        "N.m",
        1.4 * s.noise,
        formula(lambda a, n: a * (room(n.t) - 22) / 2),
        signals={word: (room, "degC")} if logged else {},
    )


def supply_voltage(rng, s: ExperimentSizes):
    """The gain of the drive follows its supply, which is logged."""
    period = rng.uniform(1.5, 6.0)
    supply = lambda t: 24 + 2 * np.sin(2 * np.pi * t / period) + 1.0 * np.sin(2 * np.pi * t / (0.31 * period))  # noqa: E731
    return LaboratoryLaw(
        "unknown:voltage",
        "u (1 + A (voltage - 24)/2)",
        ("voltage", "torque"),
        "A",
        "",
        1.4 * s.noise / s.tau,
        formula(lambda a, n: n.u * (1 + a * (supply(n.t) - 24) / 2)),
        "drive",
        limit=0.4,
        signals={"voltage": (supply, "V")},
    )


def floor_vibration(rng, s: ExperimentSizes):
    f, phase = rng.uniform(1.5, 14), rng.uniform(0, 6.28)
    return LaboratoryLaw(
        "unknown:time",
        "A sin(2 pi f t + phase), the floor",
        ("time",),
        "A",
        "N.m",
        1.4 * s.noise,
        formula(lambda a, n: a * np.sin(2 * np.pi * f * n.t + phase)),
        fixed={"f": (f, "Hz")},
    )


def rest_time(rng, s: ExperimentSizes):
    """Stiction that grows with the time at rest and is worn off by sliding (Rabinowicz 1958)."""
    grow, d = rng.uniform(0.1, 0.4), 0.15 * s.reach

    def begin(a, h):
        age = np.zeros_like(a)

        def torque(n):
            nonlocal age
            still = np.exp(-((n.v / (0.1 * s.speed)) ** 2))
            age = age + h * (still * (1 - age) / grow - abs(n.v) * age / d)
            return -a * age * s.sign(n.v)

        return torque

    return LaboratoryLaw(
        "unknown:dq,time",
        "-A age sgn v; age grows at rest, falls with the way",
        ("time", "speed", "direction"),
        "A",
        "N.m",
        6 * s.noise,
        begin,
        fixed={"grow": (grow, "s"), "d": (d, "rad")},
    )


def speed_product(rng, s: ExperimentSizes):
    both = s.speed * s.other_speed
    return LaboratoryLaw(
        "unknown:dq,dq_other",
        "A dq dq_other/(v1 v2)",
        ("dq", "dq_other"),
        "A",
        "N.m",
        1.2 * s.noise,
        formula(lambda a, n: a * n.v * n.other_v / both),
        fixed={"v1 v2": (both, "rad^2/s^2")},
    )


def jams(rng, s: ExperimentSizes):
    count = max(4, int(s.duration / 4))
    starts, lengths = np.sort(rng.uniform(0, s.duration, count)), rng.uniform(0.1, 0.6, count)

    def torque(a, n):
        k = np.maximum(np.searchsorted(starts, n.t) - 1, 0)
        return -a * np.sin(np.pi * np.clip((n.t - starts[k]) / lengths[k], 0, 1)) * s.sign(n.v)

    return LaboratoryLaw(
        "unknown:time",
        "-A sgn v at random moments, a bearing that jams",
        ("time", "direction"),
        "A",
        "N.m",
        5 * s.noise,
        formula(torque),
        fixed={"count": (float(count), "")},
    )


def fan(rng, s: ExperimentSizes):
    half = rng.uniform(2, max(2.5, s.duration / 5))
    return LaboratoryLaw(
        "unknown:time",
        "A while a fan runs",
        ("time",),
        "A",
        "N.m",
        2 * s.noise,
        formula(lambda a, n: a * 0.5 * (1 + np.tanh(8 * np.sin(np.pi * n.t / half)))),
        fixed={"half period": (half, "s")},
    )


def thin_grease(rng, s: ExperimentSizes):
    """Shear thinning (Carreau): the drag rises ever more slowly with speed."""
    v1, power = s.speed * rng.uniform(0.15, 0.4), rng.uniform(0.2, 0.5)
    return LaboratoryLaw(
        "unknown:dq",
        "-A v/v1 (1 + (v/v1)^2)^((n - 1)/2)",
        ("speed",),
        "A",
        "N.m",
        4 * s.noise,
        formula(lambda a, n: -a * n.v / v1 * (1 + (n.v / v1) ** 2) ** (0.5 * (power - 1))),
        fixed={"v1": (v1, "rad/s"), "n": (power, "")},
    )


OUTSIDE = {
    f.__name__: f
    for f in (
        other_angle,
        room_temperature,
        supply_voltage,
        floor_vibration,
        rest_time,
        speed_product,
        jams,
        fan,
        thin_grease,
    )
}
