"""A gear between the motor and the joint, and on which side of it the signals were measured."""

from collections.abc import Mapping

from attrs import frozen

from cosim.errors import Problem
from cosim.measured.fields import is_number, unknown_names

SIDES = ("joint", "motor")


@frozen
class Gear:
    """ratio: turns of the motor for one of the joint; encoder, torque: the side of q, dq, ddq, and of tau."""

    ratio: float = 1.0
    encoder: str = "joint"
    torque: str = "joint"

    @property
    def of_position(self) -> float:
        """Position of the joint for a measured one of 1."""
        return 1 / self.ratio if self.encoder == "motor" else 1.0

    @property
    def of_torque(self) -> float:
        """Torque at the joint for a given one of 1."""
        return self.ratio if self.torque == "motor" else 1.0


def read_gear(table: object, source: str, problems: list[Problem]) -> Gear:
    """The [gear] table. What is wrong is appended."""
    where = f"{source}: [gear]"
    if not isinstance(table, Mapping):
        problems.append(Problem(where, "a table", repr(table)))
        return Gear()
    unknown_names(table, ("ratio", "encoder", "torque"), where, "key", problems)
    ratio = table.get("ratio", 1.0)
    if not is_number(ratio) or ratio == 0:
        problems.append(
            Problem(f"{where}.ratio", "a number other than 0 (negative: the joint turns the other way)", repr(ratio))
        )
        ratio = 1.0
    sides = {name: table.get(name, SIDES[0]) for name in ("encoder", "torque")}
    for name, side in sides.items():
        if side not in SIDES:
            problems.append(Problem(f"{where}.{name}", "joint or motor", repr(side)))
            sides[name] = SIDES[0]
    return Gear(float(ratio), str(sides["encoder"]), str(sides["torque"]))
