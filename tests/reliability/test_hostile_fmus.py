"""FMUs of others that misbehave: an error that names the FMU, the rows up to it, and no process left."""

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import cosim
from cosim import child
from cosim.scenario import shipped
from tests.support import hostile

pytestmark = [pytest.mark.usefixtures("children_crash"), pytest.mark.needs("proc")]
COSIM = [sys.executable, "-m", "cosim"]


def command(*words, **options):
    return subprocess.run([*COSIM, *map(str, words)], capture_output=True, text=True, timeout=100, **options)


def using(folder):
    """Processes that work in the folder, zombies apart (what adopts them here may not wait for them)."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if (entry / "cwd").readlink() == folder:
                found.append(int(entry.name))
        except OSError:
            continue
    return found


def wait_until(there, seconds=30.0):
    until = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < until, "it did not come about"
        time.sleep(0.02)


@pytest.mark.parametrize(
    ("way", "rows", "words"),
    [
        ("REALTIME_SIGNAL", 51, "crashed in communication step 51 of 200 (signal 39, a real-time signal)"),
        ("LAST_STEP", 200, "crashed in communication step 200 of 200 (signal SIGABRT"),
        ("CLOSES", 201, "closed descriptors that are not its own after the last of 200 steps"),
        ("NEGATIVE", 51, "step failed (status -1, which FMI does not know)"),
    ],
)
def test_what_ends_a_run_keeps_its_rows(tmp_path, way, rows, words):
    result = cosim.run(hostile.scenario(way, tmp_path))
    assert result.outcome is cosim.Outcome.FAILED and result.failure.fmu == "evil"
    assert words in result.failure.message
    assert np.array_equal(result["evil.y"], np.arange(rows))


def test_what_an_fmu_writes_to_other_descriptors_is_its_error_and_no_more(tmp_path):
    """In a process of its own: the noise must not reach what pytest has open."""
    hostile.scenario("WRITES", tmp_path)
    done = command("run", "s.toml", "--out", "o", cwd=tmp_path)
    assert done.returncode == 1 and "the FMU wrote to descriptors that are not its own" in done.stderr
    result = cosim.open_result(tmp_path / "o")
    assert len(result.time) >= 50 and np.array_equal(result["evil.y"], np.arange(len(result.time)))


def test_a_hostile_fmu_is_bad_news_on_the_command_line(tmp_path):
    hostile.scenario("REALTIME_SIGNAL", tmp_path)
    done = command("run", "s.toml", "--out", "o", cwd=tmp_path)
    assert done.returncode == 1 and "FMU evil at t = 0.05 s" in done.stderr and "internal" not in done.stderr
    assert json.loads((tmp_path / "o/summary.json").read_text())["outcome"] == "failed"
    assert len(cosim.open_result(tmp_path / "o").time) == 51


@pytest.mark.parametrize("executor", ["compiled", "python"])
def test_rounding_and_flushing_to_zero_of_one_fmu_change_no_other(tmp_path, monkeypatch, executor):
    """1/3 rounded to the nearest is 0.333...31; upwards, ...37. The other FMU tells a flushed subnormal by adding 1."""
    if executor == "python":
        monkeypatch.setattr("cosim.engine.compiled.applies", lambda instances: False)
    result = cosim.run(hostile.scenario("THIRD", tmp_path, beside="ROUNDS"))
    assert (result["evil.y"][1:] == 1 / 3).all() and len(result.time) == 201


def test_an_fmu_that_is_never_freed_loses_no_result_and_is_ended(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(child, "FAREWELL", 0.5)
    result = cosim.run(hostile.scenario("FREE_HANGS", tmp_path))
    assert result.failure is None and len(result.time) == 201
    child._dismissed(wait=True)
    assert not child._LEAVING and "FMU evil was being freed for 0.5 s and was ended" in capfd.readouterr().err


def test_results_are_there_before_instances_are_freed(tmp_path):
    hostile.scenario("FREE_HANGS", tmp_path)
    process = subprocess.Popen([*COSIM, "run", "s.toml", "--out", "o"], cwd=tmp_path)
    wait_until((tmp_path / "o/summary.json").is_file)
    process.kill()
    process.wait()
    assert len(cosim.open_result(tmp_path / "o").time) == 201
    wait_until(lambda: not using(tmp_path))


def test_export_survives_fmus_that_exit_and_tells_of_those_that_crash(tmp_path):
    hostile.scenario("FREE_EXITS", tmp_path)
    done = command("export", "s.toml", "--out", "o", cwd=tmp_path)
    assert done.returncode == 0 and (tmp_path / "o/s.ssp").is_file() and "s.ssp" in done.stdout
    hostile.scenario("LOAD_CRASHES", tmp_path)
    done = command("export", "s.toml", "--out", "p", cwd=tmp_path)
    assert done.returncode == 1 and "FMU evil: the FMU crashed while it was loaded (signal SIGSEGV" in done.stderr


@pytest.mark.parametrize("way", ["LOOPS", "SLOW"])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_signals_keep_the_rows_as_ctrl_c_does(tmp_path, way, number):
    hostile.scenario(way, tmp_path, stop=20.0)
    process = subprocess.Popen([*COSIM, "run", "s.toml", "--out", "o"], cwd=tmp_path, stderr=subprocess.PIPE)
    wait_until(lambda: len(using(tmp_path)) > 1)  # the FMUs' process
    wait_until(lambda: _steps_are_made(using(tmp_path)))
    process.send_signal(number)
    assert process.wait(timeout=60) == 130
    result = cosim.open_result(tmp_path / "o")
    assert result.summary["outcome"] == "inconclusive" and 1 < len(result.time) < 20_000
    wait_until(lambda: not using(tmp_path))


def _steps_are_made(processes):
    """Whether the library was loaded a while ago: a looping FMU has used processor time, a slow one has slept often."""
    for process in processes:
        try:
            place = Path(f"/proc/{process}")
            loaded = "hostile" in (place / "maps").read_text()
            ticks = (place / "stat").read_text().rpartition(")")[2].split()
            slept = int(re.search(r"\nvoluntary_ctxt_switches:\s+(\d+)", (place / "status").read_text())[1])
        except OSError:
            continue
        if loaded and (int(ticks[11]) + int(ticks[12]) >= 20 or slept > 60):
            return True
    return False


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("kind", ["run", "sweep"])
def test_no_process_outlives_its_parent(tmp_path, number, kind):
    hostile.scenario("LOOPS", tmp_path)
    two_arms = next(path for path in shipped() if path.stem == "sallam-nodelay").read_text()
    (tmp_path / "arms.toml").write_text(f'{two_arms}\n[components.evil]\nfmu = "evil.fmu"\n')
    (tmp_path / "w.toml").write_text(
        'scenario = "arms.toml"\nevaluator = "cosimulation"\n[grid]\n'
        '[[axes]]\nname = "k"\npaths = ["controller_*.stiffness"]\ncount = 4\nlow = 1\nhigh = 2\n'
    )
    words = {"run": ["run", "s.toml"], "sweep": ["sweep", "w.toml", "--workers", "2"]}[kind]
    process = subprocess.Popen([*COSIM, *words, "--out", "o"], cwd=tmp_path, stderr=subprocess.DEVNULL)
    wait_until(lambda: len(using(tmp_path)) > 1 and _steps_are_made(using(tmp_path)))
    process.send_signal(number)
    process.wait(timeout=60)
    wait_until(lambda: not using(tmp_path))
    assert process.returncode in (130, -number)
