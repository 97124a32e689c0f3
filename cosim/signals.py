"""Variables of FMUs as the wiring sees them: names with brackets, units, causality, what acts directly on what."""

import re
from collections.abc import Iterable, Mapping
from functools import cached_property, lru_cache

from attrs import field, frozen

TYPES = {"Real": 0, "Float64": 0, "Float32": 1, "Boolean": 3, "String": 4, "Binary": 5, "Clock": 6}
"""In which order variables are exchanged, by type: doubles first; integers of every size are 2."""
_ELEMENT = re.compile(r"^(?P<stem>.*)\[(?P<index>\d+)\]$")


@frozen
class Unit:
    """A unit string and, where the FMU defines it, its exponents over (kg, m, s, A, K, mol, cd, rad) and its factor."""

    name: str
    exponents: tuple[int, ...] | None = None
    factor: float = 1.0

    def joins(self, other: "Unit") -> bool:
        """Whether a signal may be wired to one of the other unit: same dimension, radians counted, same scale."""
        if not self.name or not other.name:
            return True
        if self.exponents is not None and other.exponents is not None:
            return self.exponents == other.exponents and self.factor == other.factor
        return _plain(self.name) == _plain(other.name)


def _plain(unit: str) -> str:
    return unit.replace(" ", "").replace("*", ".").replace("·", ".").replace("^", "")


@frozen
class Variable:
    """One scalar variable of an FMU.

    `feedthrough` names the inputs that act on an output at the same instant; None means the FMU does not say (then
    every input may). `slope` is the value reference of an input's generated derivative input (FMI 3), else None.
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


@frozen
class FmuDescription:
    """What an FMU says of itself: variables by name, whether it integrates, whether it takes input slopes."""

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
    differentiates: bool = False

    def names(self, causality: str) -> list[str]:
        """Names of the variables of one causality, in the order of the FMU."""
        return [v.name for v in self.variables.values() if v.causality == causality]

    def elements(self, name: str) -> list[str]:
        """The scalar names behind a name: itself, or `x` -> `x[1], x[2], x[3]`; empty where there is none."""
        if name in self.variables:
            return [name]
        return list(self._vectors.get(name, ()))

    def start(self, name: str, given: Mapping[str, float | str]) -> float:
        """Start value of a numeric variable: the one that is given for it, else the FMU's own."""
        value = given.get(name, self.variables[name].start)
        assert value is not None, f"{self.model}.{name} has no start value"
        return float(value)

    @cached_property
    def _vectors(self) -> dict[str, list[str]]:
        """Scalar names by stem, in the order of their indices."""
        return {name: sorted(names, key=index_of) for name, names in grouped(self.variables).items()}

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Outputs that can be wired, in the order in which they are read."""
        return tuple(
            by_type(v for v in self.variables.values() if v.causality == "output" and TYPES.get(v.type, 2) < 4)
        )

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


@lru_cache(maxsize=8192)
def index_of(name: str) -> int:
    """`q[2]` -> 2; 0 for a scalar."""
    match = _ELEMENT.match(name)
    return int(match["index"]) if match else 0


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
