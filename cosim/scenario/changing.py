"""Values at paths, effects, and the parameters that result."""

import tomllib
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, TypeVar

from attrs import evolve, fields

from cosim.errors import InputError, Problem, did_you_mean
from cosim.opening import read_toml
from cosim.scenario.parts import OF_RECORDING, Component, ScenarioParts
from cosim.scenario.reading import record_of, unknown_keys
from cosim.scenario.writing import plain, toml_value
from cosim.signals import stem

AnyScenario = TypeVar("AnyScenario", bound=ScenarioParts)


def start_values(component: Component) -> dict[str, object]:
    """FMU parameters of a component, the parameter set expanded (a PHANToM's to `pi`, `viscous`, `coulomb`; a
    SerialArm's to its table); later keys win.
    """
    values = _set_values(component)
    whole = {key: value for key, value in component.parameters.items() if stem(key) == key}
    single = {key: value for key, value in component.parameters.items() if stem(key) != key}
    return values | whole | single


def _set_values(component: Component) -> dict[str, object]:
    """What the parameter set of a component says."""
    if component.parameter_set is None:
        return {}
    if component.model == "SerialArm":
        from cosim.arm.published import published_arm

        return dict(published_arm(component.parameter_set))
    from cosim.arm.parameters import parameter_set

    chosen = parameter_set(component.parameter_set)
    return {key: [float(v) for v in getattr(chosen, key)] for key in ("pi", "viscous", "coulomb")}


def joints_of(component: Component) -> int | None:
    """How many joints a component says that it has: models with a table of joints are cut to so many. None: it does not
    say.
    """
    if component.model is None:
        return None
    joints = _set_values(component).get("joints") if component.model == "SerialArm" else None
    joints = component.parameters.get("joints", joints)
    if isinstance(joints, (int, float)) and not isinstance(joints, bool) and float(joints).is_integer():
        return int(joints)
    return None


def parse_override(text: str) -> tuple[str, object]:
    """`path=value` as path and TOML value (bare words are text). Raises InputError."""
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        raise InputError(Problem("--set", "path=value", repr(text), "for example --set arm_l.q_start[2]=0.3"))
    try:
        return path.strip(), tomllib.loads(f"value = {value.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        return path.strip(), value.strip()


def with_override(scenario: AnyScenario, text: str, problems: list[Problem]) -> AnyScenario:
    """The scenario with one `path=value`, as `--set` gives it; what is wrong is added to `problems`."""
    try:
        path, value = parse_override(text)
    except InputError as error:
        problems += error.problems
        return scenario
    return assign(scenario, path, value, problems)


def assign(scenario: AnyScenario, path: str, value: object, problems: list[Problem]) -> AnyScenario:
    """The scenario with one value changed, which it remembers; a problem is appended where the path leads nowhere."""
    parts = _assigned(scenario, path, value, problems)
    return evolve(scenario, **parts, changes={**scenario.changes, path: toml_value(value)}) if parts else scenario


def _assigned(scenario: ScenarioParts, path: str, value: object, problems: list[Problem]) -> dict[str, Any]:
    """The part of the scenario that changes, by its name; empty where the path leads nowhere."""
    head, _, key = path.removeprefix("components.").partition(".")
    if head in ("experiment", "teleoperation"):
        return _assign_record(scenario, head, key, value, problems)
    chosen = [name for name in scenario.components if fnmatchcase(name, head)]
    if not chosen or not key:
        known = [*scenario.components, "experiment"]
        problems.append(
            Problem(f"path {path}", "component.parameter or experiment.key", repr(head), did_you_mean(head, known))
        )
        return {}
    components = dict(scenario.components)
    for name in chosen:
        components[name] = _component_with(components[name], key, value, f"path {path}", problems)
    return {"components": components}


def _assign_record(
    scenario: ScenarioParts, head: str, key: str, value: object, problems: list[Problem]
) -> dict[str, Any]:
    record = getattr(scenario, head)
    table = plain(record) | {key: value}
    changed = record_of(type(record), table, f"path {head}", problems)
    return {} if changed is None else {head: changed}


def _component_with(component: Component, key: str, value: object, where: str, problems: list[Problem]) -> Component:
    foreign = component.recording is None and key in OF_RECORDING
    parameter = foreign or key.startswith("parameters.")
    key = key.removeprefix("parameters.")
    if not parameter and key != "parameters" and key in {entry.name for entry in fields(Component)}:
        table = plain(component)
        for other in ("model", "fmu", "recording"):
            if key in ("model", "fmu", "recording") and other != key:
                table.pop(other, None)
        return record_of(Component, table | {key: value}, where, problems) or component
    kept = {k: v for k, v in component.parameters.items() if not (stem(key) == key and stem(k) == key)}
    return evolve(component, parameters=kept | {key: value})


_KINDS = {dict: "a table", str: "text", list: "a list"}


def with_effects(scenario: AnyScenario, path: Path, problems: list[Problem]) -> AnyScenario:
    """The effects file's start values, given to the components that it names or to every one of its model."""
    table = read_toml(path, where="--effects")
    unknown_keys(table, {"format", "model", "components", "parameters", "effects", "provenance"}, path.name, problems)
    kinds = {"parameters": dict, "model": str, "components": list, "effects": list}
    if "parameters" not in table:
        problems.append(
            Problem(
                f"{path.name}: [parameters]",
                "a table of start values",
                "none",
                "close-loop writes it into effects.toml",
            )
        )
    wrong = [key for key, kind in kinds.items() if key in table and not isinstance(table[key], kind)]
    if wrong or table.get("format", 1) != 1:
        problems += [Problem(f"{path.name}: {key}", _KINDS[kinds[key]], repr(table[key])) for key in wrong]
        if table.get("format", 1) != 1:
            problems.append(Problem(f"{path.name}: format", "1", repr(table["format"]), "this cosim reads format 1"))
        return scenario
    values, model = table.get("parameters", {}), table.get("model", "PhantomArm")
    named = table.get("components")
    chosen = named or [name for name, c in scenario.components.items() if c.model == model]
    for name in chosen:
        if name not in scenario.components:
            problems.append(
                Problem(
                    f"{path.name}: components",
                    "a component of the scenario",
                    repr(name),
                    did_you_mean(name, scenario.components),
                )
            )
    if not chosen:
        problems.append(Problem(f"{path.name}: model", f"a model in scenario {scenario.name}", repr(model)))
    components = dict(scenario.components)
    for name in (name for name in chosen if name in components):
        own = components[name].parameters.get("internal_steps")
        for key, value in values.items():
            if key == "internal_steps" and isinstance(value, int) and isinstance(own, int):
                value = max(value, own)  # what an effect needs makes nothing coarser
            components[name] = _component_with(components[name], key, value, path.name, problems)
    labels = tuple(str(entry.get("name", "?")) for entry in table.get("effects", ()) if isinstance(entry, dict))
    return evolve(scenario, components=components, effects=scenario.effects + (labels or tuple(values)))
