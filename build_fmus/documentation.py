"""documentation/index.html: the README of the model (its equations) and its variable table."""

from functools import cache
from html import escape
from typing import TYPE_CHECKING

from build_fmus.table import ModelTable, ModelVariable

if TYPE_CHECKING:
    from markdown_it import MarkdownIt

STYLE = (
    "body{font:16px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse;font-size:14px}td,th{border:1px solid #ccc;padding:.2em .6em;text-align:left}"
    "pre{background:#f4f4f6;padding:.7em;white-space:pre-wrap}"
)
HEADS = ("name", "causality", "type", "unit", "start", "range", "meaning")


def index_html(table: ModelTable, readme: str) -> str:
    """One HTML page without references to other files."""
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">',
            f"<title>{escape(table.model.name)}</title><style>{STYLE}</style></head><body>",
            markdown(readme),
            "<h2>Variables</h2>",
            _variables(table),
            "</body></html>\n",
        ]
    )


def _variables(table: ModelTable) -> str:
    rows = [_row(HEADS, "th"), *(_row(variable_cells(v), "td") for v in table.variable)]
    return "<table>\n" + "\n".join(rows) + "\n</table>"


def variable_cells(v: ModelVariable) -> tuple[str, ...]:
    """A row of a model's table as texts under HEADS."""
    name = f"{v.name}[1..{v.size}]" if v.size and not v.names else ", ".join(v.fmi_names)
    starts = v.starts if len(set(v.starts)) > 1 else v.starts[:1]
    start = ", ".join(f"{x:.10g}" for x in starts) if v.causality in ("input", "parameter", "tunable") else ""
    if v.type == "Enumeration":
        start = v.items[int(v.starts[0]) - 1]
    bounds = "" if v.min is None and v.max is None else f"{_bound(v.min)} .. {_bound(v.max)}"
    meaning = v.description + (f" ({', '.join(v.items)})" if v.items else "") + (f" [{v.group}]" if v.group else "")
    return name, v.causality, v.type, v.unit, start, bounds, meaning


def _bound(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


def _row(cells: tuple[str, ...], tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{escape(c)}</{tag}>" for c in cells) + "</tr>"


def markdown(text: str) -> str:
    """A README as HTML."""
    return parser().render(text)


@cache
def parser() -> "MarkdownIt":
    """The parser of every page: CommonMark with tables, without HTML."""
    from markdown_it import MarkdownIt

    return MarkdownIt("commonmark", {"html": False}).enable("table")
