"""An SSP 1.0 archive as the table of a scenario, so that `cosim run SYSTEM.ssp` simulates what another tool wired.

What is read: components that are FMUs, the connections between them, parameter values of components and system (inline
or in .ssv files of the archive), the stop time, the communication step from the Open Simulation Platform's annotation,
and the master algorithm from our own. A warning names what an archive leaves open. Nested systems, parameter mappings,
linear transformations and connections of the system's own connectors are refused by name.
"""

import hashlib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as xml

from cosim.errors import InputError, Problem

_SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
_SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
_OSP = "{http://opensimulationplatform.com/SSP/OSPAnnotations}"
_DEFAULT_STEP = 1e-3

VENDOR = "io.github.haptic-cosim"
"""Type of the annotation that names the master's algorithm."""
MASTER = "https://haptic-cosim.github.io/ssp/master"
"""Namespace of that annotation: Algorithm (name, extrapolation) with a Component (name, stepMultiple) each, in the
order of stepping.
"""


def read_ssp(path: Path, folder: Path) -> dict:
    """The scenario table (see cosim.scenario) of an SSP archive; its FMUs are unpacked below `folder`.

    Raises InputError with every problem found.
    """
    unpacked = _unpack(path, folder)
    try:
        root = xml.parse(unpacked / "SystemStructure.ssd").getroot()
    except (OSError, xml.ParseError) as error:
        raise InputError(Problem(str(path), "an SSP archive with a SystemStructure.ssd", str(error))) from None
    system = root.find(f"{_SSD}System")
    if system is None:
        raise InputError(Problem(str(path), "a System", "none in SystemStructure.ssd"))
    problems = list(_unsupported(system, path))
    if problems:
        raise InputError(problems)
    elements = system.iterfind(f"{_SSD}Elements/{_SSD}Component")
    components = {element.get("name", ""): _component(element, unpacked) for element in elements}
    _system_parameters(system, unpacked, components)
    connections = [
        f"{c.get('startElement')}.{c.get('startConnector')} -> {c.get('endElement')}.{c.get('endConnector')}"
        for c in _forward(system)
    ]
    warnings: list[str] = []
    experiment: dict[str, object] = {"stop": _stop(root), "step": _step(root, path, warnings)} | _master(
        root, path, components, warnings
    )
    return {
        "name": path.stem,
        "title": root.get("name") or path.stem,
        "experiment": experiment,
        "components": components,
        "connections": connections,
        "warnings": warnings,
    }


def _unpack(path: Path, folder: Path) -> Path:
    """The archive's contents in a folder named after their hash."""
    try:
        target = folder / hashlib.sha256(path.read_bytes()).hexdigest()[:24]
        if not target.is_dir():
            with zipfile.ZipFile(path) as archive:
                archive.extractall(target)
        return target
    except (OSError, zipfile.BadZipFile) as error:
        raise InputError(Problem(str(path), "an SSP archive", str(error))) from None


def _unsupported(system: xml.Element, path: Path) -> Iterator[Problem]:
    where = f"{path.name}: System {system.get('name', '')}"
    for nested in system.iterfind(f"{_SSD}Elements/{_SSD}System"):
        yield Problem(
            where, "components only", f"the nested system {nested.get('name')}", "flatten it in the tool that made it"
        )
    for component in system.iterfind(f"{_SSD}Elements/{_SSD}Component"):
        if component.get("type", "application/x-fmu-sharedlibrary") != "application/x-fmu-sharedlibrary":
            yield Problem(where, "components that are FMUs", f"{component.get('name')} of type {component.get('type')}")
    for connection in system.iterfind(f"{_SSD}Connections/{_SSD}Connection"):
        if not (connection.get("startElement") and connection.get("endElement")):
            yield Problem(
                where, "connections between components", "one of the system's own connectors", "wire it inside"
            )
        if len(connection):
            yield Problem(where, "plain connections", f"a transformation on {connection.get('endConnector')}")
    for mapping in system.iter(f"{_SSD}ParameterMapping"):
        yield Problem(
            where,
            "parameter values by the FMU's own names",
            "a parameter mapping",
            f"in {mapping.get('source', 'line')}",
        )


def _forward(system: xml.Element) -> Iterator[xml.Element]:
    """Connections from outputs to inputs: SSP lets start and end stand either way round."""
    kinds = {
        (component.get("name"), connector.get("name")): connector.get("kind")
        for component in system.iterfind(f"{_SSD}Elements/{_SSD}Component")
        for connector in component.iterfind(f"{_SSD}Connectors/{_SSD}Connector")
    }
    for connection in system.iterfind(f"{_SSD}Connections/{_SSD}Connection"):
        if kinds.get((connection.get("startElement"), connection.get("startConnector"))) == "input":
            for key in ("Element", "Connector"):
                start, end = connection.get(f"start{key}", ""), connection.get(f"end{key}", "")
                connection.set(f"start{key}", end)
                connection.set(f"end{key}", start)
        yield connection


def _component(component: xml.Element, unpacked: Path) -> dict[str, Any]:
    return {"fmu": str(unpacked / component.get("source", "")), "parameters": dict(_parameters(component, unpacked))}


def _system_parameters(system: xml.Element, unpacked: Path, components: dict[str, dict[str, Any]]) -> None:
    """Values of the system take precedence over those of its components: `arm_l.q_start[1]`."""
    for name, value in _parameters(system, unpacked):
        component, _, variable = name.partition(".")
        if component in components and variable:
            components[component]["parameters"][variable] = value


def _parameters(element: xml.Element, unpacked: Path) -> Iterator[tuple[str, object]]:
    for binding in element.iterfind(f"{_SSD}ParameterBindings/{_SSD}ParameterBinding"):
        source = binding.get("source")
        scope = xml.parse(unpacked / source).getroot() if source else binding
        for parameter in scope.iter(f"{_SSV}Parameter"):
            for value in parameter:
                yield parameter.get("name", ""), _value(value)


def _value(element: xml.Element) -> object:
    kind, text = element.tag.rpartition("}")[2], element.get("value", "")
    if kind == "Boolean":
        return text in ("true", "1")
    return {"Real": float, "Integer": int}.get(kind, str)(text)


def _stop(root: xml.Element) -> float:
    default = root.find(f"{_SSD}DefaultExperiment")
    return float(default.get("stopTime", 10.0)) if default is not None else 10.0


def _step(root: xml.Element, path: Path, warnings: list[str]) -> float:
    algorithm = next(root.iter(f"{_OSP}FixedStepAlgorithm"), None)
    if algorithm is None:
        warnings.append(
            f"{path.name} names no communication step: {_DEFAULT_STEP} s is taken; --set experiment.step changes it"
        )
        return _DEFAULT_STEP
    return float(algorithm.get("baseStepSize", _DEFAULT_STEP))


def _master(
    root: xml.Element, path: Path, components: dict[str, dict[str, Any]], warnings: list[str]
) -> dict[str, object]:
    """Algorithm, extrapolation and order of the experiment; step multiples go to the components."""
    found = root.find(f".//{{{MASTER}}}Algorithm")
    if found is None:
        warnings.append(
            f"{path.name} names no master algorithm: jacobi with held inputs, as other SSP tools step it; "
            "--set experiment.algorithm and experiment.extrapolation change it"
        )
        return {"algorithm": "jacobi", "extrapolation": "hold"}
    order = [component.get("name", "") for component in found]
    for name, component in zip(order, found):
        if name in components:
            components[name]["step_multiple"] = int(component.get("stepMultiple", 1))
    return {"algorithm": found.get("name"), "extrapolation": found.get("extrapolation"), "order": order}
