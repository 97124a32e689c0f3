"""An SSP as the table of a scenario, so that `cosim run SYSTEM.ssp` simulates what another tool wired.

What is read: systems in systems with their connectors, FMUs (files or folders), signal dictionaries, parameter values
at every level, inline or in .ssv files, with prefix, units and mapping (.ssm), the stop time, and what annotations say
of the step and the algorithm. The list is in ssp_grammar; all else is refused with file and line.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cosim.errors import did_you_mean
from cosim.scenario.ssp_document import Findings, children, first, parse
from cosim.scenario.ssp_experiment import experiment_of
from cosim.scenario.ssp_files import SspFiles, open_ssp
from cosim.scenario.ssp_tree import ElementPath, SspTree, read_tree
from cosim.scenario.ssp_units import Units, units_in
from cosim.scenario.ssp_values import SspParameter, Value, bound, start_value
from cosim.scenario.ssp_wires import wires


def read_ssp(path: Path, cache: Path, allow_outside: bool = False) -> dict[str, Any]:
    """The scenario table (see cosim.scenario) of an SSP: an archive, a folder, or the .ssd file in one.

    cache: where archives are unpacked; allow_outside: whether sources may lie outside the archive or folder.
    Raises InputError with every problem found.
    """
    files, findings = open_ssp(path, cache, allow_outside), Findings()
    root = parse(files.structure.read_bytes(), files.label(files.structure), "ssd:SystemStructureDescription", findings)
    findings.settle()
    assert root is not None
    system = first(root, "ssd:System")
    if system is None:
        findings.refuse(root, "a System", "none")
        findings.settle()
    assert system is not None
    units = units_in(children(root, "ssd:Units/ssc:Unit"), findings)
    tree = read_tree(system, files, units, findings)
    components = _components(tree, files, units, findings)
    connections = list(wires(tree, units, findings))
    experiment = experiment_of(root, files.name, components, findings)
    findings.settle()
    return {
        "name": path.stem,
        "title": root.get("name") or path.stem,
        "experiment": experiment,
        "components": components,
        "connections": connections,
        "warnings": findings.warnings,
    }


def _components(tree: SspTree, files: SspFiles, units: Units, findings: Findings) -> dict[str, dict[str, Any]]:
    """The components with their start values: those of systems count more than those inside, later ones more."""
    tables: dict[str, dict[str, Any]] = {
        c.name: {"fmu": str(c.fmu), "parameters": {}} for c in tree.components.values()
    }
    for path in sorted((*tree.components, *tree.systems), key=len, reverse=True):
        element = tree.components[path].element if path in tree.components else tree.systems[path]
        for parameter in bound(element, files, units, findings):
            for holder, variable, value in _values(parameter, path, tree, findings):
                tables[tree.components[holder].name]["parameters"][variable] = value
    return tables


def _values(
    parameter: SspParameter, path: ElementPath, tree: SspTree, findings: Findings
) -> Iterator[tuple[ElementPath, str, Value]]:
    """The start values that a parameter of an element gives. SSP ignores one that no variable has the name of; it is
    told.
    """
    holders = tree.holders(path, parameter.name)
    if not holders:
        whose = ".".join(path) or "the top system"
        known = tree.known(path)
        wrong = "is a connector that leads to no variable" if parameter.name in known else "is no variable there"
        advice = "" if parameter.name in known else did_you_mean(parameter.name, known)
        text = f"{parameter.name!r} of {whose} {wrong} and has no effect"
        findings.tell(parameter.element, f"{text}; {advice}" if advice else text)
    for holder, name in holders:
        face = tree.components[holder].face
        variable = None if face is None else face.variables.get(name)
        if face is None or variable is None:
            continue
        value = start_value(parameter, variable, face, findings)
        if value is not None:
            yield holder, name, value
