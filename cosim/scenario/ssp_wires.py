"""Connections between the components of an SSP, with what connectors say of types and units held against the FMUs."""

from collections.abc import Iterator

from cosim.errors import did_you_mean
from cosim.scenario.parts import Connection
from cosim.scenario.ssp_document import Element, Findings
from cosim.scenario.ssp_fmu import FmuVariable, kind_of
from cosim.scenario.ssp_grammar import short
from cosim.scenario.ssp_tree import End, Passage, SspTree, starts
from cosim.scenario.ssp_units import Units, same_unit
from cosim.signals import Signal


def wires(tree: SspTree, units: Units, findings: Findings) -> Iterator[Connection]:
    """The connections from outputs to inputs of components; problems of units and parameters are added."""
    check_connectors(tree, units, findings)
    for start, ways in starts(tree).items():
        for way in ways:
            stop = way[-1].end
            if _kind(stop, tree) == "parameter":
                findings.refuse(way[-1].element, "an input at the end of a connection", f"parameter {stop.connector!r}")
                continue
            _check_units(start, way, tree, units, findings)
            yield Connection(_signal(start, tree), _signal(stop, tree))


def _signal(end: End, tree: SspTree) -> Signal:
    return Signal(tree.components[end.path].name, end.connector)


def _kind(end: End, tree: SspTree) -> str | None:
    variable = _variable(end, tree)
    if variable is not None:
        return variable.causality
    connector = tree.connectors.get(end)
    return None if connector is None else connector.get("kind")


def _variable(end: End, tree: SspTree) -> FmuVariable | None:
    component = tree.components.get(end.path)
    return None if component is None or component.face is None else component.face.variables.get(end.connector)


def _type(connector: Element | None) -> Element | None:
    """The element that gives a connector's type, `<ssc:Real unit="m"/>`."""
    return None if connector is None else next((e for e in connector if short(e.tag).startswith("ssc:")), None)


def check_connectors(tree: SspTree, units: Units, findings: Findings) -> None:
    """Problems of components' connectors that their FMU does not have, or has with another type or unit."""
    for end, connector in tree.connectors.items():
        component = tree.components.get(end.path)
        if component is None or component.face is None:
            continue
        variable = component.face.variables.get(end.connector)
        if variable is None:
            advice = did_you_mean(end.connector, component.face.variables)
            findings.refuse(connector, "a connector that is a variable of the FMU", repr(end.connector), advice)
            continue
        declared = _type(connector)
        if declared is None:
            continue
        kind = kind_of(short(declared.tag).partition(":")[2])
        if not _fits(kind, variable.kind):
            findings.refuse(connector, f"type {variable.kind}, as the FMU says of {variable.name!r}", kind)
        unit = declared.get("unit", "")
        scales = units.get(unit), component.face.units.get(variable.unit)
        if unit and variable.unit and not same_unit(unit, variable.unit, *scales):
            findings.refuse(connector, f"unit {variable.unit!r}, as the FMU says of {variable.name!r}", repr(unit))


def _fits(kind: str, of_fmu: str) -> bool:
    """Whether a connector's type is the variable's; enumerations may be written as whole numbers."""
    return kind == of_fmu or {kind, of_fmu} == {"integer", "Enumeration"}


def _unit(end: End, tree: SspTree) -> str:
    """The unit of a connector: its own, else that of the FMU's variable."""
    declared, variable = _type(tree.connectors.get(end)), _variable(end, tree)
    own = "" if declared is None else declared.get("unit", "")
    return own or ("" if variable is None else variable.unit)


def _check_units(start: End, way: list[Passage], tree: SspTree, units: Units, findings: Findings) -> None:
    """Problems of units along a way that the wiring does not see: those of the FMUs alone are its own to check."""
    known = dict(units)
    for end in (start, way[-1].end):
        component = tree.components[end.path]
        known = {**(component.face.units if component.face else {}), **known}
    unit = _unit(start, tree)
    for passage in way:
        reached = _unit(passage.end, tree)
        if not unit or not reached:
            unit = unit or reached
            continue
        one, other = known.get(unit), known.get(reached)
        alike = same_unit(unit, reached, one, other)
        if not alike and (one is None or other is None or not one.turns(other)):
            findings.refuse(passage.element, f"the unit {reached!r} of {passage.end.connector!r}", repr(unit))
        elif not alike and not passage.converts:
            findings.refuse(passage.element, f"{unit!r} turned into {reached!r}", "suppressUnitConversion")
        unit = reached
    _check_ends(start, way, tree, known, findings)


def _check_ends(start: End, way: list[Passage], tree: SspTree, known: Units, findings: Findings) -> None:
    """A conversion that only the connectors ask for: the wiring knows the units of the FMUs only."""
    ends = (start, way[-1].end)
    variables = [_variable(end, tree) for end in ends]
    one, other = (_unit(end, tree) for end in ends)
    told = all(variable is not None and variable.unit for variable in variables)
    if not told and one and other and not same_unit(one, other, known.get(one), known.get(other)):
        findings.refuse(
            way[-1].element, f"FMUs that declare their units, to turn {one!r} into {other!r}", "one that has none"
        )
