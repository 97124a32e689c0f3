"""The search for the worst within bounds: what it finds is a scenario that shows it again, and stays within them."""

import pytest
from typer.testing import CliRunner

import cosim
from cosim.analysis.falsification import Harm, falsify
from cosim.errors import InputError
from cosim.fmu import open_system

RUNS = 14
VALUES = {
    "experiment.stop": 12.0,
    "experiment.step": 0.005,
    "experiment.record_every": 1,
    "channel_*.delay_max": 0.45,
    "operator.stop_time": 6.0,
}


@pytest.fixture(scope="module")
def scenario():
    return cosim.load("sallam-stable").with_values(VALUES)


@pytest.fixture(scope="module")
def found(scenario):
    with open_system(scenario) as system:
        return falsify(scenario, system, RUNS)


def test_the_worst_grows_more_than_the_scenario_and_stays_within_its_bounds(scenario, found):
    assert found.runs == RUNS and found.worst >= found.before + 0.01
    assert cosim.run(scenario).growth_rate == pytest.approx(found.before, abs=1e-9)
    for channel in ("channel_lr", "channel_rl"):
        assert 0.0 <= found.changes[f"{channel}.delay_min"] <= found.changes[f"{channel}.delay_max"] <= 0.45
    assert found.scenario.components["operator"].parameters["amplitude"] == [0.004, 0.0032, 0.0024]


def test_the_worst_can_be_run_again(scenario, found):
    assert cosim.run(found.scenario).growth_rate == pytest.approx(found.worst, abs=1e-9)
    assert cosim.run(scenario.with_values(found.changes)).growth_rate == pytest.approx(found.worst, abs=1e-9)


def test_the_command_leaves_the_worst_scenario(tmp_path):
    from cosim.cli import _app

    words = [w for k, v in VALUES.items() for w in ("--set", f"{k}={v}")]
    command = ["stability", "sallam-stable", *words, "--falsify", "6", "--harm", "error", "--no-report"]
    done = CliRunner().invoke(_app("stability", False), [*command, "--out", str(tmp_path)])
    assert done.exit_code == 0 and "worst error of 6 runs" in done.stdout, done.output
    worst = cosim.load(tmp_path / "worst.toml")
    before = cosim.run(cosim.load("sallam-stable").with_values(VALUES)).summary["tracking_rmse"]["total"]
    assert cosim.run(worst).summary["tracking_rmse"]["total"] >= before


def test_a_scenario_in_which_nothing_is_free_says_so():
    still = cosim.load("eq10-counterexample").with_values({"channel_*.delay_mean": 0.0})
    with open_system(still) as system, pytest.raises(InputError, match="a delay, a loss or a hand"):
        falsify(still, system, 5, Harm.FORCE)
    with pytest.raises(InputError, match="growth, error or force"):
        cosim.stability(still.with_values({"experiment.stop": 1.0}), falsify=1, harm="noise")
