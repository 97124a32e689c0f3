"""Judged runs: twins, tracking, summaries."""

import json
import re

import numpy as np
import pytest
from attrs import evolve

from cosim.analysis.twin import judged_run, twin_of
from cosim.engine.outcome import Outcome
from cosim.fmu import open_system
from cosim.report.html import render
from cosim.report.run import run_report
from cosim.results.summary import Tracking, limit_time, summary, tracking
from cosim.scenario import load_scenario


@pytest.fixture(scope="module")
def made():
    return load_scenario("sallam-stable").with_values({"experiment.stop": 6.0})


@pytest.fixture(scope="module")
def system(made):
    with open_system(made) as opened:
        yield opened


@pytest.fixture(scope="module")
def judged(made, system):
    return judged_run(made, system)


def test_the_twin_differs_in_the_start_of_the_arms_only(made, system):
    wiring = system.wiring(made)
    twin = twin_of(wiring)
    assert twin.experiment == made.experiment and twin.connections == made.connections
    changed = {name for name in made.components if made.components[name] != twin.components[name]}
    assert changed == {"arm_l", "arm_r"}
    starts = system.wiring(twin).starts
    for name in ("arm_l", "arm_r"):
        differing = {k for k in starts[name] if starts[name][k] != wiring.starts[name].get(k, 0.0)}
        assert differing == {"dq_start[1]", "dq_start[2]", "dq_start[3]"}
        assert all(0 < abs(starts[name][k]) <= 1e-6 for k in differing)


def test_tracking_is_the_rms_distance(judged):
    n = len(judged.result.time)
    known = {
        "arm_l.x[1]": np.full(n, 3e-3),
        "arm_l.x[2]": np.zeros(n),
        "arm_l.x[3]": np.zeros(n),
        "arm_r.x[1]": np.zeros(n),
        "arm_r.x[2]": np.linspace(-1, 1, n) * 4e-3,
        "arm_r.x[3]": np.zeros(n),
    }
    found = tracking(evolve(judged.result, signals=judged.result.signals | known))
    assert isinstance(found, Tracking) and found.axes[0] == pytest.approx(3e-3) and found.axes[2] == 0.0
    assert found.axes[1] == pytest.approx(
        4e-3 / np.sqrt(3), rel=2e-3
    )  # RMS of a ramp; n samples instead of an integral
    assert found.total == pytest.approx(np.hypot(found.axes[0], found.axes[1]))


def test_the_summary_is_json_without_nan(judged):
    unclear = evolve(judged, growth_rate=None, interval=None, tracking=None)
    for one in (judged, unclear):
        assert json.loads(json.dumps(summary(one), allow_nan=False))["scenario"] == "sallam-stable"
    ways = {entry["what"]: entry["seconds"] for entry in summary(judged)["added_delay"]}
    assert ways["local to remote"] == ways["remote to local"] == 0.0


def test_the_report_shows_tracking_forces_delays_paths_and_wiring(judged):
    page = render(run_report(judged))
    for words in (
        "Tracking",
        "Forces",
        "Delays",
        "Joints",
        "Wiring",
        "Components",
        "The arms in motion",
        "channel_lr",
        "SHA-256",
        "Provenance",
    ):
        assert words in page
    assert not re.findall(r"""(?:src|href|url)\s*[=(]\s*["']?https?:""", page)  # nothing is fetched


def test_a_run_out_of_the_domain_is_a_result(made, system):
    pushed = made.with_values({"operator.amplitude": [5.0, 0.0, 0.0], "arm_*.workspace_limits": True})
    judged = judged_run(pushed, system)
    assert (
        judged.outcome is Outcome.DOMAIN_EXIT
        and judged.result.stopped_at < 6.0
        and "left the domain" in judged.result.message
    )
    assert summary(judged)["simulated_time"] == judged.result.stopped_at
    assert "left the domain" in render(run_report(judged))


def test_a_motor_at_its_limit_is_told(made, system):
    limited = made.with_values({"arm_l.torque_saturation": 0.01})
    judged = judged_run(limited, system)
    assert limit_time(judged.result) is not None


def test_the_time_simulated_is_the_end_not_the_last_row(made, system):
    """12 steps, every fifth recorded: the last row stands at 10 ms."""
    judged = judged_run(made.with_values({"experiment.stop": 0.012, "experiment.record_every": 5}), system)
    assert judged.result.time[-1] == pytest.approx(0.010) and summary(judged)["simulated_time"] == 0.012


def test_an_experiment_that_asks_for_no_verdict_gets_none_and_no_alarm():
    scenario = load_scenario("identification").with_values({"experiment.stop": 0.5})
    with open_system(scenario) as system:
        judged = judged_run(scenario, system)
    assert judged.outcome is Outcome.NOT_JUDGED and judged.growth_rate is None
