"""Start values of single FMU variables, checked against what the FMU declares."""

import math
from collections.abc import Mapping

from cosim.errors import Problem, did_you_mean
from cosim.scenario import Scenario, start_values
from cosim.signals import TYPES, FmuDescription, Variable, index_of, stem

_SETTABLE = {"parameter", "input", "structuralParameter"}


def starts_of(
    scenario: Scenario, name: str, description: FmuDescription, problems: list[Problem]
) -> dict[str, float | str]:
    """Values of single FMU variables that the scenario sets: lists spread, one value for a vector repeated, items by
    name.
    """
    component, where = scenario.components[name], f"{scenario.name}: {name}"
    values: dict[str, float | str] = {}
    for key, value in start_values(component).items():
        names = description.elements(key)
        if not names:
            known = dict.fromkeys([*description.stems("parameter"), *description.names("parameter")])
            problems.append(
                Problem(
                    f"{where}.{key}", f"a parameter of {description.model}", "an unknown one", did_you_mean(key, known)
                )
            )
            continue
        given = value if isinstance(value, (list, tuple)) else [value] * len(names)
        if len(given) != len(names):
            problems.append(Problem(f"{where}.{key}", f"{len(names)} values", str(len(given))))
            continue
        for variable, entry in zip((description.variables[n] for n in names), given):
            number = _start(variable, entry, f"{where}.{variable.name}", problems)
            if number is not None:
                values[variable.name] = number
    if "seed" in description.variables and "seed" not in values:
        values["seed"] = scenario.experiment.seed + list(scenario.components).index(name)
    law = description.variables.get("law")
    if description.model == "VariableDelayChannel" and law is not None and law.items:
        problems += _outgrown(scenario, name, description, values)
    return values


_BUFFER = 8190
"""Steps of delay that the buffer of fmu_src/VariableDelayChannel holds, whatever its semantics (see its README:
Memory).
"""


def _outgrown(
    scenario: Scenario, name: str, description: FmuDescription, values: Mapping[str, float | str]
) -> list[Problem]:
    """The problem of a channel whose delay is known beforehand and outgrows its buffer in the time of the run."""
    law = description.variables["law"].items[int(description.start("law", values)) - 1]
    key = "delay_mean" if law == "constant" else "delay_max"
    delay = description.start(key, values)
    experiment = scenario.experiment
    step = scenario.components[name].step_multiple * experiment.step
    if law == "recorded" or min(delay, experiment.stop) <= _BUFFER * step * (1 + 1e-9):
        return []
    fits = f"at most {_BUFFER * step:g} s, {_BUFFER} steps of {step:g} s that the channel's buffer holds"
    advice = (
        f"take steps of {delay / _BUFFER:.2g} s or more ({name}.step_multiple, experiment.step), or a shorter delay"
    )
    return [Problem(f"{scenario.name}: {name}.{key}", fits, f"{delay:g} s", advice)]


def _start(variable: Variable, value: object, where: str, problems: list[Problem]) -> float | str | None:
    """The start value of one variable as a number (text for strings); None, and a problem, where it does not fit."""
    if variable.causality not in _SETTABLE and not (variable.start is not None and variable.causality == "local"):
        problems.append(Problem(where, "a parameter", f"a variable of causality {variable.causality}"))
        return None
    if variable.type == "String":
        return str(value)
    if variable.items and isinstance(value, str):
        if value in variable.items:
            return variable.items.index(value) + 1
        problems.append(
            Problem(where, " or ".join(map(repr, variable.items)), repr(value), did_you_mean(value, variable.items))
        )
        return None
    if not isinstance(value, (bool, int, float)) or not math.isfinite(value):
        problems.append(Problem(where, "a finite number", repr(value)))
        return None
    low = -math.inf if variable.minimum is None else variable.minimum
    high = math.inf if variable.maximum is None else variable.maximum
    if not low <= value <= high:
        problems.append(Problem(where, f"a value in [{low:g}, {high:g}] {variable.unit.name}".rstrip(), repr(value)))
        return None
    if variable.type == "Boolean" and value not in (0, 1):
        problems.append(Problem(where, "true or false", repr(value)))
        return None
    if TYPES.get(variable.type, 2) == 2 and value != int(value):
        problems.append(Problem(where, "a whole number", repr(value)))
        return None
    return value


def vector_starts(starts: Mapping[str, float | str]) -> dict[str, list[float | str]]:
    """Start values by stem, elements in order: for tables."""
    groups: dict[str, list[tuple[int, float | str]]] = {}
    for name, value in starts.items():
        groups.setdefault(stem(name), []).append((index_of(name), value))
    return {key: [value for _, value in sorted(entries, key=lambda e: e[0])] for key, entries in groups.items()}
