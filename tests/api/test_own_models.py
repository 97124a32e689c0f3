"""A user's own models: written by `cosim new`, built anywhere, named by path, built again when changed."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import cosim
from build_fmus import cache
from build_fmus.cli import app
from cosim.api.starting import KINDS
from cosim.effects import load_effects
from cosim.errors import InputError
from cosim.exports.structure import write_ssp
from cosim.fmu import describe, open_system
from tests.support.commands import told
from tests.support.paths import SOURCES

SAME = ("arm_l.x", "arm_r.x", "controller_l.f")
SHORT = {"experiment.stop": 0.5}


@pytest.fixture
def controller(tmp_path) -> Path:
    """A new controller in C."""
    return cosim.new("controller", tmp_path / "MyController").path


def reference() -> cosim.RunResult:
    """The same loop with the shipped P-like controller, whose law a new controller begins with."""
    return cosim.run(cosim.load(Path(cosim.__file__).parent / "api/beginnings/scenario.toml").with_values(SHORT))


# --- new --------------------------------------------------------------------------------------------------------------


@pytest.mark.needs("exporters")
def test_a_new_controller_begins_as_the_known_one_in_both_languages(controller, tmp_path):
    python = cosim.new("controller", tmp_path / "Slow", language="python").path
    known = reference()
    for folder in (controller, python):
        result = cosim.run(cosim.load(folder / "scenario.toml").with_values(SHORT))
        for name in SAME:
            assert np.array_equal(result[name], known[name]), f"{folder.name}: {name}"  # the same law, the same bits


def test_a_new_model_is_the_oscillator_that_it_says(tmp_path):
    folder = cosim.new("model", tmp_path / "Mass").path
    result = cosim.run(cosim.load(folder / "scenario.toml").with_values({"experiment.stop": 2.0}))
    decay, frequency = 0.5, np.sqrt(100.0 - 0.25)  # m = 1, b = 1, k = 100: b / 2m, sqrt(k/m - (b/2m)^2)
    t = result.time
    exact = 0.01 * np.exp(-decay * t) * (np.cos(frequency * t) + decay / frequency * np.sin(frequency * t))
    assert np.abs(result["model.position"] - exact).max() < 1e-12  # RK4 at 0.25 ms: (w h)^4 / 120 of 0.01 m


def test_new_files_are_read_by_what_they_are_for(tmp_path):
    effect = cosim.new("effect", tmp_path / "SquareRoot").path
    (found,) = load_effects(effect)
    assert (found.name, type(found).__name__) == ("square_root", "SquareRoot")
    scenario = cosim.load(cosim.new("scenario", tmp_path / "loop").path)
    assert scenario.name == "loop" and scenario.arms == ("arm_l", "arm_r")
    table = cosim.sweep(cosim.new("sweep", tmp_path / "map").path, workers=1, set={"experiment.stop": 1.0})
    assert len(table) == 16 and table.failure is None
    description = cosim.new("description", tmp_path / "mine").path
    time = np.arange(400) * 1e-3
    angles = 0.1 * np.sin(np.outer(time, [7.0, 9.0, 11.0]))
    data = np.column_stack([time, angles, angles])
    np.savetxt(tmp_path / "mine.csv", data, delimiter=",", header="time,q1,q2,q3,tau1,tau2,tau3", comments="")
    assert len(cosim.read(tmp_path / "mine.csv").joints) == 3
    assert cosim.data(tmp_path / "mine.csv", description).recording is not None


def test_nothing_is_overwritten_and_names_are_checked(controller, capsys, tmp_path):
    before = (controller / "law.h").read_bytes()
    assert told(capsys, "new", "controller", controller)[0] == 2
    assert (controller / "law.h").read_bytes() == before
    wrong = (
        ("controler", "A"),
        ("controller", "2nd"),
        ("effect", "a-b"),
        ("effect", "class"),
        ("model", "M", "--language", "python"),
    )
    for words in wrong:
        code, text = told(capsys, "new", words[0], tmp_path / words[1], *words[2:])
        assert code == 2 and "expected" in text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["MyController"]


def test_every_kind_is_in_the_help(capsys):
    assert "controller, model, effect, scenario, sweep or description" in told(capsys, "new", "--help")[1]
    assert list(KINDS) == ["controller", "model", "effect", "scenario", "sweep", "description"]


# --- built anywhere ---------------------------------------------------------------------------------------------------


def test_a_folder_is_built_without_a_compiler_on_the_path(controller, tmp_path):
    """As a stranger's tool does it: two FMUs that fmpy finds valid, by the one command, with an empty PATH."""
    from fmpy.validation import validate_fmu

    environment = {k: v for k, v in os.environ.items() if k not in ("PATH", "CC")} | {"PATH": str(tmp_path)}
    command = [sys.executable, "-m", "build_fmus", str(controller), "--out", str(tmp_path / "out")]
    subprocess.run(command, check=True, env=environment, capture_output=True)
    files = [tmp_path / "out" / f"fmi{version}" / "MyController.fmu" for version in (2, 3)]
    assert [validate_fmu(str(file)) for file in files] == [[], []]
    assert [file.read_bytes() for file in cosim.build(controller)] == [file.read_bytes() for file in files]


def test_a_folder_here_needs_no_dot_and_a_missing_one_is_named(controller, monkeypatch, capsys):
    monkeypatch.chdir(controller.parent)
    (file,) = cosim.build(["MyController"], "out", fmi=3)
    assert file == Path("out/fmi3/MyController.fmu") and file.is_file()
    with pytest.raises(InputError, match="no model 'MyControler'"):
        cosim.build(["MyControler"])
    with pytest.raises(InputError, match="no folder of a model"):
        cosim.build(["./MyControler"])


def test_a_copy_of_a_shipped_model_is_built_anywhere(tmp_path):
    """Its includes of files that our models share are found; its law is the shipped one, so is its token."""
    shutil.copytree(SOURCES / "AxisDrive", tmp_path / "AxisDrive")
    own, shipped = cosim.build([tmp_path / "AxisDrive", "AxisDrive"], fmi=2)
    assert describe(own).token == describe(shipped).token


MISTAKES = {
    "law.h": ("m->damping[i] * m->dx[i];", "m->dampng[i] * m->dx[i];", "law.h:8:"),
    "model.c": ("(void)t;", "int t;", "model.c:7:"),
    "model.toml": ('unit = "N"', 'unti = "N"', "did you mean 'unit'"),
}


@pytest.mark.parametrize("file", MISTAKES)
def test_a_mistake_is_pointed_at_in_the_users_file(file, controller, capsys):
    old, new, place = MISTAKES[file]
    path = controller / file
    path.write_text(path.read_text().replace(old, new, 1))
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if new in text)
    place = f"{path}:{line}:" if ":" in place else place
    code, text = told(capsys, "run", controller / "scenario.toml", "--out", controller.parent / "r")
    assert code == 2 and place in text and "Traceback" not in text
    assert text.count(place) == 1  # two components share the model: it is told once
    with pytest.raises(InputError, match=re.escape(place)):
        cosim.build(controller)


@pytest.mark.needs("exporters")
def test_a_mistake_in_python_is_pointed_at(tmp_path, capsys):
    folder = cosim.new("controller", tmp_path / "Slow", language="python").path
    path = folder / "Slow.py"
    path.write_text(path.read_text().replace("self.stiffness, self.damping =", "self.stiffness, self.dampng =", 1))
    code, text = told(capsys, "run", folder / "scenario.toml", "--out", tmp_path / "r")
    assert code == 2 and re.search(rf"{re.escape(str(path))}:\d+: AttributeError: .*'damping'", text)
    assert "Traceback" not in text


# --- built again ------------------------------------------------------------------------------------------------------


def test_a_changed_law_is_built_again_and_changed_back_it_is_known(controller):
    scenario = cosim.load(controller / "scenario.toml").with_values(SHORT)
    first = cosim.run(scenario)
    law = controller / "law.h"
    before = law.read_text()
    law.write_text(
        before.replace("double force[3]) {", "double force[3]) {\n    /* twice */", 1).replace("= m->", "= 2.0 * m->")
    )
    second = cosim.run(scenario)
    law.write_text(before)
    third = cosim.run(scenario)
    hashes = [{f["component"]: f["sha256"] for f in r.summary["fmus"]}["controller_l"] for r in (first, second, third)]
    assert hashes[0] == hashes[2] != hashes[1]
    assert np.array_equal(first["arm_l.x"], third["arm_l.x"])
    assert not np.array_equal(first["arm_l.x"], second["arm_l.x"])


def test_a_model_for_a_shipped_scenario_is_named_from_the_working_folder(controller, monkeypatch):
    monkeypatch.chdir(controller.parent)
    changed = cosim.load("sallam-nodelay").with_values({"controller_*.model": "./MyController"} | SHORT)
    known = cosim.run(cosim.load("sallam-nodelay").with_values(SHORT))
    assert np.array_equal(cosim.run(changed)["arm_r.x"], known["arm_r.x"])
    with pytest.raises(InputError, match="a folder with a model.toml"):
        cosim.load("sallam-nodelay").with_values({"controller_l.model": "./Other"})


SWEEP = """
format = 1
scenario = "{scenario}"
[set]
"experiment.stop" = 0.2
[[axes]]
name = "law"
choices = [
    {{ label = "one", set = {{ "controller_*.model" = "{one}" }} }},
    {{ label = "two", set = {{ "controller_*.model" = "{two}" }} }},
]
[[axes]]
name = "stiffness"
paths = ["controller_*.stiffness"]
values = [0.1, 0.2, 0.3, 0.4]
[grid]
"""


def test_a_sweep_builds_each_model_once_and_again_when_it_has_changed(tmp_path):
    """Two workers, two models: two builds, both before the workers begin; a changed model is another sweep."""
    one, two = (cosim.new("controller", tmp_path / name).path for name in ("SweptOne", "SweptTwo"))
    plain = (one / "law.h").read_text() + f"/* {tmp_path} */\n"  # no earlier run of this test has built it
    (one / "law.h").write_text(plain)
    (two / "law.h").write_text(plain.replace("SweptOne", "SweptTwo").replace("= m->", "= 0.5 * m->"))
    spec = tmp_path / "sweep.toml"
    spec.write_text(SWEEP.format(scenario=one / "scenario.toml", one=one, two=two))
    before = built()

    first = rates(cosim.sweep(spec, workers=2, folder=tmp_path / "s"))
    assert built() == before + 2
    assert first["one", 0.1] == first["two", 0.2] and first["one", 0.2] == first["two", 0.4]  # half of it, to the bit
    (two / "law.h").write_text(plain.replace("SweptOne", "SweptTwo"))
    with pytest.raises(InputError, match="that of another one or of a changed one"):
        cosim.sweep(spec, workers=2, folder=tmp_path / "s")
    again = rates(cosim.sweep(spec, workers=2))
    assert built() == before + 3
    assert again["one", 0.2] == again["two", 0.2] == first["one", 0.2]


def built() -> int:
    """FMUs of this test's models in the cache."""
    return sum(1 for _ in (cache.cache_folder() / "fmus").glob("*/Swept*.fmu"))


def rates(table: cosim.SweepTable) -> dict[tuple[str, float], float]:
    columns = table.columns
    assert "failed" not in columns["outcome"]
    return dict(zip(zip(columns["law"], columns["stiffness"]), columns["growth_rate"]))


def test_two_who_want_the_same_fmu_build_it_once(controller):
    """Both find it missing; the second waits for the first."""
    target, turns = controller / "waiting" / "x.fmu", []

    def work(_: int) -> None:
        with cache.one_at_a_time(target):
            if not target.is_file():
                turns.append(1)
                cache.store(target, b"x")

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, range(8)))
    assert turns == [1]


def test_a_crash_in_an_own_law_is_told_and_ends_nothing_else(controller, children_crash):
    """A mistake that no compiler finds: the run fails, this process lives."""
    law = controller / "law.h"
    law.write_text(law.read_text().replace("force[i] =", "*(volatile int *)(size_t)i = i;\n        force[i] =", 1))
    with pytest.raises(cosim.RunError, match="controller_l"):
        cosim.run(cosim.load(controller / "scenario.toml").with_values(SHORT))


def test_an_own_controller_is_exported_with_its_parameters(controller, tmp_path):
    scenario = cosim.load(controller / "scenario.toml").with_values(SHORT | {"controller_l.stiffness": 0.5})
    with open_system(scenario) as system:
        ssp = write_ssp(system.wiring(scenario), tmp_path / "loop.ssp")
    again = cosim.run(cosim.load(ssp))
    assert np.array_equal(again["controller_l.f"][::5], cosim.run(scenario)["controller_l.f"])  # record_every = 5


# --- the page ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_page_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    """Every command of own-controller.md in an empty folder, its files written; short runs and maps of four points."""
    monkeypatch.chdir(tmp_path)
    page = (Path(cosim.__file__).parent / "manual" / "own-controller.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w+)(?: (>+) (\S+))?\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert [kind for kind, *_ in blocks].count("console") >= 8 and [mode for _, mode, *_ in blocks].count(">") == 2
    for kind, mode, file, text in blocks:
        if kind == "console":
            for line in text.splitlines():
                if line.startswith(("$ cosim", "$ build-fmus")):
                    run_line(line[2:], capsys)
        elif kind == "python":
            exec(compile(text, "page", "exec"), {})
        else:
            with (tmp_path / file).open("w" if mode == ">" else "a") as stream:
                stream.write(text)
    boundaries = [json.loads((tmp_path / f"results/{name}/summary.json").read_text()) for name in ("before", "after")]
    assert [b["points"] for b in boundaries] == [4, 4]
    assert (tmp_path / "fmus/fmi3/MyController.fmu").is_file()


def run_line(line: str, capsys) -> None:
    words = shlex.split(line)
    if words[:2] == ["cosim", "sweep"]:  # a map of few points
        spec = Path(words[2])
        spec.write_text(
            re.sub(
                r"(?<!count = 2\n)low = .*",
                r"count = 2\n\g<0>",
                spec.read_text().partition("[boundary]")[0].partition("[grid]")[0],
            )
            + "[grid]\n"
        )
    if words[0] == "build-fmus":
        assert CliRunner().invoke(app, words[1:]).exit_code == 0
        return
    brief = ["--set", "experiment.stop=0.5"] if words[1] == "run" else []
    code, text = told(capsys, *words[1:], *brief)
    assert code == 0, f"{line}: {text}"
    if words[1] == "new":
        scenario = Path(words[3]) / "scenario.toml"
        scenario.write_text(scenario.read_text().replace("stop = 20.0 ", "stop = 2.0 "))
