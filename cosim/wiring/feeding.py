"""Inputs that no connection feeds, and variables that nothing records."""

from collections.abc import Mapping
from fnmatch import fnmatchcase

from cosim.errors import Problem, did_you_mean
from cosim.scenario import Scenario
from cosim.signals import FmuDescription, Variable, is_real, stem
from cosim.wiring.wiring import Link


def unwired(
    scenario: Scenario,
    descriptions: Mapping[str, FmuDescription],
    links: list[Link],
    starts: Mapping[str, Mapping[str, float | str]],
    problems: list[Problem],
) -> list[str]:
    """Notes on inputs that no connection drives and that keep their start value; a problem where they have none."""
    notes = []
    for name in scenario.components:
        free = _free(name, descriptions[name], links)
        lost = [v.name for v in free if v.start is None and v.name not in starts[name] and is_real(v)]
        if lost:
            problems.append(
                Problem(f"component {name}", f"a connection to {', '.join(lost)}", "none", "it has no start value")
            )
        held = dict.fromkeys(stem(v.name) for v in free if v.name not in lost)
        if held:
            notes.append(
                f"{name}: {', '.join(held)} not wired, {'stay' if len(held) > 1 else 'stays'} at the start value"
            )
    return notes


def _free(name: str, description: FmuDescription, links: list[Link]) -> list[Variable]:
    """Inputs of a component that no connection drives; derivative inputs that are set with their input do not count."""
    driven = {link.target.variable for link in links if link.target.component == name}
    slopes = {v.slope for v in description.variables.values() if v.slope is not None}
    inputs = (v for v in description.variables.values() if v.causality == "input")
    return [v for v in inputs if v.name not in driven and v.reference not in slopes]


def starved(scenario: Scenario, descriptions: Mapping[str, FmuDescription], links: list[Link]) -> list[str]:
    """Warnings of inputs on a signal's way that nothing feeds, although what stands beside them is fed.

    Looked at are components whose outputs are wired. What stands beside an input: the other elements of its vector;
    its reference or measurement (`x_ref` and `x`); the inputs that act with it on a wired output at once, where the
    FMU states that; the same input of another instance of the model. Forces and torques add up, and one that is absent
    is zero: they count only where a component has no input wired at all and another instance has. An input that the
    scenario gives a start value is meant to stay there.
    """
    read = {link.source.component for link in links}
    found = []
    for name in (n for n in scenario.components if n in read):
        lost = _lost(name, scenario, descriptions, links)
        if lost:
            are = "nothing feeds " + ", ".join(lost)
            found.append(f"{name}: {are}, which stays at the start value; wire it, or give it one in parameters")
    return found


def _lost(name: str, scenario: Scenario, descriptions: Mapping[str, FmuDescription], links: list[Link]) -> list[str]:
    """Inputs of a component that should be fed (see `starved`), whole vectors by their stem."""
    description, given = descriptions[name], scenario.components[name].parameters
    wired = _wired(name, links)
    others = [n for n in scenario.components if n != name and descriptions[n].model == description.model]
    elsewhere = set().union(*(_wired(n, links) for n in others))
    beside = _beside(name, description, wired, links)
    lost = {}
    for v in _free(name, description, links):
        vector = stem(v.name)
        if vector in given or v.name in given:
            continue
        part = vector != v.name and any(stem(w) == vector for w in wired)
        if part or (v.name in elsewhere and not wired) or (not _adds_up(v) and v.name in elsewhere | beside):
            lost[v.name if part else vector] = None
    return list(lost)


def _wired(name: str, links: list[Link]) -> set[str]:
    return {link.target.variable for link in links if link.target.component == name}


def _beside(name: str, description: FmuDescription, wired: set[str], links: list[Link]) -> set[str]:
    """Inputs that stand beside wired ones: their reference or measurement, and what acts with them on an output."""
    stems = {_quantity(stem(v)) for v in wired}
    same = {v for v in description.names("input") if _quantity(stem(v)) in stems}
    outputs = {link.source.variable for link in links if link.source.component == name}
    acting = [set(description.variables[v].feedthrough or ()) for v in outputs]
    signals = {v for v in wired if not _adds_up(description.variables[v])}
    return same.union(*(inputs for inputs in acting if inputs & signals))


def _quantity(name: str) -> str:
    """`x_ref` -> `x`: the quantity whose reference an input is, else the input itself."""
    return next((name.removesuffix(e) for e in ("_ref", "_des", "_reference", "_desired") if name.endswith(e)), name)


def _adds_up(variable: Variable) -> bool:
    """Whether it is a force or a torque: there is a mass in its unit."""
    return variable.unit.exponents is not None and variable.unit.exponents[0] != 0


def recorded_beside(
    scenario: Scenario, descriptions: Mapping[str, FmuDescription], problems: list[Problem]
) -> dict[str, tuple[str, ...]]:
    """Variables that `experiment.record` names beside the outputs, by component; a problem for a pattern that fits
    none.
    """
    found: dict[str, tuple[str, ...]] = {}
    for pattern in scenario.experiment.record:
        chosen = [
            (name, v)
            for name in scenario.components
            for v in descriptions[name].variables.values()
            if _matches(name, v.name, pattern)
        ]
        silent = [f"{name}.{v.name}" for name, v in chosen if not v.exchanged]
        if not chosen or silent:
            known = [f"{n}.{s}" for n in scenario.components for s in descriptions[n].stems()]
            got, advice = repr(pattern), did_you_mean(pattern, known)
            if silent:
                got, advice = f"{', '.join(silent)}, which is no number", "texts and bytes are not recorded"
            problems.append(Problem(f"{scenario.name}: experiment.record", "a variable with numbers", got, advice))
        for name, v in chosen:
            if v.causality != "output" and v.exchanged:
                found[name] = tuple(dict.fromkeys([*found.get(name, ()), v.name]))
    return found


def _matches(component: str, variable: str, pattern: str) -> bool:
    """Whether a pattern names a variable, whole vectors by their stem; brackets in it stand for themselves."""
    plain = pattern.replace("[", "[[]")
    return any(fnmatchcase(f"{component}.{name}", plain) for name in (variable, stem(variable)))


def silences(scenario: Scenario, descriptions: Mapping[str, FmuDescription]) -> list[str]:
    """Notes on outputs that are not recorded, and on a scenario that records nothing."""
    notes = [
        f"{name}: {', '.join(descriptions[name].silent)} not recorded (no numbers)"
        for name in scenario.components
        if descriptions[name].silent
    ]
    if not any(descriptions[name].outputs for name in scenario.components) and not scenario.experiment.record:
        notes.append("no component has an output: nothing but the time is recorded (experiment.record names more)")
    return notes


def tool_warnings(scenario: Scenario, descriptions: Mapping[str, FmuDescription]) -> list[str]:
    """Warnings of FMUs of others that start another tool."""
    return [
        f"{name}: the FMU only works where its tool is installed{f' ({d.tool})' if d.tool else ''}: it may wait for it"
        for name in scenario.components
        if (d := descriptions[name]).needs_tool and not scenario.components[name].own
    ]
