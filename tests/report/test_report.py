"""Reports: one file, nothing fetched, text escaped, tables and figures inside."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest
from attrs import evolve

from cosim.analysis.twin import twin_of
from cosim.engine.master import run
from cosim.engine.reference import execute
from cosim.fmu import open_system
from cosim.report.html import Code, Drawing, Report, Section, Table, render, write_report
from cosim.report.plots import Figure, Plot, curves
from cosim.report.run import run_report
from cosim.report.wiring import block_diagram, place
from cosim.results.summary import Judged
from cosim.scenario import Component, load_scenario
from tests.support.fakes import MODELS, FakeSystem, oscillator, scenario


def drawing():
    x = np.linspace(0.0, 1.0, 50)
    return Figure([Plot(curves(x, {"a </script>": x**2}), title="left & <right>")], "seen")


class Well(HTMLParser):
    """Checks that tags close in order and collects what would be fetched."""

    VOID = {"meta", "br", "link", "img", "hr"}

    def __init__(self):
        super().__init__()
        self.open, self.fetched, self.ids = [], [], []

    def handle_starttag(self, tag, attributes):
        if tag not in self.VOID:
            self.open.append(tag)
        for key, value in attributes:
            if key in ("src", "href", "xlink:href") and not value.startswith("#"):
                self.fetched.append(value)
            if key == "id":
                self.ids.append(value)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def checked(page):
    parser = Well()
    parser.feed(page)
    assert parser.open == [] and set(parser.fetched) <= {"data:,"}
    assert not re.search(
        r"@import|url\(\s*['\"]?https?:|https?://(?!www\.w3\.org/2000/svg|github\.com/leeoniya/uPlot)", page
    )
    return parser


def test_a_page_is_whole_and_offline(tmp_path):
    table = Table(("name", "value"), [("a", 1.23456789), ("b", None), ("c & <d>", 2)], "numbers")
    sections = [
        Section(f"Part {i}", "One.\n\nTwo.", [table], [drawing(), Drawing("<svg></svg>", "a drawing")])
        for i in range(3)
    ]
    page = write_report(
        Report("T <1>", "Good.", sections, {"version": "1 < 2"}, "good"), tmp_path / "a" / "r.html"
    ).read_text()
    checked(page)
    assert (
        "T &lt;1&gt;" in page
        and "c &amp; &lt;d&gt;" in page
        and "1.23457" in page
        and "–" in page
        and "1 &lt; 2" in page
    )


def test_a_command_is_one_line_of_code():
    page = render(
        Report("T", "", [Section("Points", "", [Table(("no.", "replay"), [(1, Code("cosim run a --set 'b=<1>'"))])])])
    )
    checked(page)
    assert "<td><code>cosim run a --set &#39;b=&lt;1&gt;&#39;</code></td>" in page
    assert re.search(r"td code \{[^}]*overflow: hidden; text-overflow: ellipsis; white-space: nowrap", page)


def test_empty_reports_render():
    checked(render(Report("nothing", "")))


@pytest.fixture(scope="module")
def judged():
    made = oscillator(stop=1.0)
    system = FakeSystem(made, MODELS)
    return Judged(run(made, system, executor=execute), system.wiring(made))


def test_the_report_of_a_run_without_arms(judged):
    page = render(run_report(judged))
    checked(page)
    assert "mass → spring" in page and "spring.f" in page
    assert twin_of(judged.wiring) is None


@pytest.mark.parametrize("count", [1, 2, 5, 9])
def test_boxes_never_overlap(count):
    parts = {f"m{i}": Component(model="Mass") for i in range(count)} | {
        f"s{i}": Component(model="Spring") for i in range(count)
    }
    wires = [
        w.replace("mass", f"m{i}").replace("spring", f"s{i}")
        for i in range(count)
        for w in ("mass.x -> spring.x", "spring.f -> mass.f")
    ]
    made = scenario(parts, wires)
    wiring = FakeSystem(made, MODELS).wiring(made)
    boxes = place(wiring)
    for i, a in enumerate(boxes):
        for b in boxes[i + 1 :]:
            assert a.right <= b.left or b.right <= a.left or a.bottom <= b.top or b.bottom <= a.top, (a, b)
    checked(block_diagram(wiring))


@pytest.mark.parametrize(
    ("name", "gains"),
    [
        ("sallam-stable", ("K 0.25 N/m", "B 0.09 N·s/m")),
        ("sallam-joint", ("K 0.25 N·m/rad", "B 0.09 N·m·s/rad")),
    ],
)
def test_gains_in_the_diagram_have_their_units(name, gains):
    with open_system(load_scenario(name)) as system:
        diagram = block_diagram(system.wiring(load_scenario(name)))
    assert all(diagram.count(f">{gain}<") == 2 for gain in gains)


def test_gains_that_differ_are_shown_for_every_axis():
    made = load_scenario("sallam-stable").with_values({"controller_l.stiffness": [150.0, 10.0, 10.0]})
    with open_system(made) as system:
        assert ">K 150, 10, 10 N/m<" in block_diagram(system.wiring(made))


def test_a_page_of_half_a_million_rows_of_noise_stays_small(judged):
    n, rng = 500_000, np.random.default_rng(1)
    signals = {name: rng.normal(size=n) for name in judged.result.signals}
    long = evolve(judged.result, time=np.arange(n) * 1e-3, signals=signals)
    assert len(render(run_report(evolve(judged, result=long)))) < 1_500_000
