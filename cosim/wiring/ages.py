"""The schedule of a wiring, and how much older the stepping makes each signal."""

import itertools
from collections.abc import Mapping
from fractions import Fraction

from attrs import evolve

from cosim.scenario import Connection
from cosim.signals import Signal
from cosim.wiring.schedule import Port, ScheduledComponent, build_schedule, chain_age, mean_age
from cosim.wiring.wiring import DelayPath, Hop, Wiring


def timed(wiring: Wiring) -> Wiring:
    """The wiring with its schedule and with the age of every connection, direction and local path."""
    scenario, names = wiring.scenario, list(wiring.scenario.components)
    units = _units(wiring)
    order = [names.index(name) for name in wiring.order]
    schedule = build_schedule(units, order, scenario.experiment.algorithm, scenario.experiment.step_ns)
    hops = tuple(_hop(wiring, connection, units) for connection in scenario.connections)
    timed = evolve(wiring, schedule=schedule, hops=hops)
    if scenario.arms is None:
        return timed
    local, remote = scenario.arms
    by_name = {unit.name: unit for unit in units}
    ways = {"lr": (local, remote), "rl": (remote, local), "loops_l": (local, local), "loops_r": (remote, remote)}
    return evolve(timed, **{key: _paths(timed, *way, by_name) for key, way in ways.items()})


def _units(wiring: Wiring) -> list[ScheduledComponent]:
    names = list(wiring.scenario.components)
    place = {signal: i for i, signal in enumerate(wiring.signals)}
    source = {link.target: link for link in wiring.links}
    units = []
    for name in names:
        links = [source[Signal(name, variable)] for variable in wiring.inputs(name)]
        ports = tuple(
            Port(names.index(link.source.component), place[str(link.source)], link.linear, link.gain, link.shift)
            for link in links
        )
        multiple, texts = wiring.scenario.components[name].step_multiple, bool(wiring.texts(name))
        units.append(ScheduledComponent(name, multiple, len(wiring.outputs(name)), ports, texts))
    return units


def _hop(wiring: Wiring, connection: Connection, units: list[ScheduledComponent]) -> Hop:
    a, b = connection.source.component, connection.target.component
    description = wiring.descriptions[b]
    targets = set(description.elements(connection.target.variable))
    links = [link for link in wiring.links if link.target.component == b and link.target.variable in targets]
    linear = all(link.linear for link in links)
    by_name = {unit.name: unit for unit in units}
    ahead = wiring.order.index(a) < wiring.order.index(b)
    experiment = wiring.scenario.experiment
    age = (
        Fraction(0) if linear else mean_age(experiment.algorithm, by_name[a], by_name[b], ahead, description.integrates)
    )
    unit = ", ".join(dict.fromkeys(wiring.descriptions[a].variables[x.source.variable].unit.name for x in links))
    return Hop(connection, len(links), unit, linear, float(age * experiment.step_ns) / 1e9)


def _paths(wiring: Wiring, start: str, end: str, units: Mapping[str, ScheduledComponent]) -> tuple[DelayPath, ...]:
    """Simple paths between components that pass through no arm on the way, with the age of each."""
    pairs: dict[tuple[str, str], bool] = {}
    for hop in wiring.hops:
        pair = hop.connection.source.component, hop.connection.target.component
        pairs[pair] = pairs.get(pair, True) and hop.linear
    arms = set(wiring.scenario.arms or ())
    found: list[tuple[str, ...]] = []
    stack: list[tuple[str, ...]] = [(start,)]
    while stack and len(found) < 64:
        path = stack.pop()
        for a, b in pairs:
            if a != path[-1]:
                continue
            if b == end:
                found.append((*path, b))
            elif b not in path and b not in arms:
                stack.append((*path, b))
    return tuple(DelayPath(p, _path_age(wiring, p, pairs, units)) for p in sorted(found, key=len))


def _path_age(
    wiring: Wiring,
    path: tuple[str, ...],
    linear: Mapping[tuple[str, str], bool],
    units: Mapping[str, ScheduledComponent],
) -> float:
    """Age of a path [s]: chains of held hops one by one, each ending where a hop is on a line or a component
    integrates.
    """
    experiment, age, chain = wiring.scenario.experiment, Fraction(0), [path[0]]
    for a, b in itertools.pairwise(path):
        integrates = wiring.descriptions[b].integrates
        if linear[a, b]:
            age += _chain_age(wiring, chain, units, False)
            chain = [b]
            continue
        chain.append(b)
        if integrates:
            age += _chain_age(wiring, chain, units, True)
            chain = [b]
    return float((age + _chain_age(wiring, chain, units, False)) * experiment.step_ns) / 1e9


def _chain_age(wiring: Wiring, chain: list[str], units: Mapping[str, ScheduledComponent], integrates: bool) -> Fraction:
    if len(chain) < 2:
        return Fraction(0)
    ahead = [wiring.order.index(a) < wiring.order.index(b) for a, b in itertools.pairwise(chain)]
    return chain_age(wiring.scenario.experiment.algorithm, [units[name] for name in chain], ahead, integrates)


def direction_table(wiring: Wiring) -> list[tuple[str, str, float]]:
    """(what, way, age [s]) of every direction and local path, for `cosim show` and the report."""
    rows = []
    for what, paths in (
        ("local to remote", wiring.lr),
        ("remote to local", wiring.rl),
        ("local path, local arm", wiring.loops_l),
        ("local path, remote arm", wiring.loops_r),
    ):
        rows += [(what, " → ".join(path.components), path.age) for path in paths]
    return rows
