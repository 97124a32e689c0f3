"""Round trips as one-way delays, and their replay through the channels."""

import numpy as np
import pytest

from cosim.engine.master import run
from cosim.engine.outcome import Outcome
from cosim.errors import InputError
from cosim.fmu import open_system
from cosim.measured.delays import one_way
from cosim.scenario import load_scenario


def test_constant_round_trips_split_exactly():
    time, there, back = one_way(np.full(50, 0.2), 0.25, 0.01)
    assert (
        np.allclose(there, 0.05, atol=1e-15) and np.allclose(back, 0.15, atol=1e-15) and time[-1] == pytest.approx(10.0)
    )


def test_values_stand_at_the_moment_of_receipt():
    trips = np.array([0.1, 0.3, 0.2])
    time, there, back = one_way(trips, 0.5, 0.001)
    # exchange 1 begins at 0.1: its request arrives at 0.25 after 0.15, its answer at 0.4 after 0.15
    assert there[np.argmin(abs(time - 0.25))] == pytest.approx(0.15, abs=1e-6)
    assert back[np.argmin(abs(time - 0.40))] == pytest.approx(0.15, abs=1e-6)
    # two ways to split, one sum
    _, late, early = one_way(trips, 0.8, 0.001)
    assert late.max() == pytest.approx(0.24) and early.max() == pytest.approx(0.06)


@pytest.mark.parametrize(("trips", "share"), [([0.1, 0.2], 1.5), ([0.1, -0.1], 0.5), ([0.1], 0.5)])
def test_refuses(trips, share):
    with pytest.raises(InputError):
        one_way(np.array(trips), share, 0.01)


def test_the_shipped_trace_is_replayed_by_the_channels():
    made = load_scenario("recorded-delay").with_values({"experiment.stop": 5.0, "experiment.record_every": 1})
    result = run(made)
    table = np.loadtxt(made.folder / "recorded-delay.csv", delimiter=",", skiprows=3)
    expected = np.interp(result.time, table[:, 0], table[:, 1])
    # read at the end of each step; linear between samples in the FMU as here
    assert np.abs(result.signals["channel_lr.delay_now"][1:] - expected[1:]).max() < 1e-12


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_a_real_trace_runs(shared_data, tmp_path, share):
    """Trace 024 (a robot across the city): 101 to 545 ms round trip, split two ways; the SI loop stays stable on it."""
    trips = np.loadtxt(shared_data / "telerobot_rtt" / "rtt_024.csv", delimiter=",", skiprows=1)[:, 1] * 1e-3
    time, there, back = one_way(trips, share, 0.01)
    keep = time <= 40.0
    np.savetxt(
        tmp_path / "trace.csv",
        np.column_stack([time, there, back])[keep],
        delimiter=",",
        header="time,lr,rl",
        comments="",
    )
    made = load_scenario(
        "recorded-delay",
        [f"trace.recording={tmp_path / 'trace.csv'}", 'trace.columns=["lr", "rl"]', "experiment.stop=30"],
    )
    with open_system(made) as system:
        result = run(made, system)
    assert result.outcome is Outcome.BOUNDED
    assert result.signals["channel_lr.delay_now"].max() == pytest.approx(there[time <= 30].max(), rel=0.05)
    assert np.linalg.norm(result.vector("arm_l.x")[-1] - result.vector("arm_r.x")[-1]) < 1e-3
