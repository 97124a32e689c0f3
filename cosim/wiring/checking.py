"""From a scenario and the descriptions of its FMUs to a checked wiring."""

from collections.abc import Mapping

from attrs import evolve, fields

from cosim.errors import InputError, Problem
from cosim.scenario import Component, Scenario, joints_of
from cosim.signals import FmuDescription
from cosim.wiring.ages import timed
from cosim.wiring.feeding import recorded_beside, silences, starved, tool_warnings, unwired
from cosim.wiring.links import driven_twice, links_of, scaled_links, timing_problems, too_many_instances
from cosim.wiring.loops import assumed_loops, loop_problems, stepping_order
from cosim.wiring.packets import put_in, with_packets
from cosim.wiring.starts import starts_of, unfit_starts
from cosim.wiring.wiring import Wiring


def wire(scenario: Scenario, descriptions: Mapping[str, FmuDescription]) -> Wiring:
    """Wire the scenario's components, given the description of each. Raises InputError with every problem found."""
    wiring, problems = check(scenario, descriptions)
    if problems or wiring is None:
        raise InputError(problems)
    return wiring


def restarted(wiring: Wiring, scenario: Scenario) -> Wiring | None:
    """The wiring of a scenario that differs in start values only, without wiring anew; None where it differs in more.

    Raises InputError for values that do not fit.
    """
    if not _same_structure(wiring.scenario, scenario) or _resized(wiring, scenario):
        return None
    problems: list[Problem] = []
    old = wiring.scenario.components
    starts = {
        name: wiring.starts[name]
        if component is old[name] or component == old[name]
        else starts_of(scenario, name, wiring.descriptions[name], problems)
        for name, component in scenario.components.items()
    }
    if problems:
        raise InputError(problems)
    return evolve(wiring, scenario=scenario, starts=starts)


def _resized(wiring: Wiring, scenario: Scenario) -> bool:
    """Whether a value changes that settles the size of an array or of a packet."""
    old = wiring.scenario.components
    changed = {name: component for name, component in scenario.components.items() if component is not old[name]}
    described = {name: wiring.descriptions[name] for name in changed}
    if any(put_in(scenario, n, d) != put_in(wiring.scenario, n, d) for n, d in described.items()):
        return True
    if any(joints_of(component) != joints_of(old[name]) for name, component in changed.items()):
        return True
    return any(
        component.parameters.get(name) != old[key].parameters.get(name)
        for key, component in changed.items()
        for name in described[key].names("structuralParameter")
    )


def _same_structure(one: Scenario, other: Scenario) -> bool:
    if (one.connections, one.experiment, one.teleoperation, one.folder) != (
        other.connections,
        other.experiment,
        other.teleoperation,
        other.folder,
    ) or list(one.components) != list(other.components):
        return False
    pairs = zip(one.components.values(), other.components.values())
    return all(a is b or all(getattr(a, key) == getattr(b, key) for key in _BUT_VALUES) for a, b in pairs)


_BUT_VALUES = [entry.name for entry in fields(Component) if entry.name not in ("parameters", "parameter_set")]
"""What a component is but for its start values."""


def check(scenario: Scenario, descriptions: Mapping[str, FmuDescription]) -> tuple[Wiring | None, list[Problem]]:
    """As `wire`, but returns the problems; the wiring is None where there are any."""
    problems: list[Problem] = []
    descriptions = with_packets(scenario, descriptions)
    starts = {name: starts_of(scenario, name, descriptions[name], problems) for name in scenario.components}
    links = links_of(scenario, descriptions, problems)
    problems += driven_twice(links) + loop_problems(links, descriptions) + timing_problems(scenario)
    notes = unwired(scenario, descriptions, links, starts, problems) + assumed_loops(links, descriptions)
    problems += unfit_starts(scenario, descriptions, starts, {(x.target.component, x.target.variable) for x in links})
    beside = recorded_beside(scenario, descriptions, problems)
    problems += too_many_instances(scenario, descriptions)
    if problems:
        return None, problems
    order = scenario.experiment.order or stepping_order(scenario, descriptions, links)
    warnings = (
        *scenario.warnings,
        *_apart(scenario),
        *tool_warnings(scenario, descriptions),
        *(f"{name}: {warning}" for name in scenario.components for warning in descriptions[name].warnings),
        *scaled_links(links, descriptions),
        *starved(scenario, descriptions, links),
    )
    notes = (*warnings, *notes, *silences(scenario, descriptions))
    wiring = Wiring(
        scenario, descriptions, tuple(order), tuple(links), starts, notes=notes, warnings=warnings, beside=beside
    )
    return timed(wiring), []


def _apart(scenario: Scenario) -> list[str]:
    """A warning where several components have no connection at all."""
    if scenario.connections or len(scenario.components) < 2:
        return []
    return [
        'no connections: the components do not act on each other; wire them with connections = ["a.output -> b.input"]'
    ]
