"""The manual: every key that the code reads is on a page, no link is dead, every page has its HTML."""

import json
import re
import tomllib
from html.parser import HTMLParser

import pytest
from attrs import fields

from cosim.cli import COMMANDS
from cosim.cli.reference import attribute_words, reference_pages
from cosim.measured.columns import ROLES
from cosim.measured.description import KEYS
from cosim.measured.mounted import MOTOR, NAMES
from cosim.report.manual import CONTENTS, anchor, target_of, write_manual, written_pages
from cosim.scenario.parts import Component, Experiment, Teleoperation
from cosim.sweeps import spec
from tests.benchmarks.gallery import MANUAL, entries
from tests.support.paths import ROOT

PAGES = (*written_pages(), *reference_pages())
TEXT = {page.slug: page.text for page in PAGES}
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
SETTINGS = (Experiment, Component, Teleoperation, spec.Sweep, spec.Axis, spec.Choice, *spec.DESIGNS.values())


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("docs")
    assert write_manual(PAGES, folder) == folder / "index.html"
    return folder


@pytest.mark.parametrize("kind", SETTINGS, ids=lambda kind: kind.__name__)
def test_every_key_of_scenarios_and_sweeps_is_explained_where_it_is_defined(kind):
    words = attribute_words(kind)
    assert {entry.name for entry in fields(kind)} - set(spec.NOT_IN_A_FILE) == set(words)
    page = TEXT["scenario-keys" if kind in SETTINGS[:3] else "sweep-keys"]
    assert all(f"`{name}`" in page and text in page.replace("\\|", "|") for name, text in words.items())


@pytest.mark.parametrize("key", [*KEYS, *ROLES, *NAMES, *MOTOR])
def test_every_key_of_a_description_is_on_its_page(key):
    table = TEXT["description-format"].partition("## What is doubted")[0]
    assert re.search(rf"`(\[?{key}\]?|{key} = [^`]*|\[{key}\.[A-Z]+\])`", table)


def test_shipped_scenarios_use_no_key_that_the_page_lacks():
    used = set()
    for path in (ROOT / "cosim" / "scenario" / "shipped").glob("*.toml"):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        used |= {*table, *table["experiment"], *(key for part in table["components"].values() for key in part)}
    assert len(used) > 15
    assert not {
        key for key in used if f"`{key}`" not in TEXT["scenario-keys"] and f"`[{key}" not in TEXT["scenario-keys"]
    }


def test_every_command_is_on_the_page_with_its_options():
    text = TEXT["commands"]
    assert all(f"## cosim {name}\n" in text for name in COMMANDS)
    assert "`--set`" in text
    assert "### cosim arm workspace" in text


def test_every_public_name_is_on_the_page():
    import cosim

    assert all(f"## cosim.{name}\n" in TEXT["api"] for name in cosim.__all__)
    assert "(no description)" not in TEXT["api"]


def test_every_model_has_a_page_with_all_of_its_variables():
    from build_fmus.sources import model_table, models

    assert len(models()) > 10
    for model in models():
        assert all(f"`{row.name}" in TEXT[f"model-{model}"] or row.names for row in model_table(model).variable), model


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.slug)
def test_no_link_is_dead(page, site):
    assert page.text.startswith("# ")
    for href in LINK.findall(page.text):
        target = target_of(href, page, PAGES)
        if target is None:  # a file of the project that is no page of the manual
            folder = (ROOT / page.source).parent
            assert (folder / href.partition("#")[0]).exists(), (page.slug, href)
        elif not target.startswith("http"):
            name, _, mark = target.partition("#")
            file = site / (name or f"{page.slug}.html")
            assert file.is_file(), (page.slug, href)
            assert not mark or f'id="{mark}"' in file.read_text(encoding="utf-8"), (page.slug, href)


def test_every_link_of_the_html_leads_to_a_file_of_the_folder(site):
    class Links(HTMLParser):
        def handle_starttag(self, tag, attrs):
            found.update(v for k, v in attrs if k in ("href", "src") and v)

    found: set[str] = set()
    for path in site.glob("*.html"):
        Links().feed(path.read_text(encoding="utf-8"))
    inside = {link.partition("#")[0] for link in found if not link.startswith(("http", "#"))}
    assert len(inside) > 30
    assert not {name for name in inside if not (site / name).is_file()}


def test_the_gallery_shows_ten_pictures_that_stand_in_the_folder(site):
    found = entries()
    assert len(found) == 10 == (MANUAL / "gallery.md").read_text(encoding="utf-8").count("\n## ")
    text = (site / "gallery.html").read_text(encoding="utf-8")
    for entry in found:
        picture = site / "pictures" / f"{entry['name']}.png"
        assert f'src="pictures/{entry["name"]}.png" alt="{entry["told"]}"' in text
        assert picture.read_bytes().startswith(b"\x89PNG") and 5e3 < picture.stat().st_size < 2e5


def test_headings_can_be_searched(site):
    text = (site / "headings.js").read_text(encoding="utf-8")
    found = json.loads(text.removeprefix("const HEADINGS = ").rstrip().removesuffix(";"))
    assert ["Every key of a scenario", "scenario-keys.html#experiment", "[experiment]"] in found
    assert anchor("What it is, and why") == "what-it-is-and-why"


def test_the_pages_are_in_the_package():
    assert all((ROOT / source).is_file() for _, _, source in CONTENTS)
    assert {source for _, _, source in CONTENTS} >= {
        f"cosim/manual/{path.name}" for path in (ROOT / "cosim" / "manual").glob("*.md")
    }
