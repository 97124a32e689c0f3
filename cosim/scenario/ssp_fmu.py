"""The variables of an FMU in an SSP, as far as its parameters and connectors need them: type, unit, items."""

import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

from attrs import field, frozen

from cosim.scenario.ssp_document import Element, Findings, parse_xml
from cosim.scenario.ssp_grammar import REAL, WHOLE
from cosim.scenario.ssp_units import Units, defined_unit
from cosim.signals import Unit

_MOST = 500_000_000  # bytes of one model description


@frozen
class FmuVariable:
    """One variable: `kind` is real, integer, Boolean, String, Enumeration, or the FMU's own word for another."""

    name: str
    causality: str
    kind: str
    unit: str = ""
    items: Mapping[str, int] = field(factory=dict)
    array: bool = False


@frozen
class FmuFace:
    """Variables of an FMU by name, and the units that it defines."""

    variables: Mapping[str, FmuVariable]
    units: Units

    def unit(self, variable: FmuVariable) -> Unit:
        """The unit of a variable, as the FMU defines it."""
        return self.units.get(variable.unit, Unit(variable.unit))


def read_face(fmu: Path, label: str) -> FmuFace | None:
    """What an FMU file says of its variables; None where it cannot be read (the wiring says why)."""
    findings = Findings()
    try:
        with zipfile.ZipFile(fmu) as archive:
            if archive.getinfo("modelDescription.xml").file_size > _MOST:
                return None
            root = parse_xml(archive.read("modelDescription.xml"), f"{label}: modelDescription.xml", findings)
    except (OSError, KeyError, zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError, EOFError):
        return None
    if root is None:
        return None
    face = _face(root, findings)
    return None if findings.problems else face


def _face(root: Element, findings: Findings) -> FmuFace:
    units = {
        u.get("name", ""): defined_unit(u.get("name", ""), b, findings)
        for u in root.iterfind("UnitDefinitions/Unit")
        for b in u
        if b.tag == "BaseUnit"
    }
    types = {t.get("name"): t for t in _types(root)}
    found = root.find("ModelVariables")
    variables = [_variable(v, types) for v in (found if found is not None else ())]
    return FmuFace({v.name: v for v in variables}, units)


def _types(root: Element) -> list[Element]:
    """Type definitions; in FMI 2.0 the element that holds type and unit lies in one with the name."""
    found = root.find("TypeDefinitions")
    return [] if found is None else list(found)


def _content(element: Element) -> Element:
    """The element with type and unit: in FMI 2.0 inside, in FMI 3.0 the element itself."""
    if element.tag in ("ScalarVariable", "SimpleType"):
        return next((e for e in element if e.tag in (*REAL, *WHOLE, "Boolean", "String", "Enumeration")), element)
    return element


def _variable(element: Element, types: Mapping[str | None, Element]) -> FmuVariable:
    content = _content(element)
    declared = types.get(content.get("declaredType"))
    declared = _content(declared) if declared is not None else None
    unit = content.get("unit") or (declared.get("unit") if declared is not None else None) or ""
    items = (
        {}
        if declared is None
        else {i.get("name", ""): _value(i, n) for n, i in enumerate(declared.iterfind("Item"), 1)}
    )
    return FmuVariable(
        element.get("name", ""),
        element.get("causality", "local"),
        kind_of(content.tag.removesuffix("Type")),
        unit,
        items,
        element.find("Dimension") is not None,
    )


def _value(item: Element, position: int) -> int:
    """The value of an enumeration's item; a wrong one is the wiring's to tell."""
    try:
        return int(item.get("value", position))
    except ValueError:
        return position


def kind_of(type_name: str) -> str:
    """Real and Float64 are real, all whole numbers integer."""
    return "real" if type_name in REAL else "integer" if type_name in WHOLE else type_name
