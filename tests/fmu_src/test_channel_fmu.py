"""The channel as an FMU: the same bits in both standards, packets in flight in the saved state, recorded delay,
refusals."""

import numpy as np
import pytest

from build_fmus import fmu_path
from cosim.engine.master import run
from cosim.engine.outcome import Outcome
from cosim.errors import InputError
from cosim.scenario import Component, Experiment, Scenario
from tests.support.model_harness import CompiledModel
from tests.support.probe import Importer

PARAMETERS = {
    "law": 3,
    "semantics": 3,
    "delay_max": 0.08,
    "delay_interval": 0.01,
    "loss_to_bad": 0.05,
    "loss_to_good": 0.3,
    "seed": 6,
}
NAMES = ("y[1]", "w[3]", "delay_now", "age", "lost", "in_flight")

WAVES = np.random.default_rng(1).standard_normal((1000, 2))


def drive(fmu: Importer, steps: range) -> np.ndarray:
    rows = []
    for k in steps:
        fmu.set("u[1]", WAVES[k, 0])
        fmu.set("v[3]", WAVES[k, 1])
        fmu.step(k * 1e-3, 1e-3)
        rows.append([fmu.get(n) for n in NAMES])
    return np.array(rows)


def same(a: np.ndarray, b: np.ndarray) -> bool:
    return (a.view(np.uint64) == b.view(np.uint64)).all()


@pytest.mark.parametrize("semantics", [1, 2, 3, 4])
def test_fmi_2_and_fmi_3_and_plain_c_give_the_same_bits(semantics):
    parameters = PARAMETERS | {"semantics": semantics}
    two, three = (drive(Importer(fmu_path("VariableDelayChannel", fmi), parameters), range(300)) for fmi in (2, 3))
    plain = CompiledModel("VariableDelayChannel", **parameters).start()
    u, v = np.zeros((300, 3)), np.zeros((300, 3))
    u[:, 0], v[:, 2] = WAVES[:300].T
    run = plain.run(300, 1e-3, {"u": u, "v": v}, ("y", "w", "delay_now", "age", "lost", "in_flight"))
    bare = np.column_stack(
        [run["y"][:, 0], run["w"][:, 2], run["delay_now"], run["age"], run["lost"], run["in_flight"]]
    )
    assert same(two, three) and same(two, bare)
    assert two[-1, 4] > 5


@pytest.mark.parametrize("fmi", [2, 3])
def test_packets_in_flight_are_in_the_saved_state(fmi):
    fmu = Importer(fmu_path("VariableDelayChannel", fmi), PARAMETERS)
    assert drive(fmu, range(200))[-1, 5] > 5
    state = fmu.save()
    first = drive(fmu, range(200, 400))
    fmu.restore(state)
    assert same(first, drive(fmu, range(200, 400)))
    data = fmu.serialize(state)
    other = Importer(fmu_path("VariableDelayChannel", fmi), PARAMETERS)
    other.restore(other.deserialize(data))
    assert same(first, drive(other, range(200, 400)))


@pytest.mark.parametrize("fmi", [2, 3])
def test_initial_output_is_the_initial_input(fmi):
    fmu = Importer(fmu_path("VariableDelayChannel", fmi), {"delay_mean": 0.01, "u[2]": 3.5, "v[1]": -1.25})
    assert fmu.get("y[2]") == 3.5 and fmu.get("w[1]") == -1.25
    fmu.set("u[2]", 7.0)
    for k in range(10):
        fmu.step(k * 1e-3, 1e-3)
        assert fmu.get("y[2]") == 3.5  # u(t < 0) = u(0) until the first new sample is 10 ms old
    fmu.step(0.010, 1e-3)
    assert fmu.get("y[2]") == 7.0


@pytest.mark.parametrize("fmi", [2, 3])
def test_start_time_is_not_zero(fmi):
    late = Importer(fmu_path("VariableDelayChannel", fmi), {"delay_mean": 0.005}, time=100.0)
    shown = []
    for k in range(20):
        late.set("u[1]", k + 1.0)
        late.step(100 + k * 1e-3, 1e-3)
        shown.append(late.get("y[1]"))
    assert shown == [max(0.0, k - 4.0) for k in range(20)]


@pytest.mark.parametrize("fmi", [2, 3])
def test_too_long_a_delay_names_delay_buffer_and_step(fmi):
    fmu = Importer(fmu_path("VariableDelayChannel", fmi), {"delay_mean": 0.09})
    with pytest.raises(Exception):
        for k in range(10000):
            fmu.step(k * 1e-5, 1e-5)
    assert any(all(w in m for w in ("0.09 s", "8192 samples", "step of 1e-05 s")) for m in fmu.messages), fmu.messages[
        -1:
    ]


STEPS = 8190  # of delay that cosim accepts


@pytest.mark.parametrize("semantics", range(1, 5))
def test_cosim_refuses_beforehand_what_the_buffer_does_not_hold(semantics):
    """The longest delay that passes the check runs beyond it; two steps more are refused, and fail in the FMU
    itself.
    """

    def chosen(steps, **more):
        parameters = {"semantics": semantics, "delay_mean": steps * 1e-3, **more}
        return Scenario(
            "long", Experiment(stop=10.0), {"channel": Component("VariableDelayChannel", parameters=parameters)}, ()
        )

    assert run(chosen(STEPS)).outcome is Outcome.BOUNDED
    with pytest.raises(InputError, match="delay_mean: expected at most 8.19 s.*got 8.192 s; take steps of 0.001 s"):
        run(chosen(STEPS + 2))
    with pytest.raises(InputError, match="channel.delay_max"):
        run(chosen(0, law="uniform", delay_max=9.0))
    for change in ({"experiment.stop": 8.0}, {"experiment.step": 0.002}, {"channel.step_multiple": 2}):
        assert run(chosen(STEPS + 2).with_values(change)).outcome is Outcome.BOUNDED
    fmu = Importer(fmu_path("VariableDelayChannel", 2), {"semantics": semantics, "delay_mean": (STEPS + 2) * 1e-3})
    with pytest.raises(Exception):
        for k in range(10_000):
            fmu.step(k * 1e-3, 1e-3)
    assert "take a longer step or a shorter delay" in fmu.messages[-1]
