"""Friction as it is met: levels, tables, warming, worn spots, and what happens before a joint slips."""

import math

import numpy as np
from scipy.interpolate import PchipInterpolator

from tests.support.laboratory_b.mechanism import JointScene, Law, Mechanism, Occurrence, of_state

Rng = np.random.Generator


def level(law: Law) -> Mechanism:
    return Mechanism(friction=(of_state(law),))


def table(x, y):
    """A quick look-up in a fine table of a curve without overshoot."""
    fine = np.linspace(x[0], x[-1], 800)
    values = PchipInterpolator(x, y)(fine).tolist()
    start, scale, last = float(fine[0]), 799 / float(fine[-1] - fine[0]), 798

    def look(at: float) -> float:
        s = (at - start) * scale
        if s <= 0:
            return values[0]
        k = int(s)
        return values[799] if k > last else values[k] + (s - k) * (values[k + 1] - values[k])

    return look


# --- greater just before motion -------------------------------------------------------------------------------------


def breakaway_textbook(rng: Rng, scene: JointScene) -> Occurrence:
    v_s, exponent = scene.top * rng.uniform(0.03, 0.12), rng.choice([1.0, 2.0])
    extra = 0.5 * scene.dry + 0.1 * scene.torque
    return Occurrence(
        f"Coulomb plus F exp(-(|dq|/v_s)^{exponent:.0f})",
        ("speed", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * extra * math.exp(-((abs(v) / v_s) ** exponent))),
        lambda s: {"level above Coulomb": f"{s * extra:.6g} N m", "v_s": f"{v_s:.6g} rad/s", "exponent": str(exponent)},
    )


def breakaway_table(rng: Rng, scene: JointScene) -> Occurrence:
    knots = scene.top * np.array([0.0, 0.02, 0.05, 0.12, 0.3, 1.5])
    curve = table(knots, [1, rng.uniform(0.75, 1.0), rng.uniform(0.4, 0.7), rng.uniform(0.1, 0.3), 0.0, 0.0])
    extra = 0.5 * scene.dry + 0.1 * scene.torque
    return Occurrence(
        "a measured curve over the speed that falls from standstill to a third of the top speed",
        ("speed", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * extra * curve(abs(v))),
    )


def breakaway_hyperbola(rng: Rng, scene: JointScene) -> Occurrence:
    v_s = scene.top * rng.uniform(0.03, 0.08)
    extra = 0.5 * scene.dry + 0.1 * scene.torque
    return Occurrence(
        "Hess and Soom: F / (1 + (dq/v_s)^2) above Coulomb",
        ("speed", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * extra / (1 + (v / v_s) ** 2)),
    )


# --- direction --------------------------------------------------------------------------------------------------------


def two_levels(rng: Rng, scene: JointScene) -> Occurrence:
    sign, extra = rng.choice([-1.0, 1.0]), 0.3 * scene.dry
    return Occurrence(
        "one level of dry friction in each direction",
        ("direction",),
        lambda s: level(lambda t, q, v, load, oq, ov: s * extra * (1 if v * sign > 0 else 0)),
        lambda s: {"level above the other direction": f"{s * extra:.6g} N m", "direction": f"{sign:+.0f}"},
        ("torque_offset",),
    )


def two_levels_soft(rng: Rng, scene: JointScene) -> Occurrence:
    sign, extra, width = rng.choice([-1.0, 1.0]), 0.3 * scene.dry, 0.05 * scene.top
    return Occurrence(
        "a seal with a lip: its level goes over from one direction to the other within a twentieth of the top speed",
        ("direction",),
        lambda s: level(lambda t, q, v, load, oq, ov: s * extra * (0.5 + 0.5 * math.tanh(sign * v / width))),
        alike=("torque_offset",),
    )


def drag(law: Law) -> Mechanism:
    return Mechanism(torque=(of_state(law),))


def two_viscous(rng: Rng, scene: JointScene) -> Occurrence:
    sign, b = rng.choice([-1.0, 1.0]), 0.2 * scene.torque / scene.speed
    return Occurrence(
        "viscous in one direction more than in the other",
        ("direction", "speed"),
        lambda s: drag(lambda t, q, v, load, oq, ov: -s * b * v if v * sign > 0 else 0.0),
        lambda s: {"coefficient above the other direction": f"{s * b:.6g} N m s/rad", "direction": f"{sign:+.0f}"},
    )


def check_valve(rng: Rng, scene: JointScene) -> Occurrence:
    sign, b, width = rng.choice([-1.0, 1.0]), 0.2 * scene.torque / scene.speed, 0.1 * scene.top
    return Occurrence(
        "a damper whose valve opens gradually in one direction",
        ("direction", "speed"),
        lambda s: drag(lambda t, q, v, load, oq, ov: -s * b * v * (0.5 + 0.5 * math.tanh(sign * v / width))),
    )


def square_drag(rng: Rng, scene: JointScene) -> Occurrence:
    c = 0.2 * scene.torque / scene.speed**2
    return Occurrence(
        "air: c dq |dq|",
        ("speed",),
        lambda s: drag(lambda t, q, v, load, oq, ov: -s * c * v * abs(v)),
        lambda s: {"c": f"{s * c:.6g} N m s^2/rad^2"},
    )


def pipe_drag(rng: Rng, scene: JointScene) -> Occurrence:
    power, c = rng.uniform(1.75, 2.3), 0.2 * scene.torque
    return Occurrence(
        f"fluid of a paddle: the speed to the power {power:.2f}",
        ("speed",),
        lambda s: drag(lambda t, q, v, load, oq, ov: -math.copysign(s * c * (abs(v) / scene.speed) ** power, v)),
    )


def fan_table(rng: Rng, scene: JointScene) -> Occurrence:
    x = scene.top * np.array([0, 0.25, 0.5, 0.75, 1.0, 1.5])
    y = (x / scene.speed) ** 2 * np.array([1, *rng.uniform(0.85, 1.15, 5)])
    curve, c = table(x, y), 0.2 * scene.torque
    return Occurrence(
        "a measured table of the drag of a fan, about the square of the speed",
        ("speed",),
        lambda s: drag(lambda t, q, v, load, oq, ov: -math.copysign(s * c * curve(abs(v)), v)),
    )


# --- load -------------------------------------------------------------------------------------------------------------


def share_of_load(rng: Rng, scene: JointScene) -> Occurrence:
    mu = 0.12
    return Occurrence(
        "teeth: dry friction of mu times the torque carried",
        ("load", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * mu * abs(load)),
        lambda s: {"mu": f"{s * mu:.6g}"},
    )


def efficiency(rng: Rng, scene: JointScene) -> Occurrence:
    loss, back = 0.12, rng.uniform(0.7, 1.0)
    return Occurrence(
        "efficiency: other losses while the motor drives than while the load drives",
        ("load", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * loss * abs(load) * (1 if load * v > 0 else back)),
    )


def load_table(rng: Rng, scene: JointScene) -> Occurrence:
    curve = table(scene.peak * np.array([0, 0.15, 0.4, 0.8, 2.0]), scene.peak * np.array([0, 0.02, 0.06, 0.1, 0.2]))
    return Occurrence(
        "a table of friction over the torque carried, from a worm gear's data sheet",
        ("load", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * curve(abs(load))),
    )


# --- angle ------------------------------------------------------------------------------------------------------------


def bent_shaft(rng: Rng, scene: JointScene) -> Occurrence:
    turns, phase = max(1.0, round(rng.uniform(3, 9) / scene.span)), rng.uniform(0, 2 * np.pi)
    a = 0.2 * scene.dry + 0.05 * scene.torque
    return Occurrence(
        f"bent shaft: {turns:.0f} times a turn",
        ("q", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * a * (1 + math.cos(turns * q - phase))),
        lambda s: {"amplitude": f"{s * a:.6g} N m", "times a turn": f"{turns:.0f}", "phase": f"{phase:.6g} rad"},
    )


def worn_spot(rng: Rng, scene: JointScene) -> Occurrence:
    at, width, a = scene.inside(rng.uniform(0.3, 0.7)), scene.span * rng.uniform(0.1, 0.2), 0.5 * scene.dry
    a += 0.1 * scene.torque
    return Occurrence(
        "a worn spot: friction is greater about one angle",
        ("q", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * a * math.exp(-(((q - at) / width) ** 2))),
    )


def along_range(rng: Rng, scene: JointScene) -> Occurrence:
    x = np.linspace(scene.low - 0.2, scene.high + 0.2, 7)
    curve, a = table(x, rng.permutation(np.linspace(0, 1, 7))), 0.5 * scene.dry + 0.1 * scene.torque
    return Occurrence(
        "a spline along the range",
        ("q", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * a * curve(q)),
    )


# --- time -------------------------------------------------------------------------------------------------------------


def warming_clock(rng: Rng, scene: JointScene) -> Occurrence:
    tau, a, sign = (
        scene.duration * rng.uniform(0.2, 0.5),
        0.5 * scene.dry + 0.05 * scene.torque,
        rng.choice([1.0, -0.4]),
    )
    return Occurrence(
        "warming: the level goes over from one to another exponentially",
        ("time", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * a * sign * (math.exp(-t / tau) - (sign < 0))),
        lambda s: {"time constant": f"{tau:.6g} s", "change": f"{-s * a * sign:.6g} N m"},
    )


def creeping_level(rng: Rng, scene: JointScene) -> Occurrence:
    x = np.linspace(0, scene.duration, 5)
    curve, a = table(x, np.sort(rng.uniform(0, 1, 5)) - 0.0), 0.6 * scene.dry + 0.05 * scene.torque
    return Occurrence(
        "the level creeps upward over the recording, a spline in time",
        ("time", "direction"),
        lambda s: level(lambda t, q, v, load, oq, ov: s * a * curve(t)),
    )


def running_in(rng: Rng, scene: JointScene) -> Occurrence:
    way, a = scene.speed * scene.duration * rng.uniform(0.2, 0.4), 0.5 * scene.dry + 0.05 * scene.torque

    def at(size: float) -> Mechanism:
        def make(step: float) -> Law:
            gone = 0.0

            def law(t, q, v, load, oq, ov):
                nonlocal gone
                gone += abs(v) * step
                return size * a * math.exp(-gone / way)

            return law

        return Mechanism(friction=(make,))

    return Occurrence("fresh grease spreads: the level falls with the way gone in a run", ("time", "direction"), at)


# --- before it slips --------------------------------------------------------------------------------------------------


def elements(widths, strengths) -> Mechanism:
    """Springs that each slip at their own twist (Masing, Iwan)."""
    pairs = list(zip(widths, strengths, strict=True))

    def make(step: float) -> Law:
        twist = [0.0] * len(pairs)

        def law(t, q, v, load, oq, ov):
            total, dq = 0.0, v * step
            for n, (width, strength) in enumerate(pairs):
                z = twist[n] + dq
                z = width if z > width else max(z, -width)
                twist[n] = z
                total -= strength * z / width
            return total

        return law

    return Mechanism(torque=(make,))


def sliding_springs(rng: Rng, scene: JointScene) -> Occurrence:
    widths = scene.span * np.geomspace(0.02, rng.uniform(0.15, 0.3), 4)
    share = rng.dirichlet(np.full(4, 4.0)) * (0.5 * scene.dry + 0.1 * scene.torque)
    return Occurrence(
        "four springs in parallel that slip one after another",
        ("q", "history of q"),
        lambda s: elements(widths, s * share),
    )


def dragged_cable(rng: Rng, scene: JointScene) -> Occurrence:
    width, a = scene.span * rng.uniform(0.08, 0.25), 0.4 * scene.dry + 0.1 * scene.torque
    return Occurrence(
        "a cable that is dragged along: a spring, then a constant torque",
        ("q", "history of q"),
        lambda s: elements([width], [s * a]),
        lambda s: {"torque": f"{s * a:.6g} N m", "slips after": f"{width:.6g} rad"},
    )


def dahl(rng: Rng, scene: JointScene) -> Occurrence:
    width, a = scene.span * rng.uniform(0.04, 0.1), 0.5 * scene.dry + 0.1 * scene.torque

    def at(size: float) -> Mechanism:
        def make(step: float) -> Law:
            z = 0.0

            def law(t, q, v, load, oq, ov):
                nonlocal z
                z = 1 - (1 - z) * math.exp(-v * step / width) if v > 0 else -1 + (1 + z) * math.exp(v * step / width)
                return -size * a * z

            return law

        return Mechanism(torque=(make,))

    parameters = lambda s: {"torque": f"{s * a:.6g} N m", "stiffness": f"{s * a / width:.6g} N m/rad"}  # noqa: E731
    return Occurrence("Dahl, beside the dry friction", ("q", "history of q"), at, parameters)


FORMS = {
    "stribeck": (breakaway_textbook, breakaway_table, breakaway_hyperbola),
    "coulomb_asymmetry": (two_levels, two_levels_soft),
    "viscous_asymmetry": (two_viscous, check_valve),
    "quadratic_drag": (square_drag, pipe_drag, fan_table),
    "load_friction": (share_of_load, efficiency, load_table),
    "position_friction": (bent_shaft, worn_spot, along_range),
    "friction_drift": (warming_clock, creeping_level, running_in),
    "hysteresis": (sliding_springs, dragged_cable, dahl),
}
