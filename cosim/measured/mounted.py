"""What was mounted on a joint: a known mass at a known distance, a further inertia, where it hangs straight down; and
what is known of the motor.
"""

from collections.abc import Mapping

import numpy as np
from attrs import fields, frozen

from cosim.errors import Problem
from cosim.measured.fields import is_number, unknown_names


@frozen
class Mounted:
    """mass [kg] at `length` [m] from the axis, inertia [kg m^2] beside mass length^2, angle [rad]: q where it hangs
    straight down; temperature [degC] of the run.
    """

    mass: float = 0.0
    length: float = 0.0
    inertia: float = 0.0
    angle: float = 0.0
    temperature: float | None = None

    @property
    def any(self) -> bool:
        """Whether something is mounted."""
        return bool(self.mass * self.length or self.inertia)

    def load(self, recorded: Mapping[str, np.ndarray], rows: int) -> np.ndarray:
        """Inertia [kg m^2], m l cos(angle) and m l sin(angle) [kg m] in each row, (rows, 3).

        recorded: columns (rows,) of the keys that the recording has; the others are what was described.
        """
        of = {name: recorded.get(name, np.full(rows, getattr(self, name))) for name in RECORDED}
        moment = of["mass"] * of["length"]
        inertia = moment * of["length"] + of["inertia"]
        return np.stack([inertia, moment * np.cos(of["angle"]), moment * np.sin(of["angle"])], axis=1)


MOTOR = ("back_emf", "supply")
RECORDED = ("mass", "length", "inertia", "angle")
SIGNED = ("angle", "temperature")
TEMPERATURE = "temperature"
NAMES = tuple(one.name for one in fields(Mounted))


def read_mounted(table: object, source: str, problems: list[Problem]) -> tuple[Mounted, Mapping[str, Mounted]]:
    """The [mounted] table: for all runs, and [mounted.NAME] for single ones. What is wrong is appended."""
    where = f"{source}: [mounted]"
    if not isinstance(table, Mapping):
        problems.append(Problem(where, "a table", repr(table)))
        return Mounted(), {}
    single = {name: value for name, value in table.items() if isinstance(value, Mapping)}
    plain = {name: value for name, value in table.items() if name not in single}
    for name, keys in (("", plain), *single.items()):
        unknown_names(keys, NAMES, f"{where[:-1]}.{name}]" if name else where, "key", problems)
    every = _numbers(plain, NAMES, where, problems)
    runs = {name: Mounted(**{**every, **_numbers(keys, NAMES, where, problems)}) for name, keys in single.items()}
    return Mounted(**every), runs


def _numbers(
    keys: Mapping[str, object], names: tuple[str, ...], where: str, problems: list[Problem]
) -> dict[str, float]:
    """The keys of these names; a negative one of those that have no sign is a problem."""
    found = {}
    for name in (name for name in names if name in keys):
        value = keys[name]
        if not is_number(value) or (name not in SIGNED and value < 0):
            problems.append(Problem(f"{where}.{name}", "a number" if name in SIGNED else "0 or more", repr(value)))
        else:
            found[name] = float(value)
    return found


def read_motor(table: object, source: str, problems: list[Problem]) -> Mapping[str, float]:
    """The [motor] table: back_emf [V s/rad] and supply [V]. What is wrong is appended."""
    where = f"{source}: [motor]"
    if not isinstance(table, Mapping):
        problems.append(Problem(where, "a table", repr(table)))
        return {}
    unknown_names(table, MOTOR, where, "key", problems)
    return _numbers(table, MOTOR, where, problems)
