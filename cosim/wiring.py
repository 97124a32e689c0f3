"""The wiring of a scenario, checked: units, causality, algebraic loops, stepping order, the delay of each connection."""

import math
from collections.abc import Iterable, Mapping
from fractions import Fraction
from functools import cached_property

from attrs import evolve, field, frozen

from cosim.errors import InputError, Problem, did_you_mean
from cosim.scenario import Algorithm, Connection, Extrapolation, Scenario, start_values
from cosim.schedule import Port, Schedule, Unit, build_schedule, chain_age, mean_age
from cosim.signals import Description, Signal, Variable, index_of, stem


@frozen
class Link:
    """One scalar output wired to one scalar input."""

    source: Signal
    target: Signal
    linear: bool


@frozen
class Hop:
    """What a connection adds: `age` [s] is the mean time by which the master makes the signal older (negative: newer)."""

    connection: Connection
    size: int
    unit: str
    linear: bool
    age: float


@frozen
class Path:
    """A way of a signal through components, and the mean age that it gains there [s], the channels' own delay not counted.

    With equal step multiples the age is the sum of the ages of the hops."""

    components: tuple[str, ...]
    age: float


@frozen
class Wiring:
    """A scenario that is wired up and checked.

    order: components in the order of stepping; links: scalar connections; starts: value of every FMU parameter that the
    scenario sets; lr, rl: paths from the local to the remote arm and back; loops_l, loops_r: local paths of either arm;
    notes: what the user should know.
    """

    scenario: Scenario
    descriptions: Mapping[str, Description]
    order: tuple[str, ...]
    links: tuple[Link, ...]
    starts: Mapping[str, Mapping[str, float | str]]
    hops: tuple[Hop, ...] = ()
    lr: tuple[Path, ...] = ()
    rl: tuple[Path, ...] = ()
    loops_l: tuple[Path, ...] = ()
    loops_r: tuple[Path, ...] = ()
    notes: tuple[str, ...] = ()
    schedule: Schedule = field(default=None, repr=False)

    @property
    def age_lr(self) -> float:
        """Mean age added from the local to the remote arm [s], over its paths; 0 without one."""
        return _mean(self.lr)

    @property
    def age_rl(self) -> float:
        """Mean age added from the remote to the local arm [s]."""
        return _mean(self.rl)

    @property
    def age_local(self) -> tuple[float, float]:
        """Mean age added on the local paths of the local and of the remote arm [s] (arm, its controller, arm)."""
        return _mean(self.loops_l), _mean(self.loops_r)

    def inputs(self, component: str) -> list[str]:
        """The component's wired inputs, in the order in which they are set: real ones first."""
        wired = {link.target.variable for link in self.links if link.target.component == component}
        return _by_type(v for v in self.descriptions[component].variables.values() if v.name in wired)

    def sloped(self, component: str) -> list[str]:
        """The component's inputs that move along lines, in the order of `inputs`."""
        linear = {link.target.variable for link in self.links if link.target.component == component and link.linear}
        return [name for name in self.inputs(component) if name in linear]

    def outputs(self, component: str) -> list[str]:
        """The component's outputs, in the order in which they are read: real ones first."""
        return _outputs(self.descriptions[component])

    @cached_property
    def signals(self) -> list[str]:
        """Names of all outputs, `arm_l.q[1]`, in the order of the store."""
        return [f"{name}.{output}" for name in self.scenario.components for output in self.outputs(name)]

    @cached_property
    def units(self) -> dict[str, str]:
        """Unit of every output."""
        return {f"{name}.{output}": self.descriptions[name].variables[output].unit.name
                for name in self.scenario.components for output in self.outputs(name)}  # fmt: skip


def wire(scenario: Scenario, descriptions: Mapping[str, Description]) -> Wiring:
    """Wire the scenario's components, given the description of each. Raises InputError with every problem found."""
    wiring, problems = check(scenario, descriptions)
    if problems:
        raise InputError(problems)
    return wiring


def restarted(wiring: Wiring, scenario: Scenario) -> Wiring | None:
    """The wiring of a scenario that differs in start values only, without wiring anew; None where it differs in more.

    Raises InputError for values that do not fit.
    """
    if not _same_structure(wiring.scenario, scenario):
        return None
    problems: list[Problem] = []
    old = wiring.scenario.components
    starts = {name: wiring.starts[name] if component == old[name] else _starts(scenario, name, wiring.descriptions[name], problems)
              for name, component in scenario.components.items()}  # fmt: skip
    if problems:
        raise InputError(problems)
    return evolve(wiring, scenario=scenario, starts=starts)


def _same_structure(one: Scenario, other: Scenario) -> bool:
    if (one.connections, one.experiment, one.teleoperation, one.folder) != (
        other.connections, other.experiment, other.teleoperation, other.folder,
    ) or list(one.components) != list(other.components):  # fmt: skip
        return False
    pairs = zip(one.components.values(), other.components.values())
    return all(a == b or evolve(a, parameters={}, parameter_set=None) == evolve(b, parameters={}, parameter_set=None) for a, b in pairs)


def check(scenario: Scenario, descriptions: Mapping[str, Description]) -> tuple[Wiring | None, list[Problem]]:
    """As `wire`, but returns the problems; the wiring is None where there are any."""
    problems: list[Problem] = []
    starts = {name: _starts(scenario, name, descriptions[name], problems) for name in scenario.components}
    links = _links(scenario, descriptions, problems)
    problems += _driven_twice(links) + _loops(links, descriptions) + _timing(scenario)
    notes = _unwired(scenario, descriptions, links, starts, problems) + _assumed(links, descriptions)
    problems += _instances(scenario, descriptions)
    if problems:
        return None, problems
    order = scenario.experiment.order or stepping_order(scenario, descriptions, links)
    wiring = Wiring(scenario, descriptions, tuple(order), tuple(links), starts, notes=tuple(notes))
    return _timed(wiring), []


def _mean(paths: tuple[Path, ...]) -> float:
    return sum(path.age for path in paths) / len(paths) if paths else 0.0


# --- variables and links --------------------------------------------------------------------------------------------


_TYPES = {"Real": 0, "Float64": 0, "Float32": 1, "Boolean": 3, "String": 4, "Binary": 5, "Clock": 6}


def is_real(variable: Variable) -> bool:
    """Whether the variable is a double."""
    return _TYPES.get(variable.type, 2) == 0


def _by_type(variables: Iterable[Variable]) -> list[str]:
    return [v.name for v in sorted(variables, key=lambda v: _TYPES.get(v.type, 2))]


def _outputs(description: Description) -> list[str]:
    return _by_type(v for v in description.variables.values() if v.causality == "output" and _TYPES.get(v.type, 2) < 4)


def _links(scenario: Scenario, descriptions: Mapping[str, Description], problems: list[Problem]) -> list[Link]:
    links = []
    for connection in scenario.connections:
        sources = _ends(connection.source, "output", connection, descriptions, problems)
        targets = _ends(connection.target, "input", connection, descriptions, problems)
        if not sources or not targets:
            continue
        if len(sources) != len(targets):
            problems.append(Problem(f"connection {connection}", f"as many inputs as outputs ({len(sources)})", str(len(targets))))
            continue
        problems += _unit_problems(connection, sources, targets, descriptions)
        links += [_link(scenario, connection, *pair, descriptions) for pair in zip(sources, targets)]
    return links


def _ends(end: Signal, causality: str, connection: Connection, descriptions, problems: list[Problem]) -> list[str]:
    """The scalar variables at one end of a connection; empty, and a problem, where they are not there or of another causality."""
    description = descriptions.get(end.component)
    if description is None:
        return []
    names, where = description.elements(end.variable), f"connection {connection}"
    if not names:
        known = dict.fromkeys([*description.stems(causality), *description.names(causality)])
        problems.append(Problem(where, f"an {causality} of {description.model}", repr(end.variable),
                                did_you_mean(end.variable, known) or f"{causality}s: {', '.join(description.stems(causality))}"))
        return []
    other = {description.variables[name].causality for name in names} - {causality}
    if other:
        problems.append(Problem(where, f"an {causality} at {end}", f"a variable of causality {other.pop()}"))
        return []
    return names


def _unit_problems(connection: Connection, sources, targets, descriptions) -> list[Problem]:
    """One problem for each pair of different units in a connection."""
    found = {}
    for source, target in zip(sources, targets):
        a = descriptions[connection.source.component].variables[source].unit
        b = descriptions[connection.target.component].variables[target].unit
        if not a.joins(b):
            found[a.name, b.name] = Problem(f"connection {connection}", f"the unit of the input, {b.name!r}", repr(a.name),
                                            "different units are not joined")  # fmt: skip
    return list(found.values())


def _link(scenario: Scenario, connection: Connection, source: str, target: str, descriptions) -> Link:
    ends = Signal(connection.source.component, source), Signal(connection.target.component, target)
    producer, consumer = (descriptions[end.component] for end in ends)
    a, b = producer.variables[source], consumer.variables[target]
    wanted = scenario.experiment.extrapolation is Extrapolation.LINEAR
    able = consumer.takes_slopes and (not consumer.fmi.startswith("3") or b.slope is not None)
    return Link(*ends, wanted and able and is_real(a) and is_real(b))


def _driven_twice(links: list[Link]) -> list[Problem]:
    drivers: dict[Signal, list[Signal]] = {}
    for link in links:
        drivers.setdefault(link.target, []).append(link.source)
    twice = {t: s for t, s in drivers.items() if len(s) > 1}
    merged = {(t.component, stem(t.variable), tuple((x.component, stem(x.variable)) for x in s)) for t, s in twice.items()}
    return [Problem(f"input {component}.{name}", "one source", " and ".join(f"{c}.{v}" for c, v in sources),
                    "remove one of the connections") for component, name, sources in sorted(merged)]  # fmt: skip


def _unwired(scenario: Scenario, descriptions, links, starts, problems: list[Problem]) -> list[str]:
    """Notes on inputs that no connection drives and that keep their start value; a problem where they have none."""
    driven = {link.target for link in links}
    notes = []
    for name in scenario.components:
        description = descriptions[name]
        free = [v for v in description.variables.values() if v.causality == "input" and Signal(name, v.name) not in driven]
        free = [v for v in free if not v.name.startswith("der(")]
        lost = [v.name for v in free if v.start is None and v.name not in starts[name] and is_real(v)]
        if lost:
            problems.append(Problem(f"component {name}", f"a connection to {', '.join(lost)}", "none", "it has no start value"))
        held = dict.fromkeys(stem(v.name) for v in free if v.name not in lost)
        if held:
            notes.append(f"{name}: {', '.join(held)} not wired, {'stay' if len(held) > 1 else 'stays'} at the start value")
    return notes


def _instances(scenario: Scenario, descriptions) -> list[Problem]:
    """Problems of FMUs that allow one instance in a process and are used more often."""
    used: dict[str, list[str]] = {}
    for name in scenario.components:
        if descriptions[name].single_instance:
            used.setdefault(descriptions[name].path, []).append(name)
    return [Problem(f"components {', '.join(names)}", "one instance: the FMU allows no more in a process", str(len(names)))
            for names in used.values() if len(names) > 1]  # fmt: skip


def _timing(scenario: Scenario) -> list[Problem]:
    steps = scenario.experiment.steps
    period = math.lcm(*(max(c.step_multiple, 1) for c in scenario.components.values())) if scenario.components else 1
    problems = [Problem(f"component {name}", "a stop time of whole steps of the component", f"{steps} steps of "
                        f"{scenario.experiment.step} s by {c.step_multiple}")
                for name, c in scenario.components.items() if c.step_multiple > 1 and steps % c.step_multiple]  # fmt: skip
    if period > 10_000:
        problems.append(Problem("step_multiple", "multiples that meet again within 10000 steps", f"{period} steps"))
    return problems


# --- start values -------------------------------------------------------------------------------------------------------


_SETTABLE = {"parameter", "input", "structuralParameter"}


def _starts(scenario: Scenario, name: str, description: Description, problems: list[Problem]) -> dict[str, float | str]:
    """Values of single FMU variables that the scenario sets: lists spread, one value for a vector repeated, items by name."""
    component, where = scenario.components[name], f"{scenario.name}: {name}"
    values: dict[str, float | str] = {}
    known = dict.fromkeys([*description.stems("parameter"), *description.names("parameter")])
    for key, value in start_values(component).items():
        names = description.elements(key)
        if not names:
            problems.append(Problem(f"{where}.{key}", f"a parameter of {description.model}", "an unknown one", did_you_mean(key, known)))
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
    return values


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
        problems.append(Problem(where, " or ".join(map(repr, variable.items)), repr(value), did_you_mean(value, variable.items)))
        return None
    if not isinstance(value, (bool, int, float)) or not math.isfinite(value):
        problems.append(Problem(where, "a finite number", repr(value)))
        return None
    low = -math.inf if variable.minimum is None else variable.minimum
    high = math.inf if variable.maximum is None else variable.maximum
    if not low <= value <= high:
        problems.append(Problem(where, f"a value in [{low:g}, {high:g}] {variable.unit.name}".rstrip(), repr(value)))
        return None
    if _TYPES.get(variable.type, 2) == 2 and value != int(value):
        problems.append(Problem(where, "a whole number", repr(value)))
        return None
    return value


# --- loops and order ----------------------------------------------------------------------------------------------------


def _edges(links: Iterable[Link], descriptions, assumed: bool) -> dict[Signal, list[Signal]]:
    """Instantaneous influence between signals: links, and inputs on outputs within an FMU (unstated ones where `assumed`)."""
    edges: dict[Signal, list[Signal]] = {}
    wired: dict[str, list[str]] = {}
    for link in links:
        edges.setdefault(link.source, []).append(link.target)
        wired.setdefault(link.target.component, []).append(link.target.variable)
    for name, inputs in wired.items():
        for output in _outputs(descriptions[name]):
            through = descriptions[name].variables[output].feedthrough
            acting = (inputs if assumed else []) if through is None else [i for i in inputs if i in through]
            for variable in acting:
                edges.setdefault(Signal(name, variable), []).append(Signal(name, output))
    return edges


def _cycle(edges: dict[Signal, list[Signal]]) -> list[Signal]:
    """One cycle of the graph, empty where there is none (depth-first, iterative)."""
    done: set[Signal] = set()
    for root in edges:
        path, stack = [], [(root, iter(edges.get(root, ())))]
        path.append(root)
        while stack:
            node, following = stack[-1]
            after = next((n for n in following if n not in done), None)
            if after is None:
                done.add(node)
                stack.pop()
                path.pop()
            elif after in path:
                return path[path.index(after) :] + [after]
            else:
                path.append(after)
                stack.append((after, iter(edges.get(after, ()))))
    return []


def _loops(links: list[Link], descriptions) -> list[Problem]:
    loop = _cycle(_edges(links, descriptions, assumed=False))
    if not loop:
        return []
    return [Problem("wiring", "no algebraic loop", " -> ".join(map(str, loop)),
                    "put an FMU with a state or a delay between them")]  # fmt: skip


def _assumed(links: list[Link], descriptions) -> list[str]:
    """A note where FMUs that state no dependencies may close an algebraic loop."""
    loop = _cycle(_edges(links, descriptions, assumed=True))
    if not loop or _cycle(_edges(links, descriptions, assumed=False)):
        return []
    silent = sorted({s.component for s in loop if any(v.feedthrough is None for v in descriptions[s.component].variables.values())})
    return [f"possible algebraic loop {' -> '.join(map(str, loop))}: {', '.join(silent)} states no dependencies"]


def stepping_order(scenario: Scenario, descriptions: Mapping[str, Description], links: Iterable[Link]) -> list[str]:
    """Order for Gauss-Seidel: sources, then components whose wired inputs act only through states (integrating ones first,
    sampled ones behind them), then the others with every producer of an instantaneous signal ahead of its consumer;
    within a rank as declared.

    So a loop through an arm, a channel and a controller is cut once, at the arm's input, and nowhere else.
    """
    links = list(links)
    fed = {link.target.component for link in links}
    through = _feedthrough(links, descriptions)
    names = list(scenario.components)
    stateful = sorted((n for n in names if n in fed and n not in through), key=lambda n: not descriptions[n].integrates)
    order = [n for n in names if n not in fed] + stateful
    waiting = [n for n in names if n in fed and n in through]
    while waiting:
        ready = [n for n in waiting if not any(l.source.component in waiting and l.source.component != n
                                               for l in links if l.target.component == n
                                               and l.target.variable in through[n])]  # fmt: skip
        chosen = ready[0] if ready else waiting[0]
        order.append(chosen)
        waiting.remove(chosen)
    return order


def _feedthrough(links: list[Link], descriptions) -> dict[str, set[str]]:
    """For each component the wired inputs that act at once on one of its wired outputs; components without any are left out."""
    read = {link.source for link in links}
    found: dict[str, set[str]] = {}
    for link in links:
        name = link.target.component
        for output in _outputs(descriptions[name]):
            acting = descriptions[name].variables[output].feedthrough
            if Signal(name, output) in read and (acting is None or link.target.variable in acting):
                found.setdefault(name, set()).add(link.target.variable)
    return found


# --- schedule and ages ------------------------------------------------------------------------------------------------------


def _timed(wiring: Wiring) -> Wiring:
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


def _units(wiring: Wiring) -> list[Unit]:
    names = list(wiring.scenario.components)
    place = {signal: i for i, signal in enumerate(wiring.signals)}
    source = {link.target: link for link in wiring.links}
    units = []
    for name in names:
        links = [source[Signal(name, variable)] for variable in wiring.inputs(name)]
        ports = tuple(Port(names.index(l.source.component), place[str(l.source)], l.linear) for l in links)
        units.append(Unit(name, wiring.scenario.components[name].step_multiple, len(wiring.outputs(name)), ports))
    return units


def _hop(wiring: Wiring, connection: Connection, units: list[Unit]) -> Hop:
    a, b = connection.source.component, connection.target.component
    description = wiring.descriptions[b]
    targets = set(description.elements(connection.target.variable))
    links = [l for l in wiring.links if l.target.component == b and l.target.variable in targets]
    linear = all(link.linear for link in links)
    by_name = {unit.name: unit for unit in units}
    ahead = wiring.order.index(a) < wiring.order.index(b)
    experiment = wiring.scenario.experiment
    age = Fraction(0) if linear else mean_age(experiment.algorithm, by_name[a], by_name[b], ahead, description.integrates)
    unit = wiring.descriptions[a].variables[links[0].source.variable].unit.name
    return Hop(connection, len(links), unit, linear, float(age * experiment.step_ns) / 1e9)


def _paths(wiring: Wiring, start: str, end: str, units: Mapping[str, Unit]) -> tuple[Path, ...]:
    """Simple paths between components that pass through no arm on the way, with the age of each."""
    pairs: dict[tuple[str, str], bool] = {}
    for hop in wiring.hops:
        pair = hop.connection.source.component, hop.connection.target.component
        pairs[pair] = pairs.get(pair, True) and hop.linear
    arms = set(wiring.scenario.arms or ())
    found, stack = [], [(start,)]
    while stack and len(found) < 64:
        path = stack.pop()
        for a, b in pairs:
            if a != path[-1]:
                continue
            if b == end:
                found.append(path + (b,))
            elif b not in path and b not in arms:
                stack.append(path + (b,))
    return tuple(Path(p, _path_age(wiring, p, pairs, units)) for p in sorted(found, key=len))


def _path_age(wiring: Wiring, path: tuple[str, ...], linear: Mapping[tuple[str, str], bool], units: Mapping[str, Unit]) -> float:
    """Age of a path [s]: chains of held hops one by one, each ending where a hop is on a line or a component integrates."""
    experiment, age, chain = wiring.scenario.experiment, Fraction(0), [path[0]]
    for a, b in zip(path, path[1:]):
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


def _chain_age(wiring: Wiring, chain: list[str], units: Mapping[str, Unit], integrates: bool) -> Fraction:
    if len(chain) < 2:
        return Fraction(0)
    ahead = [wiring.order.index(a) < wiring.order.index(b) for a, b in zip(chain, chain[1:])]
    return chain_age(wiring.scenario.experiment.algorithm, [units[name] for name in chain], ahead, integrates)


def direction_table(wiring: Wiring) -> list[tuple[str, str, float]]:
    """(what, way, age [s]) of every direction and local path, for `cosim show` and the report."""
    rows = []
    for what, paths in (("local to remote", wiring.lr), ("remote to local", wiring.rl),
                        ("local path, local arm", wiring.loops_l), ("local path, remote arm", wiring.loops_r)):  # fmt: skip
        rows += [(what, " → ".join(path.components), path.age) for path in paths]
    return rows


def vector_starts(starts: Mapping[str, float | str]) -> dict[str, list]:
    """Start values by stem, elements in order: for tables."""
    groups: dict[str, list[tuple[int, object]]] = {}
    for name, value in starts.items():
        groups.setdefault(stem(name), []).append((index_of(name), value))
    return {key: [value for _, value in sorted(entries, key=lambda e: e[0])] for key, entries in groups.items()}
