"""Connections between the components of an SSP, with what connectors say of types and units held against the FMUs."""

from collections.abc import Iterator

from cosim.errors import did_you_mean
from cosim.scenario.parts import Connection
from cosim.scenario.ssp_document import Element, Findings
from cosim.scenario.ssp_fmu import FmuVariable, kind_of
from cosim.scenario.ssp_grammar import short
from cosim.scenario.ssp_tree import End, Passage, SspTree, starts
from cosim.scenario.ssp_units import Units, both
from cosim.signals import Linear, Signal, Unit


def wires(tree: SspTree, units: Units, findings: Findings) -> Iterator[Connection]:
    """The connections from outputs to inputs of components; problems of units and parameters are added."""
    check_connectors(tree, units, findings)
    for start, ways in starts(tree).items():
        for way in ways:
            stop = way[-1].end
            if _kind(stop, tree) == "parameter":
                findings.refuse(way[-1].element, "an input at the end of a connection", f"parameter {stop.connector!r}")
                continue
            change = _change(start, way, tree, units, findings)
            yield Connection(_signal(start, tree), _signal(stop, tree), change)


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
        if not (units.get(unit) or Unit(unit)).joins(component.face.unit(variable)):
            findings.refuse(connector, f"unit {variable.unit!r}, as the FMU says of {variable.name!r}", repr(unit))


def _fits(kind: str, of_fmu: str) -> bool:
    """Whether a connector's type is the variable's; enumerations may be written as whole numbers."""
    return kind == of_fmu or {kind, of_fmu} == {"integer", "Enumeration"}


def _unit(end: End, tree: SspTree, units: Units) -> Unit:
    """The unit of a connector: that of the FMU's variable, else its own."""
    component, variable = tree.components.get(end.path), _variable(end, tree)
    if component is not None and component.face is not None and variable is not None and variable.unit:
        return component.face.unit(variable)
    declared = _type(tree.connectors.get(end))
    name = "" if declared is None else declared.get("unit", "")
    return units.get(name, Unit(name))


def _change(start: End, way: list[Passage], tree: SspTree, units: Units, findings: Findings) -> Linear | None:
    """What happens to a value along a way; None where it is what the wiring does by itself: it turns the unit of the
    one FMU into that of the other.
    """
    total, unit = Linear(), _unit(start, tree, units)
    for passage in way:
        reached = _unit(passage.end, tree, units)
        turn = unit.towards(reached) if passage.converts else Linear()
        if turn is None:
            findings.refuse(passage.element, f"the unit {reached.name!r} of {passage.end.connector!r}", repr(unit.name))
            return None
        step = turn if passage.change is None else both(turn, passage.change, passage.element, findings)
        total, unit = step.after(total), reached if reached.name else unit
    return None if total == _wired(start, way[-1].end, tree) else total


def _wired(start: End, stop: End, tree: SspTree) -> Linear | None:
    """What the wiring does, which knows the units of the FMUs only."""
    found = []
    for end in (start, stop):
        face, variable = tree.components[end.path].face, _variable(end, tree)
        found.append(Unit("") if face is None or variable is None else face.unit(variable))
    return found[0].towards(found[1])
