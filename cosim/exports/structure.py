"""The wired scenario as an SSP 1.0 archive: structure, FMUs, parameter values (SSP 1.0, Modelica Association, 2019).

Parameter values are written at their component, because some tools drop those of the system. They are compiled into the
component's own FMU too, because some tools (libcosim) know no enumerations, and so are the values that its inputs have
at the start, because some tools pass those on only once. SSP has no element for the master algorithm: an annotation of
the Open Simulation Platform gives the communication step, and one of our own gives the algorithm, the extrapolation and
the order of the components. `cosim.scenario.ssp` reads both.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree as xml

from cosim.engine.isolation import runner
from cosim.errors import RunError
from cosim.exports.enumerations import whole_numbers
from cosim.fmu import describe, fmu_file, open_system
from cosim.scenario import joints_of
from cosim.scenario.ssp_experiment import MASTER, OMS, OMS_TYPE, OSP, OSP_TYPE, VENDOR
from cosim.scenario.ssp_grammar import NAMESPACES
from cosim.signals import FmuDescription, Unit, Variable
from cosim.wiring import Wiring

_NAMESPACES = NAMESPACES | {"osp": OSP, "oms": OMS, "master": MASTER}
_EXPONENTS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_COLUMN, _ROW = 60.0, 40.0  # size of a block in a diagram


def write_ssp(wiring: Wiring, path: Path, platforms: Sequence[str] | None = None, enumerations: bool = True) -> Path:
    """Write the scenario as an SSP archive (same input, same bytes) with FMUs of FMI 2.0; returns its path.

    enumerations: whether the FMUs keep theirs. Raises RunError where an FMU cannot be built.
    """
    from build_fmus.archive import zip_bytes

    fmus = component_fmus(wiring, platforms, enumerations=enumerations)
    files = {f"resources/{name}.fmu": fmu.read_bytes() for name, fmu in fmus.items()}
    descriptions = {name: describe(fmu) for name, fmu in fmus.items()}
    files["SystemStructure.ssd"] = system_structure(wiring, descriptions)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(zip_bytes(files))
    return path


def component_fmus(
    wiring: Wiring, platforms: Sequence[str] | None = None, fmi: int = 2, enumerations: bool = True
) -> dict[str, Path]:
    """An FMU for every component; those of our models have parameters and inputs at t = 0 compiled in as start
    values. Without `enumerations` whole numbers take their place.
    """
    from build_fmus import BuildError, fitted_fmu

    inputs = _first_inputs(wiring)
    scenario = wiring.scenario.with_values({"experiment.fmi": fmi})
    fmus = {}
    for name, component in scenario.components.items():
        try:
            built = component.model_path(scenario.folder) if component.own else component.model
            fmus[name] = (
                fitted_fmu(
                    str(built),
                    joints_of(component),
                    fmi,
                    platforms,
                    start=_numbers(wiring.starts[name]) | inputs[name],
                )
                if built and not str(built).endswith(".py")
                else fmu_file(component, scenario)
            )
        except BuildError as error:
            raise RunError(name, None, f"cannot be built: {error}") from None
    return fmus if enumerations else {name: whole_numbers(fmu) for name, fmu in fmus.items()}


def _first_inputs(wiring: Wiring) -> dict[str, dict[str, float]]:
    """The values of each component's wired inputs at t = 0."""
    period = len(wiring.schedule.phases) * wiring.scenario.experiment.step  # s: whole steps of every component
    brief = wiring.scenario.with_values({"experiment.stop": period})
    with open_system(brief) as system:
        first = runner(brief)(brief, system)
    values: dict[str, dict[str, float]] = {name: {} for name in wiring.scenario.components}
    for link in wiring.links:
        if not link.text:
            value = float(first.signals[str(link.source)][0])
            values[link.target.component][link.target.variable] = link.gain * value + link.shift
    return values


def _numbers(starts: Mapping[str, float | str]) -> dict[str, float]:
    return {key: float(value) for key, value in starts.items()}


def system_structure(wiring: Wiring, descriptions: Mapping[str, FmuDescription]) -> bytes:
    """The SystemStructure.ssd of a scenario whose components' FMUs lie as resources/COMPONENT.fmu."""
    for prefix, uri in _NAMESPACES.items():
        xml.register_namespace(prefix, uri)
    scenario = wiring.scenario
    root = _element(
        "ssd:SystemStructureDescription", version="1.0", name=_identifier(scenario.name), generationTool="cosim"
    )
    system = _element("ssd:System", root, name="loop", description=scenario.title or scenario.name)
    elements = _element("ssd:Elements", system)
    for place, name in enumerate(scenario.components):
        _component(elements, name, f"resources/{name}.fmu", descriptions[name], wiring, place)
    connections = _element("ssd:Connections", system)
    for link in wiring.links:
        _element(
            "ssd:Connection",
            connections,
            startElement=link.source.component,
            startConnector=link.source.variable,
            endElement=link.target.component,
            endConnector=link.target.variable,
        )
    _omsimulator(system, scenario.experiment.step)
    _units(root, descriptions)
    _experiment(root, wiring)
    xml.indent(root)
    return xml.tostring(root, encoding="UTF-8", xml_declaration=True)


def _identifier(name: str) -> str:
    """The name with letters, digits and underscores only: OMSimulator reads no other."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"_{plain}" if plain[:1].isdigit() else plain


def _omsimulator(system: xml.Element, step: float) -> None:
    """What OMSimulator needs to know a system as one of co-simulation: its master with a fixed step [s].

    Its tolerances are those that it writes itself; a fixed step does not use them.
    """
    annotation = _element("ssc:Annotation", _element("ssd:Annotations", system), type=OMS_TYPE)
    information = _element("oms:SimulationInformation", _element("oms:Annotations", annotation))
    _element(
        "oms:FixedStepMaster",
        information,
        description="oms-ma",
        stepSize=repr(step),
        absoluteTolerance="0.0001",
        relativeTolerance="0.0001",
    )


def _element(qualified: str, parent: xml.Element | None = None, /, **attributes: object) -> xml.Element:
    prefix, local = qualified.split(":")
    tag = f"{{{_NAMESPACES[prefix]}}}{local}"
    texts = {key: str(value) for key, value in attributes.items() if value}
    return xml.Element(tag, texts) if parent is None else xml.SubElement(parent, tag, texts)


def _component(
    elements: xml.Element, name: str, source: str, description: FmuDescription, wiring: Wiring, place: int
) -> None:
    component = _element(
        "ssd:Component",
        elements,
        name=name,
        type="application/x-fmu-sharedlibrary",
        source=source,
        description=description.text,
    )
    connectors = _element("ssd:Connectors", component)
    wired = {str(s) for link in wiring.links for s in (link.source, link.target)}
    for variable in description.variables.values():
        kind = variable.causality if variable.causality in ("input", "output") else None
        if kind and (kind == "output" or f"{name}.{variable.name}" in wired):
            connector = _element(
                "ssd:Connector", connectors, name=variable.name, kind=kind, description=variable.description
            )
            _type(connector, variable)
    x, y = 2 * _COLUMN * (place % 4), 2 * _ROW * (place // 4)
    _element("ssd:ElementGeometry", component, x1=f"{x:g}", y1=f"{y:g}", x2=f"{x + _COLUMN:g}", y2=f"{y + _ROW:g}")
    _parameters(component, name, description, wiring.starts[name])


def _type(connector: xml.Element, variable: Variable) -> None:
    kind = {"Real": "Real", "Boolean": "Boolean", "String": "String"}.get(variable.type, "Integer")
    _element(f"ssc:{kind}", connector, **({"unit": variable.unit.name} if kind == "Real" else {}))


def _parameters(
    component: xml.Element, name: str, description: FmuDescription, starts: Mapping[str, float | str]
) -> None:
    if not starts:
        return
    bindings = _element("ssd:ParameterBindings", component)
    values = _element("ssd:ParameterValues", _element("ssd:ParameterBinding", bindings))
    parameters = _element(
        "ssv:Parameters", _element("ssv:ParameterSet", values, version="1.0", name=f"{name} start values")
    )
    for key, value in starts.items():
        variable = description.variables[key]
        parameter = _element("ssv:Parameter", parameters, name=key)
        _value(parameter, variable, value)


def _value(parameter: xml.Element, variable: Variable, value: float | str) -> None:
    if variable.type == "Boolean":
        _element("ssv:Boolean", parameter, value="true" if value else "false")
    elif variable.type == "String":
        _element("ssv:String", parameter).set("value", str(value))
    elif variable.type == "Real":
        _element("ssv:Real", parameter, value=repr(float(value)), unit=variable.unit.name)
    else:
        _element("ssv:Integer", parameter, value=str(int(value)))


def _units(root: xml.Element, descriptions: Mapping[str, FmuDescription]) -> None:
    found = {v.unit.name: v.unit for d in descriptions.values() for v in d.variables.values() if v.unit.name}
    if not found:
        return
    units = _element("ssd:Units", root)
    for name in sorted(found):
        unit = _element("ssc:Unit", units, name=name)
        _element("ssc:BaseUnit", unit, **_base(found[name]))


def _base(unit: Unit) -> dict[str, str]:
    exponents = {key: str(n) for key, n in zip(_EXPONENTS, unit.exponents or ()) if n}
    scale = {"factor": (unit.factor, 1.0), "offset": (unit.offset, 0.0)}
    return exponents | {key: repr(value) for key, (value, usual) in scale.items() if value != usual}


def _experiment(root: xml.Element, wiring: Wiring) -> None:
    experiment = wiring.scenario.experiment
    default = _element("ssd:DefaultExperiment", root, startTime="0.0", stopTime=repr(experiment.stop))
    annotations = _element("ssd:Annotations", default)
    annotation = _element("ssc:Annotation", annotations, type=OSP_TYPE)
    _element("osp:FixedStepAlgorithm", _element("osp:Algorithm", annotation), baseStepSize=repr(experiment.step))
    master = _element(
        "master:Algorithm",
        _element("ssc:Annotation", annotations, type=VENDOR),
        name=experiment.algorithm.value,
        extrapolation=experiment.extrapolation.value,
    )
    for name in wiring.order:
        _element("master:Component", master, name=name, stepMultiple=wiring.scenario.components[name].step_multiple)
