"""Start values of single FMU variables, checked against what the FMU declares."""

import math
import re
from collections.abc import Mapping, Set
from functools import cache

from attrs import evolve

from cosim.errors import Problem, did_you_mean
from cosim.scenario import Scenario, start_values
from cosim.signals import SETTABLE, TYPES, FmuDescription, Variable, indices_of, stem


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
        given = _flat(value) if isinstance(value, (list, tuple)) else [value] * len(names)
        if len(given) != len(names):
            problems.append(Problem(f"{where}.{key}", f"{len(names)} values", str(len(given))))
            continue
        for variable, entry in zip((description.variables[n] for n in names), given):
            number = _start(variable, entry, f"{where}.{variable.name}", problems)
            if number is not None:
                values[variable.name] = number
    values = _whole_arrays(description, values, where, problems)
    if "seed" in description.variables and "seed" not in values:
        values["seed"] = scenario.experiment.seed + list(scenario.components).index(name)
    law = description.variables.get("law")
    if description.model in ("VariableDelayChannel", "PacketChannel") and law is not None and law.items:
        problems += _outgrown(scenario, name, description, values)
    return values


@cache
def _buffer(model: str) -> int:
    """Steps of delay that a channel's buffer holds, whatever its semantics (see the README of VariableDelayChannel,
    Memory): one record each, beside those of the first input and of the present.
    """
    from build_fmus.unchanged import unchanged

    def shape() -> int:
        from build_fmus.sources import model_table

        return model_table(model).shape("ring")[0]

    return unchanged("buffers", model, shape) - 2


def _channel_step(scenario: Scenario, name: str) -> float:
    return scenario.components[name].step_multiple * scenario.experiment.step


def holds(scenario: Scenario, name: str, model: str, delay: float) -> bool:
    """Whether a channel's buffer holds a delay [s] for the time of the run."""
    return min(delay, scenario.experiment.stop) <= _buffer(model) * _channel_step(scenario, name) * (1 + 1e-9)


def _outgrown(
    scenario: Scenario, name: str, description: FmuDescription, values: Mapping[str, float | str]
) -> list[Problem]:
    """The problem of a channel whose delay is known beforehand and outgrows its buffer in the time of the run."""
    law = description.variables["law"].item(description.start("law", values))
    key = "delay_mean" if law == "constant" else "delay_max"
    delay = description.start(key, values)
    if law == "recorded" or holds(scenario, name, description.model, delay):
        return []
    step, most = _channel_step(scenario, name), _buffer(description.model)
    fits = f"at most {most * step:g} s, {most} steps of {step:g} s that the channel's buffer holds"
    advice = f"take steps of {delay / most:.2g} s or more ({name}.step_multiple, experiment.step), or a shorter delay"
    return [Problem(f"{scenario.name}: {name}.{key}", fits, f"{delay:g} s", advice)]


def unfit_starts(
    scenario: Scenario,
    descriptions: Mapping[str, FmuDescription],
    starts: Mapping[str, Mapping[str, float | str]],
    driven: Set[tuple[str, str]],
) -> list[Problem]:
    """Problems of values that an FMU declares against its own type or limits, where the run would begin with them:
    neither the scenario nor a connection gives another one.
    """
    found = []
    for name in scenario.components:
        for variable in descriptions[name].unfit:
            if variable in starts[name] or (name, variable) in driven:
                continue
            declared = descriptions[name].variables[variable]
            problem = _unfit(declared, declared.start, f"{scenario.name}: {name}.{variable}")
            advice = f"the FMU's own start value: give another one in components.{name}.parameters"
            found += [evolve(problem, advice=advice)] if problem else []
    return found


def _flat(values: list | tuple) -> list:
    """A list of lists, a matrix, row by row."""
    return [entry for value in values for entry in (_flat(value) if isinstance(value, (list, tuple)) else [value])]


def _whole_arrays(
    description: FmuDescription, values: dict[str, float | str], where: str, problems: list[Problem]
) -> dict[str, float | str]:
    """The values with the other elements of every array that some are given of: arrays are set as a whole."""
    if not description.arrays:
        return values
    touched = {description.variables[name].reference for name in values if description.variables[name].size > 1}
    whole = {v.name: v.start for v in description.variables.values() if v.reference in touched and v.size > 1}
    whole = {name: values.get(name, start) for name, start in whole.items()}
    lost = [name for name, value in whole.items() if value is None]
    if lost:
        problems.append(
            Problem(
                f"{where}.{stem(lost[0])}",
                "values for all elements",
                f"none for {', '.join(lost)}",
                "the FMU declares no start values for them",
            )
        )
    return values | {name: value for name, value in whole.items() if value is not None}


def _start(variable: Variable, value: object, where: str, problems: list[Problem]) -> float | str | None:
    """The start value of one variable as a number (text for strings, hexadecimal digits for bytes); None, and a
    problem, where it does not fit.
    """
    problem = _not_settable(variable, where) or _unfit(variable, value, where)
    if problem is not None:
        problems.append(problem)
        return None
    if variable.kind in ("String", "Binary"):
        return str(value)
    if isinstance(value, str):
        return variable.item_values[variable.items.index(value)]
    return value  # type: ignore[return-value] - a number, which _unfit has seen


def _not_settable(variable: Variable, where: str) -> Problem | None:
    """The problem of a variable whose start value is not the importer's to set."""
    starts = variable.start is not None and variable.causality in ("local", "output")
    if variable.constant:
        return Problem(where, "a parameter", "a constant of the FMU")
    if variable.causality not in SETTABLE and not starts:
        return Problem(where, "a parameter", f"a variable of causality {variable.causality}")
    return Problem(where, "a variable with a value", "a clock") if variable.kind == "Clock" else None


def _unfit(variable: Variable, value: object, where: str) -> Problem | None:
    """The problem of a value that the variable cannot hold; None where it can."""
    if variable.kind == "String":
        return None if isinstance(value, str) else Problem(where, "a text", repr(value), "write it in quotes")
    if variable.kind == "Binary":
        digits = isinstance(value, str) and re.fullmatch(r"([0-9a-fA-F]{2})*", value)
        return None if digits else Problem(where, "bytes as hexadecimal digits, two a byte", repr(value))
    if variable.items and isinstance(value, str):
        if value in variable.items:
            return None
        return Problem(where, " or ".join(map(repr, variable.items)), repr(value), did_you_mean(value, variable.items))
    if not isinstance(value, (bool, int, float)) or not math.isfinite(value):
        return Problem(where, "a finite number", repr(value))
    return _unfit_number(variable, value, where)


def _unfit_number(variable: Variable, value: float, where: str) -> Problem | None:
    if variable.items and value not in variable.item_values:
        items = ", ".join(f"{name} = {number}" for name, number in zip(variable.items, variable.item_values))
        return Problem(where, f"an item ({items})", repr(value))
    if TYPES.get(variable.type, 2) == 2 and value != int(value):
        return Problem(where, "a whole number", repr(value))
    if variable.kind == "Boolean":
        return None if value in (0, 1) else Problem(where, "true or false", repr(value))
    low, high = variable.limits
    if low <= value <= high:
        return None
    shown = [str(v) if isinstance(v, int) else f"{v:g}" for v in (low, high)]
    return Problem(where, f"a value in [{', '.join(shown)}] {variable.unit.name}".rstrip(), repr(value))


def vector_starts(starts: Mapping[str, float | str]) -> dict[str, list[float | str]]:
    """Start values by stem, elements in order: for tables."""
    groups: dict[str, list[tuple[tuple[int, ...], float | str]]] = {}
    for name, value in starts.items():
        groups.setdefault(stem(name), []).append((indices_of(name), value))
    return {key: [value for _, value in sorted(entries, key=lambda e: e[0])] for key, entries in groups.items()}
