"""Unit strings ("N.m.s/rad") as exponents of the SI base units, the way FMI wants them declared."""

import re

from build_fmus.errors import BuildError

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")

# name -> (factor to SI, exponents of BASE)
ATOMS: dict[str, tuple[float, tuple[int, ...]]] = {
    "1": (1.0, (0,) * 8),
    **{name: (1.0, tuple(int(name == base) for base in BASE)) for name in BASE},
    "N": (1.0, (1, 1, -2, 0, 0, 0, 0, 0)),
    "J": (1.0, (1, 2, -2, 0, 0, 0, 0, 0)),
    "W": (1.0, (1, 2, -3, 0, 0, 0, 0, 0)),
    "V": (1.0, (1, 2, -3, -1, 0, 0, 0, 0)),
    "Hz": (1.0, (0, 0, -1, 0, 0, 0, 0, 0)),
}

QUANTITIES = {
    "1": "Ratio",
    "rad": "Angle",
    "rad/s": "AngularVelocity",
    "rad/s2": "AngularAcceleration",
    "m": "Length",
    "m/s": "Velocity",
    "m/s2": "Acceleration",
    "N": "Force",
    "N.m": "Torque",
    "kg": "Mass",
    "s": "Time",
    "Hz": "Frequency",
    "N/m": "Stiffness",
    "N.s/m": "Damping",
    "N.m/rad": "AngularStiffness",
    "N.m.s/rad": "AngularDamping",
    "kg.m2": "MomentOfInertia",
    "1/s": "Rate",
}


def exponents(unit: str) -> tuple[int, ...]:
    """Exponents of (kg, m, s, A, K, mol, cd, rad). Raises BuildError for a unit that it cannot read."""
    top, _, bottom = unit.partition("/")
    total = [0] * len(BASE)
    for sign, part in ((1, top), (-1, bottom.removeprefix("(").removesuffix(")"))):
        for atom in filter(None, part.split(".")):
            total = [t + sign * e for t, e in zip(total, _atom(atom, unit), strict=True)]
    return tuple(total)


def _atom(atom: str, unit: str) -> tuple[int, ...]:
    match = re.fullmatch(r"([A-Za-z]+|1)(-?\d+)?", atom)
    if not match or match[1] not in ATOMS:
        raise BuildError(f"unit {unit!r}: {atom!r} is not known; known are {', '.join(ATOMS)} with integer exponents")
    power = int(match[2] or 1)
    return tuple(power * e for e in ATOMS[match[1]][1])


def per_second(unit: str) -> str:
    """The unit of the time derivative: "m" -> "m/s", "m/s" -> "m/s2", "N/m" -> "N/(m.s)"."""
    top, slash, bottom = unit.partition("/")
    if not slash:
        return f"{top}/s"
    if bottom == "s":
        return f"{top}/s2"
    return f"{top}/({bottom.removeprefix('(').removesuffix(')')}.s)"


def quantity(unit: str) -> str:
    """A type name for the unit: Torque for "N.m", else one made from its letters."""
    made = "Quantity_" + re.sub(r"[^A-Za-z0-9]+", "_", unit.replace("/", "_per_")).strip("_")
    return QUANTITIES.get(unit, made)
