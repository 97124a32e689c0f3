"""Which variables are exchanged, in which order: doubles first, then the other types."""

from collections.abc import Iterable

from cosim.signals import Description, Variable

TYPES = {"Real": 0, "Float64": 0, "Float32": 1, "Boolean": 3, "String": 4, "Binary": 5, "Clock": 6}


def is_real(variable: Variable) -> bool:
    """Whether the variable is a double."""
    return TYPES.get(variable.type, 2) == 0


def by_type(variables: Iterable[Variable]) -> list[str]:
    return [v.name for v in sorted(variables, key=lambda v: TYPES.get(v.type, 2))]


def outputs_of(description: Description) -> list[str]:
    return by_type(v for v in description.variables.values() if v.causality == "output" and TYPES.get(v.type, 2) < 4)
