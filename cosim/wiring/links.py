"""Connections spread to scalars and checked: names, causality, sizes, units, inputs driven twice or not at all."""

import math
from collections.abc import Mapping

from cosim.errors import Problem, did_you_mean
from cosim.scenario import Connection, Extrapolation, Scenario
from cosim.signals import FmuDescription, Linear, Signal, is_real, stem
from cosim.wiring.types import type_problems
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
        if not isinstance(connection.conversion, Linear):
            problems += _unit_problems(connection, sources, targets, descriptions)
        problems += type_problems(connection, sources, targets, descriptions)
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
        if a.towards(b) is None:
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
    wish = connection.conversion
    change = wish if isinstance(wish, Linear) else a.unit.towards(b.unit) or Linear()
    linear = wanted and able and is_real(a) and is_real(b)
    return Link(*ends, linear, change.factor, change.offset, wish, not b.exchanged)


def scaled_links(links: list[Link], descriptions: Mapping[str, FmuDescription]) -> list[str]:
    """A sentence for each pair of units that a connection turns into each other."""
    found: dict[tuple[str, ...], str] = {}
    for link in (link for link in links if link.scaled and not isinstance(link.conversion, Linear)):
        units = [descriptions[end.component].variables[end.variable].unit.name for end in (link.source, link.target)]
        ends = [f"{end.component}.{stem(end.variable)}" for end in (link.source, link.target)]
        shift = f" {'+' if link.shift > 0 else '-'} {abs(link.shift):.9g}" if link.shift else ""
        sentence = f"{ends[0]} -> {ends[1]}: converted from {units[0]} to {units[1]}, times {link.gain:.9g}{shift}"
        found.setdefault((*ends, units[0]), sentence)
    return list(found.values())


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


def too_many_instances(scenario: Scenario, descriptions: Mapping[str, FmuDescription]) -> list[Problem]:
    """Problems of FMUs that allow one instance in a process and are used more often, under whatever file names."""
    used: dict[str, list[str]] = {}
    for name in scenario.components:
        if descriptions[name].single_instance:
            used.setdefault(descriptions[name].sha256 or descriptions[name].path, []).append(name)
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
