"""What an FMU file says of itself."""

import itertools
import math
from collections.abc import Mapping
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

from attrs import evolve, frozen

from cosim import signals
from cosim.errors import InputError, Problem
from cosim.fmu.faults import faults
from cosim.fmu.places import Progress, digest, fmu_file, recording_warnings, stamp
from cosim.opening import named_file
from cosim.scenario import Scenario
from cosim.signals import BASE_UNITS, WHOLE, FmuDescription, Unit, Variable


def describe(path: Path, parameters: Mapping[str, object] | None = None) -> FmuDescription:
    """What an FMU file says of itself, its arrays spread to scalars `v[1,2]`.

    parameters: values that the scenario gives; those of structural parameters settle the sizes of arrays.
    Raises InputError where it is no co-simulation FMU of FMI 2.0 or 3.0.
    """
    plain = _describe(str(path), *stamp(named_file(path, "an FMU")), ())
    given = _structural(plain, parameters or {})
    return _describe(str(path), *stamp(path), given) if given else plain


def _structural(description: FmuDescription, parameters: Mapping[str, object]) -> tuple[tuple[str, int], ...]:
    """Whole numbers given for structural parameters; what does not fit is told when start values are checked."""
    known = description.variables
    return tuple(
        (name, int(value))
        for name, value in parameters.items()
        if isinstance(value, (int, float)) and value >= 0 and value == value // 1 and name in known
        if known[name].causality == "structuralParameter" and value != known[name].start
    )


_LARGEST = 200_000
"""Elements of arrays that are spread to scalars, each with its name."""
_REMEMBERED = 5000
"""Variables of a description that is kept from one process to the next: a megabyte."""


def descriptions(scenario: Scenario, progress: Progress | None = None) -> dict[str, FmuDescription]:
    """The description of every component, FMUs built where they are missing. Raises InputError with every problem
    found.
    """
    found, problems = {}, []
    for name, component in scenario.components.items():
        try:
            description = describe(fmu_file(component, scenario, progress), component.parameters)
            warnings = (*description.warnings, *recording_warnings(component, scenario))
            found[name] = evolve(description, warnings=warnings) if warnings else description
        except InputError as error:
            told = {p.got for p in problems}  # a model that two components share
            problems += [
                evolve(p, where=f"{scenario.name}: components.{name}: {p.where}")
                for p in error.problems
                if p.got not in told or not component.own
            ]
    if problems:
        raise InputError(problems)
    return found


@lru_cache(maxsize=256)
def _describe(path: str, modified: int, size: int, given: tuple[tuple[str, int], ...]) -> FmuDescription:
    """As read before by any process, where neither the file's content nor what reads it has changed since."""
    from build_fmus.cache import key_of, remembered

    content = digest(path, modified, size)
    key = key_of(content, repr(given), *_readers())
    found = remembered("descriptions", key, lambda: _read(path, content, given), _worth_keeping)
    return found if found.path == path else evolve(found, path=path)


def _worth_keeping(found: FmuDescription) -> bool:
    return len(found.variables) <= _REMEMBERED


@cache
def _readers() -> tuple[bytes, ...]:
    """The code that decides what is read from a description: ours and fmpy's."""
    package = find_spec("fmpy")
    theirs = Path(package.origin).with_name("model_description.py") if package and package.origin else Path()
    ours = [Path(__file__).with_name(name) for name in ("description.py", "faults.py")]
    return tuple(path.read_bytes() for path in (*ours, Path(signals.__file__), theirs) if path.is_file())


def _read(path: str, content: str, given: tuple[tuple[str, int], ...]) -> FmuDescription:
    """What the file says, read now. content: its SHA-256."""
    model = model_of(path)
    problem = no_cosimulation(path, model)
    if problem is not None:
        raise InputError(problem)
    interface, experiment = model.coSimulation, model.defaultExperiment
    sizes = structural_sizes(model, dict(given))
    units = {u.name: _unit(u) for u in model.unitDefinitions}
    root = _root(path)
    return FmuDescription(
        model.modelName,
        _variables(model, units, sizes),
        model.numberOfContinuousStates > 0 or _has_states(model),
        _takes_slopes(model),
        model.fmiVersion,
        path,
        content,
        interface.modelIdentifier,
        model.guid,
        model.description or "",
        interface.canBeInstantiatedOnlyOncePerProcess,
        interface.canGetAndSetFMUstate,
        _optional(experiment and experiment.stepSize),
        _optional(experiment and experiment.tolerance),
        platforms_of(path),
        interface.needsExecutionTool,
        model.generationTool or "",
        given,
        _begins_late(experiment),
        differentiates=_differentiates(root),
        carried={pair.get("output", ""): pair.get("input", "") for pair in root.iter("Carries")},
    )


def model_of(path: str) -> Any:
    """fmpy's description of a model; every field of it may be None to a checker. Raises InputError."""
    import fmpy

    try:
        model = fmpy.read_model_description(path, validate=False)
    except KeyError as error:
        raise InputError(Problem(path, "an FMU", f"one that refers to {error}, which it does not define")) from None
    except Exception as error:  # noqa: BLE001 - fmpy raises bare exceptions for whatever it meets in a file
        raise InputError(Problem(path, "an FMU", str(error) or type(error).__name__)) from None
    if problems := faults(path, model):
        raise InputError(problems)
    return model


def no_cosimulation(path: str, model: Any) -> Problem | None:
    """The problem of an FMU that cannot be stepped here; None where it can."""
    expected = "a co-simulation FMU of FMI 2.0 or 3.0"
    kinds = [
        ("coSimulation", "co-simulation"),
        ("modelExchange", "model exchange"),
        ("scheduledExecution", "scheduled execution"),
    ]
    has = " and ".join(words for key, words in kinds if getattr(model, key, None) is not None) or "no interface"
    if not model.fmiVersion.startswith(("2", "3")):
        advice = "export it again as FMI 2.0 or 3.0; its functions are others than those of the later versions"
        return Problem(path, expected, f"FMI {model.fmiVersion} ({has})", advice)
    if model.coSimulation is None:
        return Problem(path, expected, f"FMI {model.fmiVersion} with {has} only", "export it again for co-simulation")
    return None


def platforms_of(path: str) -> tuple[str, ...]:
    """The platforms that an FMU has a binary for, in its own words: `linux64`, `x86_64-windows`."""
    from zipfile import BadZipFile

    try:
        with ZipFile(path) as archive:
            names = archive.namelist()
    except (OSError, BadZipFile):
        return ()
    found = (name.split("/") for name in names if name.startswith("binaries/") and not name.endswith("/"))
    return tuple(dict.fromkeys(parts[1] for parts in found if len(parts) > 2))


def _optional(text: str | None) -> float | None:
    return float(text) if text else None


def _begins_late(experiment: Any) -> tuple[str, ...]:
    """A warning where an FMU's default experiment does not start where every run does."""
    start = _optional(experiment and experiment.startTime) or 0.0
    return (f"its default experiment starts at {start:g} s; a run starts at 0 s",) if start else ()


def _root(path: str) -> ElementTree.Element:
    """The description itself, for what fmpy leaves out: annotations, derivatives in FMI 3.0. Raises InputError where
    its encoding is not the one that it names, which fmpy's parser forgives.
    """
    with ZipFile(path) as archive, archive.open("modelDescription.xml") as text:
        try:
            return ElementTree.parse(text).getroot()
        except ElementTree.ParseError as error:
            raise InputError(Problem(f"{path}: modelDescription.xml", "XML in UTF-8", str(error))) from None


def _differentiates(root: ElementTree.Element) -> bool:
    """Whether it gives directional derivatives in co-simulation."""
    interface = root.find("CoSimulation")
    names = ("providesDirectionalDerivative", "providesDirectionalDerivatives")
    return interface is not None and any(interface.get(name) in ("true", "1") for name in names)


def _has_states(model: Any) -> bool:
    return any(variable.derivative is not None for variable in model.modelVariables)


def _takes_slopes(model: Any) -> bool:
    """FMI 2.0 says so by a flag; in FMI 3.0 our FMUs have an input der(u) for each real input u."""
    if model.fmiVersion.startswith("2"):
        return bool(model.coSimulation.canInterpolateInputs)
    return _ours(model) and any(v.causality == "input" and v.name.startswith("der(") for v in model.modelVariables)


def _ours(model: Any) -> bool:
    from build_fmus.homes import GENERATOR

    return model.generationTool == GENERATOR


def _unit(unit: Any) -> Unit:
    base = unit.baseUnit
    if base is None:
        return Unit(unit.name)
    exponents = tuple(getattr(base, name) for name in BASE_UNITS)
    return Unit(unit.name, exponents, base.factor, base.offset)


# --- variables --------------------------------------------------------------------------------------------------------


def structural_sizes(model: Any, given: Mapping[str, int]) -> dict[int, int]:
    """Values of the structural parameters by value reference: the given ones, else the start values."""
    found = (v for v in model.modelVariables if v.causality == "structuralParameter" and v.type in WHOLE)
    return {v.valueReference: given.get(v.name, int(v.start or 0)) for v in found}


def _variables(model: Any, units: Mapping[str, Unit], sizes: Mapping[int, int]) -> dict[str, Variable]:
    through = {u.variable.name: u.dependencies for u in model.outputs}
    slopes = {}
    if _takes_slopes(model):
        inputs = (v for v in model.modelVariables if v.causality == "input" and v.name.startswith("der("))
        slopes = {v.name[4:-1]: v.valueReference for v in inputs}
    shapes = {v.name: shape_of(v, sizes) for v in model.modelVariables}
    if (count := sum(math.prod(shape) for shape in shapes.values())) > _LARGEST:
        raise InputError(Problem(model.modelName, f"at most {_LARGEST} elements of arrays", str(count)))
    found = {}
    for v in model.modelVariables:
        acting = _acting(through.get(v.name), shapes)
        for scalar in _scalars(v, shapes[v.name]):
            found[scalar.name] = _variable(v, scalar, units, acting, slopes.get(v.name))
    return found


def shape_of(v: Any, sizes: Mapping[int, int]) -> tuple[int, ...]:
    """How many values an array has along each dimension; empty for a scalar."""
    return tuple(int(d.start) if d.start is not None else sizes[d.valueReference] for d in v.dimensions or ())


def _acting(through: list[Any] | None, shapes: Mapping[str, tuple[int, ...]]) -> tuple[str, ...] | None:
    """The inputs that act on an output, element by element; None where the FMU does not say."""
    if through is None:
        return None
    inputs = (d for d in through if d.causality == "input")
    return tuple(name for d in inputs for name in _element_names(d.name, shapes[d.name]))


def _element_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """`A`, (2, 3) -> `A[1,1]`, `A[1,2]`, ..., row by row; the name itself for a scalar."""
    if not shape:
        return [name]
    places = itertools.product(*(range(1, count + 1) for count in shape))
    return [f"{name}[{','.join(map(str, place))}]" for place in places]


@frozen
class _Element:
    """An element of a variable: its name, its place among how many, its start value."""

    name: str
    element: int
    size: int
    start: float | str | None


def _scalars(v: Any, shape: tuple[int, ...]) -> list[_Element]:
    names = _element_names(v.name, shape)
    starts = _starts(v, len(names), bool(shape))
    return [_Element(name, i, len(names) if shape else 1, start) for i, (name, start) in enumerate(zip(names, starts))]


def _starts(v: Any, count: int, array: bool) -> list[float | str | None]:
    """Start values of the elements; one value in the file stands for all."""
    if v.start is None or v.type in ("String", "Binary"):
        return [v.start] * count
    texts = str(v.start).split() if array else [str(v.start)]
    texts = texts * count if len(texts) == 1 else texts
    return [_number(v, text) for text in texts] if len(texts) == count else [None] * count  # other sizes: not known


def _number(v: Any, text: str) -> float:
    if v.type == "Boolean":
        return float(text.strip().lower() in ("true", "1"))
    if v.type in WHOLE:
        return int(text)
    return float(text)


def _variable(
    v: Any, scalar: _Element, units: Mapping[str, Unit], through: tuple[str, ...] | None, slope: int | None
) -> Variable:
    declared = v.declaredType
    name = v.unit or (declared.unit if declared else None) or ""
    low, high = (getattr(v, key) or (getattr(declared, key) if declared else None) for key in ("min", "max"))
    nominal = v.nominal or (declared.nominal if declared else None)
    items = declared.items if declared is not None and v.type == "Enumeration" else ()
    return Variable(
        scalar.name,
        v.causality,
        v.type,
        units.get(name, Unit(name)),
        scalar.start,
        _optional(low),
        _optional(high),
        v.valueReference,
        through if v.causality == "output" else (),
        tuple(item.name for item in items),
        v.description or "",
        slope,
        v.derivative.name if v.derivative is not None else None,
        v.variability == "tunable",
        tuple(int(item.value) for item in items),
        scalar.element,
        scalar.size,
        v.variability == "constant",
        _optional(nominal),
    )
