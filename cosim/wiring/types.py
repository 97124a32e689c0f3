"""Types at both ends of a connection: what may be wired to what, and which conversions a scenario may wish for.

| output | input | allowed |
|---|---|---|
| real | real, whole number to real | as it is (into Float32: rounded to single precision) |
| real | whole number | `(round)`, `(floor)` or `(ceil)` |
| whole number | whole number | as it is; a value that the input's type cannot hold ends the run |
| Enumeration | Enumeration | with the same items; else, and to and from numbers, `(number)` |
| Boolean | Boolean | as it is; to a number `(number)`, from a number `(nonzero)` |
| String, Binary | the same | as it is |
| real or whole number | real | `(times 1.8 plus 32.0)`, in place of a conversion of units |
"""

from collections.abc import Mapping

from cosim.errors import Problem
from cosim.scenario import Connection, Conversion
from cosim.signals import FmuDescription, Linear, Variable

_NUMBERS = ("real", "integer")
_ROUNDING = (Conversion.ROUND, Conversion.FLOOR, Conversion.CEIL)


def type_problems(
    connection: Connection, sources: list[str], targets: list[str], descriptions: Mapping[str, FmuDescription]
) -> list[Problem]:
    """One problem for each pair of types in a connection that do not fit, or that a wish does not fit."""
    found = {}
    for source, target in zip(sources, targets):
        a = descriptions[connection.source.component].variables[source]
        b = descriptions[connection.target.component].variables[target]
        problem = _problem(connection, a, b)
        if problem is not None:
            found[a.type, b.type] = problem
    return list(found.values())


def _problem(connection: Connection, a: Variable, b: Variable) -> Problem | None:
    where, wish, wishes = f"connection {connection}", connection.conversion, possible(a, b)
    if "Clock" in (a.kind, b.kind):
        return Problem(where, "variables with values", "a clock", "clocks are not connected here")
    if isinstance(wish, Linear):
        numbers = a.kind in _NUMBERS and b.kind == "real"
        return None if numbers else Problem(where, f"numbers for ({wish})", f"{_words(a)} to {_words(b)}")
    if wish is not None and wish not in wishes:
        fitting = " or ".join(f"({w.value})" for w in wishes) or "no conversion: the types fit, or never do"
        return Problem(where, fitting, f"({wish.value}) from {_words(a)} to {_words(b)}")
    if wish is None and not _fits(a, b):
        asked = " or ".join(f"'{connection} ({w.value})'" for w in wishes)
        advice = f"if that is meant, write {asked}" if asked else "such values are not converted"
        return Problem(where, f"an output that fits the input ({_words(b)})", _words(a), advice)
    return None


def _fits(a: Variable, b: Variable) -> bool:
    """Whether a value of one variable is one of the other, as it is."""
    if a.kind == b.kind:
        return a.kind != "Enumeration" or (a.items, a.item_values) == (b.items, b.item_values)
    return (a.kind, b.kind) == ("integer", "real")


def possible(a: Variable, b: Variable) -> tuple[Conversion, ...]:
    """The conversions that a scenario may wish for between two variables."""
    if (a.kind, b.kind) == ("real", "integer"):
        return _ROUNDING
    if a.kind in _NUMBERS and b.kind == "Boolean":
        return (Conversion.NONZERO,)
    coded, plain = {"Enumeration", "Boolean"}, {"Enumeration", *_NUMBERS}
    if a.kind in coded and b.kind in plain and not _fits(a, b):
        return (Conversion.NUMBER,)
    if a.kind == "integer" and b.kind == "Enumeration":
        return (Conversion.NUMBER,)
    return ()


def _words(variable: Variable) -> str:
    if variable.kind == "Enumeration":
        return f"Enumeration {', '.join(f'{n} = {v}' for n, v in zip(variable.items, variable.item_values))}"
    return variable.type
