"""Every kind of page in a real browser: no message on its console, zoom, cursor, slider, keyboard, downloads, print.

Where a page is wrong an accessibility checker (axe) says what and where.
"""

import csv
import json
import re
import tomllib
from xml.etree import ElementTree

import numpy as np
import pytest

import cosim
from cosim.arm.dissection import dissect, random_motion
from cosim.arm.parameters import parameter_set
from cosim.arm.workspace import LINKED, definiteness
from cosim.measured import Recording, Run, parse_description
from cosim.report import arm as arm_sections
from cosim.report.html import Report, write_report
from cosim.report.manual import write_manual, written_pages
from tests.arm.test_urdf import GOOD
from tests.support.browser import SeenPage, open_page
from tests.support.paths import DATA

KINDS = [
    "run",
    "stability",
    "sweep",
    "identification",
    "closure",
    "workspace",
    "dissection",
    "robot",
    "data",
    "compare",
]
FILES = {
    "run": ("summary.json", "summary.json of a run"),
    "stability": ("stability.json", "stability.json"),
    "sweep": ("summary.json", "summary.json and sweep.h5 of a sweep"),
    "identification": ("identification.json", "identification.json"),
    "closure": ("closure.json", "closure.json"),
    "data": ("data.json", "data.json"),
    "compare": ("compare.json", "compare.json"),
    "robot": ("robot.json", "robot.json"),
}
"""The JSON file of each kind of result, and its section on the page of files."""
PENDULUM = DATA / "dfki_pendulum_1dof" / "ddp.csv"
SWEEP = """
format = 1
scenario = "sallam-nodelay"
evaluator = "spectrum"
[[axes]]
name = "stiffness"
unit = "N/m"
paths = ["controller_*.stiffness"]
low = 0.1
high = 1.0
[[axes]]
name = "delay"
unit = "s"
paths = ["channel_*.delay_mean"]
low = 0.05
high = 0.8
[boundary]
trace = ["stiffness", "delay"]
"""


@pytest.fixture(scope="module")
def result():
    return cosim.run(cosim.load("contact").with_values({"experiment.stop": 3.0}))


@pytest.fixture(scope="module")
def axis():
    """A motor axis with Stribeck's friction, which the plain model has not."""
    time = np.arange(0, 24, 4e-3)
    q = 0.8 * np.sin(1.7 * time) + 0.4 * np.sin(3.1 * time)
    dq, ddq = np.gradient(q, time), np.gradient(np.gradient(q, time), time)
    friction = (0.3 + 0.25 * np.exp(-((dq / 0.2) ** 2))) * np.tanh(dq / 0.01) + 0.2 * dq
    tau = 0.05 * ddq + friction + 0.005 * np.random.default_rng(0).normal(size=len(time))
    described = parse_description({"device": "axis", "columns": {"q": ["q"], "tau": ["tau"]}}, "test")
    return Recording(described, (Run("axis", time, q[:, None], tau[:, None], time >= 12),))


@pytest.fixture(scope="module")
def pages(tmp_path_factory, result, axis):
    """The folder of each page, made when it is asked for."""
    root, made = tmp_path_factory.mktemp("pages"), {}

    def sections(kind):
        arm = parameter_set("UR")
        if kind == "workspace":
            return [arm_sections.limits(arm), arm_sections.definite(arm, definiteness(arm.pi, LINKED))]
        motion = random_motion(1, 10.0)
        return [arm_sections.own_dissection(dissect(arm, motion), motion, "random")]

    def make(kind, folder):
        if kind == "run":
            result.save(folder)
        elif kind == "stability":
            cosim.stability(cosim.load("sallam-unstable").with_values({"experiment.stop": 5.0})).save(folder)
        elif kind == "sweep":
            (root / "map.toml").write_text(SWEEP)
            cosim.sweep(root / "map.toml", workers=1).save(folder)
        elif kind == "identification":
            cosim.identify(axis).save(folder)
        elif kind == "closure":
            cosim.close_loop(axis, replay=False).save(folder)
        elif kind == "data":
            cosim.data(PENDULUM).save(folder)
        elif kind == "compare":
            stiffer = cosim.load("contact").with_values({"experiment.stop": 3.0, "controller_*.stiffness": 0.4})
            cosim.compare([result, stiffer], tolerance=0.1, names=["as it is", "stiffer"]).save(folder)
        elif kind == "robot":
            (root / "two.urdf").write_text(GOOD)
            cosim.robot(root / "two.urdf").save(folder)
        else:
            write_report(Report(kind, "An arm.", sections(kind)), folder / "report.html")

    def page(kind):
        if kind not in made:
            make(kind, root / kind)
            made[kind] = root / kind
        return made[kind] / "report.html"

    return page


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_opens_without_a_message_and_an_accessibility_checker_finds_nothing(kind, pages, browser):
    with open_page(browser, pages(kind)) as page:
        assert page.locator("canvas").count() > 0
        assert page.violations() == []
    assert page.said == []
    assert pages(kind).stat().st_size < 1_500_000


@pytest.mark.parametrize("kind", sorted(FILES))
def test_every_key_of_the_files_that_are_written_is_on_the_page_of_files(kind, pages):
    file, heading = FILES[kind]
    text = next(page.text for page in written_pages() if page.slug == "outputs")
    section = next(part for part in text.split("\n## ") if part.startswith(heading))
    written = json.loads((pages(kind).parent / file).read_text(encoding="utf-8"))
    assert len(written) > 4 and not [key for key in written if f"`{key}`" not in section]


def test_every_key_of_an_effects_file_is_on_the_page_of_files(pages):
    text = next(page.text for page in written_pages() if page.slug == "outputs")
    section = next(part for part in text.split("\n## ") if part.startswith("effects.toml"))
    written = tomllib.loads((pages("closure").parent / "effects.toml").read_text(encoding="utf-8"))
    entries = [key for effect in written["effects"] for key in effect]
    assert entries and not [key for key in (*entries, *written["provenance"]) if f"`{key}`" not in section]
    assert not [key for key in written if not re.search(rf"`\[*{key}\]*`", section)]


@pytest.mark.parametrize("kind", ["run", "sweep"])
def test_dark_colours_pass_too_and_the_switch_changes_them(kind, pages, browser):
    with open_page(browser, pages(kind), color_scheme="dark") as page:
        assert page.evaluate("document.documentElement.dataset.theme") == "dark"
        assert page.violations() == []
        page.locator("#theme").click()
        assert page.evaluate("document.documentElement.dataset.theme") == "light"
        assert page.evaluate("getComputedStyle(document.querySelector('main')).backgroundColor") == "rgb(255, 255, 255)"


def test_a_narrow_screen_is_not_wider_than_itself(pages, browser):
    with open_page(browser, pages("run"), viewport={"width": 390, "height": 800}) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390


def over(page, number):
    """The frame of a plot."""
    frame = page.locator(".u-over").nth(number)
    frame.scroll_into_view_if_needed()
    return frame


def ranges(page):
    return page.evaluate("View.links.get('time').map(v => v.range.x)")


def test_zoom_by_the_mouse_is_linked_over_all_plots_of_time(pages, browser):
    with open_page(browser, pages("run")) as page:
        whole = ranges(page)
        assert len(whole) > 6 and all(np.allclose(r, [0, 3]) for r in whole)
        box = over(page, 0).bounding_box()
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 40)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 60, steps=4)
        page.mouse.up()
        zoomed = ranges(page)
        assert all(np.allclose(r, [0.75, 1.5], atol=0.01) for r in zoomed)
        page.keyboard.down("Shift")
        page.mouse.down()
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 60, steps=4)
        page.mouse.up()
        page.keyboard.up("Shift")
        moved = ranges(page)
        assert all(np.allclose(r, [0.75 + 0.75 / 4, 1.5 + 0.75 / 4], atol=0.02) for r in moved)
        over(page, 0).dblclick()
        assert all(np.allclose(r, [0, 3]) for r in ranges(page))


def test_the_values_under_the_cursor_are_those_of_the_run(pages, browser, result):
    with open_page(browser, pages("run")) as page:
        frame = over(page, 0)
        width = frame.bounding_box()["width"]
        frame.hover(position={"x": 0.6 * width, "y": 50})
        told = page.locator(".plot").nth(0).locator(".where").inner_text()
        at = float(re.fullmatch(r"time ([\d.]+)", told)[1])
        assert at == pytest.approx(1.8, abs=3 / width)
        row = int(np.argmin(np.abs(result.time - at)))
        assert result.time[row] == pytest.approx(at, abs=1e-9), "a row of the run, not a place between rows"
        for axis in range(3):
            shown = page.locator(".plot").nth(axis).locator(".value").all_inner_texts()
            expected = [1e3 * result[f"{arm}.x"][row, axis] for arm in ("arm_l", "arm_r")]
            assert [float(v) for v in shown] == pytest.approx(expected, rel=1e-5, abs=1e-9)
        assert page.evaluate("motion.now") == pytest.approx(at)


def test_the_slider_moves_the_arms_and_the_cursors(pages, browser, result):
    with open_page(browser, pages("run")) as page:
        slider = page.locator("input.time")
        slider.focus()
        before = page.evaluate("motion.tips")
        for _ in range(40):
            page.keyboard.press("ArrowRight")
        now = page.evaluate("motion.now")
        row = int(np.argmin(np.abs(result.time - now)))
        assert row > 0 and page.evaluate("motion.tips") != before
        for k, arm in enumerate(("arm_l", "arm_r")):
            tip = page.evaluate(f"motion.pose(motion.arms[{k}]).at(-1)")
            assert tip == pytest.approx(result[f"{arm}.x"][row], abs=1e-6)
        told = page.evaluate("View.links.get('time').map(v => v.plot.series[0].x[v.row])")
        assert told == pytest.approx([now] * len(told), abs=2e-3)
        flying = page.evaluate("motion.flying")
        assert set(flying) == {"channel_lr", "channel_rl"} and all(n >= 1 for n in flying.values())


def test_playing_moves_on_and_stops(pages, browser):
    with open_page(browser, pages("run")) as page:
        play = page.get_by_role("button", name="play")
        play.click()
        page.wait_for_function("motion.now > 0.1")
        page.get_by_role("button", name="pause").click()
        assert page.evaluate("motion.playing") is False
        page.locator("canvas.scene").focus()
        turned = page.evaluate("motion.turn")
        page.keyboard.press("ArrowRight")
        assert page.evaluate("motion.turn") == pytest.approx(turned + 0.1)


def test_a_plot_obeys_the_keyboard(pages, browser):
    with open_page(browser, pages("run")) as page:
        plot = page.locator(".plot").nth(0)
        plot.focus()
        page.keyboard.press("+")
        assert all(np.ptp(r) == pytest.approx(2.0) for r in ranges(page))
        page.keyboard.press("Shift+ArrowRight")
        assert ranges(page)[0][0] == pytest.approx(0.5 + 0.15 * 2.0)
        page.keyboard.press("ArrowRight")
        first = plot.locator(".where").inner_text()
        page.keyboard.press("ArrowRight")
        assert plot.locator(".where").inner_text() != first
        assert "arm_l" in page.locator("#said").inner_text()
        page.keyboard.press("0")
        assert all(np.allclose(r, [0, 3]) for r in ranges(page))
        key = plot.get_by_role("button", name="arm_l")
        key.focus()
        page.keyboard.press("Enter")
        assert key.get_attribute("aria-pressed") == "false"
        assert page.evaluate("View.all[0].u.series[1].show") is False


def test_a_point_of_a_map_tells_its_evidence_and_its_command_is_copied(pages, browser):
    with open_page(browser, pages("sweep"), permissions=["clipboard-read", "clipboard-write"]) as page:
        plot = page.locator(".plot").nth(0)
        plot.focus()
        page.keyboard.press("ArrowRight")
        tip = plot.locator(".tip").inner_text()
        assert "evidence:" in tip and "stiffness [N/m]: 0.1" in tip
        page.keyboard.press("Enter")
        command = page.evaluate("navigator.clipboard.readText()")
        assert command in tip and re.match(r"cosim run sallam-nodelay --set '?controller_\*\.stiffness=0\.1", command)
        place = page.evaluate(
            "(() => { const v = View.all[0], s = v.plot.series.find(s => s.name === 'growing'), "
            "i = s.x.findIndex((x, k) => x > 0.5 && x < 0.95 && s.y[k] > 0.5 && s.y[k] < 0.75);"
            "return [v.u.valToPos(s.x[i], 'x'), v.u.valToPos(s.y[i], 'y'), s.commands[i]]; })()"
        )
        over(page, 0).click(position={"x": place[0], "y": place[1]})
        assert page.evaluate("navigator.clipboard.readText()") == place[2]
        assert "copied" in page.locator("#said").inner_text()


def test_what_is_downloaded(pages, browser, result):
    with open_page(browser, pages("run")) as page:
        files = {}
        for kind in ("CSV", "SVG", "PNG"):
            with page.expect_download() as got:
                page.locator("#figure-1").get_by_text(kind, exact=True).click()
            files[got.value.suggested_filename] = got.value.path().read_bytes()
    assert set(files) == {"tips.csv", "tips.svg", "tips.png"}
    assert files["tips.png"].startswith(b"\x89PNG")
    picture = ElementTree.fromstring(files["tips.svg"])
    texts = [text.text for text in picture.iter("{http://www.w3.org/2000/svg}text")]
    assert {"time [s]", "x [mm]", "arm_l", "arm_r"} <= set(texts)
    lines = files["tips.csv"].decode().splitlines()
    assert lines[1].endswith("everything is in result.h5") and re.search(r"(all|of) \d+ rows", lines[1])
    table = list(csv.reader(lines[2 : lines.index("")]))
    assert table[0] == ["time [s]", "arm_l", "arm_r"]
    values = np.array(table[1:], dtype=float)
    rows = np.searchsorted(result.time, values[:, 0] - 1e-9)
    assert values[:, 1] == pytest.approx(1e3 * result["arm_l.x"][rows, 0], rel=1e-6, abs=1e-6)


def test_a_map_is_printed_on_a_few_pages_as_a_vector_picture(pages, browser):
    with open_page(browser, pages("sweep"), color_scheme="dark") as page:
        printed = page.pdf(format="A4", print_background=True)
    assert len(re.findall(rb"/Type\s*/Page\b", printed)) <= 4
    assert printed.count(b"/Subtype /Image") == 0, "no plot is a picture of points"


def test_the_curves_of_a_comparison_are_those_of_the_runs_and_their_difference(pages, browser, result):
    with open_page(browser, pages("compare")) as page:
        plots = page.evaluate("View.all.map(v => [v.plot.title, v.plot.series.map(s => s.name)])")
        assert plots[0][1] == ["as it is", "stiffer"] and plots[1][1] == ["stiffer"]
        values = page.evaluate("[View.all[0].plot.series, View.all[1].plot.series].flat().map(s => Array.from(s.y))")
        first, other, apart = map(np.array, values)
        assert first == pytest.approx(result[plots[0][0]][: len(first)], abs=1e-6 * np.ptp(first))
        assert apart == pytest.approx(other - first, abs=1e-6 * np.ptp(first)) and np.ptp(apart) > 0
        tables = page.locator("table").all_inner_texts()
        assert any("controller_l.stiffness[1]" in text and "0.4" in text for text in tables)


def test_a_page_of_the_manual_opens_its_search_finds_and_the_checker_finds_nothing(browser, tmp_path):
    first = write_manual(written_pages(), tmp_path)
    said = []
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    page.on("console", lambda message: said.append(message.text))
    page.goto(first.as_uri())
    page.get_by_label("Search the headings").fill("growth rate")
    page.locator("#found a").first.click()
    page.wait_for_url("**/growth-rate.html*")
    assert page.locator("h1").inner_text() == "What a growth rate is"
    assert said == []  # axe reads the style sheet again, which the browser refuses for files
    assert SeenPage(page).violations() == []
    page.close()
