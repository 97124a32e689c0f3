"""What a wiring is: links between scalars, their ages, the order of stepping, the schedule."""

from collections.abc import Mapping
from functools import cached_property

from attrs import field, frozen

from cosim.scenario import Connection, Conversion, Scenario
from cosim.signals import FmuDescription, Linear, Signal, by_type
from cosim.wiring.schedule import Schedule


@frozen
class Link:
    """One scalar output wired to one scalar input: input = gain output + shift, which turns units into each other, or
    does what the scenario wishes.

    conversion: what the scenario wishes to be done to the value; text: it carries a text or bytes.
    """

    source: Signal
    target: Signal
    linear: bool
    gain: float = 1.0
    shift: float = 0.0
    conversion: Conversion | Linear | None = None
    text: bool = False

    @property
    def scaled(self) -> bool:
        """Whether the value changes on its way."""
        return (self.gain, self.shift) != (1.0, 0.0)


@frozen
class Hop:
    """What a connection adds: `age` [s] is the mean delay that the stepping adds (negative: ahead)."""

    connection: Connection
    size: int
    unit: str
    linear: bool
    age: float


@frozen
class DelayPath:
    """A way of a signal through components, and the mean age that it gains there [s], the channels' own delay not
    counted.

    With equal step multiples the age is the sum of the ages of the hops.
    """

    components: tuple[str, ...]
    age: float


@frozen
class Wiring:
    """A scenario that is wired up and checked.

    order: components in the order of stepping; links: scalar connections; starts: value of every FMU parameter that the
    scenario sets; lr, rl: paths from the local to the remote arm and back; loops_l, loops_r: local paths of either arm;
    notes: what the user should know; warnings: those of them that are said before anything else; beside: variables of
    each component that are recorded beside its outputs.
    """

    scenario: Scenario
    descriptions: Mapping[str, FmuDescription]
    order: tuple[str, ...]
    links: tuple[Link, ...]
    starts: Mapping[str, Mapping[str, float | str]]
    hops: tuple[Hop, ...] = ()
    lr: tuple[DelayPath, ...] = ()
    rl: tuple[DelayPath, ...] = ()
    loops_l: tuple[DelayPath, ...] = ()
    loops_r: tuple[DelayPath, ...] = ()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    schedule: Schedule = field(default=None, repr=False)
    beside: Mapping[str, tuple[str, ...]] = field(factory=dict)

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

    def start(self, component: str, variable: str) -> float:
        """Start value of a component's numeric variable: the scenario's, else that of the FMU itself."""
        return self.descriptions[component].start(variable, self.starts[component])

    def inputs(self, component: str) -> list[str]:
        """The component's wired inputs, in the order in which they are set: real ones first."""
        wired = {link.target.variable for link in self.links if link.target.component == component and not link.text}
        return by_type(v for v in self.descriptions[component].variables.values() if v.name in wired)

    def sloped(self, component: str) -> list[str]:
        """The component's inputs that move along lines, in the order of `inputs`."""
        linear = {link.target.variable for link in self.links if link.target.component == component and link.linear}
        return [name for name in self.inputs(component) if name in linear]

    def outputs(self, component: str) -> list[str]:
        """The component's outputs and what is recorded beside them, in the order in which they are read: real ones
        first.
        """
        description, beside = self.descriptions[component], self.beside.get(component)
        if not beside:
            return list(description.outputs)
        return by_type(description.variables[name] for name in (*description.outputs, *beside))

    def conversions(self, component: str) -> dict[str, Conversion]:
        """Conversions that the scenario wishes for the component's inputs."""
        mine = (link for link in self.links if link.target.component == component)
        return {link.target.variable: link.conversion for link in mine if isinstance(link.conversion, Conversion)}

    def texts(self, component: str) -> list[Link]:
        """Links that carry texts or bytes to the component."""
        return [link for link in self.links if link.text and link.target.component == component]

    @cached_property
    def signals(self) -> list[str]:
        """Names of all outputs, `arm_l.q[1]`, in the order of the store."""
        return [f"{name}.{output}" for name in self.scenario.components for output in self.outputs(name)]

    @cached_property
    def units(self) -> dict[str, str]:
        """Unit of every output."""
        return {
            f"{name}.{output}": self.descriptions[name].variables[output].unit.name
            for name in self.scenario.components
            for output in self.outputs(name)
        }


def _mean(paths: tuple[DelayPath, ...]) -> float:
    return sum(path.age for path in paths) / len(paths) if paths else 0.0


def resolved_starts(wiring: Wiring) -> dict[str, float | str]:
    """Every start value of a run by `component.variable`: what the scenario sets, else what the FMU declares."""
    found: dict[str, float | str] = {}
    for component, description in wiring.descriptions.items():
        given = wiring.starts[component]
        for name, variable in description.variables.items():
            value = given.get(name, variable.start)
            if value is not None:
                found[f"{component}.{name}"] = value
    return found
