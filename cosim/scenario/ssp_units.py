"""Units, enumerations and linear transformations as the files of an SSP and its FMUs define them."""

from collections.abc import Iterable, Mapping

from cosim.scenario.ssp_document import Element, Findings, children, first, real, required, whole
from cosim.signals import BASE_UNITS, Linear, Unit

Units = Mapping[str, Unit]


def units_in(elements: Iterable[Element], findings: Findings) -> dict[str, Unit]:
    """Units by name that <ssc:Unit> elements define; those without a base unit are left out."""
    found = {}
    for unit in elements:
        base = first(unit, "ssc:BaseUnit")
        if base is not None:
            name = required(unit, "name", findings)
            found[name] = defined_unit(name, base, findings)
    return found


def defined_unit(name: str, base: Element, findings: Findings) -> Unit:
    """The unit that a <BaseUnit> of SSP or FMI defines."""
    exponents = tuple(whole(base, key, findings, 0) for key in BASE_UNITS)
    return Unit(name, exponents, _factor(base, findings), real(base, "offset", findings, 0.0))


def _factor(element: Element, findings: Findings) -> float:
    factor = real(element, "factor", findings, 1.0)
    if factor == 0.0:
        findings.refuse(element, "a factor other than 0", "0")
        return 1.0
    return factor


def transformation(element: Element, findings: Findings) -> Linear:
    """What a <ssc:LinearTransformation> does."""
    return Linear(_factor(element, findings), real(element, "offset", findings, 0.0))


def both(turn: Linear, change: Linear, element: Element, findings: Findings) -> Linear:
    """A conversion of units and a linear transformation together; a problem where the order would matter."""
    if not turn.commutes(change):
        findings.refuse(
            element,
            "units to convert or a transformation, or two of which either may come first",
            f"a conversion ({turn}) and a transformation ({change})",
            "SSP does not say which comes first; suppressUnitConversion leaves the transformation alone",
        )
    return change.after(turn)


def items_in(elements: Iterable[Element], findings: Findings) -> dict[str, dict[str, int]]:
    """Items of <ssc:Enumeration> elements with their values, by the name of the enumeration."""
    return {
        required(enumeration, "name", findings): {
            required(item, "name", findings): whole(item, "value", findings)
            for item in children(enumeration, "ssc:Item")
        }
        for enumeration in elements
    }
