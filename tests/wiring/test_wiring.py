"""Wiring: what is refused, in which order components step, and how old signals get."""

from fractions import Fraction

import pytest

from cosim.engine.master import run
from cosim.errors import InputError
from cosim.scenario import Algorithm, Component, Extrapolation, Teleoperation
from cosim.wiring.schedule import ScheduledComponent, mean_age
from cosim.wiring.structure import of_structure
from tests.support.fakes import (
    LOOP,
    MODELS,
    FakeInstance,
    FakeSystem,
    description,
    integrator,
    oscillator,
    scenario,
    variable,
)


def problems(made, models=MODELS):
    with pytest.raises(InputError) as caught:
        FakeSystem(made, models).wiring(made)
    return [str(problem) for problem in caught.value.problems]


def test_every_mistake_is_listed():
    parts = {
        "mass": Component(model="Mass", parameters={"x9": 1.0, "x0": [1.0, 2.0]}),
        "spring": Component(model="Spring", parameters={"k": -1.0}),
    }
    wires = [
        "mass.x -> spring.v",
        "mass.x -> spring.x",
        "mass.v -> spring.x",
        "mass.xx -> spring.x",
        "spring.f -> mass.x",
    ]
    found = problems(scenario(parts, wires))
    assert len(found) == 8
    for words in (
        "mass.x9: expected a parameter",
        "mass.x0: expected 1 values, got 2",
        "spring.k: expected a value in [0, inf] N/m, got -1",
        "connection mass.x -> spring.v: expected the unit of the input, 'm/s', got 'm'",
        "connection mass.v -> spring.x: expected the unit of the input, 'm', got 'm/s'",
        "connection mass.xx -> spring.x: expected an output of Mass",
        "an input at mass.x, got a variable of causality output",
        "input spring.x: expected one source",
    ):
        assert any(words in p for p in found), words


def test_radians_are_counted():
    a = description("A", variable("y", "output", "rad/s", feedthrough=()))
    b = description("B", variable("u", "input", "rad"))
    models = {"A": (a, lambda n, d: FakeInstance(n, d)), "B": (b, lambda n, d: FakeInstance(n, d))}
    assert "'rad'" in problems(scenario({"a": "A", "b": "B"}, ["a.y -> b.u"]), models)[0]


def test_an_input_without_start_value_must_be_wired():
    b = description("B", variable("u", "input", start=None))
    assert "a connection to u" in problems(scenario({"b": "B"}, []), {"B": (b, lambda n, d: FakeInstance(n, d))})[0]


def test_unwired_inputs_are_reported():
    made = scenario({"mass": "Mass"}, [])
    assert FakeSystem(made, MODELS).wiring(made).notes == ("mass: f not wired, stays at the start value",)


def test_components_without_connections_are_a_warning():
    (warning,) = FakeSystem(made := scenario({"mass": "Mass", "spring": "Spring"}, []), MODELS).wiring(made).warnings
    assert warning.startswith("no connections: the components do not act on each other")
    for quiet in (scenario({"mass": "Mass"}, []), oscillator()):
        assert FakeSystem(quiet, MODELS).wiring(quiet).warnings == ()


def through(dependencies):
    gain = description("Gain", variable("u", "input"), variable("y", "output", feedthrough=dependencies))
    return {"Gain": (gain, lambda n, d: FakeInstance(n, d, outputs=lambda v, t: v.update(y=0.5 * v["u"])))}


def test_algebraic_loops_are_refused_where_fmus_state_them():
    made = scenario({"a": "Gain", "b": "Gain"}, ["a.y -> b.u", "b.y -> a.u"])
    (found,) = problems(made, through(("u",)))
    assert (
        "no algebraic loop" in found and "a.u -> a.y -> b.u -> b.y -> a.u" in "a.u -> " + found.partition("got ")[2]
    ) or "a.y" in found


def test_unstated_dependencies_give_a_note():
    made = scenario({"a": "Gain", "b": "Gain"}, ["a.y -> b.u", "b.y -> a.u"])
    notes = FakeSystem(made, through(None)).wiring(made).notes
    assert any("possible algebraic loop" in note for note in notes)


def test_vectors_are_spread_and_sizes_compared():
    a = description("A", *(variable(f"x[{i}]", "output", feedthrough=()) for i in (1, 2, 3)))
    b = description(
        "B", *(variable(f"u[{i}]", "input") for i in (1, 2, 3)), variable("w[1]", "input"), variable("w[2]", "input")
    )
    models = {"A": (a, lambda n, d: FakeInstance(n, d)), "B": (b, lambda n, d: FakeInstance(n, d))}
    made = scenario({"a": "A", "b": "B"}, ["a.x -> b.u", "a.x[3] -> b.w[1]"])
    assert [f"{link.source} {link.target}" for link in FakeSystem(made, models).wiring(made).links] == [
        "a.x[1] b.u[1]",
        "a.x[2] b.u[2]",
        "a.x[3] b.u[3]",
        "a.x[3] b.w[1]",
    ]
    assert "as many inputs as outputs (3), got 2" in problems(scenario({"a": "A", "b": "B"}, ["a.x -> b.w"]), models)[0]


def test_sources_then_states_then_feedthrough():
    made = scenario({"spring": "Spring", "mass": "Mass"}, LOOP)
    assert FakeSystem(made, MODELS).wiring(made).order == ("mass", "spring")
    fixed = scenario({"spring": "Spring", "mass": "Mass"}, LOOP, order=("spring", "mass"))
    assert FakeSystem(fixed, MODELS).wiring(fixed).order == ("spring", "mass")


# --- ages: measured with a ramp. Through the chain source (t) -> relay (sampled) -> integral (continuous), the
# integral is
# --- t^2/2 - age t to the last bit that the ramp allows, once a whole period of the schedule has passed.

SOURCE = description("Source", variable("y", "output", feedthrough=()))
RELAY = description("Relay", variable("u", "input"), variable("y", "output", feedthrough=("u",)))
INTEGRAL = description(
    "Integral", variable("u", "input"), variable("s", "output", "m.s", feedthrough=()), integrates=True
)
CHAIN = {
    "Source": (SOURCE, lambda n, d: FakeInstance(n, d, outputs=lambda v, t: v.update(y=t))),
    "Relay": (RELAY, lambda n, d: FakeInstance(n, d, outputs=lambda v, t: v.update(y=v["u"]))),
    "Integral": (
        INTEGRAL,
        lambda n, d: FakeInstance(
            n, d, begin=lambda v: v.update(s=0.0), advance=integrator(lambda v, t: [v["u"]], ["s"])
        ),
    ),
}


def chain(multiples, **more):
    parts = {
        name: Component(model=name.capitalize(), step_multiple=k)
        for name, k in zip(("source", "relay", "integral"), multiples)
    }
    more.setdefault("teleoperation", Teleoperation("source", "integral"))
    return scenario(parts, ["source.y -> relay.u", "relay.y -> integral.u"], step=0.01, **more)


@pytest.mark.parametrize("multiples", [(1, 1, 1), (1, 3, 1), (3, 1, 1), (1, 1, 3), (2, 3, 1), (4, 1, 2), (2, 4, 3)])
@pytest.mark.parametrize(
    "order", [(), ("integral", "relay", "source"), ("relay", "integral", "source"), ("integral", "source", "relay")]
)
@pytest.mark.parametrize("algorithm", list(Algorithm))
def test_the_age_of_held_signals_is_what_the_wiring_says(algorithm, order, multiples):
    made = chain(multiples, stop=1.2 * 4, algorithm=algorithm, extrapolation=Extrapolation.HOLD, order=order)
    system = FakeSystem(made, CHAIN)
    (path,) = system.wiring(made).lr
    result = run(made, system, executor=python())
    # over the last 2.4 s: growth of the integral = ramp's own growth - age * 2.4 (the ramp's start-up is over by then)
    half = len(result.time) // 2
    s = result.signals["integral.s"]
    grown = (result.time[-1] ** 2 - result.time[half] ** 2) / 2
    assert (grown - (s[-1] - s[half])) / 2.4 == pytest.approx(path.age, abs=1e-12)


@pytest.mark.parametrize("multiples", [(1, 1, 1), (1, 3, 1), (3, 1, 1), (2, 4, 3)])
@pytest.mark.parametrize("order", [(), ("integral", "relay", "source")])
@pytest.mark.parametrize("algorithm", list(Algorithm))
def test_signals_on_lines_have_no_age(algorithm, order, multiples):
    made = chain(multiples, stop=4.8, algorithm=algorithm, extrapolation=Extrapolation.LINEAR, order=order)
    system = FakeSystem(made, CHAIN)
    assert system.wiring(made).age_lr == 0.0
    result = run(made, system, executor=python())
    half, s = len(result.time) // 2, result.signals["integral.s"]
    # a ramp is its own line: extrapolation is exact, up to rounding
    assert s[-1] - s[half] == pytest.approx((result.time[-1] ** 2 - result.time[half] ** 2) / 2, abs=1e-11)


def python():
    from cosim.engine.reference import execute

    return execute


def test_the_hop_table():
    one = ScheduledComponent("p", 1, 1, ()), ScheduledComponent("c", 1, 1, ())
    assert mean_age(Algorithm.JACOBI, *one, True, False) == 1
    assert mean_age(Algorithm.JACOBI, *one, True, True) == Fraction(1, 2)
    assert mean_age(Algorithm.GAUSS_SEIDEL, *one, True, False) == 0
    assert mean_age(Algorithm.GAUSS_SEIDEL, *one, True, True) == Fraction(-1, 2)
    assert mean_age(Algorithm.GAUSS_SEIDEL, *one, False, False) == 1
    assert mean_age(Algorithm.GAUSS_SEIDEL, *one, False, True) == Fraction(1, 2)


def test_an_fmu_that_takes_no_slopes_is_held():
    deaf = {
        "Mass": (
            description("Mass", *MODELS["Mass"][0].variables.values(), takes_slopes=False, integrates=True),
            MODELS["Mass"][1],
        ),
        "Spring": MODELS["Spring"],
    }
    made = oscillator(extrapolation=Extrapolation.LINEAR)
    hops = {str(h.connection): h for h in FakeSystem(made, deaf).wiring(made).hops}
    assert not hops["spring.f -> mass.f"].linear and hops["spring.f -> mass.f"].age == pytest.approx(0.5e-3)
    assert hops["mass.x -> spring.x"].linear


def test_what_is_remembered_of_a_structure_is_told_of_no_other():
    """Wirings without links all have the same empty tuple of them."""
    asked = []

    @of_structure
    def names(wiring):
        asked.append(wiring)
        return tuple(wiring.scenario.components)

    alone = [FakeSystem(made, MODELS).wiring(made) for made in (scenario({n: "Spring"}, []) for n in "ab")]
    assert [names(wiring) for wiring in (*alone, *alone)] == [("a",), ("b",)] * 2
    loop = FakeSystem(oscillator(), MODELS).wiring(oscillator())
    assert names(loop) == names(loop) == ("mass", "spring") and len(asked) == 5
