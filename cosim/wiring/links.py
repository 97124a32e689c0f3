"""Connections spread to scalars and checked: names, causality, sizes, units, inputs driven twice or not at all."""

import math
from collections.abc import Mapping

from cosim.errors import Problem, did_you_mean
from cosim.scenario import Connection, Extrapolation, Scenario
from cosim.signals import FmuDescription, Signal, is_real, stem
from cosim.wiring.wiring import Link


def links_of(scenario: Scenario, descriptions: Mapping[str, FmuDescription], problems: list[Problem]) -> list[Link]:
    """The scalar connections of a scenario; what does not fit is added to `problems`."""
    links = []
    for connection in scenario.connections:
        sources = _ends(connection.source, "output", connection, descriptions, problems)
        targets = _ends(connection.target, "input", connection, descriptions, problems)
        if not sources or not targets:
            continue
        if len(sources) != len(targets):
            problems.append(
                Problem(f"connection {connection}", f"as many inputs as outputs ({len(sources)})", str(len(targets)))
            )
            continue
        problems += _unit_problems(connection, sources, targets, descriptions)
        links += [_link(scenario, connection, *pair, descriptions) for pair in zip(sources, targets)]
    return links


def _ends(
    end: Signal,
    causality: str,
    connection: Connection,
    descriptions: Mapping[str, FmuDescription],
    problems: list[Problem],
) -> list[str]:
    """The scalar variables at one end of a connection; empty, and a problem, where they are not there or of another
    causality.
    """
    description = descriptions.get(end.component)
    if description is None:
        return []
    names, where = description.elements(end.variable), f"connection {connection}"
    if not names:
        known = dict.fromkeys([*description.stems(causality), *description.names(causality)])
        problems.append(
            Problem(
                where,
                f"an {causality} of {description.model}",
                repr(end.variable),
                did_you_mean(end.variable, known) or f"{causality}s: {', '.join(description.stems(causality))}",
            )
        )
        return []
    other = {description.variables[name].causality for name in names} - {causality}
    if other:
        problems.append(Problem(where, f"an {causality} at {end}", f"a variable of causality {other.pop()}"))
        return []
    return names


def _unit_problems(
    connection: Connection, sources: list[str], targets: list[str], descriptions: Mapping[str, FmuDescription]
) -> list[Problem]:
    """One problem for each pair of different units in a connection."""
    found = {}
    for source, target in zip(sources, targets):
        a = descriptions[connection.source.component].variables[source].unit
        b = descriptions[connection.target.component].variables[target].unit
        if not a.joins(b):
            found[a.name, b.name] = Problem(
                f"connection {connection}",
                f"the unit of the input, {b.name!r}",
                repr(a.name),
                "different units are not joined",
            )
    return list(found.values())


def _link(
    scenario: Scenario, connection: Connection, source: str, target: str, descriptions: Mapping[str, FmuDescription]
) -> Link:
    ends = Signal(connection.source.component, source), Signal(connection.target.component, target)
    producer, consumer = (descriptions[end.component] for end in ends)
    a, b = producer.variables[source], consumer.variables[target]
    wanted = scenario.experiment.extrapolation is Extrapolation.LINEAR
    able = consumer.takes_slopes and (not consumer.fmi.startswith("3") or b.slope is not None)
    return Link(*ends, wanted and able and is_real(a) and is_real(b))


def driven_twice(links: list[Link]) -> list[Problem]:
    """Inputs that two outputs are wired to."""
    drivers: dict[Signal, list[Signal]] = {}
    for link in links:
        drivers.setdefault(link.target, []).append(link.source)
    twice = {t: s for t, s in drivers.items() if len(s) > 1}
    merged = {
        (t.component, stem(t.variable), tuple((x.component, stem(x.variable)) for x in s)) for t, s in twice.items()
    }
    return [
        Problem(
            f"input {component}.{name}",
            "one source",
            " and ".join(f"{c}.{v}" for c, v in sources),
            "remove one of the connections",
        )
        for component, name, sources in sorted(merged)
    ]


def unwired(
    scenario: Scenario,
    descriptions: Mapping[str, FmuDescription],
    links: list[Link],
    starts: Mapping[str, Mapping[str, float | str]],
    problems: list[Problem],
) -> list[str]:
    """Notes on inputs that no connection drives and that keep their start value; a problem where they have none."""
    driven = {link.target for link in links}
    notes = []
    for name in scenario.components:
        description = descriptions[name]
        free = [
            v for v in description.variables.values() if v.causality == "input" and Signal(name, v.name) not in driven
        ]
        free = [v for v in free if not v.name.startswith("der(")]
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


def too_many_instances(scenario: Scenario, descriptions: Mapping[str, FmuDescription]) -> list[Problem]:
    """Problems of FMUs that allow one instance in a process and are used more often."""
    used: dict[str, list[str]] = {}
    for name in scenario.components:
        if descriptions[name].single_instance:
            used.setdefault(descriptions[name].path, []).append(name)
    return [
        Problem(f"components {', '.join(names)}", "one instance: the FMU allows no more in a process", str(len(names)))
        for names in used.values()
        if len(names) > 1
    ]


def timing_problems(scenario: Scenario) -> list[Problem]:
    """Step multiples and orders that cannot be scheduled."""
    steps = scenario.experiment.steps
    period = math.lcm(*(max(c.step_multiple, 1) for c in scenario.components.values())) if scenario.components else 1
    problems = [
        Problem(
            f"component {name}",
            "a stop time of whole steps of the component",
            f"{steps} steps of {scenario.experiment.step} s by {c.step_multiple}",
        )
        for name, c in scenario.components.items()
        if c.step_multiple > 1 and steps % c.step_multiple
    ]
    if period > 10_000:
        problems.append(Problem("step_multiple", "multiples that meet again within 10000 steps", f"{period} steps"))
    return problems
