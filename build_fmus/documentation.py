"""documentation/index.html: the README of the model (its equations) and its variable table."""

import re
from html import escape
from textwrap import indent

from build_fmus.table import ModelTable, ModelVariable

STYLE = (
    "body{font:16px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse;font-size:14px}td,th{border:1px solid #ccc;padding:.2em .6em;text-align:left}"
    "pre{background:#f4f4f6;padding:.7em;white-space:pre-wrap}"
)


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
    heads = ("name", "causality", "type", "unit", "start", "range", "meaning")
    rows = [_row(heads, "th"), *(_row(_cells(v), "td") for v in table.variable)]
    return "<table>\n" + "\n".join(rows) + "\n</table>"


def _cells(v: ModelVariable) -> tuple[str, ...]:
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
    """The Markdown that the READMEs use: headings, indented or fenced blocks, lists, tables, paragraphs, `code`."""
    return "\n".join(_block(block) for block in _blocks(text))


def _blocks(text: str) -> list[str]:
    """Split at blank lines; a fenced block counts as an indented one, indented neighbours are joined."""
    plain = re.sub(
        r"^```\w*\n(.*?)^```[ \t]*$", lambda m: "\n" + indent(m[1], "    ") + "\n", text, flags=re.DOTALL | re.MULTILINE
    )
    blocks = [block.strip("\n") for block in re.split(r"\n[ \t]*\n", plain)]
    return _join_indented([b for b in blocks if b.strip()])


def _join_indented(blocks: list[str]) -> list[str]:
    joined: list[str] = []
    for block in blocks:
        if joined and _indented(block) and _indented(joined[-1]):
            joined[-1] += "\n\n" + block
        else:
            joined.append(block)
    return joined


def _indented(block: str) -> bool:
    return all(line.startswith("    ") or not line.strip() for line in block.split("\n"))


def _block(block: str) -> str:
    if _indented(block):
        return "<pre>" + escape("\n".join(line[4:] for line in block.split("\n"))) + "</pre>"
    heading = re.match(r"(#+) +(.*)(?:\n(.*))?", block, flags=re.DOTALL)
    if heading:
        level = min(len(heading[1]), 6)
        title, _, rest = block[len(heading[1]) :].strip().partition("\n")
        return f"<h{level}>{_inline(title)}</h{level}>" + (_block(rest) if rest.strip() else "")
    lines = block.split("\n")
    if lines[0].lstrip().startswith(("- ", "* ")):
        return "<ul>" + "".join(f"<li>{_inline(item)}</li>" for item in _items(lines)) + "</ul>"
    if lines[0].startswith("|") and len(lines) > 1:
        cells = [[c.strip() for c in line.strip().strip("|").split("|")] for line in lines]
        return (
            "<table>" + "".join(_html_row(c, "td" if i else "th") for i, c in enumerate(cells) if i != 1) + "</table>"
        )
    return f"<p>{_inline(' '.join(lines))}</p>"


def _html_row(cells: list[str], tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{_inline(c)}</{tag}>" for c in cells) + "</tr>"


def _items(lines: list[str]) -> list[str]:
    items: list[str] = []
    for line in lines:
        if line.lstrip().startswith(("- ", "* ")):
            items.append(line.lstrip()[2:])
        else:
            items[-1] += " " + line.strip()
    return items


def _inline(text: str) -> str:
    html = re.sub(r"`([^`]*)`", r"<code>\1</code>", escape(text))
    return re.sub(r"\*\*([^*]+)\*\*", r"<b>\1</b>", html)
