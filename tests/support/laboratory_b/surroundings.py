"""Torques of the angle, contacts, and what stands in no book."""

import math

import numpy as np

from tests.support.laboratory_b.friction import drag, level, table
from tests.support.laboratory_b.mechanism import JointScene, Law, Mechanism, Occurrence

Rng = np.random.Generator


def return_spring(rng: Rng, scene: JointScene) -> Occurrence:
    at, k = scene.inside(rng.uniform(0, 1)), 0.4 * scene.torque / scene.span
    return Occurrence(
        "a return spring over the whole range",
        ("q",),
        lambda s: drag(lambda t, q, v, load, oq, ov: -s * k * (q - at)),
        lambda s: {"stiffness": f"{s * k:.6g} N m/rad", "rest": f"{at:.6g} rad"},
    )


def leaf_spring(rng: Rng, scene: JointScene) -> Occurrence:
    at, k = scene.inside(rng.uniform(0.45, 0.65)), 1.0 * scene.torque / scene.span
    return Occurrence(
        "a leaf spring that is met beyond an angle",
        ("q",),
        lambda s: drag(lambda t, q, v, load, oq, ov: -s * k * (q - at) if q > at else 0.0),
        lambda s: {"stiffness": f"{s * k:.6g} N m/rad", "met at": f"{at:.6g} rad"},
        ("external_contact",),
    )


def cable_loom(rng: Rng, scene: JointScene) -> Occurrence:
    x = np.linspace(scene.low - 0.3 * scene.span, scene.high + 0.3 * scene.span, 8)
    curve, a = table(x, np.cumsum(rng.uniform(-1, 1, 8))), 0.15 * scene.torque
    return Occurrence(
        "a cable loom: a spline over the angle",
        ("q",),
        lambda s: drag(lambda t, q, v, load, oq, ov: s * a * curve(q)),
    )


def rubber(rng: Rng, scene: JointScene) -> Occurrence:
    at, a = scene.inside(rng.uniform(0.15, 0.3)), 2.0 * scene.torque
    return Occurrence(
        "a rubber stop below an angle: torque with the square of its squeeze",
        ("q",),
        lambda s: drag(lambda t, q, v, load, oq, ov: s * a * ((at - q) / scene.span) ** 2 * 8 if q < at else 0.0),
        alike=("external_contact",),
    )


def cogging(rng: Rng, scene: JointScene) -> Occurrence:
    order, phase = max(3, round(rng.uniform(18, 40) / scene.span)), rng.uniform(0, 2 * np.pi)
    a = 0.1 * scene.torque
    return Occurrence(
        f"cogging of order {order}",
        ("q",),
        lambda s: drag(lambda t, q, v, load, oq, ov: s * a * math.sin(order * q + phase)),
        lambda s: {"amplitude": f"{s * a:.6g} N m", "order": str(order), "phase": f"{phase:.6g} rad"},
    )


def two_orders(rng: Rng, scene: JointScene) -> Occurrence:
    order, (p, r) = max(3, round(rng.uniform(16, 30) / scene.span)), rng.uniform(0, 2 * np.pi, 2)
    a, second = 0.1 * scene.torque, rng.uniform(0.3, 0.7)
    return Occurrence(
        f"cogging of orders {order} and {2 * order}",
        ("q",),
        lambda s: drag(
            lambda t, q, v, load, oq, ov: s * a * (math.sin(order * q + p) + second * math.sin(2 * order * q + r))
        ),
    )


def magnet_table(rng: Rng, scene: JointScene) -> Occurrence:
    pitch = scene.span / rng.uniform(4, 8)
    pitch = 2 * np.pi / max(3, round(2 * np.pi / pitch))
    skew = rng.uniform(0.2, 0.45)
    curve, a = table([0, skew / 2, skew, 0.5 + skew / 2, 1], [0, 1, 0, -1, 0]), 0.12 * scene.torque
    return Occurrence(
        f"a table over the magnets' pitch, {2 * np.pi / pitch:.0f} a turn, steeper on one side",
        ("q",),
        lambda s: drag(lambda t, q, v, load, oq, ov: s * a * curve((q / pitch) % 1.0)),
    )


# --- contact ----------------------------------------------------------------------------------------------------------


def soft_thing(rng: Rng, scene: JointScene) -> Occurrence:
    at, k = scene.inside(rng.uniform(0.6, 0.75)), 2.5 * scene.torque / scene.span
    c = 0.1 * scene.torque / scene.top

    def at_size(size: float) -> Mechanism:
        def law(t, q, v, load, oq, ov):
            return -size * max(k * (q - at) + c * v, 0.0) if q > at else 0.0

        return drag(law)

    return Occurrence(
        "a cushion in part of the range: spring and damper, never pulling",
        ("q", "speed"),
        at_size,
        lambda s: {"stiffness": f"{s * k:.6g} N m/rad", "met at": f"{at:.6g} rad"},
        ("position_torque",),
    )


def hard_thing(rng: Rng, scene: JointScene) -> Occurrence:
    k = scene.inertia * (2 * np.pi * 6) ** 2

    def at_size(size: float) -> Mechanism:
        at = scene.high - scene.span * min(0.04 * size, 0.6)

        def law(t, q, v, load, oq, ov):
            over = q - at
            return -max(k * over * (1 + 0.6 * max(-1.0, min(v, 5.0))), 0.0) if over > 0 else 0.0

        return drag(law)

    return Occurrence(
        "something hard near the end of the range (Hunt and Crossley)",
        ("q", "speed"),
        at_size,
        alike=("position_torque",),
    )


def somebody_leans(rng: Rng, scene: JointScene) -> Occurrence:
    count = int(rng.integers(1, 3))
    starts = np.sort(rng.uniform(0.1, 0.8, count)) * scene.duration
    length = min(rng.uniform(1.5, 4), 0.2 * scene.duration)
    a = rng.choice([-1.0, 1.0]) * 0.4 * scene.torque

    def at(size: float) -> Mechanism:
        def law(t, q, v, load, oq, ov):
            total = 0.0
            for start in starts:
                s = t - start
                if 0 < s < length:
                    total += size * a * min(s / 0.3, 1.0, (length - s) / 0.3)
            return total

        return drag(law)

    return Occurrence("somebody leans on the link for some seconds", ("time",), at)


# --- in no book -------------------------------------------------------------------------------------------------------


def friction_of_neighbour(rng: Rng, scene: JointScene) -> Occurrence:
    a, phase, n = 0.4 * scene.dry + 0.1 * scene.torque, rng.uniform(0, 2 * np.pi), rng.uniform(1.0, 2.5)
    return Occurrence(
        "friction that depends on the angle of the neighbour",
        ("q of the other joint", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * a * (1 + math.cos(n * oq - phase))),
    )


def product_of_speeds(rng: Rng, scene: JointScene) -> Occurrence:
    a = 0.15 * scene.torque / scene.speed / scene.other_speed
    return Occurrence(
        "a torque with the product of two joints' speeds",
        ("speed", "speed of the other joint"),
        lambda s: drag(lambda t, q, v, load, oq, ov: s * a * v * ov),
    )


def supply_voltage(rng: Rng, scene: JointScene) -> Occurrence:
    periods = scene.duration / rng.uniform(2.2, 6.3, 2)
    a, logged = 0.15 * scene.torque, bool(rng.integers(2))

    def volts(t: float) -> float:
        return math.sin(2 * math.pi * t / periods[0] + 0.4) + 0.6 * math.sin(2 * math.pi * t / periods[1])

    name = f"supply voltage ({'logged' if logged else 'not logged'})"
    return Occurrence(
        f"a torque with the {name}",
        (name, "time"),
        lambda s: drag(lambda t, q, v, load, oq, ov: s * a * volts(t)),
        signal="supply" if logged else None,
    )


def shaking_floor(rng: Rng, scene: JointScene) -> Occurrence:
    f, phase, a = rng.uniform(1.5, 7), rng.uniform(0, 2 * np.pi), 0.12 * scene.torque
    return Occurrence(
        f"the floor oscillates at {f:.3f} Hz",
        ("time",),
        lambda s: drag(lambda t, q, v, load, oq, ov: s * a * math.sin(2 * math.pi * f * t + phase)),
    )


def sticking_after_rest(rng: Rng, scene: JointScene) -> Occurrence:
    a, fade, still_speed = scene.dry + 0.4 * scene.torque, 0.15 * scene.span, 0.02 * scene.top

    def at(size: float) -> Mechanism:
        def make(step: float) -> Law:
            still, glue = 0.0, 0.0

            def law(t, q, v, load, oq, ov):
                nonlocal still, glue
                if abs(v) < still_speed:
                    still += step
                    glue = max(glue, size * a * (1 - math.exp(-still / 0.4)))
                else:
                    still = 0.0
                    glue *= math.exp(-abs(v) * step / fade)
                return glue

            return law

        return Mechanism(friction=(make,))

    return Occurrence("friction grows while the joint stands still and is worn off over a way", ("time at rest",), at)


def jamming(rng: Rng, scene: JointScene) -> Occurrence:
    count = int(rng.integers(4, 10))
    starts, lengths = np.sort(rng.uniform(0.05, 0.95, count)) * scene.duration, rng.uniform(0.1, 0.5, count)
    a = 0.4 * scene.dry + 0.2 * scene.torque
    moments = list(zip(starts.tolist(), lengths.tolist(), strict=True))

    def at(size: float) -> Mechanism:
        return level(lambda t, q, v, load, oq, ov: size * a if any(s < t < s + n for s, n in moments) else 0.0)

    return Occurrence("a bearing jams at random moments", ("time", "direction"), at)


def switching_fan(rng: Rng, scene: JointScene) -> Occurrence:
    half, phase, a = scene.duration / rng.uniform(5, 11), rng.uniform(0, 1), 0.1 * scene.torque
    return Occurrence(
        "a fan that switches on and off",
        ("time",),
        lambda s: drag(lambda t, q, v, load, oq, ov: s * a if (t / half + phase) % 2 < 1 else 0.0),
    )


def thinning_grease(rng: Rng, scene: JointScene) -> Occurrence:
    v0, b = scene.top * rng.uniform(0.1, 0.25), 0.4 * scene.torque
    return Occurrence(
        "grease that thins: viscous drag that grows ever less with speed",
        ("speed",),
        lambda s: drag(lambda t, q, v, load, oq, ov: -s * b * v / (v0 + abs(v))),
    )


FORMS = {
    "position_torque": (return_spring, leaf_spring, cable_loom, rubber),
    "torque_ripple": (cogging, two_orders, magnet_table),
    "external_contact": (soft_thing, hard_thing, somebody_leans),
}
OUTSIDE_ANYWHERE = (
    supply_voltage,
    shaking_floor,
    sticking_after_rest,
    jamming,
    switching_fan,
    thinning_grease,
)
OUTSIDE_TWO_JOINTS = (friction_of_neighbour, product_of_speeds)
