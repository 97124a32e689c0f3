"""Between command and link: the amplifier, the gear, the mounting, and the logger's zeros."""

import math
from collections import deque

import numpy as np

from tests.support.laboratory_b.chain import TipLoad
from tests.support.laboratory_b.mechanism import Amplifier, JointScene, Mechanism, Occurrence, SpringGear, of_state

Rng = np.random.Generator


def static(law: Amplifier) -> Mechanism:
    return Mechanism(amplifier=(lambda step: law,))


def late_first_order(rng: Rng, scene: JointScene) -> Occurrence:
    def at(size: float) -> Mechanism:
        def make(step: float) -> Amplifier:
            keep, x = math.exp(-step / (0.006 * size)), 0.0

            def law(t, u, v):
                nonlocal x
                x = u + (x - u) * keep
                return x

            return law

        return Mechanism(amplifier=(make,))

    return Occurrence("current loop of first order", ("torque's past",), at, lambda s: {"T": f"{0.006 * s:.6g} s"})


def late_second_order(rng: Rng, scene: JointScene) -> Occurrence:
    zeta = rng.uniform(0.6, 1.1)

    def at(size: float) -> Mechanism:
        def make(step: float) -> Amplifier:
            w, x, dx = 1 / (0.004 * size), 0.0, 0.0
            parts = max(1, math.ceil(w * step / 0.2))

            def law(t, u, v):
                nonlocal x, dx
                h = step / parts
                for _ in range(parts):
                    dx += h * (w * w * (u - x) - 2 * zeta * w * dx)
                    x += h * dx
                return x

            return law

        return Mechanism(amplifier=(make,))

    return Occurrence("current loop of second order", ("torque's past",), at)


def dead_time(rng: Rng, scene: JointScene) -> Occurrence:
    def at(size: float) -> Mechanism:
        def make(step: float) -> Amplifier:
            wait = 0.006 * size / step
            whole, part = int(wait), wait - int(wait)
            past = deque([0.0] * (whole + 2), maxlen=whole + 2)

            def law(t, u, v):
                past.append(u)
                return (1 - part) * past[1] + part * past[0]

            return law

        return Mechanism(amplifier=(make,))

    return Occurrence("pure dead time", ("torque's past",), at, lambda s: {"dead time": f"{0.006 * s:.6g} s"})


def bus_cycle(rng: Rng, scene: JointScene) -> Occurrence:
    def at(size: float) -> Mechanism:
        def make(step: float) -> Amplifier:
            cycle = max(1, round(0.004 * size / step))
            waiting, acting, n = 0.0, 0.0, 0

            def law(t, u, v):
                nonlocal waiting, acting, n
                if n % cycle == 0:
                    waiting, acting = u, waiting
                n += 1
                return acting

            return law

        return Mechanism(amplifier=(make,))

    return Occurrence("a slow bus: the command is taken once a cycle and acts in the next", ("torque's past",), at)


def gain(rng: Rng, scene: JointScene) -> Occurrence:
    sign = rng.choice([-1.0, 1.0])
    return Occurrence(
        "torque constant off by some percent",
        ("torque",),
        lambda s: static(lambda t, u, v: u * (1 + sign * 0.05 * s)),
        lambda s: {"true over commanded - 1": f"{sign * 0.05 * s:.6g}"},
    )


def warm_magnets(rng: Rng, scene: JointScene) -> Occurrence:
    knee = 1.5 * scene.peak
    return Occurrence(
        "weak magnets: the torque constant is lower, somewhat more so at high current",
        ("torque",),
        lambda s: static(lambda t, u, v: u * (1 - 0.05 * s * (1 + 0.3 * min((u / knee) ** 2, 1)))),
    )


def no_result_below(rng: Rng, scene: JointScene) -> Occurrence:
    width = 0.08 * scene.torque
    return Occurrence(
        "commands below a level have no result, the others come whole",
        ("torque",),
        lambda s: static(lambda t, u, v: 0.0 if abs(u) < s * width else u),
        lambda s: {"width": f"{s * width:.6g} N m"},
    )


def missing_part(rng: Rng, scene: JointScene) -> Occurrence:
    width = 0.05 * scene.torque
    return Occurrence(
        "dead time of the bridge: every command loses the same amount",
        ("torque",),
        lambda s: static(lambda t, u, v: math.copysign(max(abs(u) - s * width, 0.0), u)),
        lambda s: {"width": f"{s * width:.6g} N m"},
    )


def cut_off(rng: Rng, scene: JointScene) -> Occurrence:
    def limit(size):
        return scene.peak / (1 + 0.3 * size)

    return Occurrence(
        "cut off at a level",
        ("torque",),
        lambda s: static(lambda t, u, v: max(-limit(s), min(limit(s), u))),
        lambda s: {"limit": f"{limit(s):.6g} N m"},
    )


def cut_off_by_voltage(rng: Rng, scene: JointScene) -> Occurrence:
    fall = rng.uniform(0.1, 0.35) / scene.top

    def at(size: float) -> Mechanism:
        def law(t, u, v):
            limit = scene.peak / (1 + 0.3 * size) * (1 - min(fall * max(v * math.copysign(1, u), 0), 0.6))
            return max(-limit, min(limit, u))

        return static(law)

    return Occurrence("cut off at a level that falls with speed (voltage)", ("torque", "speed"), at)


def soft_limit(rng: Rng, scene: JointScene) -> Occurrence:
    def at(size: float) -> Mechanism:
        knee = scene.peak / (1.3 + 0.4 * size)
        rest = 0.15 * scene.peak

        def law(t, u, v):
            over = abs(u) - knee
            return u if over <= 0 else math.copysign(knee + rest * math.tanh(over / rest), u)

        return static(law)

    return Occurrence("a limit that sets in gradually above a knee", ("torque",), at)


# --- gear -------------------------------------------------------------------------------------------------------------


def flexing(rng: Rng, scene: JointScene) -> Occurrence:
    share, zeta = scene.rotor_share(rng.uniform(0.25, 0.5)), rng.uniform(0.05, 0.15)
    rotor = share * scene.inertia

    def stiffness(size):
        return scene.inertia * (2 * math.pi * 12) ** 2 * share * (1 - share) / size

    def at(size: float) -> Mechanism:
        k = stiffness(size)
        c = 2 * zeta * math.sqrt(k * scene.inertia * share * (1 - share))
        return Mechanism(gear=SpringGear(lambda x, dx: k * x + c * dx, rotor))

    return Occurrence(
        "torsion spring and damper between rotor and link, encoder on the rotor",
        ("twist",),
        at,
        lambda s: {"stiffness": f"{stiffness(s):.6g} N m/rad", "rotor": f"{rotor:.6g} kg m^2"},
    )


def stiffening(rng: Rng, scene: JointScene) -> Occurrence:
    share, zeta = scene.rotor_share(rng.uniform(0.25, 0.5)), rng.uniform(0.05, 0.15)

    def at(size: float) -> Mechanism:
        k = scene.inertia * (2 * math.pi * 10) ** 2 * share * (1 - share) / size
        c, knee = 2 * zeta * math.sqrt(k * scene.inertia * share * (1 - share)), scene.torque / k
        return Mechanism(
            gear=SpringGear(lambda x, dx: k * x * (1 + min((x / knee) ** 2, 8)) + c * dx, share * scene.inertia)
        )

    return Occurrence("strain-wave gear: a spring that stiffens with its twist", ("twist",), at)


def gap(width: float, k: float, c: float, rounded: bool):
    """Contact on both sides of a play of this width [rad]; the damper works in contact only."""
    half = width / 2

    def law(x, dx):
        over = x - half if x > half else x + half if x < -half else 0.0
        if over == 0.0:
            return 0.0
        touch = min(abs(over) / (0.2 * width + 1e-9), 1.0) if rounded else 1.0
        torque = (k * over + c * dx) * touch
        return torque if torque * over > 0 else 0.0

    return law


def play(rng: Rng, scene: JointScene) -> Occurrence:
    share, rounded = scene.rotor_share(rng.uniform(0.3, 0.5)), bool(rng.integers(2))

    def at(size: float) -> Mechanism:
        k = scene.inertia * (2 * math.pi * 70) ** 2 * share * (1 - share)
        c = 1.2 * math.sqrt(k * scene.inertia * share * (1 - share))
        return Mechanism(gear=SpringGear(gap(0.02 * size, k, c, rounded), share * scene.inertia))

    words = "teeth that engage gradually" if rounded else "stiff springs on both sides"
    return Occurrence(
        f"play between rotor and link, {words}", ("twist",), at, lambda s: {"play": f"{0.02 * s:.6g} rad"}
    )


# --- mounting and logging ---------------------------------------------------------------------------------------------


def unknown_weight(rng: Rng, scene: JointScene) -> Occurrence:
    lever, edge = rng.choice([0.0, 0.05]), rng.choice([0.0, 0.08])

    def mass(size):
        return 0.12 * scene.torque / 9.81 / 0.3 * size

    words = "a box beyond the tip" if lever or edge else "a point of mass at the tip"
    return Occurrence(
        f"{words} that the model does not know",
        ("q", "dq", "ddq"),
        lambda s: Mechanism(tip_load=TipLoad(mass(s), lever, edge)),
        lambda s: {"mass": f"{mass(s):.6g} kg", "beyond the tip": f"{lever} m"},
    )


def tilted(rng: Rng, scene: JointScene) -> Occurrence:
    heading = rng.uniform(0, 2 * np.pi) if rng.integers(2) else rng.choice([0, 0.5, 1, 1.5]) * np.pi
    x, y = math.cos(heading), math.sin(heading)
    return Occurrence(
        "base not level",
        ("q",),
        lambda s: Mechanism(tilt=(0.05 * s * x, 0.05 * s * y)),
        lambda s: {"about x": f"{0.05 * s * x:.6g} rad", "about y": f"{0.05 * s * y:.6g} rad"},
    )


def zero_off(rng: Rng, scene: JointScene) -> Occurrence:
    sign = rng.choice([-1.0, 1.0])
    return Occurrence(
        "zero of the encoder off",
        ("q",),
        lambda s: Mechanism(encoder_zero=0.04 * s * sign),
        lambda s: {"logged - true angle": f"{0.04 * s * sign:.6g} rad"},
    )


def sensor_offset(rng: Rng, scene: JointScene) -> Occurrence:
    sign = rng.choice([-1.0, 1.0])
    return Occurrence(
        "zero of the current sensor off",
        (),
        lambda s: Mechanism(sensor_zero=0.05 * s * sign * scene.torque),
        lambda s: {"logged - true torque": f"{0.05 * s * sign * scene.torque:.6g} N m"},
        ("coulomb_asymmetry",),
    )


def amplifier_offset(rng: Rng, scene: JointScene) -> Occurrence:
    sign = rng.choice([-1.0, 1.0])
    return Occurrence(
        "the amplifier adds a constant",
        (),
        lambda s: static(lambda t, u, v: u + 0.05 * s * sign * scene.torque),
        lambda s: {"true - commanded torque": f"{0.05 * s * sign * scene.torque:.6g} N m"},
        ("coulomb_asymmetry",),
    )


# --- another joint ----------------------------------------------------------------------------------------------------


def pulley_drag(rng: Rng, scene: JointScene) -> Occurrence:
    b = rng.choice([-1.0, 1.0]) * 0.1 * scene.torque / scene.other_speed
    return Occurrence(
        "a cable over a pulley of the neighbour: torque in proportion to its speed",
        ("speed of the other joint",),
        lambda s: Mechanism(torque=(of_state(lambda t, q, v, load, oq, ov: s * b * ov),)),
        lambda s: {"torque over the neighbour's speed": f"{s * b:.6g} N m s/rad"},
    )


def rubbing_sleeve(rng: Rng, scene: JointScene) -> Occurrence:
    a, v0 = rng.choice([-1.0, 1.0]) * 0.1 * scene.torque, 0.05 * scene.other_speed
    return Occurrence(
        "a sleeve that rubs on the neighbour: torque with the direction of its movement",
        ("direction of the other joint",),
        lambda s: Mechanism(torque=(of_state(lambda t, q, v, load, oq, ov: s * a * math.tanh(ov / v0)),)),
    )


def belt(rng: Rng, scene: JointScene) -> Occurrence:
    k = rng.choice([-1.0, 1.0]) * 0.15 * scene.torque
    return Occurrence(
        "an elastic belt to the neighbour: torque in proportion to its angle",
        ("q of the other joint",),
        lambda s: Mechanism(torque=(of_state(lambda t, q, v, load, oq, ov: s * k * oq),)),
        lambda s: {"torque over the neighbour's angle": f"{s * k:.6g} N m/rad"},
    )


FORMS = {
    "actuator_lag": (late_first_order, late_second_order),
    "time_delay": (dead_time, bus_cycle),
    "torque_gain": (gain, warm_magnets),
    "torque_deadband": (no_result_below, missing_part),
    "torque_saturation": (cut_off, cut_off_by_voltage, soft_limit),
    "joint_elasticity": (flexing, stiffening),
    "backlash": (play,),
    "payload": (unknown_weight,),
    "base_tilt": (tilted,),
    "encoder_offset": (zero_off,),
    "torque_offset": (sensor_offset, amplifier_offset),
    "joint_coupling": (pulley_drag, rubbing_sleeve, belt),
}
