"""FMUs made of Python functions, with the timing that ours have, so that the master can be tested without a compiler.

A sampled fake acts at the end of a step on the input extrapolated to that end; a continuous one integrates with classic
Runge-Kutta over the input u + du/dt (t - t_n).
"""

import numpy as np

from cosim.errors import RunError
from cosim.fmu.contract import Instance
from cosim.scenario import Component, Connection, Experiment, Scenario, Teleoperation
from cosim.signals import FmuDescription, Signal, Unit, Variable
from cosim.wiring import wire


def variable(name, causality, unit="m", **more):
    if causality in ("input", "parameter"):
        more.setdefault("start", 0.0)
    return Variable(name, causality, unit=Unit(unit), **more)


def description(model, *variables, **more):
    more.setdefault("takes_slopes", True)
    return FmuDescription(model, {v.name: v for v in variables}, **more)


class FakeInstance(Instance):
    """An instance of functions over a dictionary `v` of all its variables (and what else it wants to remember)."""

    def __init__(self, name, description, begin=None, advance=None, outputs=None):
        super().__init__(name, description)
        self.on_begin, self.on_advance, self.on_outputs = begin, advance, outputs
        self.v, self.slope, self.calls = {}, {}, []

    def wire(self, inputs, sloped, outputs):
        super().wire(inputs, sloped, outputs)
        self.sloped = sloped

    def start(self, values):
        self.v = {v.name: v.start if v.start is not None else 0.0 for v in self.description.variables.values()} | dict(
            values
        )
        self.slope, self.time, self.begun = {}, 0.0, False
        if self.on_begin:
            self.on_begin(self.v)

    def begin(self):
        self.begun = True

    def set(self):
        self.v.update(zip(self.input_names, self.inputs.tolist()))
        self.slope = dict(zip(self.sloped, self.slopes.tolist()))

    def get(self):
        if self.on_outputs:
            self.on_outputs(self.v, self.time)
        self.outputs[:] = [self.v[name] for name in self.output_names]

    def step(self, time, size):
        self.calls.append((time, size))
        try:
            going = self.on_advance(self.v, self.slope, time, size) if self.on_advance else True
        except ArithmeticError as error:
            raise RunError(self.name, time, str(error)) from None
        self.time = time + size
        for name, slope in self.slope.items():
            self.v[name] += slope * size
        return going is not False


def integrator(derivative, states):
    """advance() of a continuous fake: classic Runge-Kutta on v[states], derivative(v, t) -> list."""

    def advance(v, slope, time, size):
        start = dict(v)

        def rate(offset, x):
            at = start | dict(zip(states, x)) | {n: start[n] + s * offset for n, s in slope.items()}
            return np.array(derivative(at, time + offset), dtype=float)

        x = np.array([v[s] for s in states], dtype=float)
        k1 = rate(0.0, x)
        k2 = rate(size / 2, x + size / 2 * k1)
        k3 = rate(size / 2, x + size / 2 * k2)
        k4 = rate(size, x + size * k3)
        v.update(zip(states, (x + size / 6 * (k1 + 2 * k2 + 2 * k3 + k4)).tolist()))

    return advance


class FakeSystem:
    """Instances by component name, made of factories model -> (name, description) -> instance."""

    def __init__(self, scenario, models):
        self.models = models
        self.descriptions = {name: models[c.model][0] for name, c in scenario.components.items()}
        self.prepared = {}
        self.made = {name: models[c.model][1](name, self.descriptions[name]) for name, c in scenario.components.items()}

    def wiring(self, scenario):
        return wire(scenario, self.descriptions)

    def instances(self, wiring):
        return [self.made[name] for name in wiring.scenario.components]


def scenario(components, connections, **more):
    """A scenario of fakes: components name -> Component or model name; connections as text."""
    teleoperation = more.pop("teleoperation", Teleoperation())
    parts = {n: c if isinstance(c, Component) else Component(model=c) for n, c in components.items()}
    wires = []
    for text in connections:
        ends = [Signal(*end.strip().split(".", 1)) for end in text.split("->")]
        wires.append(Connection(*ends))
    return Scenario("fake", Experiment(**({"stop": 1.0} | more)), parts, tuple(wires), teleoperation=teleoperation)


# An oscillator loop: a mass driven by a sampled spring and damper; x'' = f, f = -k x - b v.
MASS = (
    description(
        "Mass",
        variable("f", "input", "N"),
        variable("x", "output", feedthrough=()),
        variable("v", "output", "m/s", feedthrough=()),
        variable("x0", "parameter"),
        variable("domain", "output", "1", feedthrough=()),
        integrates=True,
    ),
    lambda name, d: FakeInstance(
        name,
        d,
        begin=lambda v: v.update(x=v["x0"], v=0.0, domain=1.0),
        advance=integrator(lambda v, t: [v["v"], v["f"]], ["x", "v"]),
    ),
)
SPRING = (
    description(
        "Spring",
        variable("x", "input"),
        variable("v", "input", "m/s"),
        variable("f", "output", "N", feedthrough=("x", "v")),
        variable("k", "parameter", "N/m", start=4.0, minimum=0.0),
        variable("b", "parameter", "N.s/m", start=0.4),
    ),
    lambda name, d: FakeInstance(name, d, outputs=lambda v, t: v.update(f=-v["k"] * v["x"] - v["b"] * v["v"])),
)
MODELS = {"Mass": MASS, "Spring": SPRING}
LOOP = ["mass.x -> spring.x", "mass.v -> spring.v", "spring.f -> mass.f"]


def oscillator(**more):
    return scenario({"mass": Component(model="Mass", parameters={"x0": 1.0}), "spring": "Spring"}, LOOP, **more)
