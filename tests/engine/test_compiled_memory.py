"""Memory: many runs in one process do not grow, long runs lie on disk, and what is read from there is the same."""

import subprocess
import sys

import numpy as np
import pytest

from cosim.engine.master import run
from cosim.engine.table import SignalTable, stacked
from cosim.errors import InputError
from cosim.fmu import open_system
from cosim.results.files import export_csv, read_h5, write_h5
from cosim.scenario import load_scenario

MEGABYTE = 2**20


def resident() -> float:
    """Resident memory of this process [MB]."""
    with open("/proc/self/statm") as stream:
        return int(stream.read().split()[1]) * 4096 / MEGABYTE


def grown(runs: int, warm: int) -> float:
    """By how much memory grows over so many runs with changing parameters, after `warm` of them [MB]."""
    base = load_scenario("sallam-stable").with_values({"experiment.stop": 0.01, "experiment.record_every": 1})
    scenarios = [base.with_values({"controller_*.stiffness": k}) for k in (0.1, 0.2, 0.3)]
    with open_system(base) as system:
        for i in range(warm):
            run(scenarios[i % 3], system)
        before = resident()
        for i in range(runs):
            run(scenarios[i % 3], system)
        return resident() - before


@pytest.mark.needs("proc")
def test_2000_runs_do_not_grow():
    """A leak of one table (11 rows of 87 doubles, 7.5 kB) a run would make 15 MB; the allocator's own noise is below
    1.
    """
    assert grown(2000, 300) < 2.0


@pytest.mark.needs("proc")
@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_100000_runs_do_not_grow():
    """A leak of 100 bytes a run would make 10 MB."""
    assert grown(100_000, 1000) < 4.0


LONG = """
import sys
from cosim.fmu import open_system
from cosim.analysis.twin import judged_run
from cosim.results.files import write_h5
from cosim.scenario import load_scenario
values = {"experiment.stop": float(sys.argv[1]), "experiment.record_every": 1}
scenario = load_scenario("sallam-stable").with_values(values)
with open_system(scenario) as system:
    judged = judged_run(scenario, system)
write_h5(judged.result, sys.argv[2])
print(len(judged.result.time), [line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")][0])
"""


@pytest.mark.needs("proc")
@pytest.mark.slow
def test_ten_minutes_at_1_khz_stay_below_200_mb(tmp_path):
    """All 87 signals of 600,001 rows are 418 MB; the run, its twin, the verdict and the file must not hold them at
    once.
    """
    path = tmp_path / "long.h5"
    told = subprocess.run(
        [sys.executable, "-c", LONG, "600", str(path)], capture_output=True, text=True, check=True
    ).stdout
    rows, peak = map(int, told.split())
    assert rows == 600_001 and path.stat().st_size > 400e6
    assert peak * 1024 < 200e6


def test_a_table_on_disk_reads_like_one_in_memory():
    rng = np.random.default_rng(3)
    values = rng.standard_normal((70_001, 30))
    here, there = SignalTable(*values.shape), SignalTable(*values.shape, in_memory=0)
    assert there.on_disk and not here.on_disk and there.block < len(values)
    for rows in (here, there):
        rows.values[:] = values
        rows.drop(len(values))
        for count, every in ((70_001, 1), (70_001, 7), (17_477, 3), (1, 5), (0, 1)):
            assert np.array_equal(rows.columns(4, count, every), values[:count:every, 4])
            assert np.array_equal(rows.columns([5, 2], count, every), values[:count:every][:, [5, 2]])
        assert np.array_equal(np.concatenate([part for _, part in rows.blocks(60_000)]), values[:60_000])


def test_a_table_larger_than_the_disk_is_refused_in_words():
    with pytest.raises(
        InputError, match=r"200000000001 rows x 87 signals = 1\.39e\+05 GB; raise experiment.record_every"
    ):
        run(load_scenario("sallam-nodelay").with_values({"experiment.stop": 1e9}))


def test_results_of_a_run_on_disk(tmp_path, monkeypatch):
    """The same run with its table in memory and on disk: same signals, HDF5 and CSV."""
    scenario = load_scenario("sallam-stable").with_values({"experiment.stop": 8.0, "experiment.record_every": 1})
    with open_system(scenario) as system:
        here = run(scenario, system)
        monkeypatch.setattr(SignalTable.__init__, "__defaults__", (0,))
        there = run(scenario, system)
    assert there.signals.rows.on_disk and there.signals.rows.block < len(there.time)
    names = list(here.signals)
    assert names == list(there.signals)
    assert np.array_equal(stacked(here.signals, names), stacked(there.signals, names))
    assert np.array_equal(here.vector("arm_l.q"), there.vector("arm_l.q"))
    read = read_h5(write_h5(there, tmp_path / "there.h5"))
    for name in names:
        assert np.array_equal(read.signals[name], here.signals[name]), name
    short = {"experiment.stop": 0.02}
    with open_system(scenario) as system:
        again = run(scenario.with_values(short), system)
    lines = export_csv(again, tmp_path / "there.csv").read_text().splitlines()
    assert len(lines) == 22 and float(lines[21].split(",")[0]) == 0.02
