"""Sweeps under bad luck: evaluators that are none, points that all fail, damaged journals, clusters that go away."""

import subprocess
import sys
import time

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.results.files import read_table
from cosim.sweeps.campaign import run_sweep, task_of
from cosim.sweeps.journal import Journal
from cosim.sweeps.points import PointResult, point
from cosim.sweeps.pool import Here
from cosim.sweeps.spec import Axis, Grid, Sweep, parse_sweep
from tests.support import hostile

pytestmark = pytest.mark.usefixtures("children_crash")
COSIM = [sys.executable, "-m", "cosim"]
SPEC = """scenario = "{scenario}"
evaluator = "{evaluator}"
[grid]
[[axes]]
name = "g"
paths = ["{path}"]
low = 1
high = 2
count = {count}
"""
TRIVIAL = """from cosim.sweeps.points import PointResult
def evaluate(task, points):
    return [PointResult("converged", -1.0, -1.1, -0.9) for _ in points]
def worse(task, points):
    raise ValueError("on purpose")
"""


@pytest.fixture
def sweeping(tmp_path):
    """Runs `cosim sweep` of a small sweep with further words."""

    def run(*words, evaluator="simulation", scenario="sallam-nodelay", path="controller_l.stiffness", count=2):
        text = SPEC.format(scenario=scenario, evaluator=evaluator, path=path, count=count)
        (tmp_path / "w.toml").write_text(text)
        (tmp_path / "own.py").write_text(TRIVIAL)
        command = [*COSIM, "sweep", "w.toml", "--workers", "1", "--out", "o", *words]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100)

    return run


@pytest.mark.parametrize(
    "name", ["nothing", "os:system", "antigravity:x", "own:evaluate", "simulaton", "own.py:evaluate"]
)
def test_an_evaluator_in_a_file_is_one_of_a_list(sweeping, tmp_path, name):
    done = sweeping(evaluator=name)
    assert done.returncode == 2 and "evaluator: expected 'simulation' or 'cosimulation' or 'spectrum'" in done.stderr
    assert not (tmp_path / "o/journal.jsonl").exists()


def test_an_own_evaluator_is_named_on_the_command_line(sweeping):
    assert "2 converged" in sweeping("--evaluator", "own.py").stdout
    wrong = sweeping("--evaluator", "own.py:wors")
    assert wrong.returncode == 2 and "expected a function wors(task, points), got none of that name" in wrong.stderr
    assert sweeping("--evaluator", "os:system").returncode == sweeping("--evaluator", "no.py").returncode == 2


def test_a_sweep_without_one_good_point_ends_with_1_and_the_reason(sweeping, tmp_path):
    done = sweeping("--evaluator", "own.py:worse")
    assert done.returncode == 1 and "error: every point failed; the first: ValueError: on purpose" in done.stderr
    assert (tmp_path / "o/summary.json").is_file()


def test_a_crash_at_each_point_is_the_reason(sweeping, tmp_path):
    scenario = hostile.scenario("LOAD_CRASHES", tmp_path)
    done = sweeping(evaluator="cosimulation", scenario="s.toml", path="good.u")
    assert done.returncode == 1 and scenario.is_file()
    assert "every point failed; the first: " in done.stderr and "internal" not in done.stderr


NOISE = """import os
from cosim.sweeps.points import PointResult
def evaluate(task, points):
    if any(p.entries[0] == 2.0 for p in points):
        for file in range(3, 40):
            try:
                os.write(file, b"\\0\\0\\0\\4junk")
            except OSError:
                pass
    return [PointResult("converged", -1.0, -1.1, -0.9) for _ in points]
"""


def test_a_worker_whose_pipe_is_written_to_costs_its_point_only(sweeping, tmp_path):
    """What arrives is no answer: the worker is replaced, and what arrived is text and nothing else.

    The command is a process of its own: the noise must not reach what pytest has open.
    """
    (tmp_path / "noise.py").write_text(NOISE)
    done = sweeping("--evaluator", "noise.py", count=3)
    assert done.returncode == 0 and "2 converged, 1 failed" in done.stdout, done.stderr
    table = read_table(tmp_path / "o/sweep.h5")
    assert table["outcome"] == ["converged", "converged", "failed"] and "wrote to" in table["message"][2]


def trivial(tmp_path, count):
    (tmp_path / "own.py").write_text(TRIVIAL)
    axis = Axis("g", paths=("a.b",), low=1.0, high=2.0, count=count)
    return Sweep("trivial", "none", (axis,), Grid(), evaluator=f"{tmp_path / 'own.py'}:evaluate")


def seconds_a_point(tmp_path, count):
    """Of processor time, least of two."""
    times = []
    for turn in range(2):
        began = time.process_time()
        campaign = run_sweep(trivial(tmp_path, count), tmp_path / f"{count}-{turn}", Here(), tell=lambda progress: None)
        times.append((time.process_time() - began) / len(campaign.points))
    return min(times)


def test_bookkeeping_grows_with_the_points_and_not_with_their_square(tmp_path):
    """5,000 and 40,000 points that cost nothing: a square would take eight times as long a point."""
    assert seconds_a_point(tmp_path, 40_000) <= 2.0 * seconds_a_point(tmp_path, 5_000)


def test_a_damaged_line_is_named_set_aside_and_computed_again(tmp_path):
    rng = np.random.default_rng(3)
    described = trivial(tmp_path, 30)
    whole = run_sweep(described, tmp_path / "o", Here())
    book = tmp_path / "o/journal.jsonl"
    for turn in range(20):
        data = bytearray(book.read_bytes())
        first = data.index(b"\n") + 1
        data[int(rng.integers(first, len(data) - 1))] ^= int(rng.integers(1, 128))
        lines = len(bytes(data).splitlines())
        book.write_bytes(data)
        again = run_sweep(described, tmp_path / "o", Here())
        assert again.findings == whole.findings, turn
        assert lines != 31 or (len(again.warnings) == 1 and "is damaged" in again.warnings[0])
        assert (tmp_path / "o/journal.damaged").is_file()
        assert run_sweep(described, tmp_path / "o", Here()).warnings == ()


def test_a_damaged_first_line_is_no_journal_of_this_sweep(tmp_path):
    (tmp_path / "journal.jsonl").write_text('{"format": 1, "swe\n')
    with pytest.raises(InputError, match="the journal of this sweep"):
        Journal(tmp_path / "journal.jsonl", "x")


def test_lines_of_journals_without_checksums_are_read(tmp_path):
    old = '{"format": 1, "sweep": "x"}\n{"key": "a", "finding": {"outcome": "growing", "growth_rate": NaN}}\n'
    (tmp_path / "journal.jsonl").write_text(old)
    with Journal(tmp_path / "journal.jsonl", "x") as book:
        assert book.findings["a"].outcome == "growing" and book.damaged == []
        book.add([point((Axis("a", paths=("b",)),), (1.0,))], [PointResult("growing")])


def test_a_hundred_thousand_unknown_keys_are_told_at_once(tmp_path):
    with pytest.raises(InputError) as caught:
        parse_sweep({f"key{n}": n for n in range(100_000)}, tmp_path / "w.toml")
    assert len(caught.value.problems) < 30 and "99980 more unknown ones" in str(caught.value)


def test_a_cluster_without_workers_or_without_its_scheduler_is_told_in_time(tmp_path):
    import distributed

    from cosim.sweeps.cluster import DaskPool

    with distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=None) as cluster:
        with pytest.raises(InputError, match="a cluster with workers at .*, got none within 1 s"):
            DaskPool(cluster.scheduler_address, timeout=1.0)
        cluster.scale(1)
        cluster.wait_for_workers(1, timeout=30)
        with DaskPool(cluster.scheduler_address) as workers:
            described = trivial(tmp_path, 4)
            points = [point(described.axes, (x,)) for x in (1.0, 2.0)]
            (tmp_path / "own.py").write_text("import time\ndef evaluate(task, points):\n    time.sleep(30)\n")
            answers = workers.answers(task_of(described), points, 1)
            cluster.close()
            began = time.monotonic()
            with pytest.raises(ConnectionError, match="what was computed is kept"):
                list(answers)
            assert time.monotonic() - began < 10.0
