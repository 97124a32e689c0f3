"""The compiled executor against the Python one, the readable reference: same bits, same endings in the same words."""

import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

from build_fmus.build import BuildJob, build
from build_fmus.compiler import this_platform
from build_fmus.table import DefaultExperiment, Head, ModelTable, ModelVariable, Private
from cosim.engine import compiled
from cosim.engine.master import run
from cosim.engine.outcome import Outcome
from cosim.engine.reference import execute as in_python
from cosim.fmu import open_system
from cosim.scenario import load_scenario, load_text, shipped

STEPS = 40
NAMES = [path.stem for path in shipped()]
ALGORITHMS = [("gauss-seidel", "linear"), ("gauss-seidel", "hold"), ("jacobi", "linear"), ("jacobi", "hold")]


def short(name, fmi, algorithm="gauss-seidel", extrapolation="linear", **more):
    chosen = load_scenario(name)
    values = {
        "experiment.stop": STEPS * chosen.experiment.step,
        "experiment.record_every": 1,
        "experiment.fmi": fmi,
        "experiment.algorithm": algorithm,
        "experiment.extrapolation": extrapolation,
    }
    return chosen.with_values(values | more)


def both(scenario, system):
    """The compiled run and the Python run; fails where the compiled executor leaves the scenario to the Python one."""
    one = run(scenario, system)
    assert compiled.applies(system.ready)
    return one, run(scenario, system, executor=in_python)


def assert_same(one, other):
    assert (one.outcome, one.message, one.stopped_at) == (other.outcome, other.message, other.stopped_at)
    assert str(one.failure) == str(other.failure)
    assert one.time.tobytes() == other.time.tobytes()
    for name in one.signals:
        assert (
            np.ascontiguousarray(one.signals[name]).tobytes() == np.ascontiguousarray(other.signals[name]).tobytes()
        ), name


# --- the same bits ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", NAMES)
def test_same_bits_for_every_shipped_scenario(name, fmi):
    with open_system(short(name, fmi)) as system:
        for algorithm, extrapolation in ALGORITHMS:
            one, other = both(short(name, fmi, algorithm, extrapolation), system)
            assert len(one.time) == STEPS + 1
            assert_same(one, other)


@pytest.mark.parametrize("fmi", [2, 3])
def test_same_bits_with_step_multiples(fmi):
    multiples = {"controller_*.step_multiple": 2, "channel_lr.step_multiple": 3, "operator.step_multiple": 5}
    with open_system(short("sallam-stable", fmi)) as system:
        for algorithm, extrapolation in ALGORITHMS:
            scenario = short("sallam-stable", fmi, algorithm, extrapolation, **multiples, **{"experiment.stop": 0.12})
            assert_same(*both(scenario, system))


def test_same_bits_after_many_other_runs_on_the_same_fmus():
    """Nothing is left of earlier runs: slopes, packets in flight, start values."""
    scenario = short("sallam-stable", 2)
    with open_system(scenario) as fresh:
        first = run(scenario, fresh)
    with open_system(scenario) as system:
        for stiffness in (0.1, 0.9):
            run(scenario.with_values({"controller_*.stiffness": stiffness, "arm_l.q_start[1]": 0.2}), system)
        run(scenario, system, record=["arm_l.q"])
        run(short("sallam-stable", 2, "jacobi", "hold"), system)
        assert_same(run(scenario, system), first)


def test_the_start_in_c_is_the_start_in_python():
    for name, fmi in (("sallam-stable", 2), ("contact", 3)):
        scenario = short(name, fmi)
        with open_system(scenario) as system:
            wiring = system.wiring(scenario)
            instances = system.instances(wiring)
            executor = compiled.CompiledExecutor()
            for _ in range(2):
                store = executor.initialise(wiring, instances).copy()
                assert store.tobytes() == compiled.initialise_in_python(wiring, instances).tobytes()


# --- endings ----------------------------------------------------------------------------------------------------------

RAMP = b"""
/* y' = rate y + u; the model refuses y above `most`, forgets how to be finite above `cliff` */
static void derivatives(Model *m, double t) { (void)t; m->dy = m->rate * m->y + m->u; }
static const char *start(Model *m) {
    if (m->rate > 1e3) return refuse(m, "rate", 0, m->rate, "at most 1000");
    m->y = m->y_start;
    return NULL;
}
static const char *sample(Model *m, double t) {
    (void)t;
    if (m->y > m->most) return refuse(m, "y", 0, m->y, "at most the model's most");
    if (m->y > m->cliff) m->y = m->y / (m->zero * 0.0);
    return NULL;
}
static void outputs(Model *m, double t) { (void)t; m->domain = m->y > m->edge ? 0.0 : 1.0; }
"""
RAMP_TABLE = ModelTable(
    Head("Ramp", "an exponential that can fail", "continuous"),
    DefaultExperiment(1.0, 0.001),
    [
        ModelVariable("u", "input", "input", unit="1/s"),
        ModelVariable("y", "state", "state", unit="1", derivative="dy", initial="y_start"),
        ModelVariable("dy", "output", "its derivative", unit="1/s", feedthrough=["u"]),
        ModelVariable("domain", "output", "inside", unit="1", start=1.0),
        ModelVariable("y_start", "parameter", "start", unit="1", start=1.0),
        ModelVariable("rate", "parameter", "rate", unit="1/s", start=10.0),
        ModelVariable("most", "parameter", "refused above", unit="1", start=1e300),
        ModelVariable("cliff", "parameter", "not finite above", unit="1", start=1e300),
        ModelVariable("edge", "parameter", "out of the domain above", unit="1", start=1e300),
        ModelVariable(
            "internal_steps", "parameter", "Runge-Kutta steps", type="Integer", start=1.0, min=1.0, max=100.0
        ),
    ],
    [Private("zero")],
)


@pytest.fixture(scope="module", params=[2, 3])
def ramps(request):
    """A scenario of two ramps, one after the other."""
    fmu: Path = build(
        BuildJob(RAMP_TABLE, request.param, (this_platform(),), {"model.c": RAMP, "README.md": b"# Ramp\n"})
    )
    return load_text(f"""
        format = 1
        connections = ["first.dy -> second.u"]
        [experiment]
        stop = 2.0
        step = 0.001
        [components.first]
        fmu = "{fmu}"
        [components.second]
        fmu = "{fmu}"
        parameters = {{ rate = 1.0 }}
    """)


ENDINGS = {
    "refusal": ({"second.most": 50.0}, Outcome.FAILED),
    "not finite": ({"second.cliff": 50.0}, Outcome.FAILED),
    "domain": ({"first.edge": 50.0}, Outcome.DOMAIN_EXIT),
    "divergence": ({"experiment.bound": 1e4}, Outcome.DIVERGED),
    "none": ({"first.rate": 0.1}, Outcome.BOUNDED),
}


@pytest.mark.parametrize("ending", ENDINGS)
def test_same_ending_in_the_same_words(ramps, ending):
    values, outcome = ENDINGS[ending]
    scenario = ramps.with_values(values)
    with open_system(scenario) as system:
        one, other = both(scenario, system)
        assert one.outcome is outcome
        assert_same(one, other)
        assert_same(run(scenario, system), other)  # and again on instances that failed
        if outcome is Outcome.FAILED:
            assert one.failure.fmu == "second" and "y" in str(one.failure) and one.failure.time > 0.1


def test_a_start_that_is_refused_is_told_as_in_python(ramps):
    scenario = ramps.with_values({"first.rate": 1e4})
    words = []
    with open_system(scenario) as system:
        for executor in (None, in_python):
            with pytest.raises(Exception, match="rate") as caught:
                run(scenario, system, executor=executor)
            words.append(str(caught.value))
        good = scenario.with_values({"first.rate": 0.1})
        assert run(good, system).outcome is Outcome.BOUNDED
    assert words[0] == words[1]


def test_ctrl_c_keeps_what_was_computed(monkeypatch):
    long = load_scenario("sallam-nodelay").with_values({"experiment.stop": 600.0, "experiment.record_every": 100})
    with open_system(long) as system:
        run(long.with_values({"experiment.stop": 0.1}), system)
        for executor in (None, in_python):
            timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
            timer.start()
            result = run(long, system, executor=executor)
            timer.join()
            assert result.interrupted and result.message == "interrupted" and result.outcome is Outcome.INCONCLUSIVE
            assert 0 < len(result.time) < 6001 and np.all(np.isfinite(result.vector("arm_l.q")))
            assert result.stopped_at >= result.time[-1]


def test_progress_grows_to_the_end():
    scenario = load_scenario("sallam-stable").with_values({"experiment.stop": 5.0})
    with open_system(scenario) as system:
        told = []
        run(scenario, system, told.append)
    done = [p.done for p in told]
    assert done == sorted(set(done)) and done[-1] == told[-1].total == 5000
    assert told[-1].simulated == 5.0 and told[-1].wall > 0


def test_threads_run_beside_each_other():
    """Two systems in two threads give the bits of one: neither the loop nor the FMUs share anything."""
    scenario = load_scenario("sallam-stable").with_values({"experiment.stop": 2.0})
    with open_system(scenario) as one, open_system(scenario) as other:
        expected, found = run(scenario, one), []
        workers = [threading.Thread(target=lambda s=s: found.append(run(scenario, s))) for s in (one, other)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
    assert len(found) == 2
    for result in found:
        assert_same(result, expected)
