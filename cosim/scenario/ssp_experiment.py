"""How an SSP is stepped: times of its default experiment, and what tools add in annotations.

Read are the step size of the Open Simulation Platform and of OMSimulator, and our own algorithm. Other annotations
change no standard meaning of a file; that they are there is told.
"""

from typing import Any

from cosim.scenario.ssp_document import Element, Findings, first, place, real, whole
from cosim.scenario.ssp_grammar import NAMESPACES

VENDOR = "io.github.haptic-cosim"
"""Type of the annotation that names the master's algorithm."""
MASTER = "https://haptic-cosim.github.io/ssp/master"
"""Namespace of that annotation: Algorithm (name, extrapolation) with a Component (name, stepMultiple) each, in the
order of stepping.
"""
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
OSP_TYPE, OMS_TYPE = "com.opensimulationplatform", "org.openmodelica"
_STOP, _STEP = 10.0, 1e-3  # s, where a file names none
_READ = {VENDOR: {"Algorithm", "Component"}, OSP_TYPE: {"Algorithm", "FixedStepAlgorithm"}}
_READ[OMS_TYPE] = {"Annotations", "SimulationInformation", "FixedStepMaster"}


def experiment_of(
    root: Element, name: str, components: dict[str, dict[str, Any]], findings: Findings
) -> dict[str, Any]:
    """The [experiment] of a scenario; step multiples go to the components."""
    table = {"stop": _stop(root, name, findings), "step": _step(root, name, findings)}
    table |= _master(root, name, components, findings)
    if root.find(f".//{{{MASTER}}}Algorithm") is None:
        _tell_unread(root, findings)
    return table


def _stop(root: Element, name: str, findings: Findings) -> float:
    default = first(root, "ssd:DefaultExperiment")
    if default is not None and real(default, "startTime", findings, 0.0) != 0.0:
        found = f"{default.get('startTime')} s"
        findings.refuse(default, "a startTime of 0 s, where every run starts", found, "shift the times of the system")
    if default is None or default.get("stopTime") is None:
        findings.warnings.append(f"{name} names no stop time: {_STOP:g} s is taken; --set experiment.stop changes it")
        return _STOP
    return real(default, "stopTime", findings)


def _step(root: Element, name: str, findings: Findings) -> float:
    """The communication step [s] that an annotation gives. Raises nothing: two that differ are a problem."""
    found = [
        (element, key)
        for tag, key in ((f"{{{OSP}}}FixedStepAlgorithm", "baseStepSize"), (f"{{{OMS}}}FixedStepMaster", "stepSize"))
        for element in root.iter(tag)
    ]
    steps = {real(element, key, findings): element for element, key in found}
    if len(steps) > 1:
        element = list(steps.values())[-1]
        findings.refuse(element, "one communication step", " and ".join(f"{s:g} s" for s in steps))
    if not steps:
        findings.warnings.append(
            f"{name} names no communication step: {_STEP} s is taken; --set experiment.step changes it"
        )
    return next(iter(steps), _STEP)


def _master(root: Element, name: str, components: dict[str, dict[str, Any]], findings: Findings) -> dict[str, Any]:
    """Algorithm, extrapolation and order of the experiment; step multiples go to the components."""
    found = root.find(f".//{{{MASTER}}}Algorithm")
    if found is None:
        findings.warnings.append(
            f"{name} names no master algorithm: jacobi with held inputs, as other SSP tools step it; "
            "--set experiment.algorithm and experiment.extrapolation change it"
        )
        return {"algorithm": "jacobi", "extrapolation": "hold"}
    order = [component.get("name", "") for component in found]
    for key, component in zip(order, found):
        if key in components:
            components[key]["step_multiple"] = whole(component, "stepMultiple", findings, 1)
    return {
        "algorithm": found.get("name", ""),
        "extrapolation": found.get("extrapolation", ""),
        "order": order,
    }


def _tell_unread(root: Element, findings: Findings) -> None:
    """A warning for each kind of content of annotations that is not read."""
    told: dict[tuple[str, str], Element] = {}
    for annotation in root.iter(f"{{{NAMESPACES['ssc']}}}Annotation"):
        kind = annotation.get("type", "")
        for element in annotation.iterdescendants():
            word = str(element.tag).rpartition("}")[2]
            if word not in _READ.get(kind, ()):
                told.setdefault((kind, word), element)
    for (kind, word), element in told.items():
        findings.warnings.append(f"{place(element)}: <{word}> of {kind or 'an annotation'} is not read")
