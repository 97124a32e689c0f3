"""The wired scenario as one container FMU, for tools that read no SSP: fmpy's container with our FMUs inside.

fmpy writes the container (its binaries exist for x86_64 Linux, Windows and macOS and for aarch64 macOS). This module
adds what fmpy leaves out: a tolerance in the default experiment, start values compiled into the components, the time as
the first variable (the binary expects it there), and the FMI 3.0 type name of connections, which the binary expects for
FMI 2.0 too. The archive is packed again so that its bytes are reproducible.

The container passes values along its connections one after another and then steps every component. An output with
direct feedthrough reacts to an input that was set just before. The connections are therefore ordered so that such
outputs are read first, and the container does what the Jacobi algorithm with held inputs does.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from attrs import evolve

from cosim.exports.structure import component_fmus
from cosim.wiring import Link, Wiring

_FILES_OF_FMPY = ("Container.zip",)


def write_container(wiring: Wiring, path: Path, fmi: int = 2, enumerations: bool = True) -> Path:
    """Write the scenario as one co-simulation FMU; its variables are the components' outputs, `arm_l.q[1]`.

    enumerations: whether the FMUs inside keep theirs. Raises RunError where an FMU cannot be built.
    """
    from fmpy.container_fmu.cli import create_container_fmu

    from build_fmus.archive import zip_bytes
    from build_fmus.scratch import workspace

    fmus = component_fmus(wiring, fmi=fmi, enumerations=enumerations)
    with workspace() as folder:
        named = _named(fmus, folder / "fmus")
        unpacked = folder / "container"
        unpacked.mkdir()
        create_container_fmu(_configuration(wiring, named, fmi), unpacked, folder / "container.fmu")
        files = {
            p.relative_to(unpacked).as_posix(): p.read_bytes()
            for p in unpacked.rglob("*")
            if p.is_file() and p.name not in _FILES_OF_FMPY
        }
    files["modelDescription.xml"] = _with_tolerance(files["modelDescription.xml"])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(zip_bytes(files))
    return path


def _with_tolerance(description: bytes) -> bytes:
    """The model description with the tolerance of the default experiment, which fmpy's writer leaves out."""
    return description.replace(b"<DefaultExperiment", b'<DefaultExperiment tolerance="1e-06"', 1)


def _named(fmus: Mapping[str, Path], folder: Path) -> dict[str, Path]:
    """Copies named after their components: the container tells them apart by file name."""
    folder.mkdir(parents=True)
    for name, fmu in fmus.items():
        (folder / f"{name}.fmu").write_bytes(fmu.read_bytes())
    return {name: folder / f"{name}.fmu" for name in fmus}


def _configuration(wiring: Wiring, fmus: Mapping[str, Path], fmi: int):
    """fmpy's description of the container: components, connections, outer variables."""
    import fmpy
    from fmpy.container_fmu.config import Component, Configuration, Connection

    components = {name: Component(name, fmu, fmpy.read_model_description(fmu)) for name, fmu in fmus.items()}
    variables = {name: {v.name: v for v in c.modelDescription.modelVariables} for name, c in components.items()}

    def port(signal):
        found = variables[signal.component][signal.variable]
        return evolve(found, type="Float64") if found.type == "Real" else found

    connections = [
        Connection(
            components[link.source.component],
            [port(link.source)],
            components[link.target.component],
            [port(link.target)],
        )
        for link in _read_first(wiring)
    ]
    outer = {}
    for name in wiring.signals:
        component, _, variable = name.partition(".")
        outer[name] = (
            _outer(name, variables[component][variable], fmi),
            [(components[component], variables[component][variable])],
        )
    description = _description(wiring, [_time(fmi), *(v for v, _ in outer.values())], components.values(), fmi)
    return Configuration(False, description, list(components.values()), connections, dict(outer.values()))


def _read_first(wiring: Wiring) -> list[Link]:
    """The links, those behind the longest chain of direct feedthrough first.

    So each output is read before the inputs that act on it at once are set.
    """
    into: dict[str, list[Link]] = {}
    for link in wiring.links:
        into.setdefault(link.target.component, []).append(link)

    @cache
    def depth(component: str, output: str) -> int:
        through = wiring.descriptions[component].variables[output].feedthrough
        ahead = [link.source for link in into.get(component, []) if through is None or link.target.variable in through]
        return 1 + max((depth(s.component, s.variable) for s in ahead), default=0) if ahead else 0

    return sorted(wiring.links, key=lambda link: -depth(link.source.component, link.source.variable))


def _outer(name: str, inner, fmi: int):
    """The container's variable for a component's output."""
    from fmpy.model_description import ModelVariable

    return ModelVariable(
        name=name,
        type="Real" if fmi == 2 else "Float64",
        causality="output",
        variability="continuous",
        unit=inner.unit,
        canHandleMultipleSetPerTimeInstant=False,
        description=inner.description,
    )


def _time(fmi: int):
    from fmpy.model_description import ModelVariable

    return ModelVariable(
        name="time",
        type="Real" if fmi == 2 else "Float64",
        causality="independent",
        variability="continuous",
        unit="s",
        description="simulated time",
        canHandleMultipleSetPerTimeInstant=False,
    )


def _description(wiring: Wiring, variables, components, fmi: int):
    from fmpy.model_description import CoSimulation, DefaultExperiment, ModelDescription, Unknown

    from build_fmus.cache import key_of

    scenario = wiring.scenario
    token = key_of(scenario.name, repr(wiring.starts), *(c.modelDescription.guid for c in components))
    description = ModelDescription(
        fmiVersion="2.0" if fmi == 2 else "3.0",
        modelName=scenario.name.replace("-", "_"),
        instantiationToken="{" + token[:36] + "}",
        description=scenario.title or scenario.name,
        generationTool="haptic-cosim with fmpy",
        modelVariables=list(variables),
        unitDefinitions=_units(variables, components),
        coSimulation=CoSimulation(
            modelIdentifier="container_fmu",
            canHandleVariableCommunicationStepSize=False,
            fixedInternalStepSize=scenario.experiment.step,
        ),
        defaultExperiment=DefaultExperiment(
            startTime="0.0",
            stopTime=repr(scenario.experiment.stop),
            stepSize=repr(scenario.experiment.step),
        ),
    )
    description.outputs = [Unknown(variable=v) for v in variables if v.causality == "output"]
    description.initialUnknowns = [Unknown(variable=v) for v in variables if v.causality == "output"]
    return description


def _units(variables, components) -> list:
    used = {v.unit for v in variables if v.unit}
    found = {unit.name: unit for component in components for unit in component.modelDescription.unitDefinitions}
    return [found[name] for name in sorted(used) if name in found]
