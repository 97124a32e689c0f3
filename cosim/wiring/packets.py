"""Channels that carry numbers of any unit: what is put into a packet, and its units at the far end."""

from collections.abc import Mapping

from attrs import evolve

from cosim.scenario import Scenario
from cosim.signals import FmuDescription, Unit, stem


def with_packets(scenario: Scenario, descriptions: Mapping[str, FmuDescription]) -> Mapping[str, FmuDescription]:
    """The descriptions with channels as they are used.

    A number that an FMU carries has the unit of what feeds it. A packet is as long as what is put into it: inputs that
    nothing feeds and that have no start value of the scenario's are left out, with the outputs that carry them.
    Channels may feed one another.
    """
    channels = {name: description for name, description in descriptions.items() if description.carried}
    if not channels:
        return descriptions
    put = {name: put_in(scenario, name, description) for name, description in channels.items()}
    while True:
        known = {**descriptions, **{name: _packed(channels[name], put[name]) for name in channels}}
        more = {name: put[name] | _fed(scenario, name, channels[name], known) for name in channels}
        if more == put:
            return known
        put = more


def put_in(scenario: Scenario, name: str, description: FmuDescription) -> dict[str, Unit]:
    """Carried inputs that the scenario gives a start value, in no unit."""
    if not description.carried:
        return {}
    given = scenario.components[name].parameters
    return {i: Unit("") for i in description.carried.values() if i in given or stem(i) in given}


def _fed(
    scenario: Scenario, name: str, description: FmuDescription, known: Mapping[str, FmuDescription]
) -> dict[str, Unit]:
    """Units of the carried inputs by what is known to feed them; a vector fills a longer one from its beginning."""
    found, carried = {}, set(description.carried.values())
    for connection in scenario.connections:
        source = known.get(connection.source.component)
        if connection.target.component != name or source is None:
            continue
        names = source.elements(connection.source.variable)
        pairs = zip(description.elements(connection.target.variable), names)
        found |= {target: source.variables[n].unit for target, n in pairs if target in carried}
    return found


def _packed(description: FmuDescription, put: Mapping[str, Unit]) -> FmuDescription:
    """A channel with the inputs that are put into its packets, and what carries them, in their units."""
    units = dict(put) | {output: put[i] for output, i in description.carried.items() if i in put}
    left = {name for pair in description.carried.items() if pair[1] not in put for name in pair}
    left |= {f"der({name})" for name in left}
    variables = {
        name: evolve(variable, unit=units[name]) if name in units else variable
        for name, variable in description.variables.items()
        if name not in left
    }
    return evolve(description, variables=variables)
