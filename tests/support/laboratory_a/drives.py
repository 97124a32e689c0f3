"""Drives between command and torque, and gears between motor and link.

A drive is a function of the moment that gives the torque for `now.u`. A gear is (transmit(twist, rate), flexible):
the torque on the link, and the columns in which motor and link turn apart.
"""

import numpy as np
from scipy.linalg import expm

from tests.support.laboratory_a.laws import ExperimentSizes, LaboratoryLaw, formula


def first_order(a, h):
    """T dx/dt = u - x, exact for a command held over the step."""
    share, x = -np.expm1(-h / np.maximum(a, 1e-9)), None

    def drive(n):
        nonlocal x
        x = n.u if x is None else x + share * (n.u - x)
        return x

    return drive


def second_order(damping):
    """x'' + 2 z w x' + w^2 (x - u) = 0 with delay 2 z/w = A at low frequency, exact for a held command."""

    def begin(a, h):
        w = 2 * damping / np.maximum(a, h / 5)
        steps = [expm(h * np.array([[0, 1, 0], [-k * k, -2 * damping * k, k * k], [0, 0, 0]])) for k in w]
        ab = np.stack(steps, axis=-1)
        x, rate = None, np.zeros_like(a)

        def drive(n):
            nonlocal x, rate
            if x is None:
                x = n.u
            x, rate = (ab[k, 0] * x + ab[k, 1] * rate + ab[k, 2] * n.u for k in (0, 1))
            return np.where(a > 0, x, n.u)

        return drive

    return begin


def actuator_lag(rng, s: ExperimentSizes):
    damping = rng.uniform(0.5, 1.0)
    begin, text = [(first_order, "first order"), (second_order(damping), "second order")][rng.integers(2)]
    scale = s.noise / s.torque_rate
    return LaboratoryLaw(
        "actuator_lag",
        text,
        ("history",),
        "delay at low frequency",
        "s",
        scale,
        begin,
        "drive",
        limit=0.35 / s.bandwidth,
        fixed={"damping": (damping, "")} if begin is not first_order else {},
    )


def dead_time(a, h):
    """u(t - A), linear between the steps."""
    length = int(np.max(a) / h) + 3
    whole = np.floor(a / h).astype(int)
    share, columns, k = a / h - whole, np.arange(len(a)), 0
    past = None

    def drive(n):
        nonlocal past, k
        if past is None:
            past = np.repeat(n.u[None], length, axis=0)
        past[k % length] = n.u
        new, old = past[(k - whole) % length, columns], past[(k - whole - 1) % length, columns]
        k += 1
        return new + share * (old - new)

    return drive


def held(a, h):
    """A drive that samples the command every A (bus cycle) and holds it: A/2 late on the average."""
    every = np.maximum(np.round(a / h).astype(int), 1)
    kept, k = None, 0

    def drive(n):
        nonlocal kept, k
        kept = n.u if kept is None else np.where(k % every == 0, n.u, kept)
        k += 1
        return kept

    return drive


def time_delay(rng, s: ExperimentSizes):
    begin, text, times = [(dead_time, "pure delay", 1), (held, "bus that holds for A", 2)][rng.integers(2)]
    scale = times * s.noise / s.torque_rate
    return LaboratoryLaw(
        "time_delay", text, ("history",), "A", "s", scale, begin, "drive", limit=times * 0.35 / s.bandwidth
    )


def torque_gain(rng, s: ExperimentSizes):
    side = rng.choice([-1, 1])
    forms = {
        "u (1 + A)": lambda a, n: n.u * (1 + side * a),
        "u (1 - A |u|/peak), iron that saturates": lambda a, n: n.u * (1 - a * np.minimum(abs(n.u) / s.peak, 1)),
    }
    text = rng.choice(list(forms))
    return LaboratoryLaw(
        "torque_gain",
        text,
        ("torque",),
        "A",
        "",
        1.5 * s.noise / s.tau,
        formula(forms[text]),
        "drive",
        limit=0.4,
        fixed={"side": (float(side), ""), "peak": (s.peak, "N.m")},
    )


def torque_saturation(rng, s: ExperimentSizes):
    """A is the share of the planned peak that is cut."""
    top = 10 * s.speed
    forms = {
        "+-L, L = peak (1 - A)": lambda a, n: np.clip(n.u, -s.peak * (1 - a), s.peak * (1 - a)),
        "L falls with speed: (1 - |v|/v_top)": lambda a, n: np.clip(
            n.u, *(k * s.peak * (1 - a) * np.clip(1.25 - abs(n.v) / top, 0.1, 1) for k in (-1, 1))
        ),
        "L tanh(u/L), L = peak/(5A)": lambda a, n: s.peak / (5 * a) * np.tanh(n.u / (s.peak / (5 * a))),
    }
    text = rng.choice(list(forms))
    f = forms[text]
    begin = formula(lambda a, n: np.where(a > 0, f(np.maximum(a, 1e-9), n), n.u))
    return LaboratoryLaw(
        "torque_saturation",
        text,
        ("torque",),
        "A",
        "",
        0.05,
        begin,
        "drive",
        limit=0.8,
        fixed={"peak": (s.peak, "N.m"), "v_top": (top, "rad/s")},
    )


def torque_deadband(rng, s: ExperimentSizes):
    forms = {
        "sgn u max(|u| - A, 0)": lambda a, n: n.u - np.clip(n.u, -a, a),
        "u where |u| > A, else 0": lambda a, n: np.where(abs(n.u) > a, n.u, 0),
        "u^3/(u^2 + A^2)": lambda a, n: n.u**3 / (n.u**2 + a**2 + 1e-300),
    }
    text = rng.choice(list(forms))
    return LaboratoryLaw(
        "torque_deadband", text, ("torque",), "A", "N.m", 2 * s.noise, formula(forms[text]), "drive", limit=2 * s.tau
    )


def joint_elasticity(rng, s: ExperimentSizes):
    """Two masses (Spong 1987): k x + c dx/dt, or with a cubic term that hardens the spring. A = 1/k."""
    damping = rng.uniform(0.03, 0.15)
    hard = rng.choice([0.0, 0.5])
    reduced = s.inertia * s.rotor / (s.inertia + s.rotor)
    softest = s.inertia * ((1.3 if s.collocated else 6) * s.bandwidth) ** 2
    stiffest = max(reduced * (0.4 / s.h) ** 2, 2 * softest)
    scale = s.noise / (s.inertia**2 * s.acceleration * (s.acceleration / s.speed) ** 2)

    def begin(a, h):
        flexible = a > 0
        k = 1 / np.maximum(a, 1 / stiffest)
        c = 2 * damping * np.sqrt(k * reduced)
        wide = s.tau / k

        def transmit(twist, rate):
            return k * twist * (1 + hard * np.minimum(abs(twist) / wide, 3) ** 2) + c * rate

        return transmit, flexible

    text = "k x + c dx/dt" + (", k (1 + 0.5 (x/x1)^2)" if hard else "")
    return LaboratoryLaw(
        "joint_elasticity",
        text,
        ("history", "torque"),
        "1/k",
        "rad/(N.m)",
        scale,
        begin,
        "gear",
        limit=1 / softest,
        fixed={"damping ratio": (damping, ""), "rotor": (s.rotor, "kg.m^2")},
    )


def backlash(rng, s: ExperimentSizes):
    """Two masses with a gap of A: flanks that are springs with dampers, or Hunt and Crossley's impact, never
    pulling."""
    reduced = s.inertia * s.rotor / (s.inertia + s.rotor)
    k = reduced * (rng.uniform(0.12, 0.2) / s.h) ** 2
    damping, impact = rng.uniform(0.15, 0.4), rng.choice([False, True])
    c = 2 * damping * np.sqrt(k * reduced)

    def begin(a, h):
        def transmit(twist, rate):
            pressed = twist - np.clip(twist, -a / 2, a / 2)
            if impact:
                loss = 1.5 * np.clip(rate * np.sign(pressed) / (0.3 * s.speed), -0.6, 1)
                return k * pressed * (1 + loss)
            force = k * pressed + c * rate * (pressed != 0)
            return np.where(pressed > 0, np.maximum(force, 0), np.minimum(force, 0))

        return transmit, a > 0

    text = "a gap of A, " + ("impact k x (1 + b dx/dt)" if impact else "flanks k x + c dx/dt")
    fixed = {"k": (k, "N.m/rad"), "c": (c, "N.m.s/rad"), "rotor": (s.rotor, "kg.m^2")}
    return LaboratoryLaw(
        "backlash",
        text,
        ("history", "direction"),
        "A",
        "rad",
        2e-3 * s.reach,
        begin,
        "gear",
        limit=0.3 * s.reach,
        fixed=fixed,
    )
