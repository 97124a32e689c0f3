"""The master on instances made of functions: order, time, repeatability, and every way a run can end."""

import math

import numpy as np
import pytest

from cosim.engine.master import run
from cosim.engine.outcome import Outcome
from cosim.engine.reference import execute
from cosim.errors import InputError, RunError
from cosim.scenario import Algorithm, Component, Extrapolation
from tests.support.fakes import (
    MASS,
    MODELS,
    SPRING,
    FakeInstance,
    FakeSystem,
    description,
    integrator,
    oscillator,
    scenario,
    variable,
)

HOLD, LINEAR = Extrapolation.HOLD, Extrapolation.LINEAR


def exact(time):
    """x'' = -4 x - 0.4 x', x(0) = 1, x'(0) = 0."""
    omega = math.sqrt(4 - 0.04)
    return np.exp(-0.2 * time) * (np.cos(omega * time) + 0.2 / omega * np.sin(omega * time))


def deviation(step, **more):
    made = oscillator(stop=5.0, step=step, **more)
    result = run(made, FakeSystem(made, MODELS), executor=execute)
    assert result.outcome is Outcome.BOUNDED and result.time[-1] == 5.0
    return np.abs(result.signals["mass.x"] - exact(result.time)).max()


@pytest.mark.parametrize("algorithm", list(Algorithm))
@pytest.mark.parametrize(("extrapolation", "order"), [(HOLD, 1), (LINEAR, 2)])
def test_order_of_convergence(algorithm, extrapolation, order):
    errors = [deviation(h, algorithm=algorithm, extrapolation=extrapolation) for h in (0.01, 0.005)]
    # the next term of the error is one order higher: 2^order to within a few per cent at these steps
    assert errors[0] / errors[1] == pytest.approx(2**order, rel=0.06)


def test_a_fast_and_a_slow_component_keep_the_order():
    def slow(step):
        parts = {
            "mass": Component(model="Mass", parameters={"x0": 1.0}),
            "spring": Component(model="Spring", step_multiple=4),
        }
        made = scenario(parts, ["mass.x -> spring.x", "mass.v -> spring.v", "spring.f -> mass.f"], stop=4.0, step=step)
        result = run(made, FakeSystem(made, MODELS), executor=execute)
        return np.abs(result.signals["mass.x"] - exact(result.time)).max()

    assert slow(0.005) / slow(0.0025) == pytest.approx(4.0, rel=0.1)


def test_the_same_bits_again_and_after_other_runs():
    made = oscillator(stop=1.0)
    system = FakeSystem(made, MODELS)
    first = run(made, system, executor=execute)
    run(made.with_values({"spring.k": 9.0, "experiment.algorithm": "jacobi"}), system, executor=execute)
    again = run(made, system, executor=execute)
    assert {"mass.x", "mass.v", "spring.f"} <= set(first.signals)
    assert all(np.array_equal(first.signals[name], again.signals[name]) for name in first.signals)


def test_communication_points_are_counted_not_summed():
    calls = []
    clock = description("Clock", variable("y", "output", feedthrough=()))
    models = {"Clock": (clock, lambda n, d: FakeInstance(n, d, advance=lambda v, s, t, h: calls.append((t, h))))}
    made = scenario({"a": "Clock"}, [], stop=30.0, step=0.0003)
    result = run(made, FakeSystem(made, models), executor=execute)
    assert len(calls) == 100_000 and result.time[-1] == 30.0
    # the double nearest to n * 0.3 ms, which a sum of steps or n * 0.0003 misses
    assert all(calls[n][0] == float(f"{3 * n}e-4") for n in range(0, 100_000, 7))
    assert {h for _, h in calls} == {0.0003}


def test_records_what_is_asked_for():
    made = oscillator(stop=0.1, record_every=10)
    system = FakeSystem(made, MODELS)
    result = run(made, system, record=["mass.x", "spring.f"], executor=execute)
    assert list(result.signals) == ["mass.x", "spring.f"] and result.units == {"mass.x": "m", "spring.f": "N"}
    assert result.time.tolist() == [n / 100 for n in range(11)]
    every = run(made.with_values({"experiment.record_every": 1}), system, executor=execute)
    assert np.array_equal(every.signals["mass.x"][::10], result.signals["mass.x"])
    with pytest.raises(InputError, match="did you mean 'mass.x'"):
        run(made, system, record=["mas.x"], executor=execute)


def test_initial_values_travel_through_feedthrough():
    made = oscillator(stop=0.001)
    result = run(made, FakeSystem(made, MODELS), executor=execute)
    assert result.signals["spring.f"][0] == -4.0  # -k x0, though the spring has no state of its own


def failing(at, how):
    def advance(v, slope, time, size):
        if time >= at - 1e-12:
            return how(v)
        return None

    spring = (
        SPRING[0],
        lambda n, d: FakeInstance(
            n, d, advance=advance, outputs=lambda v, t: v.update(f=v.get("bad", -v["k"] * v["x"]))
        ),
    )
    return {"Mass": MASS, "Spring": spring}


def outcome(models, **more):
    made = oscillator(stop=1.0, step=0.01, **more)
    return run(made, FakeSystem(made, models), executor=execute)


def raising(_):
    raise ArithmeticError("k went missing")


def test_an_fmu_that_fails_keeps_what_was_computed():
    result = outcome(failing(0.5, raising))
    assert result.outcome is Outcome.FAILED and len(result.time) == 51 and result.stopped_at == 0.5
    assert isinstance(result.failure, RunError) and result.failure.fmu == "spring" and result.failure.time == 0.5
    assert "k went missing" in result.message and np.isfinite(result.signals["mass.x"]).all()


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_values_that_are_not_finite_name_fmu_variable_and_time(value):
    result = outcome(failing(0.5, lambda v: v.update(bad=value)))
    assert result.outcome is Outcome.FAILED
    assert (result.failure.fmu, result.failure.variable, result.failure.time) == ("spring", "f", 0.51)
    assert len(result.time) == 51 and np.isfinite(result.signals["spring.f"]).all()


def test_the_fmu_that_gave_nan_is_named_not_the_one_that_choked_on_it():
    choking = FakeInstance
    mass = (
        MASS[0],
        lambda n, d: choking(
            n,
            d,
            begin=lambda v: v.update(x=v["x0"], v=0.0, domain=1.0),
            advance=lambda v, s, t, h: raising(v) if math.isnan(v["f"]) else None,
        ),
    )
    models = {"Mass": mass, "Spring": failing(0.5, lambda v: v.update(bad=math.nan))["Spring"]}
    assert outcome(models, order=("spring", "mass")).failure.fmu == "spring"


def test_domain_exit():
    leaving = (
        MASS[0],
        lambda n, d: FakeInstance(
            n,
            d,
            begin=lambda v: v.update(x=v["x0"], v=0.0, domain=1.0),
            advance=lambda v, s, t, h: v.update(domain=float(t < 0.295)),
        ),
    )
    result = outcome({"Mass": leaving, "Spring": SPRING})
    assert (
        result.outcome is Outcome.DOMAIN_EXIT and result.stopped_at == 0.31 and "mass left the domain" in result.message
    )
    assert result.failure is None and len(result.time) == 32


def test_divergence_is_a_result():
    made = oscillator(stop=100.0, step=0.01).with_values({"spring.b": -5.0, "experiment.bound": 1e3})
    result = run(made, FakeSystem(made, MODELS), executor=execute)
    assert result.outcome is Outcome.DIVERGED and 0 < result.stopped_at < 100 and "passed 1000" in result.message
    assert max(np.abs(values[-2]).max() for values in result.signals.values()) <= 1e3


def test_an_fmu_may_end_the_run():
    result = outcome(failing(0.5, lambda v: False))
    assert result.outcome is Outcome.BOUNDED and result.stopped_at == 0.51 and "asked to end" in result.message


def test_interruption_keeps_what_was_computed():
    def interrupt(_):
        raise KeyboardInterrupt

    result = outcome(failing(0.5, interrupt))
    assert result.interrupted and len(result.time) == 51 and result.stopped_at == 0.5


def test_progress_ends_at_the_end():
    told = []
    made = oscillator(stop=1.0)
    run(made, FakeSystem(made, MODELS), told.append, executor=execute)
    assert told[-1].done == told[-1].total == 1000 and told[-1].simulated == 1.0 and told[-1].factor > 0


def test_a_start_that_fails_raises():
    refusing = (
        SPRING[0],
        lambda n, d: FakeInstance(n, d, begin=lambda v: (_ for _ in ()).throw(RunError(n, 0.0, "no"))),
    )
    made = oscillator()
    with pytest.raises(RunError, match="FMU spring at t = 0 s: no"):
        run(made, FakeSystem(made, {"Mass": MASS, "Spring": refusing}), executor=execute)


def test_integrator_of_the_fakes_is_fourth_order():
    """The oracle's own oracle: x' = x over one step."""
    errors = []
    for size in (0.1, 0.05):
        v = {"x": 1.0}
        integrator(lambda v, t: [v["x"]], ["x"])(v, {}, 0.0, size)
        errors.append(abs(v["x"] - math.exp(size)))
    assert errors[0] / errors[1] == pytest.approx(32, rel=0.05)
