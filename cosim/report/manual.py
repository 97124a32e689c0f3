"""The manual as a folder of offline HTML pages: Markdown in, one file a page out, with contents and a search."""

import json
import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from posixpath import normpath
from typing import TYPE_CHECKING

from attrs import frozen

from build_fmus.documentation import parser
from cosim.report.html import filled, web
from cosim.results.saving import write_text

if TYPE_CHECKING:
    from markdown_it.token import Token

ROOT = Path(__file__).parents[2]
PICTURES = "cosim/manual/pictures"
GROUPS = ("Start", "How to", "Reference", "Explanation", "In depth", "Models")
CONTENTS = (
    ("Start", "index", "cosim/manual/index.md"),
    ("Start", "tutorial", "cosim/manual/tutorial.md"),
    ("Start", "gallery", "cosim/manual/gallery.md"),
    ("How to", "scenario", "cosim/manual/scenario.md"),
    ("How to", "sweep", "cosim/manual/sweep.md"),
    ("How to", "own-controller", "cosim/manual/own-controller.md"),
    ("How to", "recording", "cosim/manual/recording.md"),
    ("How to", "live", "cosim/manual/live.md"),
    ("How to", "other-tools", "cosim/manual/other-tools.md"),
    ("Reference", "outputs", "cosim/manual/outputs.md"),
    ("Reference", "description-format", "cosim/measured/README.md"),
    ("Explanation", "growth-rate", "cosim/manual/growth-rate.md"),
    ("Explanation", "evidence", "cosim/manual/evidence.md"),
    ("Explanation", "names", "cosim/manual/names.md"),
    ("Explanation", "misprints", "cosim/arm/MISPRINTS.md"),
    ("In depth", "closing-the-loop", "cosim/closure/README.md"),
    ("In depth", "identification", "cosim/identification/README.md"),
    ("In depth", "any-delay", "cosim/analysis/ANY_DELAY.md"),
    ("In depth", "exports", "cosim/exports/README.md"),
)
"""Group, name of the file, and where it stands in the project."""
_LINK = re.compile(r"^(?P<path>[^#]*)(?P<anchor>#.*)?$")


@frozen
class ManualPage:
    """One page: its group in the contents, file name without suffix, Markdown, and where that came from in the project
    (relative links start there).
    """

    group: str
    slug: str
    text: str
    source: str = ""

    @property
    def title(self) -> str:
        """The first heading."""
        return next((line.lstrip("# ") for line in self.text.splitlines() if line.startswith("# ")), self.slug)

    @property
    def headings(self) -> list[tuple[str, str]]:
        """Every heading with its anchor."""
        tokens = parser().parse(self.text)
        return [
            (_plain(t), anchor(_plain(t))) for k, t in enumerate(tokens) if k and tokens[k - 1].type == "heading_open"
        ]


def anchor(heading: str) -> str:
    """The anchor of a heading, as on GitHub: lower case, dashes for blanks, nothing else."""
    return re.sub(r"[^\w-]", "", heading.lower().replace(" ", "-"))


def write_manual(pages: Sequence[ManualPage], folder: Path) -> Path:
    """Write every page as HTML and as Markdown; returns the first page's HTML file."""
    folder.mkdir(parents=True, exist_ok=True)
    found = [[page.title, f"{page.slug}.html#{mark}", words] for page in pages for words, mark in page.headings]
    write_text(f"const HEADINGS = {json.dumps(found, ensure_ascii=False)};\n", folder / "headings.js")
    write_text(web(("page.css", "manual.css")), folder / "manual.css")
    write_text(web(("manual.js",)), folder / "manual.js")
    for picture in (ROOT / PICTURES).glob("*.png"):
        (folder / "pictures").mkdir(exist_ok=True)
        shutil.copyfile(picture, folder / "pictures" / picture.name)
    for page in pages:
        write_text(page.text, folder / f"{page.slug}.md")
        write_text(page_html(page, pages), folder / f"{page.slug}.html")
    return folder / f"{pages[0].slug}.html"


def page_html(page: ManualPage, pages: Sequence[ManualPage]) -> str:
    """One page with the contents of the manual beside it."""
    groups = [(group, [other for other in pages if other.group == group]) for group in GROUPS]
    return filled(
        "manual.html.j2", page=page, groups=[entry for entry in groups if entry[1]], body=body_html(page, pages)
    )


def body_html(page: ManualPage, pages: Sequence[ManualPage]) -> str:
    """The page's text as HTML; links to other pages go to their HTML, links to files that are no page become text."""
    tokens = parser().parse(page.text)
    for k, token in enumerate(tokens):
        if token.type == "heading_open":
            token.attrSet("id", anchor(_plain(tokens[k + 1])))
        if token.type == "inline" and token.children:
            token.children = _linked(token.children, page, pages)
    html = parser().renderer.render(tokens, parser().options, {})
    return re.sub(r"(<table>.*?</table>)", r'<div class="scroll" tabindex="0">\1</div>', html, flags=re.DOTALL)


def _linked(children: "list[Token]", page: ManualPage, pages: Sequence[ManualPage]) -> "list[Token]":
    kept: list[Token] = []
    dropping = False
    for child in children:
        if child.type == "link_open":
            target = target_of(str(child.attrGet("href")), page, pages)
            dropping = target is None
            if target is not None:
                child.attrSet("href", target)
        if not (dropping and child.type in ("link_open", "link_close")):
            kept.append(child)
    return kept


def target_of(href: str, page: ManualPage, pages: Sequence[ManualPage]) -> str | None:
    """Where a link of a page goes in the HTML; None where it names a file that is no page of the manual."""
    if href.startswith(("http://", "https://", "#")):
        return href
    match = _LINK.match(href)
    assert match is not None, "the pattern fits every text"
    place = normpath(f"{page.source.rpartition('/')[0]}/{match['path']}").lstrip("/")
    for other in pages:
        if place in (other.source, f"{other.slug}.md", f"cosim/manual/{other.slug}.md"):
            return f"{other.slug}.html{match['anchor'] or ''}"
    return None


def _plain(token: "Token") -> str:
    return "".join(child.content for child in token.children or () if child.type in ("text", "code_inline"))


def written_pages() -> tuple[ManualPage, ...]:
    """The pages that are written by hand: those of `cosim/manual`, and those that stand beside what they describe."""
    return tuple(
        ManualPage(group, slug, (ROOT / source).read_text(encoding="utf-8"), source) for group, slug, source in CONTENTS
    )
