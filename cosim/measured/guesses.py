"""What the columns of a file are likely to be, from their names, the units that the file tells, and their values."""

import re
from collections.abc import Mapping

import numpy as np
from attrs import frozen

from cosim.measured import units
from cosim.measured.plausibility import TURNS
from cosim.measured.stamps import LIKELY, PER_SECOND, SLOWEST, typical_step
from cosim.measured.table import RawTable

# Role -> what its columns are called, in lower case without indices and units; the first role that fits is taken.
NAMES: Mapping[str, str] = {
    "time": r"t|time|stamp|timestamp|header\.stamp|%time|zeit|seconds|elapsed|x_value",
    "run": r"run|trial|episode|experiment|episode_index",
    "split": r"split|fold",
    "q_ref": r".*(ref|des|desired|cmd|target|setpoint|goal).*|action",
    "ddq": r"ddq|qdd|acc|acceleration",
    "dq": r"dq|qd|qdot|q_dot|vel|velocity|speed|omega|dtheta",
    "tau": r"tau|torque|effort|force|f|current|i|curr|moment|duty|pwm|voltage|u|motor_torque|trq|moment|strom|spannung",
    "q": r"q|pos|position|angle|theta|joint|joint_pos|x|phi|encoder|winkel|observation\.state",
    "supply": r"supply|battery|vbus|vbat|u_supply",
    "temperature": r"temp|temperature|t_motor|motor_temp",
}
ENDING = re.compile(r"[_\[( ]+(?P<unit>[A-Za-z%°][A-Za-z0-9/*.^²° _]*?)[\])]?$")
ELECTRICAL = {
    "current": "A",
    "curr": "A",
    "i": "A",
    "duty": "duty",
    "pwm": "duty",
    "voltage": "V",
    "u": "V",
    "strom": "A",
}
ROLE_OF_UNIT = {"s": "time", "rad": "q", "rad/s": "dq", "rad/s^2": "ddq", "N.m": "tau"}  # where no name says it


@frozen
class ColumnGuess:
    """A column: what it holds, its range, the role and the unit that it is likely to have, and why."""

    name: str
    kind: str
    rows: int
    low: float | None
    high: float | None
    role: str = ""
    unit: str = ""
    why: str = ""


def guessed(table: RawTable) -> tuple[ColumnGuess, ...]:
    """Every column of a table; a role is given where the name is one that is used for it."""
    return tuple(_guess(table, name) for name in table.columns)


def _guess(table: RawTable, name: str) -> ColumnGuess:
    values = np.asarray(table.columns[name])
    stem, ending = _parts(name)
    told = units.spelled(table.units.get(name, ""))
    role = _role(stem) or ROLE_OF_UNIT.get(units.FACTORS.get(told or ending, ("",))[0], "")
    if values.dtype.kind in "Mm":
        return ColumnGuess(name, "dates", len(values), None, None, "time" if role == "time" else "", "", "dates")
    if values.dtype.kind not in "fiub":
        return ColumnGuess(name, "words", len(values), None, None, role if role in ("run", "split", "time") else "")
    finite = values[np.isfinite(values)].astype(float)
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (None, None)
    unit, why = (told, "the file says so") if units.known(told) else (ending, "the name says so")
    if not unit:
        unit, why = _by_values(role, stem, finite)
    return ColumnGuess(name, "numbers", len(values), low, high, role, unit, why)


def _role(stem: str) -> str:
    """The role whose names the stem is one of, or its last word: `motor_current`."""
    words = (stem, re.split(r"[_ ]", stem)[-1])
    return next((role for word in words for role, pattern in NAMES.items() if re.fullmatch(pattern, word)), "")


def _parts(name: str) -> tuple[str, str]:
    """The name in lower case without path, index and unit; and the unit in it, where it is a known one."""
    plain = re.sub(r"\[\d+\]$", "", name).rsplit("/", 1)[-1]
    found = ENDING.search(plain)
    unit = units.spelled(found["unit"].replace("_", "/")) if found else ""
    known = found and units.known(unit) and found.start() > 0
    stem = plain[: found.start()] if found and known else plain
    stem = re.sub(r"_?\d+$", "", stem.strip().lower())
    return stem if stem in ("header.stamp", "observation.state") else stem.rsplit(".", 1)[-1], unit if known else ""


def _by_values(role: str, stem: str, values: np.ndarray) -> tuple[str, str]:
    """A unit that the values speak for, and the reason in words."""
    if role == "time":
        step = typical_step(values)
        fits = [u for u, per in PER_SECOND.items() if LIKELY <= step / per <= SLOWEST] if step else []
        return (fits[0], f"its step {step:.4g} is then {PER_SECOND[fits[0]] / step:.5g} Hz") if fits else ("", "")
    if role in ("q", "q_ref") and len(values):
        span = float(np.ptp(values))
        if span > TURNS * 2 * np.pi:
            return "deg", f"it spans {span:.4g}, which would be {span / (2 * np.pi):.3g} turns in rad"
        return "rad", f"it spans {span:.4g}, less than {TURNS:g} turns"
    word = next((word for word in (stem, re.split(r"[_ ]", stem)[-1]) if word in ELECTRICAL), "")
    if role == "tau" and word:
        return ELECTRICAL[word], "the name says so"
    return "", ""
