"""The live page: the bits of `cosim run`, what is refused, and the page in a browser: drag, delay, keyboard."""

import json
import re
import subprocess

import numpy as np
import pytest

import cosim
from cosim.analysis.gain_map import gain_map
from cosim.api import touching
from cosim.api.runs import checked
from cosim.api.touching import models_of
from cosim.fmu import descriptions, open_system
from cosim.report.html import WEB
from cosim.report.live import LiveChoice, write_live
from cosim.report.live_controls import coupling, slider_names
from cosim.wiring import wire
from tests.support.browser import open_page
from tests.support.commands import ended
from tests.support.needs import node
from tests.support.paths import ROOT

SCENARIOS = ("sallam-stable", "contact", "sallam-joint")
DELAY = 0.3
SHORT = {"experiment.stop": 1.0}


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Makes the page of a scenario with values."""
    made = {}

    def page(name, *values):
        if (name, values) not in made:
            folder = tmp_path_factory.mktemp("live")
            made[name, values] = write_live([LiveChoice("", checked(name, values))], folder / "live.html")
        return made[name, values]

    return page


def run_page(file, rows, out, choice=0, changed=None):
    """What tests/support/loop.mjs tells of a page, and the rows. changed: start values to set first."""
    script = ROOT / "tests" / "support" / "loop.mjs"
    command = [node(), script, file, WEB / "loop.js", str(rows), out, str(choice), json.dumps(changed or {})]
    told = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return told, np.fromfile(out).reshape(rows + 1, -1)


def same_bits(file, scenario, out, choice=0, changed=None):
    result = cosim.run(scenario)
    told, rows = run_page(file, len(result.time) - 1, out, choice, changed)
    assert told["rows"] == len(result.time) - 1 > 100 and not told["ended"]
    expected = np.column_stack([result[name] for name in told["signals"]])
    assert set(told["signals"]) == set(result.units) and np.ptp(expected, axis=0).max() > 0
    different = (rows.view(np.int64) != expected.view(np.int64)).any(axis=0)
    assert not different.any(), [name for name, bad in zip(told["signals"], different) if bad]
    return told


@pytest.mark.needs("node")
@pytest.mark.parametrize("name", [*SCENARIOS, "recorded-delay"])
def test_the_rows_have_the_bits_of_a_run(page, name, tmp_path):
    scenario = cosim.load(name).with_values({"experiment.stop": 2.0})
    told = same_bits(page(name), scenario, tmp_path / "rows")
    assert told["imports"] == []  # nothing of the browser's is called: no clock, no random numbers


@pytest.mark.needs("node")
def test_other_schedules_have_the_bits_of_a_run_too(page, tmp_path):
    values = {"experiment.algorithm": "jacobi", "experiment.extrapolation": "hold", "channel_lr.step_multiple": 2}
    file = page("sallam-stable", *(f"{name}={value}" for name, value in values.items()))
    scenario = cosim.load("sallam-stable").with_values({**values, "experiment.stop": 2.0})
    assert same_bits(file, scenario, tmp_path / "rows")["rows"] == 400


@pytest.mark.needs("node")
def test_a_law_of_delay_that_is_changed_in_the_page_has_the_bits_of_a_run(page, tmp_path):
    law = {"law": "uniform", "delay_min": 0.02, "delay_max": 0.1}
    scenario = cosim.load("sallam-nodelay").with_values(
        {f"channel_*.{name}": value for name, value in law.items()} | {"experiment.stop": 2.0}
    )
    changed = {f"channel_{way}.{name}": 3 if name == "law" else v for way in ("lr", "rl") for name, v in law.items()}
    same_bits(page("sallam-nodelay"), scenario, tmp_path / "rows", changed=changed)


@pytest.mark.slow
@pytest.mark.needs("node")
@pytest.mark.parametrize("name", SCENARIOS)
def test_the_rows_have_the_bits_of_a_run_of_20_s_faster_than_fifty_times_real_time(page, name, tmp_path):
    scenario = cosim.load(name).with_values({"experiment.stop": 20.0})
    told = same_bits(page(name), scenario, tmp_path / "rows")
    print(f"{name}: {told['factor']:.0f} times real time, by processor time")
    assert told["factor"] >= 50


@pytest.mark.slow
def test_the_page_of_ten_controllers_is_small_enough(tmp_path):
    size = cosim.live("controllers", tmp_path, stability_map=False).stat().st_size
    print(f"{size / 1e6:.2f} MB")
    assert size < 1.5e6


@pytest.mark.needs("node")
def test_a_recording_of_the_page_is_read(page, tmp_path):
    told, _ = run_page(page("sallam-stable"), 400, tmp_path / "rows")
    (tmp_path / "hand.csv").write_text(told["recording"])
    (tmp_path / "hand.toml").write_text(told["recorded"])
    run = cosim.read(tmp_path / "hand.csv").runs[0]
    result = cosim.run(cosim.load("sallam-stable").with_values({"experiment.stop": 2.0}))
    assert np.array_equal(run.q, result["arm_l.q"][1:]) and np.array_equal(run.tau, result["arm_l.tau_motor"][1:])
    assert run.force is not None and run.force.shape == (400, 3)


def test_the_page_is_small_and_fetches_nothing(page):
    text = page("sallam-stable").read_text(encoding="utf-8")
    assert len(text.encode()) < 1.5e6
    assert not [word for word in ("src=", "@import", "fetch(", "XMLHttpRequest") if word in text]


def test_fmus_of_others_are_refused_by_name(tmp_path, capsys):
    from build_fmus import fmu_path

    text = (ROOT / "cosim" / "scenario" / "shipped" / "sallam-nodelay.toml").read_text(encoding="utf-8")
    foreign = tmp_path / "foreign.toml"
    foreign.write_text(text.replace('model = "Operator"', f'fmu = "{fmu_path("Operator", 2)}"'))
    code, _, said = ended(capsys, "live", str(foreign), "--out", tmp_path / "out")
    assert code == 2 and "components.operator" in said and "C sources" in said
    assert not (tmp_path / "out" / "live.html").exists()


@pytest.fixture(scope="module")
def controllers(tmp_path_factory):
    """The page of scenario `controllers` as it is and with waves in the place of its controllers; its scenarios."""
    shown = cosim.load("controllers"), cosim.load("controllers").with_values({"controller_*.model": "WaveController"})
    choices = [LiveChoice(label, wire(s, descriptions(s))) for label, s in zip(("as it is", "waves"), shown)]
    return write_live(choices, tmp_path_factory.mktemp("choices") / "live.html"), shown


@pytest.mark.needs("node")
def test_every_choice_has_the_bits_of_its_run(controllers, tmp_path):
    file, shown = controllers
    for number, scenario in enumerate(shown):
        same_bits(file, scenario.with_values({"experiment.stop": 1.0}), tmp_path / "rows", number)


def test_the_choices_of_a_scenario_are_those_of_its_sweep():
    found = [choice.label for choice in models_of(cosim.load("controllers"))]
    assert found[:4] == ["P+d", "PD+d", "position-force", "waves"] and len(found) == 10
    assert not list(models_of(cosim.load("sallam-stable")))


def test_another_controller_takes_over_and_the_energies_are_those_of_a_run(controllers, browser):
    file, (scenario, _) = controllers
    energies = ("energy_hand", "energy_environment", "energy_coupling")
    expected = cosim.run(scenario.with_values({"experiment.stop": 1.0})).summary["measures"]
    with open_page(browser, file, color_scheme="dark") as seen:
        seen.evaluate(
            "(() => { livePage.running = false; livePage.again();"
            "while (livePage.loop.time < 1 - 1e-9) { livePage.loop.advance(); livePage.note(); } })()"
        )
        told = seen.evaluate("[livePage.energy.hand, livePage.energy.environment, -livePage.energy.coupling]")
        assert told == pytest.approx([expected[name]["value"] for name in energies], rel=1e-9)
        seen.get_by_label("loop").select_option("waves")
        seen.wait_for_selector("html[data-ready='1']", state="attached")
        seen.wait_for_function("livePage.loop.time > 0.05")
        assert seen.locator("#sliders").get_by_text("WaveController").count() > 0
        assert seen.locator("#sliders").get_by_text("PDLikeController").count() == 0
        assert seen.locator("#plots .u-wrap").count() == 3
        assert seen.violations() == [] and seen.said == []


@pytest.fixture(scope="module")
def mapped():
    """The stability map of `sallam-nodelay` at three stiffnesses and its damping."""
    scenario, gains = cosim.load("sallam-nodelay"), ("stiffness", "damping")
    stiffness, damping = ([f"controller_{side}.{g}[{k}]" for side in "lr" for k in (1, 2, 3)] for g in gains)
    with open_system(scenario) as system:
        across, beside = (stiffness, np.array([0.25, 0.5, 1.0])), (damping, np.array([0.09]))
        yield scenario, gain_map(scenario, system, across, beside)


def test_the_map_is_the_boundary_of_the_spectrum(mapped):
    scenario, found = mapped
    expected = cosim.stability(scenario.with_values({"experiment.stop": 2.0})).to_dict()["spectrum"]["max_delay"]
    assert found.delay[0, 0] == pytest.approx(expected, rel=1e-6)


def test_the_live_point_moves_on_the_map_and_jitter_makes_the_law_uniform(mapped, browser, tmp_path):
    scenario, found = mapped
    choice = LiveChoice("", wire(scenario, descriptions(scenario)), found)
    with open_page(browser, write_live([choice], tmp_path / "live.html")) as seen:
        words = seen.locator("#map-says")
        assert "up to 0.457 s each way are borne: the loop stands inside" in words.inner_text()
        delay, jitter = (seen.get_by_label(f"VariableDelayChannel: {word}") for word in ("delay", "jitter"))
        delay.focus()
        for _ in range(50):
            seen.keyboard.press("ArrowRight")
        assert "the loop stands outside" in words.inner_text()
        start = "livePage.loop.starts[livePage.scenario.starts['channel_rl.{}'].place]"
        assert seen.evaluate(start.format("delay_mean")) == pytest.approx(0.5)
        assert seen.evaluate(start.format("law")) == 1
        jitter.focus()
        seen.keyboard.press("ArrowRight")
        assert seen.evaluate(start.format("law")) == 3
        assert seen.evaluate(start.format("delay_min")) == pytest.approx(0.49)
        assert seen.evaluate(start.format("delay_max")) == pytest.approx(0.51)
        assert "jitter" in words.inner_text()
        seen.get_by_label("stiffness K").focus()
        seen.keyboard.press("ArrowLeft")
        borne = seen.evaluate("livePage.map.borne()")
        assert borne == pytest.approx(0.457, rel=0.06) and borne > 0.457
        assert seen.violations() == [] and seen.said == []


def told_choices(file):
    text = file.read_text(encoding="utf-8")
    return json.loads(re.search(r'<script type="application/json" id="choices">(.*?)</script>', text)[1])


def test_the_command_puts_the_map_into_the_page_or_says_why_there_is_none(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(touching, "PLACES", 2)
    monkeypatch.setattr(touching, "LEVELS", np.ones(1))
    code, out, _ = ended(capsys, "live", "sallam-nodelay", "--out", tmp_path / "mapped")
    (told,) = told_choices(tmp_path / "mapped" / "live.html")
    assert code == 0 and "live.html" in out
    assert told["map"]["across"] == [0.5, 1.0] and told["map"]["beside"] == [0.09]
    borne = cosim.stability(cosim.load("sallam-nodelay").with_values({"controller_*.stiffness": 0.5, **SHORT}))
    assert 1 / told["map"]["inverse"][0][0] == pytest.approx(borne.to_dict()["spectrum"]["max_delay"], rel=1e-6)
    (told,) = told_choices(cosim.live("recorded-delay", tmp_path / "recorded"))
    assert told["map"] is None and told["no_map"] == "it needs a stiffness, a damping and a delay that can be set"


def test_the_gains_of_a_page_are_those_of_the_space_that_the_coupling_acts_in():
    for name, stem in (
        ("sallam-joint", "joint_stiffness"),
        ("sallam-stable", "stiffness"),
        ("controllers", "stiffness"),
    ):
        groups = slider_names(checked(name))
        assert [s for model, s in groups if s.endswith("stiffness") and model.endswith("Controller")] == [stem]
        _, stiffness, damping = coupling(groups)
        assert {n.partition("[")[0].partition(".")[2] for n in stiffness} == {stem} and len(stiffness) == len(damping)


@pytest.fixture
def still(page):
    """A page in which nothing moves until somebody drags; constant delay."""
    return page("sallam-nodelay", "operator.amplitude=0", f"channel_*.delay_mean={DELAY}")


ROWS = "livePage.rows.map((row) => [row.time, ...row.tips[0], ...row.tips[1]])"


def test_a_drag_moves_the_remote_arm_after_the_delay(browser, still):
    with open_page(browser, still) as seen:
        box = seen.locator("#scene").bounding_box()
        seen.mouse.move(box["x"] + box["width"] / 4, box["y"] + box["height"] / 2)
        seen.mouse.down()
        seen.mouse.move(box["x"] + box["width"] / 4 + 60, box["y"] + box["height"] / 2 - 30, steps=4)
        seen.wait_for_function("livePage.rows.some((row) => Math.abs(row.tips[1][0] - livePage.origin[1][0]) > 1e-4)")
        seen.mouse.up()
        rows = np.array(seen.evaluate(ROWS))
        assert seen.evaluate("livePage.loop.hand[0]") == 0
        assert seen.said == []
    moved = np.abs(rows[:, 1:] - rows[0, 1:]).reshape(-1, 2, 3).max(axis=2) > 1e-9
    begins = rows[moved.argmax(axis=0), 0]
    assert moved.any(axis=0).all() and begins[0] + DELAY <= begins[1] <= begins[0] + DELAY + 0.2


def test_keyboard_sliders_and_what_the_checker_of_accessibility_finds(browser, still):
    with open_page(browser, still) as seen:
        seen.locator("#scene").focus()
        seen.keyboard.press("ArrowRight")
        assert seen.evaluate("livePage.loop.hand[0]") == 1
        seen.keyboard.press("Escape")
        assert seen.evaluate("livePage.loop.hand[0]") == 0
        seen.keyboard.press(" ")
        assert seen.evaluate("livePage.running") is False
        stiffness = "livePage.loop.starts[livePage.scenario.starts['controller_r.stiffness[3]'].place]"
        assert seen.evaluate(stiffness) == 0.25
        time = seen.evaluate("livePage.loop.time")
        slider = seen.get_by_label("stiffness K")
        slider.focus()
        seen.keyboard.press("ArrowRight")
        assert seen.evaluate(stiffness) == pytest.approx(0.26) and seen.evaluate("livePage.loop.time") == time
        delay = seen.get_by_label("delay (starts again)")
        delay.focus()
        seen.keyboard.press("ArrowRight")
        assert seen.evaluate("livePage.loop.starts[livePage.scenario.starts['channel_lr.delay_mean'].place]") > DELAY
        assert seen.evaluate("livePage.rows[0].time") == 0
        assert seen.violations() == []
        assert seen.said == []
