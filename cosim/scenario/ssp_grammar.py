"""What of SSP is read: elements with their attributes and children. All that is not on this list is refused by name.

The names are those of SSP 1.0 (Modelica Association, 2019); of SSP 2.0 the types of numbers are read too. On the list
is also what cannot change a simulation: pictures, descriptions, authors, and the frame of annotations (see
ssp_experiment).
"""

from collections.abc import Mapping

from attrs import frozen

_URI = "http://ssp-standard.org/SSP1/SystemStructure"
NAMESPACES = {
    "ssd": f"{_URI}Description",
    "ssc": f"{_URI}Common",
    "ssv": f"{_URI}ParameterValues",
    "ssm": f"{_URI}ParameterMapping",
    "ssb": f"{_URI}SignalDictionary",
}
STRUCTURE = "SystemStructure.ssd"
"""The file that an SSP holds."""
REAL = ("Real", "Float64", "Float32")
WHOLE = ("Integer", "Int8", "Int16", "Int32", "Int64", "UInt8", "UInt16", "UInt32", "UInt64")


@frozen
class Accepted:
    """Attributes and children that an element may have."""

    attributes: frozenset[str]
    children: frozenset[str]


def qualified(name: str) -> str:
    """`ssd:System` as XML libraries write it, `{http://...}System`."""
    prefix, _, local = name.partition(":")
    return f"{{{NAMESPACES[prefix]}}}{local}"


def short(tag: str) -> str:
    """`{http://...}System` as `ssd:System`."""
    uri, _, local = tag[1:].rpartition("}")
    return next((f"{prefix}:{local}" for prefix, known in NAMESPACES.items() if known == uri), tag)


def _row(attributes: str = "", children: str = "") -> Accepted:
    return Accepted(frozenset(attributes.split()), frozenset(children.split()))


_BASE = " id description"
_FILE = " version author fileversion copyright license generationTool generationDateAndTime" + _BASE
_TYPES = " " + " ".join(f"ssc:{name}" for name in (*REAL, *WHOLE, "Boolean", "String", "Enumeration", "Binary"))
_VALUES = " " + " ".join(f"ssv:{name}" for name in (*REAL, *WHOLE, "Boolean", "String", "Enumeration"))
_TRANSFORMATIONS = (
    " ssc:LinearTransformation ssc:BooleanMappingTransformation ssc:IntegerMappingTransformation"
    " ssc:EnumerationMappingTransformation"
)
_NOTES = " ssd:Annotations"
_BOX = "x1 y1 x2 y2"
_ELEMENT = "ssd:Connectors ssd:ElementGeometry ssd:ParameterBindings"

ACCEPTED: Mapping[str, Accepted] = {
    "ssd:SystemStructureDescription": _row(
        "name" + _FILE, "ssd:System ssd:Enumerations ssd:Units ssd:DefaultExperiment" + _NOTES
    ),
    "ssd:System": _row(
        "name" + _BASE,
        _ELEMENT
        + " ssd:Elements ssd:Connections ssd:SignalDictionaries ssd:SystemGeometry ssd:GraphicalElements"
        + _NOTES,
    ),
    "ssd:Elements": _row("", "ssd:Component ssd:System ssd:SignalDictionaryReference"),
    "ssd:Component": _row("name type source implementation" + _BASE, _ELEMENT + _NOTES),
    "ssd:SignalDictionaryReference": _row("name dictionary" + _BASE, _ELEMENT + _NOTES),
    "ssd:SignalDictionaries": _row("", "ssd:SignalDictionary"),
    "ssd:SignalDictionary": _row("name type source" + _BASE, "ssb:SignalDictionary"),
    "ssd:Connectors": _row("", "ssd:Connector"),
    "ssd:Connector": _row("name kind" + _BASE, "ssd:ConnectorGeometry" + _NOTES + _TYPES),
    "ssd:Connections": _row("", "ssd:Connection"),
    "ssd:Connection": _row(
        "startElement startConnector endElement endConnector suppressUnitConversion" + _BASE,
        "ssd:ConnectionGeometry" + _NOTES + _TRANSFORMATIONS,
    ),
    "ssd:ParameterBindings": _row("", "ssd:ParameterBinding"),
    "ssd:ParameterBinding": _row(
        "type source sourceBase prefix" + _BASE, "ssd:ParameterValues ssd:ParameterMapping" + _NOTES
    ),
    "ssd:ParameterValues": _row("", "ssv:ParameterSet"),
    "ssd:ParameterMapping": _row("type source sourceBase" + _BASE, "ssm:ParameterMapping"),
    "ssd:DefaultExperiment": _row("startTime stopTime", "ssd:Annotations"),
    "ssd:Units": _row("", "ssc:Unit"),
    "ssd:Enumerations": _row("", "ssc:Enumeration"),
    "ssd:Annotations": _row("", "ssc:Annotation"),
    "ssd:ConnectorGeometry": _row("x y"),
    "ssd:ConnectionGeometry": _row("pointsX pointsY"),
    "ssd:ElementGeometry": _row(_BOX + " rotation iconSource iconRotation iconFlip iconFixedAspectRatio"),
    "ssd:SystemGeometry": _row(_BOX),
    "ssd:GraphicalElements": _row("", "ssd:Note"),
    "ssd:Note": _row(_BOX + " text"),
    "ssv:ParameterSet": _row(
        "name" + _FILE, "ssv:Parameters ssv:Enumerations ssv:Units ssc:Enumerations ssc:Units ssv:Annotations"
    ),
    "ssv:Parameters": _row("", "ssv:Parameter"),
    "ssv:Parameter": _row("name" + _BASE, "ssv:Annotations" + _VALUES),
    "ssv:Units": _row("", "ssc:Unit"),
    "ssv:Enumerations": _row("", "ssc:Enumeration"),
    "ssv:Annotations": _row("", "ssc:Annotation"),
    "ssv:Boolean": _row("value"),
    "ssv:String": _row("value"),
    "ssv:Enumeration": _row("value name"),
    **{f"ssv:{name}": _row("value unit") for name in REAL},
    **{f"ssv:{name}": _row("value") for name in WHOLE},
    "ssm:ParameterMapping": _row(_FILE, "ssm:MappingEntry ssm:Annotations"),
    "ssm:MappingEntry": _row("source target suppressUnitConversion" + _BASE, "ssm:Annotations" + _TRANSFORMATIONS),
    "ssm:Annotations": _row("", "ssc:Annotation"),
    "ssb:SignalDictionary": _row(_FILE, "ssb:DictionaryEntry ssb:Enumerations ssb:Units ssb:Annotations"),
    "ssb:DictionaryEntry": _row("name" + _BASE, "ssb:Annotations" + _TYPES),
    "ssb:Units": _row("", "ssc:Unit"),
    "ssb:Enumerations": _row("", "ssc:Enumeration"),
    "ssb:Annotations": _row("", "ssc:Annotation"),
    "ssc:Units": _row("", "ssc:Unit"),
    "ssc:Enumerations": _row("", "ssc:Enumeration"),
    "ssc:Unit": _row("name" + _BASE, "ssc:BaseUnit ssc:Annotations"),
    "ssc:BaseUnit": _row("kg m s A K mol cd rad factor offset"),
    "ssc:Enumeration": _row("name" + _BASE, "ssc:Item ssc:Annotations"),
    "ssc:Item": _row("name value"),
    "ssc:Annotations": _row("", "ssc:Annotation"),
    **{f"ssc:{name}": _row("unit") for name in REAL},
    **{f"ssc:{name}": _row() for name in (*WHOLE, "Boolean", "String")},
    "ssc:Binary": _row("mime-type"),
    "ssc:LinearTransformation": _row("factor offset"),
    **{f"ssc:{kind}MappingTransformation": _row("", "ssc:MapEntry") for kind in ("Boolean", "Integer", "Enumeration")},
    "ssc:MapEntry": _row("source target"),
}
NOTE = "ssc:Annotation"
"""The frame of what a tool adds to the standard; its content is left to ssp_experiment."""
FREE = "{http://www.w3.org/2001/XMLSchema-instance}"
"""Namespace of attributes that say where a schema is."""
