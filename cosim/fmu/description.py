"""What an FMU file says of itself."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

from attrs import evolve

from cosim.errors import InputError, Problem
from cosim.fmu.places import Progress, digest, fmu_file, stamp
from cosim.scenario import Scenario
from cosim.signals import FmuDescription, Unit, Variable


def describe(path: Path) -> FmuDescription:
    """What an FMU file says of itself. Raises InputError where it is no co-simulation FMU of FMI 2.0 or 3.0."""
    return _describe(str(path), *stamp(path))


def descriptions(scenario: Scenario, progress: Progress | None = None) -> dict[str, FmuDescription]:
    """The description of every component, FMUs built where they are missing. Raises InputError with every problem
    found.
    """
    found, problems = {}, []
    for name, component in scenario.components.items():
        try:
            found[name] = describe(fmu_file(component, scenario, progress))
        except InputError as error:
            problems += [evolve(p, where=f"{scenario.name}: components.{name}: {p.where}") for p in error.problems]
    if problems:
        raise InputError(problems)
    return found


@lru_cache(maxsize=256)
def _describe(path: str, modified: int, size: int) -> FmuDescription:
    import fmpy

    try:
        model: Any = fmpy.read_model_description(path, validate=False)  # every field of fmpy's may be None to a checker
    except Exception as error:  # noqa: BLE001 - fmpy raises bare exceptions for whatever it meets in a file
        raise InputError(Problem(path, "an FMU", str(error) or type(error).__name__)) from None
    if model.coSimulation is None or not model.fmiVersion.startswith(("2", "3")):
        raise InputError(
            Problem(path, "a co-simulation FMU of FMI 2.0 or 3.0", f"FMI {model.fmiVersion}, no co-simulation")
        )
    interface = model.coSimulation
    units = {u.name: _unit(u) for u in model.unitDefinitions}
    return FmuDescription(
        model.modelName,
        _variables(model, units),
        model.numberOfContinuousStates > 0 or _has_states(model),
        _takes_slopes(model),
        model.fmiVersion,
        path,
        digest(path, modified, size),
        interface.modelIdentifier,
        model.guid,
        model.description or "",
        interface.canBeInstantiatedOnlyOncePerProcess,
        interface.canGetAndSetFMUstate,
        float(model.defaultExperiment.stepSize)
        if model.defaultExperiment and model.defaultExperiment.stepSize
        else None,
        _differentiates(path),
    )


def _differentiates(path: str) -> bool:
    """Whether it gives directional derivatives in co-simulation; read here, since fmpy leaves it out for FMI 3.0."""
    with ZipFile(path) as archive, archive.open("modelDescription.xml") as text:
        interface = ElementTree.parse(text).getroot().find("CoSimulation")
    names = ("providesDirectionalDerivative", "providesDirectionalDerivatives")
    return interface is not None and any(interface.get(name) in ("true", "1") for name in names)


def _has_states(model: Any) -> bool:
    return any(variable.derivative is not None for variable in model.modelVariables)


def _takes_slopes(model: Any) -> bool:
    """FMI 2.0 says so by a flag; in FMI 3.0 our FMUs have an input der(u) for each real input u."""
    if model.fmiVersion.startswith("2"):
        return bool(model.coSimulation.canInterpolateInputs)
    return any(v.causality == "input" and v.name.startswith("der(") for v in model.modelVariables)


def _unit(unit: Any) -> Unit:
    base = unit.baseUnit
    if base is None:
        return Unit(unit.name)
    return Unit(
        unit.name, tuple(getattr(base, name) for name in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")), base.factor
    )


def _variables(model: Any, units: Mapping[str, Unit]) -> dict[str, Variable]:
    through = {u.variable.name: u.dependencies for u in model.outputs}
    slopes = {
        v.name[4:-1]: v.valueReference
        for v in model.modelVariables
        if v.causality == "input" and v.name.startswith("der(")
    }
    return {v.name: _variable(v, units, through.get(v.name), slopes) for v in model.modelVariables}


def _variable(v: Any, units: Mapping[str, Unit], through: list[Any] | None, slopes: Mapping[str, int]) -> Variable:
    declared = v.declaredType
    name = v.unit or (declared.unit if declared else None) or ""
    low, high = (getattr(v, key) or (getattr(declared, key) if declared else None) for key in ("min", "max"))
    items = tuple(item.name for item in declared.items) if declared is not None and v.type == "Enumeration" else ()
    return Variable(
        v.name,
        v.causality,
        v.type,
        units.get(name, Unit(name)),
        _start(v),
        _bound(low),
        _bound(high),
        v.valueReference,
        None if through is None else tuple(d.name for d in through if d.causality == "input"),
        items,
        v.description or "",
        slopes.get(v.name),
        v.derivative.name if v.derivative is not None else None,
        v.variability == "tunable",
    )


def _start(v: Any) -> float | str | None:
    if v.start is None or v.type in ("String", "Binary"):
        return v.start
    if v.type == "Boolean":
        return float(v.start in ("true", "1", True))
    return float(str(v.start).split()[0])


def _bound(text: str | None) -> float | None:
    return None if text is None else float(text)
