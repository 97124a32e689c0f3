"""The journal: kill a sweep at any time, run it again, and the table is the one of an undisturbed run."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.sweeps.campaign import run_sweep
from cosim.sweeps.journal import Journal
from cosim.sweeps.points import PointResult, point
from cosim.sweeps.pool import Here
from cosim.sweeps.spec import Axis, Random, Sweep
from cosim.sweeps.table import columns
from tests.support.paths import ROOT, SUPPORT

A, B = Axis("a", paths=("x.a",)), Axis("b", paths=("x.b",))
PROGRAM = """
import json, sys
from cosim.sweeps.campaign import run_sweep
from cosim.sweeps.pool import Here, LocalPool
from cosim.sweeps.table import columns
from tests.sweeps.test_journal import sweep
if __name__ == "__main__":
    with (LocalPool(2) if sys.argv[2] == "pool" else Here()) as workers:
        campaign = run_sweep(sweep(int(sys.argv[3]), sys.argv[1] + "/log"), __import__("pathlib").Path(sys.argv[1]),
        workers, chunk=4)
    open(sys.argv[1] + "/table.json", "w").write(json.dumps(columns(campaign)))
"""


def sweep(count, log):
    return Sweep(
        "killed",
        "none",
        (A, B),
        Random(count, seed=5),
        evaluator=f"{SUPPORT / 'sweep_models.py'}:quick",
        set={"log": log, "pause": 0.01},
    )


def start(folder, workers, count):
    """The sweep in a process group of its own."""
    (folder / "program.py").write_text(PROGRAM)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(ROOT), str(SUPPORT))), "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, str(folder / "program.py"), str(folder), workers, str(count)],
        env=environment,
        start_new_session=True,
        stderr=subprocess.DEVNULL,
    )


def killed_and_finished(folder, workers, count, kills, seed):
    """Kill the whole group at random times after its first answer, then let it finish; the table, and how often each
    point was begun.
    """
    rng = np.random.default_rng(seed)
    folder.mkdir()
    journal = folder / "journal.jsonl"
    for _ in range(kills):
        process = start(folder, workers, count)
        size = journal.stat().st_size if journal.exists() else 0
        while process.poll() is None and (not journal.exists() or journal.stat().st_size == size):
            time.sleep(0.002)
        time.sleep(float(rng.uniform(0.0, 0.1)))
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    process = start(folder, workers, count)
    assert process.wait(timeout=120) == 0
    begun = (folder / "log").read_text().split()
    return json.loads((folder / "table.json").read_text()), {key: begun.count(key) for key in begun}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    def table(count):
        folder = tmp_path_factory.mktemp("undisturbed")
        with Here() as workers:
            return json.loads(
                json.dumps(columns(run_sweep(sweep(count, str(folder / "log")), folder / "out", workers)))
            )

    sys.path.insert(0, str(SUPPORT))
    yield table
    sys.path.remove(str(SUPPORT))


def without_log(table):
    """The table without the replay column, which names the log file."""
    return {name: values for name, values in table.items() if name != "replay"}


@pytest.mark.parametrize("workers", ["here", "pool"])
def test_kills_end_in_the_identical_table(tmp_path, undisturbed, workers):
    table, begun = killed_and_finished(tmp_path / "run", workers, 120, 3, seed=1)
    assert without_log(table) == without_log(undisturbed(120))
    # only points that were under way at a kill are computed again: at most two workers' chunks of 4 each time
    assert sum(count - 1 for count in begun.values()) <= 3 * 8


@pytest.mark.slow
def test_a_hundred_kills(tmp_path, undisturbed):
    table, begun = killed_and_finished(tmp_path / "run", "here", 3000, 100, seed=2)
    assert without_log(table) == without_log(undisturbed(3000))
    assert sum(count - 1 for count in begun.values()) <= 100 * 8


def journal(tmp_path, fingerprint="sweep"):
    return Journal(tmp_path / "journal.jsonl", fingerprint)


def test_a_line_cut_off_anywhere_is_forgotten_and_nothing_else(tmp_path):
    points, findings = (
        [point((A, B), (0.1 * k, 0.5)) for k in range(4)],
        [PointResult("converged", -0.1 * k) for k in range(4)],
    )
    with journal(tmp_path) as book:
        book.add(points, findings)
    whole = (tmp_path / "journal.jsonl").read_bytes()
    last = whole.rstrip(b"\n").rfind(b"\n") + 1
    assert whole.count(b"\n") == 4 + 1 and len(whole) - last > 20  # the sweep's own line, and one for each point
    for cut in range(last, len(whole)):
        (tmp_path / "journal.jsonl").write_bytes(whole[:cut])
        with journal(tmp_path) as book:
            assert len(book.findings) == 3
            book.add(points, findings)
        assert (tmp_path / "journal.jsonl").read_bytes() == whole


def test_findings_come_back_as_they_were(tmp_path):
    wanted = PointResult("growing", 0.1 + 0.2, np.nan, np.inf, "falsified", {"tracking_rmse": 1e-300}, "é")
    with journal(tmp_path) as book:
        book.add([point((A, B), (0.1, 0.2))], [wanted])
    with journal(tmp_path) as book:
        (found,) = book.findings.values()
    assert (found.outcome, found.growth_rate, found.high, found.numbers, found.message) == (
        "growing",
        wanted.growth_rate,
        np.inf,
        {"tracking_rmse": 1e-300},
        "é",
    )
    assert np.isnan(found.low)


def test_a_known_point_is_not_written_twice(tmp_path):
    where = point((A, B), (0.1, 0.2))
    with journal(tmp_path) as book:
        book.add([where], [PointResult("growing")])
        book.add([where], [PointResult("converged")])
        assert book.findings[where.key].outcome == "growing"
    assert len((tmp_path / "journal.jsonl").read_text().splitlines()) == 2


def test_another_sweeps_folder_and_a_folder_in_use_are_bad_input(tmp_path):
    with journal(tmp_path), pytest.raises(InputError, match="no other sweep writes"):
        journal(tmp_path)
    with pytest.raises(InputError, match="another"):
        journal(tmp_path, "other")
