"""Parameter sets of an SSP with their mappings, and the value that each gives to an FMU variable."""

import math
from collections.abc import Iterator, Mapping

from attrs import evolve, field, frozen

from cosim.scenario.ssp_document import (
    Element,
    Findings,
    children,
    first,
    parse,
    real,
    required,
    truth,
    whole,
)
from cosim.scenario.ssp_files import SspFiles
from cosim.scenario.ssp_fmu import FmuFace, FmuVariable
from cosim.scenario.ssp_grammar import REAL, WHOLE, short
from cosim.scenario.ssp_units import Units, both, items_in, transformation, units_in
from cosim.signals import Linear, Unit

Value = float | int | bool | str
_TYPES = {
    "ParameterBinding": "application/x-ssp-parameter-set",
    "ParameterMapping": "application/x-ssp-parameter-mapping",
}


@frozen
class SspParameter:
    """A value as an SSP gives it: for the variable `name` of the element that it is bound to.

    change: a linear transformation beside the conversion of units; converts: whether units are converted at all.
    """

    name: str
    value: Value
    element: Element
    unit: str = ""
    change: Linear = Linear()
    converts: bool = True
    units: Units = field(factory=dict)
    items: Mapping[str, int] = field(factory=dict)
    enumerated: bool = False


def bound(element: Element, files: SspFiles, units: Units, findings: Findings) -> Iterator[SspParameter]:
    """The parameters that are bound to a component or system, in order: later ones count."""
    for binding in children(element, "ssd:ParameterBindings/ssd:ParameterBinding"):
        if not _readable(binding, findings):
            continue
        values = _content(binding, first(binding, "ssd:ParameterValues"), "ssv:ParameterSet", files, findings)
        mapping = first(binding, "ssd:ParameterMapping")
        entries = None
        if mapping is not None and _readable(mapping, findings):
            entries = _content(mapping, mapping, "ssm:ParameterMapping", files, findings)
        if values is None or (mapping is not None and entries is None):
            continue
        found = [evolve(p, name=binding.get("prefix", "") + p.name) for p in _parameters(values, units, findings)]
        yield from found if entries is None else _mapped(found, entries, findings)


def _readable(element: Element, findings: Findings) -> bool:
    """Whether a source is of the standard's own type and is looked for beside the structure."""
    kind = _TYPES[short(element.tag).partition(":")[2]]
    if element.get("type", kind) != kind:
        findings.refuse(element, f"a source of type {kind}", repr(element.get("type")))
        return False
    if element.get("sourceBase", "SSD") != "SSD":
        findings.refuse(element, "a source relative to the .ssd file", f"sourceBase={element.get('sourceBase')!r}")
        return False
    return True


def _content(
    element: Element, holder: Element | None, name: str, files: SspFiles, findings: Findings
) -> Element | None:
    """The <ssv:ParameterSet> or <ssm:ParameterMapping> inside an element, or in the file that it names."""
    source = element.get("source")
    inline = None if holder is None else first(holder, name)
    if (source is None) == (inline is None):
        findings.refuse(element, f"a source or a <{name}> inside", "none" if source is None else "both")
        return None
    if source is None:
        return inline
    read = files.read(element, source, findings)
    return None if read is None else parse(*read, name, findings)


def _parameters(values: Element, units: Units, findings: Findings) -> Iterator[SspParameter]:
    """The parameters of a set; its own units come before those of the system."""
    own = units_in([*children(values, "ssv:Units/ssc:Unit"), *children(values, "ssc:Units/ssc:Unit")], findings)
    enumerations = items_in(
        [*children(values, "ssv:Enumerations/ssc:Enumeration"), *children(values, "ssc:Enumerations/ssc:Enumeration")],
        findings,
    )
    for parameter in children(values, "ssv:Parameters/ssv:Parameter"):
        name = required(parameter, "name", findings)
        held = [child for child in parameter if short(child.tag) != "ssv:Annotations"]
        if len(held) != 1:
            findings.refuse(parameter, "one value", f"{len(held)} in {name!r}")
            continue
        content = held[0]
        yield SspParameter(
            name,
            _value(content, findings),
            content,
            content.get("unit", ""),
            units={**units, **own},
            items=enumerations.get(content.get("name", ""), {}),
            enumerated=short(content.tag) == "ssv:Enumeration",
        )


def _value(content: Element, findings: Findings) -> Value:
    kind = short(content.tag).partition(":")[2]
    if kind in REAL:
        return real(content, "value", findings)
    if kind in WHOLE:
        return whole(content, "value", findings)
    if kind == "Boolean":
        return truth(content, "value", findings)
    if content.get("value") is None:
        findings.refuse(content, "a value", "nothing")
    return content.get("value", "")


def _mapped(found: list[SspParameter], entries: Element, findings: Findings) -> Iterator[SspParameter]:
    """Parameters under the names that a mapping gives them; those that it does not name keep theirs."""
    by_source: dict[str, list[Element]] = {}
    for entry in children(entries, "ssm:MappingEntry"):
        by_source.setdefault(required(entry, "source", findings), []).append(entry)
    for parameter in found:
        if parameter.name not in by_source:
            yield parameter
        for entry in by_source.pop(parameter.name, ()):
            yield _transformed(parameter, entry, findings)
    for source, left in by_source.items():
        for entry in left:
            findings.tell(entry, f"the mapping from {source!r} does nothing: no parameter has that name")


def _transformed(parameter: SspParameter, entry: Element, findings: Findings) -> SspParameter:
    target = evolve(
        parameter,
        name=required(entry, "target", findings),
        converts=not truth(entry, "suppressUnitConversion", findings, False),
    )
    held = [child for child in entry if short(child.tag) != "ssm:Annotations"]
    if not held:
        return target
    if short(held[0].tag) == "ssc:LinearTransformation":
        return _linear(target, held[0], findings)
    return evolve(target, value=_looked_up(parameter, held[0], findings), enumerated=parameter.enumerated)


def _linear(target: SspParameter, element: Element, findings: Findings) -> SspParameter:
    if isinstance(target.value, (bool, str)):
        findings.refuse(element, "a linear transformation of a number", f"{target.value!r}")
    return evolve(target, change=transformation(element, findings))


def _looked_up(parameter: SspParameter, transformation: Element, findings: Findings) -> Value:
    """The value that a mapping of Booleans, whole numbers or items gives for a parameter's value."""
    kind = short(transformation.tag).removeprefix("ssc:").removesuffix("MappingTransformation")
    readers = {"Boolean": truth, "Integer": whole, "Enumeration": required}
    table = {
        readers[kind](entry, "source", findings): readers[kind](entry, "target", findings)
        for entry in children(transformation, "ssc:MapEntry")
    }
    fits = {"Boolean": bool, "Integer": int, "Enumeration": str}[kind]
    if type(parameter.value) is not fits or parameter.value not in table:
        listed = ", ".join(map(str, table)) or "none"
        findings.refuse(transformation, f"an entry for {parameter.value!r} of {parameter.name!r}", listed)
        return parameter.value
    return table[parameter.value]


def start_value(parameter: SspParameter, variable: FmuVariable, face: FmuFace, findings: Findings) -> Value | None:
    """The start value of an FMU variable, in its unit and of its type; None, and a problem, where it does not fit."""
    if variable.array:
        findings.refuse(parameter.element, f"a scalar variable {variable.name!r}", "an array: SSP has one value a name")
        return None
    if variable.kind == "real":
        return _real(parameter, variable, face, findings)
    if parameter.change != Linear():
        findings.refuse(parameter.element, f"a real {variable.name!r} to transform", f"one of type {variable.kind}")
        return None
    fitting = {
        "integer": _integer,
        "Enumeration": _item,
        "Boolean": lambda p, _: p.value if isinstance(p.value, bool) else None,
        "String": lambda p, _: p.value if isinstance(p.value, str) and not p.enumerated else None,
    }.get(variable.kind)
    value = None if fitting is None else fitting(parameter, variable)
    if value is None:
        advice = f"items: {', '.join(variable.items)}" if variable.items else ""
        findings.refuse(
            parameter.element,
            f"a value for {variable.name!r} of type {variable.kind}",
            f"{short(parameter.element.tag)} {parameter.value!r}",
            advice,
        )
    return value


def _integer(parameter: SspParameter, variable: FmuVariable) -> Value | None:
    if parameter.enumerated:
        return parameter.items.get(str(parameter.value))
    return parameter.value if type(parameter.value) is int else None


def _item(parameter: SspParameter, variable: FmuVariable) -> Value | None:
    """The name of an enumeration's item, given by name or by value."""
    if isinstance(parameter.value, str):
        return parameter.value if parameter.value in variable.items else None
    if type(parameter.value) is not int:
        return None
    return next((name for name, value in variable.items.items() if value == parameter.value), None)


def _real(parameter: SspParameter, variable: FmuVariable, face: FmuFace, findings: Findings) -> float | None:
    if isinstance(parameter.value, (bool, str)):
        found = f"{short(parameter.element.tag)} {parameter.value!r}"
        findings.refuse(parameter.element, f"a number for {variable.name!r}", found)
        return None
    number = float(parameter.value)
    if math.isnan(number):  # it was no number, which is told already
        return None
    if number != parameter.value:
        findings.refuse(parameter.element, f"a number that a double holds for {variable.name!r}", str(parameter.value))
        return None
    turn = _turn(parameter, variable, face, findings)
    return None if turn is None else both(turn, parameter.change, parameter.element, findings)(number)


def _turn(parameter: SspParameter, variable: FmuVariable, face: FmuFace, findings: Findings) -> Linear | None:
    """What turns the number into the unit of the FMU's variable."""
    if not parameter.converts or not parameter.unit:
        return Linear()
    if not variable.unit:
        told = f"the unit {parameter.unit!r} is not used: {variable.name!r} has none in its FMU"
        findings.tell(parameter.element, told)
    mine = parameter.units.get(parameter.unit) or face.units.get(parameter.unit) or Unit(parameter.unit)
    turn = mine.towards(face.unit(variable))
    if turn is None:
        undefined = f"{parameter.unit!r} has no definition"
        findings.refuse(
            parameter.element,
            f"a value in {variable.unit!r}, the unit of {variable.name!r} in its FMU",
            f"one in {parameter.unit!r}",
            undefined if mine.exponents is None else "units of other dimensions are not converted",
        )
    return turn
