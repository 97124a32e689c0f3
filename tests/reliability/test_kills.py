"""Commands killed at random moments: a repeat succeeds, and leaves no process and no temporary folder."""

import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from build_fmus.scratch import workspace
from build_fmus.unpacking import unpack
from tests.support.paths import DATA

pytestmark = pytest.mark.needs("proc")
PYTHON = sys.executable
RUN = [PYTHON, "-m", "cosim", "run", "sallam-stable", "--set", "experiment.stop=8", "--out", "o"]
SWEEP = [PYTHON, "-m", "cosim", "sweep", "w.toml", "--workers", "2", "--out", "w"]
CLOSE = [PYTHON, "-m", "cosim", "close-loop", str(DATA / "staubli_tx40/staubli_tx40_j6.csv"), "--out", "c"]
BUILD = [PYTHON, "-m", "build_fmus", "Operator", "PLikeController", "--out", "b"]
EXPORT = [PYTHON, "-m", "cosim", "export", "sallam-nodelay", "--out", "e"]
LEFT = {
    "run": (RUN, ["o/report.html", "o/result.h5", "o/summary.json"]),
    "sweep": (SWEEP, ["w/journal.jsonl", "w/report.html", "w/summary.json", "w/sweep.h5"]),
    "close-loop": (CLOSE, ["c/closure.json", "c/report.html"]),
    "build-fmus": (BUILD, ["b/fmi2/Operator.fmu", "b/fmi3/Operator.fmu", "b/fmi3/PLikeController.fmu"]),
    "export": (EXPORT, ["e/sallam-nodelay.ssp", "e/fmi2/Operator.fmu", "e/fmi3/PhantomArm.fmu"]),
}
SPEC = """scenario = "sallam-nodelay"
evaluator = "cosimulation"
[set]
"experiment.stop" = 10.0
[random]
count = 12
[[axes]]
name = "k"
paths = ["controller_*.stiffness"]
low = 0.1
high = 0.5
"""


@pytest.fixture
def place(tmp_path):
    """A folder to work in, with temporary files of its own."""
    (tmp_path / "tmp").mkdir()
    (tmp_path / "w.toml").write_text(SPEC)
    return tmp_path


def begun(place, name):
    """The command; builds take a cache of their own, so that there is something to kill."""
    environment = os.environ | {"TMPDIR": str(place / "tmp")}
    if name == "build-fmus":
        environment["COSIM_CACHE"] = str(place / "cache")
    with open(place / "said", "w") as said:
        return subprocess.Popen(LEFT[name][0], cwd=place, env=environment, stdout=said, stderr=said)


def alive(place):
    """Processes that have the folder for temporary files, zombies apart."""
    mark, found = f"TMPDIR={place / 'tmp'}".encode(), []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if mark in (entry / "environ").read_bytes().split(b"\0"):
                found.append((entry / "cmdline").read_bytes().replace(b"\0", b" ")[:80])
        except OSError:
            continue
    return found


def nothing_left(place):
    until = time.monotonic() + 10.0
    while alive(place):
        assert time.monotonic() < until, alive(place)
        time.sleep(0.05)


def killed(place, name, number, after):
    """End the command by the signal after so many seconds; whether it was still at work."""
    process = begun(place, name)
    try:
        process.wait(timeout=after)
    except subprocess.TimeoutExpired:
        process.send_signal(number)
        assert process.wait(timeout=60) in (130, -number, 0)
        nothing_left(place)
        return True
    return False


def repeated(place, name):
    """The same command once more: it succeeds, its files are there, and nothing else is."""
    process = begun(place, name)
    assert process.wait(timeout=1000) == 0, (place / "said").read_text()
    nothing_left(place)
    assert all((place / file).is_file() for file in LEFT[name][1])
    assert [str(p) for p in place.rglob("*.part")] == [] and list((place / "tmp").iterdir()) == []


@pytest.mark.parametrize(
    ("name", "number", "after"),
    [
        ("run", signal.SIGKILL, 1.2),
        ("sweep", signal.SIGKILL, 2.5),
        ("build-fmus", signal.SIGTERM, 1.5),
        ("build-fmus", signal.SIGKILL, 1.5),
        ("export", signal.SIGTERM, 1.2),
    ],
)
def test_a_kill_leaves_nothing_that_a_repeat_does_not_mend(place, name, number, after):
    killed(place, name, number, after)
    repeated(place, name)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", list(LEFT))
def test_eight_kills_at_random_moments(place, name):
    """With five commands: 40."""
    rng = np.random.default_rng(len(name))
    began = time.monotonic()
    repeated(place, name)
    whole = time.monotonic() - began
    for turn in range(8):
        number = [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT][turn % 4]
        if name in ("sweep", "build-fmus"):
            for file in LEFT[name][1]:
                (place / file).unlink(missing_ok=True)
        killed(place, name, number, float(rng.uniform(0.0, whole)))
        repeated(place, name)


def test_a_folder_of_a_dead_process_is_removed_and_that_of_a_living_one_is_not(tmp_path):
    program = f"""
import sys
from pathlib import Path
from build_fmus.scratch import workspace
from build_fmus.unpacking import unpack
with workspace(Path({str(tmp_path)!r})) as folder:
    print(folder, flush=True)
    sys.stdin.read()
"""
    dead, living = (
        subprocess.Popen([PYTHON, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    )
    folders = [Path(process.stdout.readline().strip()) for process in (dead, living)]
    dead.kill()
    dead.wait()
    with workspace(tmp_path) as mine:
        assert set(tmp_path.iterdir()) == {folders[1], mine}
    living.communicate("")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("removed", range(1, 5))
def test_a_folder_whose_removal_was_killed_is_removed_by_who_comes_next(tmp_path, removed):
    program = f"""
import os, signal
from pathlib import Path
from build_fmus.scratch import workspace
unlink, count = os.unlink, 0
def killed(*words, **more):
    global count
    unlink(*words, **more)
    count += 1
    if count == {removed}:
        os.kill(os.getpid(), signal.SIGKILL)
with workspace(Path({str(tmp_path)!r})) as folder:
    for name in ("0", "a", "z"):
        (folder / name).write_text("")
    os.unlink = killed
"""
    done = subprocess.run([PYTHON, "-c", program], check=False)
    assert done.returncode == -signal.SIGKILL and len(list(tmp_path.iterdir())) == 1
    with workspace(tmp_path) as mine:
        assert list(tmp_path.iterdir()) == [mine]


def test_an_archive_whose_unpacking_was_killed_leaves_nothing_after_the_repeat(tmp_path):
    archive, folder = tmp_path / "a.zip", tmp_path / "cache/contents"
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("first", bytes(1000))
        file.writestr("second", bytes(1000))
    program = f"""
import sys, zipfile
from pathlib import Path
from build_fmus.unpacking import unpack
extract = zipfile.ZipFile.extract
def slow(self, member, *more):
    extract(self, member, *more)
    print("one member is there", flush=True)
    sys.stdin.read()
zipfile.ZipFile.extract = slow
unpack(Path({str(archive)!r}), Path({str(folder)!r}))
"""
    process = subprocess.Popen([PYTHON, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "one member is there\n"
    process.kill()
    process.communicate()
    assert not folder.exists() and list(folder.parent.rglob("first"))
    unpack(archive, folder)
    assert list(folder.parent.iterdir()) == [folder] and {p.name for p in folder.iterdir()} == {"first", "second"}
