"""FMUs of others run in a process of their own: the same bits, and what was computed survives a crash."""

import faulthandler
import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from build_fmus.build import BuildJob, build
from build_fmus.compiler import this_platform
from build_fmus.table import DefaultExperiment, Head, ModelTable, ModelVariable
from cosim.engine.isolation import called, run_apart, runner
from cosim.engine.master import run
from cosim.engine.outcome import Outcome
from cosim.engine.table import SignalTable
from cosim.errors import RunError
from cosim.fmu import open_system
from cosim.results.files import read_h5
from cosim.scenario import load_scenario, load_text

pytestmark = pytest.mark.usefixtures("children_crash")

CLOCK = b"""
/* y counts the milliseconds; at `last` the model dies in one of several ways */
#include <stdlib.h>
static const char *start(Model *m) {
    if (m->last < 0) abort();
    return NULL;
}
static const char *sample(Model *m, double t) {
    (void)t;
    m->y += 1.0;
    if (m->y > m->last && m->way == 1.0) *(volatile double *)(size_t)64 = 1.0;
    if (m->y > m->last && m->way == 2.0) exit(3);
    while (m->y > m->last && m->way == 3.0) {}
    return NULL;
}
static void outputs(Model *m, double t) { (void)m; (void)t; }
"""
CLOCK_TABLE = ModelTable(
    Head("Clock", "a counter that can crash", "sampled"),
    DefaultExperiment(1.0, 0.001),
    [
        ModelVariable("u", "input", "input", unit="1"),
        ModelVariable("y", "output", "count", unit="1"),
        ModelVariable("last", "parameter", "last count before the crash", unit="1", start=1e9),
        ModelVariable(
            "way", "parameter", "1: segmentation fault, 2: exit, 3: never returns", type="Integer", start=1.0
        ),
    ],
    [],
)


@pytest.fixture(scope="module", params=[2, 3])
def clocks(request):
    """The text of a scenario of two clocks, one after the other."""
    fmu: Path = build(
        BuildJob(CLOCK_TABLE, request.param, (this_platform(),), {"model.c": CLOCK, "README.md": b"# Clock\n"})
    )
    return f"""
        connections = ["first.y -> second.u"]
        [experiment]
        stop = 1.0
        step = 0.001
        [components.first]
        fmu = "{fmu}"
        [components.second]
        fmu = "{fmu}"
    """


def apart(text, **values):
    scenario = load_text(text).with_values({key.replace("__", "."): value for key, value in values.items()})
    with open_system(scenario) as system:
        return run_apart(scenario, system)


def test_only_fmus_of_others_run_apart(clocks):
    assert runner(load_text(clocks)) is run_apart
    assert runner(load_scenario("sallam-stable")) is run


@pytest.mark.parametrize("in_memory", [0, 1 << 30], ids=["on disk", "in memory"])
def test_same_bits_as_in_this_process(clocks, in_memory, monkeypatch):
    monkeypatch.setattr(SignalTable.__init__, "__defaults__", (in_memory,))
    scenario = load_text(clocks)
    with open_system(scenario) as system:
        told = []
        there = run_apart(scenario, system, told.append)
        assert not system.loaded and told[-1].done == told[-1].total == 1000
        here = run(scenario, system)
    assert (there.outcome, there.message) == (here.outcome, here.message) == (Outcome.BOUNDED, "")
    assert all(np.array_equal(there.signals[name], here.signals[name]) for name in here.signals)


@pytest.mark.parametrize(
    ("way", "words"), [(1, "signal SIGSEGV, Segmentation fault"), (2, "it ended the process, exit code 3")]
)
@pytest.mark.parametrize("every", [1, 10])
def test_a_crash_keeps_the_rows_up_to_it(clocks, way, words, every):
    result = apart(clocks, second__last=400, second__way=way, experiment__record_every=every)
    assert result.outcome is Outcome.FAILED and result.stopped_at == result.failure.time == 0.4
    assert (
        result.failure.fmu == "second"
        and words in result.message
        and "communication step 401 of 1000" in result.message
    )
    assert len(result.time) == 400 // every + 1
    assert np.array_equal(result.signals["second.y"], np.arange(0, 401, every))


def test_the_python_executor_marks_its_way_too(clocks, monkeypatch):
    monkeypatch.setattr("cosim.engine.compiled.applies", lambda instances: False)
    result = apart(clocks, first__last=3)
    assert (
        result.failure.fmu == "first"
        and result.stopped_at == 0.003
        and result.signals["second.y"].tolist() == [0, 1, 2, 3]
    )
    with pytest.raises(RunError, match="FMU second: the FMU crashed while it was initialised .signal SIGABRT"):
        apart(clocks, second__last=-1)


def test_a_crash_before_the_start_is_an_error(clocks):
    with pytest.raises(RunError, match="FMU second: the FMU crashed while it was initialised .signal SIGABRT"):
        apart(clocks, second__last=-1)


def test_what_an_fmu_refuses_is_told_as_in_this_process(clocks):
    with pytest.raises(RunError, match="FMU first: cannot be loaded"):
        scenario = load_text(clocks)
        with open_system(scenario) as system:
            system.instance = lambda name, description: (_ for _ in ()).throw(RunError(name, None, "cannot be loaded"))
            run_apart(scenario, system)


def cosim_run(text, folder):
    (folder / "clocks.toml").write_text(text)
    return [sys.executable, "-m", "cosim", "run", str(folder / "clocks.toml"), "--out", str(folder / "o")]


def test_the_command_tells_component_time_and_signal(clocks, tmp_path):
    text = clocks + "parameters = { last = 250 }\n"
    done = subprocess.run(cosim_run(text, tmp_path), capture_output=True, text=True)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert (
        "error: FMU second at t = 0.25 s: the FMU crashed in communication step 251 of 1000 (signal SIGSEGV"
        in done.stderr
    )
    result, summary = read_h5(tmp_path / "o/result.h5"), json.loads((tmp_path / "o/summary.json").read_text())
    assert result.time[-1] == 0.25 and result.signals["second.y"][-1] == 250
    assert summary["outcome"] == "failed" and summary["stopped_at"] == 0.25 and (tmp_path / "o/report.html").is_file()


def test_ctrl_c_ends_an_fmu_that_never_returns(clocks):
    """The first progress is told after 2000 steps; the FMU hangs 500 steps later."""
    scenario = load_text(clocks).with_values({"experiment.stop": 3.0, "second.last": 2500, "second.way": 3})
    with open_system(scenario) as system:
        result = run_apart(
            scenario, system, lambda _: threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        )
    assert result.interrupted and result.message == "interrupted" and 2000 <= len(result.time) - 1 <= 2500
    assert np.array_equal(result.signals["second.y"], np.arange(len(result.time)))


def test_other_uses_of_fmus_run_apart_too(clocks):
    scenario = load_text(clocks)
    with open_system(scenario) as system:

        def counted(mark):
            return sum(instance.start({}) is None for instance in system.instances(system.wiring(scenario)))

        assert called(counted, int, scenario, system, "it was counted") == 2 and not system.loaded
        with pytest.raises(ZeroDivisionError):
            called(lambda mark: 1 / 0, int, scenario, system, "it was counted")
        with pytest.raises(RunError, match="FMU second: the FMU crashed while it was counted .signal SIGABRT"):
            called(lambda mark: os.abort(), int, scenario, system, "it was counted")
    assert called(lambda mark: os.getpid(), int, load_scenario("sallam-stable"), None, "") == os.getpid()


def test_a_child_that_may_crash_has_no_fault_handler_of_pytest(clocks):
    scenario = load_text(clocks)
    with open_system(scenario) as system:
        assert called(lambda mark: faulthandler.is_enabled(), bool, scenario, system, "it was asked") is False


def test_the_stability_command_tells_of_a_crash(clocks, tmp_path):
    words = cosim_run(clocks + "parameters = { last = -1 }\n", tmp_path)
    done = subprocess.run([{"run": "stability"}.get(word, word) for word in words], capture_output=True, text=True)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "error: FMU second: the FMU crashed while the loop was linearised (signal SIGABRT" in done.stderr
