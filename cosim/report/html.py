"""One offline HTML file: verdict, sections with text, figures and tables, provenance.

The only module that imports jinja2. Everything is inline: no script, no font, no picture is fetched. Figures are data
(`cosim.report.plots`) that the page's script draws with uPlot (folder `web`, with its licence and checksum).
"""

from collections.abc import Iterable
from datetime import UTC, datetime
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from attrs import asdict, evolve, field, frozen

from cosim.report.motion import Playback
from cosim.report.packing import packed
from cosim.report.plots import Figure
from cosim.results.saving import write_text

if TYPE_CHECKING:
    from jinja2 import Environment

WEB = Path(__file__).with_name("web")
STYLES = ("uPlot.min.css", "page.css")
SCRIPTS = ("uPlot.iife.min.js", "marks.js", "plots.js", "motion.js", "page.js")


@frozen
class Code:
    """A cell with a command: in one line that scrolls, chosen as a whole by one click."""

    text: str

    def __str__(self) -> str:
        return self.text


def _rows(rows: Iterable[Iterable[object]]) -> tuple[tuple[object, ...], ...]:
    return tuple(tuple(row) for row in rows)


@frozen
class Table:
    """Rows of cells under a header. Numbers have `digits` significant digits, None is a dash, `Code` is code."""

    header: tuple[str, ...] = field(converter=tuple)
    rows: tuple[tuple[object, ...], ...] = field(converter=_rows)
    caption: str = ""
    digits: int = 6


@frozen
class Drawing:
    """An inline `<svg>` element (trusted: our own drawing) and what it shows."""

    svg: str
    caption: str = ""


@frozen
class Section:
    """A heading with text (blank lines part paragraphs), then figures, then tables."""

    heading: str
    text: str = ""
    tables: tuple[Table, ...] = field(default=(), converter=tuple)
    figures: tuple[Figure | Drawing | Playback, ...] = field(default=(), converter=tuple)


@frozen
class Report:
    """What a command found. `verdict` stands on top in one or two sentences; `mood` colours it: good, bad, neutral.

    source: the file that holds all of what the figures show a part of.
    """

    title: str
    verdict: str
    sections: tuple[Section, ...] = field(default=(), converter=tuple)
    provenance: dict[str, object] = field(factory=dict)
    mood: str = "neutral"
    source: str = ""


def write_report(report: Report, path: Path | str) -> Path:
    """Write the report as one HTML file and return its path; folders are made."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(render(report), path)
    return path


def render(report: Report) -> str:
    """The report as the text of one HTML page."""
    figures = _figures(report)
    places = {id(figure): k for k, figure in enumerate(figures, 1)}
    return filled(
        "report.html.j2",
        report=report,
        number=lambda figure: places[id(figure)],
        numbers=packed(
            [evolve(f, name=f.name or f"figure-{k}") for k, f in enumerate(figures, 1)],
            source=report.source,
            motion=_motion(report),
        ),
        style=web(STYLES),
        script=web(SCRIPTS),
    )


def filled(template: str, **values: object) -> str:
    """The page that a template makes of values and of the time."""
    return _environment().get_template(template).render(made=_now(), **values)


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("cosim.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(cell=cell, numeric=_numeric_columns, paragraphs=_paragraphs, anchor=_anchor)
    for name, kind in (("code", Code), ("drawing", Drawing), ("playback", Playback)):
        environment.tests[name] = partial(_is_a, kind)
    return environment


def _is_a(kind: type, value: object) -> bool:
    return isinstance(value, kind)


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")


def _figures(report: Report) -> list[Figure]:
    return [figure for section in report.sections for figure in section.figures if isinstance(figure, Figure)]


def _motion(report: Report) -> dict[str, object] | None:
    """The arms in motion as the page holds them: a page has at most one."""
    found = [f for section in report.sections for f in section.figures if isinstance(f, Playback)]
    return asdict(found[0], recurse=True) if found else None


@cache
def web(names: tuple[str, ...]) -> str:
    """Files of the folder `web`, one after the other."""
    return "\n".join((WEB / name).read_text(encoding="utf-8") for name in names)


def cell(value: object, digits: int = 6) -> str:
    """A table cell as text: floats with so many significant digits, None as a dash, lists with commas."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float) or type(value).__name__.startswith("float"):
        return f"{value:.{digits}g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(cell(item, digits) for item in value)
    return str(value)


def _numeric_columns(table: Table) -> list[bool]:
    """Which columns hold numbers (and are set to the right)."""
    return [any(_numeric(row[i]) for row in table.rows if i < len(row)) for i in range(len(table.header))]


def _numeric(value: object) -> bool:
    kind = type(value).__name__
    return not isinstance(value, bool) and (isinstance(value, (int, float)) or kind.startswith(("float", "int")))


def _paragraphs(text: str) -> Iterable[str]:
    return [part.strip() for part in text.split("\n\n") if part.strip()]


def _anchor(heading: str) -> str:
    return "-".join("".join(c if c.isalnum() else " " for c in heading.lower()).split())
