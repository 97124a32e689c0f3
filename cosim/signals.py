"""Variables of FMUs as the wiring sees them: names with brackets, units, causality, what acts directly on what."""

import math
import re
from collections.abc import Iterable, Mapping
from functools import cached_property, lru_cache

from attrs import Factory, field, frozen

TYPES = {"Real": 0, "Float64": 0, "Float32": 1, "Boolean": 3, "String": 4, "Binary": 5, "Clock": 6}
"""In which order variables are exchanged, by type: doubles first; integers of every size are 2."""
REALS = ("Real", "Float64", "Float32")
WHOLE = {
    "Integer": (-(2**31), 2**31 - 1),
    "Enumeration": (-(2**63), 2**63 - 1),
    **{f"Int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}
"""Least and greatest value of every type of whole numbers (an enumeration of FMI 2.0 has 32 bits, see `limits`)."""
SETTABLE = frozenset({"parameter", "input", "structuralParameter"})
"""Causalities whose start values are the importer's to set."""
EXACT = 2**53
"""Whole numbers up to this size are doubles exactly."""
_PART = re.compile(r"^(?P<stem>.*)\[(?P<first>\d{1,6})\.\.(?P<last>\d{1,6})\]$")
_ELEMENT = re.compile(r"^(?P<stem>.*)\[(?P<index>\d+(,\d+)*)\]$")


BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""Base units of FMI and SSP, in the order of every tuple of exponents."""


@frozen
class Linear:
    """A linear change of a number on its way: factor value + offset."""

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, value: float) -> float:
        """The changed number; the same bits where nothing changes."""
        return value if self == Linear() else self.factor * value + self.offset

    def after(self, first: "Linear") -> "Linear":
        """The change that does another one first, then this one."""
        if Linear() in (self, first):
            return first if self == Linear() else self
        return Linear(self.factor * first.factor, self.factor * first.offset + self.offset)

    def commutes(self, other: "Linear") -> bool:
        """Whether it does not matter which of the two comes first."""
        one, two = self.after(other).offset, other.after(self).offset
        return math.isclose(one, two, rel_tol=1e-12, abs_tol=1e-300)

    def __str__(self) -> str:
        words = [f"times {self.factor!r}"] if self.factor != 1.0 or not self.offset else []
        return " ".join(words + ([f"plus {self.offset!r}"] if self.offset else []))


@frozen
class Unit:
    """A unit string and, where the FMU defines it, its exponents over BASE_UNITS, its factor and its offset.

    A value in base units is factor value + offset.
    """

    name: str
    exponents: tuple[int, ...] | None = None
    factor: float = 1.0
    offset: float = 0.0

    def joins(self, other: "Unit") -> bool:
        """Whether a signal may be wired to one of the other unit as it is."""
        return self.towards(other) == Linear()

    def towards(self, other: "Unit") -> Linear | None:
        """What turns a value of this unit into one of the other; None where the dimensions differ.

        The base units of FMI and SSP decide where both are defined; else the spelling does. Radians count as a
        dimension, between units of two names: tools define `rad` with and without an exponent of its own.
        """
        if not self.name or not other.name:
            return Linear()
        same = plain_unit(self.name) == plain_unit(other.name)
        if self.exponents is None or other.exponents is None:
            return Linear() if same else None
        counted = len(BASE_UNITS) - 1 if same else len(BASE_UNITS)
        if self.exponents[:counted] != other.exponents[:counted]:
            return None
        if (self.factor, self.offset) == (other.factor, other.offset):
            return Linear()
        return Linear(self.factor / other.factor, (self.offset - other.offset) / other.factor)

    @property
    def of_motion(self) -> bool:
        """Whether positions, rates, accelerations, forces and torques are measured in it, in SI."""
        if self.exponents is None:
            return plain_unit(self.name) in ("m", "m/s", "m/s2", "rad", "rad/s", "rad/s2", "N", "N.m")
        mechanical, rest, rad = self.exponents[:3], self.exponents[3:-1], self.exponents[-1]
        motion = mechanical in _MOTIONS or (rad and mechanical == (0, 0, 0))
        return bool(motion and not any(rest) and (self.factor, self.offset) == (1.0, 0.0))


_MOTIONS = ((0, 1, 0), (0, 1, -1), (0, 1, -2), (0, 0, -1), (0, 0, -2), (1, 1, -2), (1, 2, -2))
"""Exponents (kg, m, s) of position, velocity, acceleration, angular rates, force and torque."""


def plain_unit(unit: str) -> str:
    """One spelling of a unit string: without blanks and carets, products with a dot."""
    return unit.replace(" ", "").replace("*", ".").replace("·", ".").replace("^", "")


@frozen
class Variable:
    """One scalar variable of an FMU, or one element of an array.

    `feedthrough` names the inputs that act on an output at the same instant; None means the FMU does not say (then
    every input may). `slope` is the value reference of an input's generated derivative input (FMI 3), else None.
    `items` and `item_values`: names and values of an enumeration. `element`, `size`: which of how many values behind
    the reference (row by row), 0 of 1 for a scalar.
    """

    name: str
    causality: str
    type: str = "Real"
    unit: Unit = Unit("")
    start: float | str | None = None
    minimum: float | None = None
    maximum: float | None = None
    reference: int = 0
    feedthrough: tuple[str, ...] | None = ()
    items: tuple[str, ...] = ()
    description: str = ""
    slope: int | None = None
    derivative_of: str | None = None
    tunable: bool = False
    item_values: tuple[int, ...] = field(
        default=Factory(lambda self: tuple(range(1, len(self.items) + 1)), takes_self=True)
    )
    element: int = 0
    size: int = 1
    constant: bool = False
    nominal: float | None = None

    def item(self, value: float | str) -> str:
        """The name of an enumeration's value; the value itself where no item has it."""
        number = float(value)
        return next((name for name, v in zip(self.items, self.item_values) if v == number), f"{number:g}")

    @property
    def kind(self) -> str:
        """What it holds: real, integer, Boolean, Enumeration, String, Binary or Clock."""
        return "real" if self.type in REALS else "integer" if self.type in _WHOLE_NUMBERS else self.type

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest value: of the type, narrowed by what the FMU declares."""
        low, high = WHOLE.get(self.type, (-math.inf, math.inf))
        low = low if self.minimum is None else max(low, self.minimum)
        return low, high if self.maximum is None else min(high, self.maximum)

    @property
    def fits(self) -> bool:
        """Whether the start value that the FMU declares is one that its type and its limits allow."""
        if not self.exchanged or self.start is None or isinstance(self.start, str):
            return True
        low, high = self.limits
        return low <= self.start <= high and (not self.items or self.start in self.item_values)

    @property
    def exchanged(self) -> bool:
        """Whether its values are numbers, so that they can be recorded."""
        return TYPES.get(self.type, 2) < 4


_WHOLE_NUMBERS = frozenset(WHOLE) - {"Enumeration"}


@frozen
class FmuDescription:
    """What an FMU says of itself: variables by name, whether it integrates, whether it takes input slopes.

    `tolerance`, `step`: of its default experiment; `platforms`: those that it has a binary for, in its own words;
    `needs_tool`: whether it only runs where the tool that made it is installed; `sizes`: structural parameters that
    differ from their start values, by which its arrays are spread; `warnings`: what the user should know of its use;
    `carried`: outputs with the inputs that they show, sooner or later, in whatever unit those have.
    """

    model: str
    variables: Mapping[str, Variable]
    integrates: bool = False
    takes_slopes: bool = False
    fmi: str = "2.0"
    path: str = ""
    sha256: str = ""
    identifier: str = ""
    token: str = ""
    text: str = ""
    single_instance: bool = False
    saves_state: bool = False
    step: float | None = None
    tolerance: float | None = None
    platforms: tuple[str, ...] = ()
    needs_tool: bool = False
    tool: str = ""
    sizes: tuple[tuple[str, int], ...] = ()
    warnings: tuple[str, ...] = ()
    differentiates: bool = False
    carried: Mapping[str, str] = field(factory=dict)

    def names(self, causality: str) -> list[str]:
        """Names of the variables of one causality, in the order of the FMU."""
        return list(self._causal.get(causality, ()))

    def elements(self, name: str) -> list[str]:
        """The scalar names behind a name: itself, `x` -> `x[1], x[2], x[3]`, `x[2..3]` -> `x[2], x[3]`; empty: none."""
        if name in self.variables:
            return [name]
        if part := _PART.match(name):
            names = [f"{part['stem']}[{i}]" for i in range(int(part["first"]), int(part["last"]) + 1)]
            return names if all(n in self.variables for n in names) else []
        return list(self._vectors.get(name, ()))

    def start(self, name: str, given: Mapping[str, float | str]) -> float:
        """Start value of a numeric variable: the one that is given for it, else the FMU's own."""
        value = given.get(name, self.variables[name].start)
        assert value is not None, f"{self.model}.{name} has no start value"
        return float(value)

    @cached_property
    def _causal(self) -> dict[str, list[str]]:
        """Names by causality, in the order of the FMU."""
        found: dict[str, list[str]] = {}
        for variable in self.variables.values():
            found.setdefault(variable.causality, []).append(variable.name)
        return found

    @cached_property
    def _vectors(self) -> dict[str, list[str]]:
        """Scalar names by stem, in the order of their indices."""
        return {name: sorted(names, key=indices_of) for name, names in grouped(self.variables).items()}

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Outputs that can be wired, in the order in which they are read."""
        return tuple(by_type(v for v in self.variables.values() if v.causality == "output" and v.exchanged))

    @cached_property
    def silent(self) -> tuple[str, ...]:
        """Outputs that are no numbers, and so are not recorded."""
        return tuple(v.name for v in self.variables.values() if v.causality == "output" and not v.exchanged)

    @cached_property
    def unfit(self) -> tuple[str, ...]:
        """Parameters and inputs that declare a start value which their type or limits do not allow."""
        settable = (v for v in self.variables.values() if v.causality in SETTABLE)
        return tuple(v.name for v in settable if not v.fits)

    @cached_property
    def arrays(self) -> bool:
        """Whether several values lie behind one reference."""
        return any(v.size != 1 for v in self.variables.values())

    def stems(self, causality: str | None = None) -> list[str]:
        """Names without brackets, each once, in the order of the FMU."""
        names = (v.name for v in self.variables.values() if causality in (None, v.causality))
        return list(dict.fromkeys(stem(name) for name in names))


def is_real(variable: Variable) -> bool:
    """Whether the variable is a double."""
    return TYPES.get(variable.type, 2) == 0


def by_type(variables: Iterable[Variable]) -> list[str]:
    """Names of the variables in the order in which they are exchanged."""
    return [v.name for v in sorted(variables, key=lambda v: TYPES.get(v.type, 2))]


@lru_cache(maxsize=8192)
def stem(name: str) -> str:
    """`q[2]` -> `q`."""
    match = _ELEMENT.match(name)
    return match["stem"] if match else name


def index_of(name: str) -> int:
    """`q[2]` -> 2; 0 for a scalar."""
    return next(iter(indices_of(name)), 0)


@lru_cache(maxsize=8192)
def indices_of(name: str) -> tuple[int, ...]:
    """`q[2]` -> (2,), `A[1,3]` -> (1, 3); empty for a scalar."""
    match = _ELEMENT.match(name)
    return tuple(map(int, match["index"].split(","))) if match else ()


def grouped(names: Iterable[str]) -> dict[str, list[str]]:
    """Names by stem, in order: {"arm_l.q": ["arm_l.q[1]", ...], ...}."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(stem(name), []).append(name)
    return groups


@frozen
class Signal:
    """A variable of a component: `arm_l.q[1]`."""

    component: str
    variable: str = field()

    def __str__(self) -> str:
        return f"{self.component}.{self.variable}"
