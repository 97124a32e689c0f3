"""Units and enumerations that the files of an SSP and its FMUs define, and values turned from one unit into another."""

from collections.abc import Iterable, Mapping

from attrs import frozen

from cosim.scenario.ssp_document import Element, Findings, children, first, real, required, whole
from cosim.signals import BASE_UNITS, plain_unit


@frozen
class UnitScale:
    """What a unit means: a value in it is factor value + offset in SI base units of these exponents."""

    exponents: tuple[int, ...]
    factor: float = 1.0
    offset: float = 0.0

    def turns(self, other: "UnitScale") -> bool:
        """Whether values can be turned into the other unit: both are of one dimension."""
        return self.exponents == other.exponents

    def into(self, value: float, other: "UnitScale") -> float:
        """A value of this unit in the other one, of the same dimension."""
        if self == other:
            return value
        return (self.factor * value + (self.offset - other.offset)) / other.factor


Units = Mapping[str, UnitScale]


def units_in(elements: Iterable[Element], findings: Findings) -> dict[str, UnitScale]:
    """Units by name that <ssc:Unit> elements define; those without a base unit are left out."""
    found = {}
    for unit in elements:
        base = first(unit, "ssc:BaseUnit")
        if base is not None:
            found[required(unit, "name", findings)] = unit_scale(base, findings)
    return found


def unit_scale(base: Element, findings: Findings) -> UnitScale:
    """The scale that a <BaseUnit> of SSP or FMI declares."""
    exponents = tuple(whole(base, name, findings, 0) for name in BASE_UNITS)
    factor = real(base, "factor", findings, 1.0)
    if factor == 0.0:
        findings.refuse(base, "a factor other than 0", "0")
        factor = 1.0
    return UnitScale(exponents, factor, real(base, "offset", findings, 0.0))


def items_in(elements: Iterable[Element], findings: Findings) -> dict[str, dict[str, int]]:
    """Items of <ssc:Enumeration> elements with their values, by the name of the enumeration."""
    return {
        required(enumeration, "name", findings): {
            required(item, "name", findings): whole(item, "value", findings)
            for item in children(enumeration, "ssc:Item")
        }
        for enumeration in elements
    }


def same_unit(one: str, other: str, of_one: UnitScale | None, of_other: UnitScale | None) -> bool:
    """Whether values in two units are the same numbers.

    Units of one name differ where their factors or offsets do; their exponents are not compared, because tools define
    `rad` with and without an exponent of its own.
    """
    if of_one is None or of_other is None:
        return plain_unit(one) == plain_unit(other)
    if one == other:
        return (of_one.factor, of_one.offset) == (of_other.factor, of_other.offset)
    return of_one == of_other
