"""A position servo: what drives the joint is its error, the reference less the measured position, times a gain that may
be unknown, beyond a dead band that may be unknown.

    tau = gain (e - dead_band sgn(e)) where |e| > dead_band, else 0;  e = q_ref - q
"""

from collections.abc import Mapping

import numpy as np
from attrs import fields, frozen

from cosim.errors import Problem
from cosim.measured.fields import is_number, unknown_names


@frozen
class Servo:
    """gain [unit of tau / rad], dead_band [rad], limit [rad]: the error from which on its output is at its end.

    None: not known. Torques of a servo without a gain are errors [rad]; a dead band that is not known is fitted along.
    """

    gain: float | None = None
    dead_band: float | None = None
    limit: float | None = None

    def output(self, error: np.ndarray) -> np.ndarray:
        """What drives the joint at errors (n, nj) [rad], without the dead band where that is not known."""
        beyond = error if not self.dead_band else np.sign(error) * np.maximum(np.abs(error) - self.dead_band, 0.0)
        return (self.gain or 1.0) * beyond

    def side(self, error: np.ndarray) -> np.ndarray | None:
        """What one radian of dead band takes from the output (n, nj); None where the dead band is known."""
        return None if self.dead_band is not None else (self.gain or 1.0) * np.where(error < 0, -1.0, 1.0)

    def at_limit(self, error: np.ndarray) -> np.ndarray | None:
        """Rows (n, nj) whose output is at its end; None where there are none or the end is not known."""
        marks = np.zeros(error.shape, bool) if self.limit is None else np.abs(error) >= self.limit
        return marks if marks.any() else None


def read_servo(table: object, source: str, problems: list[Problem]) -> Servo | None:
    """The [servo] table; None without one. What is wrong is appended."""
    if table is None:
        return None
    where = f"{source}: [servo]"
    if not isinstance(table, Mapping):
        problems.append(Problem(where, "a table", repr(table)))
        return None
    names = tuple(one.name for one in fields(Servo))
    unknown_names(table, names, where, "key", problems)
    found: dict[str, float] = {}
    for name in (name for name in names if name in table):
        least = "0 or more" if name == "dead_band" else "a positive number"
        value = table[name]
        if is_number(value) and (value > 0 or (value == 0 and name == "dead_band")):
            found[name] = float(value)
        else:
            problems.append(Problem(f"{where}.{name}", least, repr(value)))
    return Servo(**found)
