"""Forms of friction beyond Coulomb and viscous. Each torque acts against the drive side of the joint."""

import numpy as np

from tests.support.laboratory_a.laws import ExperimentSizes, LaboratoryLaw, formula


def stribeck(rng, s: ExperimentSizes):
    """Armstrong-Helouvry 1991: Gaussian; Tustin 1947: exponential; Hess and Soom 1990: 1/(1 + v/vs)."""
    vs = s.speed * rng.uniform(0.2, 0.6)
    forms = {
        "-A exp(-(v/vs)^2) sgn v": lambda a, n: -a * np.exp(-((n.v / vs) ** 2)) * s.sign(n.v),
        "-A exp(-|v|/vs) sgn v": lambda a, n: -a * np.exp(-abs(n.v) / vs) * s.sign(n.v),
        "-A/(1 + |v|/vs) sgn v": lambda a, n: -a / (1 + abs(n.v) / vs) * s.sign(n.v),
    }
    text = rng.choice(list(forms))
    return LaboratoryLaw(
        "stribeck",
        text,
        ("speed", "direction"),
        "A",
        "N.m",
        4 * s.noise,
        formula(forms[text]),
        fixed={"vs": (vs, "rad/s")},
    )


def coulomb_asymmetry(rng, s: ExperimentSizes):
    forms = {
        "-A |sgn v|: F+ - F- = 2A": lambda a, n: -a * s.sign(n.v) ** 2,
        "-2A sgn v where v > 0": lambda a, n: -2 * a * np.maximum(s.sign(n.v), 0),
    }
    text = rng.choice(list(forms))
    return LaboratoryLaw("coulomb_asymmetry", text, ("direction",), "A", "N.m", s.noise, formula(forms[text]))


def viscous_asymmetry(rng, s: ExperimentSizes):
    side, w = rng.choice([-1, 1]), 0.2 * s.speed
    forms = {
        "-A v where v has one sign": lambda a, n: -a * np.where(side * n.v > 0, n.v, 0),
        "-A v (1 + tanh(v/w))/2": lambda a, n: -a * n.v * 0.5 * (1 + np.tanh(side * n.v / w)),
    }
    text = rng.choice(list(forms))
    return LaboratoryLaw(
        "viscous_asymmetry",
        text,
        ("speed", "direction"),
        "A",
        "N.m.s/rad",
        4 * s.noise / s.speed,
        formula(forms[text]),
        fixed={"side": (float(side), ""), "w": (w, "rad/s")},
    )


def load_friction(rng, s: ExperimentSizes):
    """By the torque that the gear transmits (Niemann; Dohring et al. 1993; Hamon et al. 2010); a bearing under load."""
    low = 0.3 * s.load
    forms = {
        "-A |load| sgn v": lambda a, n: -a * abs(n.load) * s.sign(n.v),
        "-A sqrt(load^2 + l^2) sgn v": lambda a, n: -a * np.sqrt(n.load**2 + low**2) * s.sign(n.v),
        "-A |load| (1 - 0.4 sgn(load v)) sgn v": lambda a, n: (
            -a * abs(n.load) * (1 - 0.4 * np.tanh(n.load * n.v / (low * s.smooth))) * s.sign(n.v)
        ),
    }
    text = rng.choice(list(forms))
    return LaboratoryLaw(
        "load_friction",
        text,
        ("load", "direction"),
        "A",
        "",
        4 * s.noise / s.load,
        formula(forms[text]),
        limit=0.4,
        fixed={"l": (low, "N.m")},
    )


def position_friction(rng, s: ExperimentSizes):
    turns, phase = rng.integers(1, 5) * rng.uniform(0.8, 1.2) / s.reach, rng.uniform(0, 6.28)
    spot, width = s.centre + s.reach * rng.uniform(-0.6, 0.6), s.reach * rng.uniform(0.15, 0.4)
    forms = {
        "-A (1 + cos(n q + phase)) sgn v": lambda a, n: -a * (1 + np.cos(turns * n.q + phase)) * s.sign(n.v),
        "-2A exp(-((q - spot)/width)^2) sgn v": lambda a, n: (
            -2 * a * np.exp(-(((n.q - spot) / width) ** 2)) * s.sign(n.v)
        ),
        "-A (1 + tanh((q - spot)/width)) sgn v": lambda a, n: -a * (1 + np.tanh((n.q - spot) / width)) * s.sign(n.v),
    }
    text = rng.choice(list(forms))
    fixed = {"n": (turns, "1/rad"), "phase": (phase, "rad"), "spot": (spot, "rad"), "width": (width, "rad")}
    return LaboratoryLaw(
        "position_friction", text, ("q", "direction"), "A", "N.m", 2 * s.noise, formula(forms[text]), fixed=fixed
    )


def quadratic_drag(rng, s: ExperimentSizes):
    """White, Fluid Mechanics: v^2 of a bluff body; v^1.75 of turbulent skin (Blasius); a cubic churning loss."""
    forms = {
        "-A |v/v1| v/v1": lambda a, n: -a * abs(n.v) * n.v / s.speed**2,
        "-A |v/v1|^1.75 sgn v": lambda a, n: -a * np.sign(n.v) * abs(n.v / s.speed) ** 1.75,
        "-A (v/v1)^3": lambda a, n: -a * (n.v / s.speed) ** 3,
    }
    text = rng.choice(list(forms))
    return LaboratoryLaw(
        "quadratic_drag",
        text,
        ("speed",),
        "A",
        "N.m",
        3 * s.noise,
        formula(forms[text]),
        fixed={"v1": (s.speed, "rad/s")},
    )


def friction_drift(rng, s: ExperimentSizes):
    warm = s.duration * rng.uniform(0.25, 0.6)
    forms = {
        "-A exp(-t/T) sgn v": lambda a, n: -a * np.exp(-n.t / warm) * s.sign(n.v),
        "-A (1 - t/T) sgn v, T the end": lambda a, n: -a * (1 - n.t / s.duration) * s.sign(n.v),
        "-A exp(-t/T) v/v1": lambda a, n: -a * np.exp(-n.t / warm) * n.v / s.speed,
    }
    text = rng.choice(list(forms))
    fixed = {"T": (s.duration if "the end" in text else warm, "s"), "v1": (s.speed, "rad/s")}
    depends = ("time", "speed") if "v1" in text else ("time", "direction")
    return LaboratoryLaw("friction_drift", text, depends, "A", "N.m", 5 * s.noise, formula(forms[text]), fixed=fixed)


def dahl(d, rng):
    """dz/dt = v - |v| z/d, F = -A z/d; exact for v that is constant over the step. Dahl 1968."""

    def begin(a, h):
        z = np.zeros_like(a)

        def torque(n):
            nonlocal z
            end = np.sign(n.v)
            z = end + (z - end) * np.exp(-abs(n.v) * h / d)
            return -a * z

        return torque

    return begin


def lugre(d, rng):
    """Canudas de Wit et al. 1995 with g(v) = A and damping of the bristles: F = -A (z + tau dz/dt)."""

    def begin(a, h):
        z = np.zeros_like(a)

        def torque(n):
            nonlocal z
            end = np.sign(n.v)
            last, z = z, end + (z - end) * np.exp(-abs(n.v) * h / d)
            return -a * (z + 0.004 * (z - last) / h)

        return torque

    return begin


def bouc_wen(d, rng):
    """d dz/dt = v (1 - |z|^1.5 (0.6 + 0.4 sgn(v z))), F = -A z. Wen 1976."""

    def begin(a, h):
        z = np.zeros_like(a)

        def torque(n):
            nonlocal z
            z = z + h * n.v / d * (1 - abs(z) ** 1.5 * (0.6 + 0.4 * np.sign(n.v * z)))
            z = np.clip(z, -1, 1)
            return -a * z

        return torque

    return begin


def maxwell_slip(d, rng):
    """Six springs of one stiffness that slip in turn (Iwan 1966; Lampaert et al. 2003)."""
    slips = d * np.array([0.1, 0.25, 0.5, 0.9, 1.4, 2.2])[:, None]

    def begin(a, h):
        stretch, last = np.zeros((6, len(a))), None

        def torque(n):
            nonlocal stretch, last
            moved = 0 if last is None else n.q - last
            last = n.q.copy()
            stretch = np.clip(stretch + moved, -slips, slips)
            return -a * stretch.sum(0) / slips.sum()

        return torque

    return begin


def hysteresis(rng, s: ExperimentSizes):
    forms = {"Dahl": dahl, "LuGre": lugre, "Bouc-Wen": bouc_wen, "Maxwell slip": maxwell_slip}
    text = rng.choice(list(forms))
    d = s.reach * rng.uniform(0.04, 0.25)
    return LaboratoryLaw(
        "hysteresis",
        f"{text}: {forms[text].__doc__}",
        ("q", "direction", "history"),
        "A",
        "N.m",
        4 * s.noise,
        forms[text](d, rng),
        fixed={"d": (d, "rad")},
    )
