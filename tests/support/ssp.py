"""SSP archives as other tools write them, around one small FMU, for the tests of their reader."""

import zipfile
from functools import cache
from pathlib import Path

from build_fmus.build import BuildJob, build
from build_fmus.compiler import this_platform
from build_fmus.table import DefaultExperiment, Head, ModelTable, ModelVariable

_CODE = b"""
/* x counts k every millisecond, y is the input as it was, seen holds what was set */
static const char *start(Model *m) { (void)m; return NULL; }
static const char *sample(Model *m, double t) {
    (void)t;
    m->x += 0.001 * m->k;
    m->y = m->u;
    m->seen = 100.0 * m->n + 10.0 * m->mode + m->on;
    return NULL;
}
static void outputs(Model *m, double t) { (void)m; (void)t; }
"""
_TABLE = ModelTable(
    Head("Part", "a part of a system", "sampled"),
    DefaultExperiment(1.0, 0.001),
    [
        ModelVariable("u", "input", "input", unit="m"),
        ModelVariable("x", "output", "sum", unit="m"),
        ModelVariable("y", "output", "input of the step before", unit="m"),
        ModelVariable("seen", "output", "parameters seen", unit="1"),
        ModelVariable("k", "parameter", "rate of x", unit="m", start=1.0),
        ModelVariable("n", "parameter", "a whole number", type="Integer", start=0.0),
        ModelVariable("on", "parameter", "a switch", type="Boolean", start=0.0),
        ModelVariable("mode", "parameter", "a choice", type="Enumeration", items=["slow", "fast"], start=1.0),
    ],
    [],
)
_ROOT = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<ssd:SystemStructureDescription version="1.0" name="test"'
    + "".join(
        f' xmlns:{prefix}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
        for prefix, name in (
            ("ssd", "Description"),
            ("ssc", "Common"),
            ("ssv", "ParameterValues"),
            ("ssm", "ParameterMapping"),
            ("ssb", "SignalDictionary"),
        )
    )
    + ">\n"
)
NAMESPACES = _ROOT.split('name="test"')[1].removesuffix(">\n")
"""Declarations of all prefixes of SSP, for a file of parameters."""
EXPERIMENT = '<ssd:DefaultExperiment startTime="0" stopTime="1"/>'
MILLIMETRE = '<ssc:Unit name="mm"><ssc:BaseUnit m="1" factor="0.001"/></ssc:Unit>'
METRE = '<ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit>'


@cache
def part() -> Path:
    """The FMU `Part` for FMI 2.0."""
    return build(BuildJob(_TABLE, 2, (this_platform(),), {"model.c": _CODE, "README.md": b"# Part\n"}))


def component(name: str, inside: str = "", source: str = "resources/part.fmu", connectors: str = "") -> str:
    """A <Component> with connectors u, x, y and k, and what else stands in it."""
    listed = connectors or "".join(
        f'<ssd:Connector name="{connector}" kind="{kind}"><ssc:Real unit="m"/></ssd:Connector>\n'
        for connector, kind in (("u", "input"), ("x", "output"), ("y", "output"), ("k", "parameter"))
    )
    return (
        f'<ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" source="{source}">\n'
        f"<ssd:Connectors>{listed}</ssd:Connectors>{inside}</ssd:Component>\n"
    )


def binding(values: str, attributes: str = "", mapping: str = "", units: str = "") -> str:
    """<ParameterBindings> with one inline set of values."""
    held = f"<ssv:Units>{units}</ssv:Units>" if units else ""
    return (
        f"<ssd:ParameterBindings><ssd:ParameterBinding {attributes}><ssd:ParameterValues>\n"
        f'<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>{values}</ssv:Parameters>{held}</ssv:ParameterSet>\n'
        f"</ssd:ParameterValues>{mapping}</ssd:ParameterBinding></ssd:ParameterBindings>"
    )


def parameter(name: str, value: object, kind: str = "Real", more: str = "") -> str:
    """A <Parameter> with its value."""
    return f'<ssv:Parameter name="{name}"><ssv:{kind} value="{value}" {more}/></ssv:Parameter>\n'


def connection(start: str, end: str, inside: str = "", attributes: str = "") -> str:
    """A <Connection>, `a.x` to `b.u`; without a dot: a connector of the system."""
    ends = []
    for side, text in (("start", start), ("end", end)):
        element, _, connector = text.rpartition(".")
        ends.append((f'{side}Element="{element}" ' if element else "") + f'{side}Connector="{connector}"')
    return f"<ssd:Connection {' '.join(ends)} {attributes}>{inside}</ssd:Connection>\n"


def structure(elements: str, connections: str = "", before: str = "", after: str = EXPERIMENT, end: str = "") -> str:
    """The text of a SystemStructure.ssd; `before` and `end` stand in the system, `after` behind it."""
    wires = f"<ssd:Connections>\n{connections}</ssd:Connections>" if connections else ""
    return (
        f'{_ROOT}<ssd:System name="root">{before}<ssd:Elements>\n{elements}</ssd:Elements>{wires}{end}</ssd:System>\n'
        f"{after}</ssd:SystemStructureDescription>"
    )


def archive(path: Path, text: str, **files: str | bytes) -> Path:
    """An SSP archive of a structure, the FMU and further files (`__` in a name stands for `/`, `_dot_` for `.`)."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as opened:
        opened.writestr("SystemStructure.ssd", text)
        opened.write(part(), "resources/part.fmu")
        for name, content in files.items():
            opened.writestr(name.replace("__", "/").replace("_dot_", "."), content)
    return path
