"""XML files of an SSP: parsed with the line of every element, checked against what is read, values of attributes."""

import math
import re
from collections.abc import Iterator

from attrs import field, frozen
from lxml import etree

from cosim.errors import InputError, Problem, did_you_mean
from cosim.scenario.ssp_grammar import ACCEPTED, FREE, NOTE, qualified, short

_DOUBLE = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_INTEGER = re.compile(r"[+-]?\d+")
Element = etree._Element


@frozen
class Findings:
    """What is wrong with an SSP, and what its reader is told."""

    problems: list[Problem] = field(factory=list)
    warnings: list[str] = field(factory=list)

    def refuse(self, element: Element, expected: str, got: str, advice: str = "") -> None:
        """Add a problem at an element."""
        self.problems.append(Problem(place(element), expected, got, advice))

    def tell(self, element: Element, text: str) -> None:
        """Add a warning at an element."""
        self.warnings.append(f"{place(element)}: {text}")

    def settle(self) -> None:
        """Raise InputError where there are problems."""
        if self.problems:
            raise InputError(self.problems)


def place(element: Element) -> str:
    """`loop.ssp: SystemStructure.ssd, line 12`."""
    return f"{element.getroottree().docinfo.URL}, line {element.sourceline}"


def parse(data: bytes, label: str, root: str, findings: Findings) -> Element | None:
    """The root element of an XML file; None, and a problem, where it is no XML or something else.

    label: the file's name in messages; root: the name that is expected, `ssv:ParameterSet`. Entities are not replaced
    and nothing is loaded from elsewhere.
    """
    found = parse_xml(data, label, findings)
    if found is None:
        return None
    if found.tag != qualified(root):
        findings.refuse(found, f"<{root}>", f"<{short(found.tag)}>")
        return None
    _check_version(found, findings)
    _check(found, findings)
    return found


def parse_xml(data: bytes, label: str, findings: Findings) -> Element | None:
    """The root element of any XML file; None, and a problem, where it is not well formed or has a document type."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True)
    try:
        found = etree.fromstring(data, parser, base_url=label)
    except etree.XMLSyntaxError as error:
        findings.problems.append(Problem(f"{label}, line {error.lineno or 1}", "XML", error.msg or "something else"))
        return None
    if found.getroottree().docinfo.internalDTD is not None:
        findings.refuse(found, "no document type", "a DOCTYPE", "remove it: entities are not replaced")
        return None
    return found


def _check_version(root: Element, findings: Findings) -> None:
    version = root.get("version")
    if version is not None and not re.match(r"[12]\.", version):
        findings.refuse(root, "version 1.x or 2.x", repr(version))


def _check(element: Element, findings: Findings) -> None:
    """Problems of attributes and children that nothing reads, below an element that is read."""
    accepted = ACCEPTED[short(element.tag)]
    for key in element.attrib:
        if key not in accepted.attributes and not str(key).startswith(FREE):
            advice = did_you_mean(str(key), accepted.attributes)
            findings.refuse(element, f"an attribute of <{short(element.tag)}> that is read", repr(str(key)), advice)
    for child in element:
        name = short(str(child.tag))
        if name == NOTE and name in accepted.children:
            continue
        if name not in accepted.children:
            listed = ", ".join(sorted(accepted.children)) or "nothing"
            findings.refuse(child, f"in <{short(element.tag)}> what is read there ({listed})", f"<{name}>")
        else:
            _check(child, findings)


def children(element: Element, path: str) -> Iterator[Element]:
    """Elements below another: `ssd:Elements/ssd:Component`."""
    return element.iterfind("/".join(qualified(name) for name in path.split("/")))


def first(element: Element, path: str) -> Element | None:
    """The first element below another, None where there is none."""
    return next(children(element, path), None)


def required(element: Element, key: str, findings: Findings) -> str:
    """The text of an attribute that must be there, and not empty."""
    text = element.get(key)
    if not text:
        findings.refuse(element, f"{key} of <{short(element.tag)}>", "none" if text is None else "an empty one")
    return text or ""


def real(element: Element, key: str, findings: Findings, default: float | None = None) -> float:
    """A number; a problem where it is none or infinite."""
    text = element.get(key)
    if text is None and default is not None:
        return default
    if text is not None and _DOUBLE.fullmatch(text.strip()) and math.isfinite(float(text)):
        return float(text)
    advice = "numbers have a decimal point" if text and "," in text else ""
    findings.refuse(element, f"{key} to be a number", "nothing" if text is None else repr(text), advice)
    return math.nan


def whole(element: Element, key: str, findings: Findings, default: int | None = None) -> int:
    """A whole number; a problem where it is none."""
    text = element.get(key)
    if text is None and default is not None:
        return default
    if text is not None and len(text) < 40 and _INTEGER.fullmatch(text.strip()):
        return int(text)
    findings.refuse(element, f"{key} to be a whole number", "nothing" if text is None else repr(text))
    return 0


def truth(element: Element, key: str, findings: Findings, default: bool | None = None) -> bool:
    """A Boolean as XML writes it; a problem where it is none."""
    text = element.get(key)
    if text is None and default is not None:
        return default
    values = {"true": True, "1": True, "false": False, "0": False}
    if text is not None and text.strip() in values:
        return values[text.strip()]
    findings.refuse(element, f"{key} to be true or false", "nothing" if text is None else repr(text))
    return False
