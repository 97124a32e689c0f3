"""One offline HTML file: verdict, sections with text, figures and tables, provenance.

The only module that imports jinja2. Everything is inline: no script, no font, no picture is fetched.
"""

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from attrs import field, frozen

from cosim.results.saving import write_text


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
class Figure:
    """An inline `<svg>` element (trusted: our own drawing) and what it shows."""

    svg: str
    caption: str = ""


@frozen
class Section:
    """A heading with text (blank lines part paragraphs), then figures, then tables."""

    heading: str
    text: str = ""
    tables: tuple[Table, ...] = field(default=(), converter=tuple)
    figures: tuple[Figure, ...] = field(default=(), converter=tuple)


@frozen
class Report:
    """What a command found. `verdict` stands on top in one or two sentences; `mood` colours it: good, bad, neutral."""

    title: str
    verdict: str
    sections: tuple[Section, ...] = field(default=(), converter=tuple)
    provenance: dict[str, object] = field(factory=dict)
    mood: str = "neutral"


def write_report(report: Report, path: Path | str) -> Path:
    """Write the report as one HTML file and return its path; folders are made."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(render(report), path)
    return path


def render(report: Report) -> str:
    """The report as the text of one HTML page."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("cosim.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(cell=cell, numeric=_numeric_columns, paragraphs=_paragraphs, anchor=_anchor)
    environment.tests["code"] = lambda value: isinstance(value, Code)
    made = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return environment.get_template("report.html.j2").render(report=report, made=made)


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
