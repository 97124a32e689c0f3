"""Files are complete or not there, of one run, where they belong; full disks and odd files end with a message."""

import json
import os
import resource
import subprocess
import sys

import numpy as np
import pytest

import cosim
from cosim.cli.folder import named
from cosim.results.files import read_table, write_table
from cosim.results.saving import save_files, write_json
from cosim.scenario.ssp_grammar import NAMESPACES
from tests.support import hostile
from tests.support.commands import ended

COSIM = [sys.executable, "-m", "cosim"]
SHORT = ["--set", "experiment.stop=8"]


def command(*words, **options):
    return subprocess.run([*COSIM, *map(str, words)], capture_output=True, text=True, timeout=100, **options)


def names(folder):
    return sorted(entry.name for entry in folder.iterdir())


def limited(size):
    """No file may become larger: what a full disk does to a single file."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.parametrize("size", [100_000, 700_000])
def test_a_full_disk_is_told_and_keeps_the_files_that_fit(tmp_path, size):
    """8 s of the scenario: result.h5 of over 1 MB, report.html of 0.3 MB, summary.json of 3 kB."""
    assert command("run", "sallam-stable", *SHORT, "--out", "built", cwd=tmp_path).returncode == 0  # its FMUs are there
    done = command("run", "sallam-stable", *SHORT, "--out", "o", cwd=tmp_path, preexec_fn=limited(size))
    assert done.returncode == 1, done.stderr
    assert "error: not written: o/result.h5: File too large" in done.stderr and "free space" in done.stderr
    assert json.loads((tmp_path / "o/summary.json").read_text())["scenario"] == "sallam-stable"
    assert (tmp_path / "o/report.html").exists() == (size > 400_000)
    assert not list((tmp_path / "o").glob("*.part")) and not (tmp_path / "o/result.h5").exists()


def test_a_table_that_outgrows_its_disk_leaves_none(tmp_path):
    """The space for texts is estimated: where it is too little, the failure comes while HDF5 writes."""
    program = """
import resource, sys
from pathlib import Path
from cosim.results.files import write_table
from tests.support.commands import ended
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
try:
    texts = {f"k{n}": "y" * 60_000 for n in range(10)}
    write_table({"a": [1.0] * 10, "b": ["x"] * 10}, {}, texts, Path(sys.argv[1]))
except OSError as error:
    print(error.strerror)
"""
    done = subprocess.run([sys.executable, "-c", program, tmp_path / "t.h5"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "File too large\n"), done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_table_comes_back(tmp_path):
    columns = {"a": list(np.linspace(0, 1, 1000)), "b": [f"text {n}" for n in range(1000)]}
    assert read_table(write_table(columns, {"a": "m"}, {"name": "n"}, tmp_path / "t.h5")) == columns


def test_a_folder_in_place_of_a_file_stops_nothing_else(tmp_path):
    hostile.scenario("HONEST", tmp_path)
    (tmp_path / "o/result.h5").mkdir(parents=True)
    done = command("run", "s.toml", "--out", "o", cwd=tmp_path)
    assert done.returncode == 1 and "not written: o/result.h5: Is a directory" in done.stderr
    assert (tmp_path / "o/summary.json").is_file() and (tmp_path / "o/report.html").is_file()


def test_what_another_run_left_goes_first(tmp_path):
    """Killed between its first file and its last, the second run leaves nothing of the first beside its own."""
    hostile.scenario("HONEST", tmp_path)
    first = cosim.run(tmp_path / "s.toml")
    first.save(tmp_path / "o", export=["csv"])
    assert names(tmp_path / "o") == ["report.html", "result.csv", "result.h5", "summary.json"]

    def killed(path):
        raise SystemExit

    with pytest.raises(SystemExit):
        save_files(
            tmp_path / "o", {"result.h5": lambda path: path.write_text("B"), "summary.json": killed}, ["report.html"]
        )
    assert names(tmp_path / "o") == ["result.csv", "result.h5"]
    first.save(tmp_path / "o", report=False)
    assert names(tmp_path / "o") == ["result.h5", "summary.json"]


def test_ctrl_c_while_files_are_written_loses_none(tmp_path):
    calls = []

    def pressed(path):
        calls.append(path.name)
        if len(calls) == 1:
            raise KeyboardInterrupt
        write_json({"a": 1}, path)

    with pytest.raises(KeyboardInterrupt):
        save_files(tmp_path, {"a.json": pressed, "b.json": pressed})
    assert calls == ["a.json", "a.json", "b.json"] and names(tmp_path) == ["a.json", "b.json"]


@pytest.mark.parametrize("name", ["../../x", "/etc/x", "..", "", "a/../../b", "x\n", "." * 300])
def test_names_choose_no_folder_outside_results(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = named(name).resolve()
    assert folder.parent == tmp_path / "results" and len(folder.name) <= 200
    assert named("sallam-stable").name == "sallam-stable"


def test_a_scenario_with_slashes_in_its_name_stays_in_results(tmp_path):
    path = hostile.scenario("HONEST", tmp_path)
    path.write_text('name = "../../escaped"\n' + path.read_text())
    assert command("run", "s.toml", cwd=tmp_path).returncode == 0
    assert [p.parent.name for p in tmp_path.rglob("summary.json")] == ["_.._escaped"]
    assert not (tmp_path.parent / "escaped").exists() and not (tmp_path.parent.parent / "escaped").exists()


COMMANDS = [
    ["run", "PLACE"],
    ["run", "--effects=PLACE"],
    ["sweep", "PLACE"],
    ["sweep", "gain-delay", "--evaluator=PLACE"],
    ["stability", "PLACE"],
    ["show", "PLACE"],
    ["export", "PLACE"],
    ["fmu", "PLACE"],
    ["data", "PLACE"],
    ["identify", "PLACE"],
    ["identify", "d.csv", "--description=PLACE"],
    ["close-loop", "d.csv", "--effects=PLACE"],
    ["robot", "PLACE"],
]
"""Every command with the places where it takes a file."""
NAMED = {
    "fmu": ["run", "s.toml"],
    "recording": ["run", "s.toml"],
    "source": ["run", "x"],
    "beside": ["identify", "d.csv"],
    "effects": ["sweep", "w.toml"],
}
"""Files that name others, and the command that reads them."""


@pytest.fixture
def strange(tmp_path):
    """A folder with a pipe that nobody writes to and the files of the commands."""
    os.mkfifo(tmp_path / "pipe")
    time = np.arange(500) * 1e-3
    table = np.column_stack([time, *(np.sin((3 + k) * time) for k in range(6))])
    np.savetxt(tmp_path / "d.csv", table, delimiter=",", header="time,q1,q2,q3,tau1,tau2,tau3", comments="")
    return tmp_path


def refused(folder, words, monkeypatch, capsys):
    """What a command says that ends with 2."""
    monkeypatch.chdir(folder)
    code, _, err = ended(capsys, *words)
    assert code == 2
    return err


@pytest.mark.timeout(60)  # a pipe that is opened is waited for
@pytest.mark.parametrize("place", ["pipe", "/dev/zero"])
@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_pipes_and_devices_are_refused_at_once(strange, words, place, monkeypatch, capsys):
    if words[-1] == "--evaluator=PLACE":
        (strange / "e.py").symlink_to(strange / "pipe" if place == "pipe" else place)
        place = "e.py"
    told = refused(strange, [word.replace("PLACE", place) for word in words], monkeypatch, capsys)
    assert "got a device or a pipe" in told and "write it to a file first" in told


@pytest.mark.timeout(60)  # a pipe that is opened is waited for
@pytest.mark.parametrize("place", ["pipe", "/dev/zero"])
@pytest.mark.parametrize("named", NAMED)
def test_a_pipe_that_a_file_names_is_refused_at_once(strange, named, place, monkeypatch, capsys):
    component = {"fmu": f"fmu = {place!r}", "recording": f"recording = {place!r}\ncolumns = ['q']"}.get(named, "")
    (strange / "s.toml").write_text(f"connections = []\n[experiment]\nstop = 1.0\n[components.a]\n{component}\n")
    axes = "[[axes]]\nname = 'k'\npaths = ['controller_*.stiffness']\nlow = 1.0\nhigh = 2.0\n[grid]\n"
    (strange / "w.toml").write_text(f"scenario = 'sallam-nodelay'\neffects = {place!r}\n{axes}")
    (strange / "x").mkdir()
    component = f"<ssd:Component name='a' source='{'../pipe' if place == 'pipe' else place}'/>"
    (strange / "x/SystemStructure.ssd").write_text(
        f"<ssd:SystemStructureDescription name='x' version='1.0' xmlns:ssd='{NAMESPACES['ssd']}'><ssd:System name='s'>"
        f"<ssd:Elements>{component}</ssd:Elements></ssd:System></ssd:SystemStructureDescription>"
    )
    if named == "beside":
        (strange / "d.toml").symlink_to(strange / "pipe" if place == "pipe" else place)
    told = refused(strange, NAMED[named], monkeypatch, capsys)
    assert "a device or a pipe" in told or (named == "source" and "expected a file as source" in told), told


UNFED = "warning: good: nothing feeds u, which stays at the start value; wire it, or give it one in parameters\n"


@pytest.mark.parametrize("closed", ["1>&-", "2>&-", "1>&- 2>&-", "<&- 1>&- 2>&-", "| true"])
def test_closed_streams_are_no_error(tmp_path, closed):
    hostile.scenario("HONEST", tmp_path)
    program = f"set -o pipefail; {sys.executable} -m cosim run s.toml --out o {closed}"
    done = subprocess.run(["bash", "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stderr in ("", UNFED)
    assert len(cosim.open_result(tmp_path / "o").time) == 201


def test_damaged_results_are_bad_input(tmp_path):
    hostile.scenario("HONEST", tmp_path)
    cosim.run(tmp_path / "s.toml").save(tmp_path, report=False)
    whole = (tmp_path / "result.h5").read_bytes()
    for cut in (0, 100, len(whole) // 2):
        (tmp_path / "result.h5").write_bytes(whole[:cut])
        with pytest.raises(cosim.InputError, match="expected a result of cosim"):
            cosim.open_result(tmp_path)
    (tmp_path / "result.h5").write_bytes(whole)
    (tmp_path / "summary.json").write_text("[1]")
    with pytest.raises(cosim.InputError, match="summary of a run"):
        cosim.open_result(tmp_path)


def test_the_cache_is_listed_and_cleaned(tmp_path):
    cache = tmp_path / "cache"
    (cache / "extracted/a").mkdir(parents=True)
    (cache / "extracted/a/b").write_bytes(bytes(2_000_000))
    (cache / "fmus").mkdir()
    environment = os.environ | {"COSIM_CACHE": str(cache)}
    listed = command("cache", "list", env=environment)
    assert listed.returncode == 0 and "extracted        1 files        2.0 MB" in listed.stdout
    wrong = command("cache", "clean", "extractd", env=environment)
    assert wrong.returncode == 2 and "did you mean 'extracted'" in wrong.stderr
    assert command("cache", "clean", "extracted", env=environment).returncode == 0
    assert [entry.name for entry in cache.iterdir()] == ["fmus"]
    assert command("cache", "clean", env=environment).returncode == 0 and list(cache.iterdir()) == []
