"""What is in an FMU file and what a scenario needs to use it, of whatever version and for whatever platform."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from attrs import asdict, frozen

from cosim.fmu.description import model_of, no_cosimulation, platforms_of, shape_of, structural_sizes
from cosim.fmu.library import here
from cosim.opening import named_file
from cosim.scenario.writing import toml_key, toml_value
from cosim.signals import WHOLE

_CAPABILITIES = {
    "canHandleVariableCommunicationStepSize": "variable communication step",
    "canInterpolateInputs": "input derivatives",
    "canGetAndSetFMUstate": "saves its state",
    "canSerializeFMUstate": "writes its state to a file",
    "providesDirectionalDerivative": "directional derivatives",
    "providesDirectionalDerivatives": "directional derivatives",
    "hasEventMode": "event mode",
    "providesIntermediateUpdate": "intermediate update",
    "mightReturnEarlyFromDoStep": "may return early from a step",
    "canBeInstantiatedOnlyOncePerProcess": "one instance in a process only",
    "needsExecutionTool": "needs its tool installed",
}
_KINDS = {
    "coSimulation": "co-simulation",
    "modelExchange": "model exchange",
    "scheduledExecution": "scheduled execution",
}


@frozen
class ListedVariable:
    """A variable as the file has it; an array is one variable of several values."""

    name: str
    kind: str
    variability: str
    type: str
    unit: str
    start: str | None
    size: tuple[int, ...]
    minimum: str | None
    maximum: str | None
    items: Mapping[str, int]
    description: str

    @property
    def shown_size(self) -> str:
        """`3 x 3`; empty for a scalar."""
        return " x ".join(map(str, self.size))


@frozen
class FmuContents:
    """What an FMU file holds. `needs`: what a scenario must see to, in sentences; `scenario`: a TOML file to begin
    with, empty where the FMU cannot be used.
    """

    file: str
    model: str
    fmi: str
    interfaces: tuple[str, ...]
    tool: str
    description: str
    experiment: Mapping[str, float]
    platforms: tuple[str, ...]
    capabilities: tuple[str, ...]
    variables: tuple[ListedVariable, ...]
    needs: tuple[str, ...]
    scenario: str

    def to_dict(self) -> dict[str, object]:
        """The content of `cosim fmu --json`."""
        return asdict(self)

    def __str__(self) -> str:
        facts = [
            ("FMI", f"{self.fmi}, {' and '.join(self.interfaces) or 'no interface'}"),
            ("made by", self.tool),
            ("platforms", ", ".join(self.platforms) or "none (no binaries)"),
            ("can", ", ".join(self.capabilities)),
            ("experiment", ", ".join(f"{key} {value:g}" for key, value in self.experiment.items())),
        ]
        lines = [f"{self.model}: {self.description}" if self.description else self.model]
        lines += [f"  {name:<11} {text}" for name, text in facts if text]
        lines += ["", *_table(self.variables), "", "needs", *(f"  {need}" for need in self.needs)]
        return "\n".join([*lines, "", "a scenario to begin with", "", self.scenario] if self.scenario else lines)


def contents(file: str | Path) -> FmuContents:
    """What is in an FMU file. Raises InputError where it is none, or not there."""
    path = named_file(file, "an FMU")
    model = model_of(str(path))
    sizes = structural_sizes(model, {})
    problem, variables = no_cosimulation(str(path), model), tuple(_listed(v, sizes) for v in model.modelVariables)
    interface = model.coSimulation or model.modelExchange
    found = dict.fromkeys(words for key, words in _CAPABILITIES.items() if getattr(interface, key, False) is True)
    platforms = platforms_of(str(path))
    needs = [str(problem)] if problem else _needs(variables, platforms, model)
    return FmuContents(
        str(path),
        model.modelName or "",
        model.fmiVersion,
        tuple(words for key, words in _KINDS.items() if getattr(model, key, None) is not None),
        model.generationTool or "",
        model.description or "",
        _experiment(model.defaultExperiment),
        platforms,
        tuple(found),
        variables,
        tuple(needs),
        "" if problem else _scenario(path, model, variables),
    )


def _experiment(given: Any) -> dict[str, float]:
    keys = {"startTime": "start", "stopTime": "stop", "stepSize": "step", "tolerance": "tolerance"}
    return {words: float(getattr(given, key)) for key, words in keys.items() if given and getattr(given, key)}


def _listed(v: Any, sizes: Mapping[int, int]) -> ListedVariable:
    declared = v.declaredType
    items = declared.items if declared is not None and v.type == "Enumeration" else ()
    low, high, unit = (getattr(v, k) or (getattr(declared, k) if declared else None) for k in ("min", "max", "unit"))
    return ListedVariable(
        v.name,
        v.causality,
        v.variability or "",
        v.type,
        unit or "",
        v.start,
        shape_of(v, sizes),
        low,
        high,
        {item.name: int(item.value) for item in items},
        v.description or "",
    )


def _needs(variables: tuple[ListedVariable, ...], platforms: tuple[str, ...], model: Any) -> list[str]:
    """What a scenario must see to, in sentences."""
    needs = []
    if platforms and not set(here()) & set(platforms):
        needs.append(f"another machine: there is no binary for {here()[model.fmiVersion.startswith('3')]}")
    if model.coSimulation.needsExecutionTool:
        needs.append("the tool that made it, installed on this machine (needsExecutionTool)")
    if model.coSimulation.canBeInstantiatedOnlyOncePerProcess:
        needs.append("to be used once in a scenario (canBeInstantiatedOnlyOncePerProcess)")
    inputs = [v for v in variables if v.kind == "input"]
    lost = [v.name for v in inputs if v.start is None and v.type not in ("Clock", "String", "Binary")]
    if lost:
        needs.append(f"connections to {', '.join(lost)}, which have no start values")
    others = [v.name for v in inputs if v.name not in lost]
    if others:
        needs.append(f"connections to {', '.join(others)}, or they stay at their start values")
    clocks = [v.name for v in variables if v.type == "Clock"]
    if clocks:
        needs.append(f"no clocks: {', '.join(clocks)} are not used")
    return needs or ["nothing but a step and a stop time"]


def _table(variables: tuple[ListedVariable, ...]) -> list[str]:
    rows = [("variable", "kind", "type", "unit", "start", "size", "")]
    rows += [(v.name, v.kind, v.type, v.unit, _short(v.start), v.shown_size, _notes(v)) for v in variables]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip() for row in rows]


def _short(start: str | None) -> str:
    text = "" if start is None else str(start)
    return text if len(text) <= 30 else text[:29] + "…"


def _notes(v: ListedVariable) -> str:
    items = ", ".join(f"{name} = {value}" for name, value in v.items.items())
    limits = f"{v.minimum or ''} to {v.maximum or ''}".strip() if v.minimum or v.maximum else ""
    return "; ".join(part for part in (items, limits, v.description) if part)


_MANY = 1e6  # steps of a scenario to begin with


def _scenario(path: Path, model: Any, variables: tuple[ListedVariable, ...]) -> str:
    """A scenario file that runs the FMU alone, with its parameters at their start values."""
    name, known = "fmu", _experiment(model.defaultExperiment)
    inputs = [v.name for v in variables if v.kind == "input" and v.type != "Clock"]
    step = known.get("step", 1e-3)
    stop = max(1, round(min(known.get("stop", 1.0), _MANY * step) / step)) * step
    cut = f"  # the FMU's own: {known['stop']:g} s" if known.get("stop", 0.0) > _MANY * step else ""
    lines = ["format = 1", "connections = ["]
    lines += [f"    # {toml_value(f'other.output -> {name}.{v}')}," for v in inputs]
    lines += ["]", "[experiment]", f"stop = {float(f'{stop:.12g}')!r}{cut}", f"step = {step!r}", f"[components.{name}]"]
    lines += [f"fmu = {toml_value(path.name)}", f"[components.{name}.parameters]"]
    lines += [
        _assignment(v) for v in variables if v.kind in ("parameter", "structuralParameter") and v.start is not None
    ]
    return "\n".join(lines) + "\n"


def _assignment(v: ListedVariable) -> str:
    names = {value: item for item, value in v.items.items()}
    comment = ", ".join(part for part in (v.unit, " or ".join(v.items)) if part)
    return f"{toml_key(v.name)} = {toml_value(_value(v, names))}" + (f"  # {comment}" if comment else "")


def _value(v: ListedVariable, names: Mapping[int, str]) -> object:
    """The start value as a scenario gives it: items by name, arrays as lists row by row."""
    text = v.start or ""
    if v.type in ("String", "Binary"):
        return text
    values = [_single(v.type, part, names) for part in text.split()]
    return values if v.size and len(values) != 1 else values[0]


def _single(kind: str, text: str, names: Mapping[int, str]) -> object:
    if kind == "Boolean":
        return text.lower() in ("true", "1")
    if kind in WHOLE:
        return names.get(int(text), int(text))
    return float(text)
