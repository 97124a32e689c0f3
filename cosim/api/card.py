"""How results look in a notebook."""

from collections.abc import Mapping


def card(text: str, facts: Mapping[str, object]) -> str:
    """A few lines of HTML: what a command would print, then facts in a table."""
    from html import escape

    head, *rest = text.splitlines()
    rows = "".join(f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in facts.items())
    lines = f"<pre>{escape(chr(10).join(rest))}</pre>" if rest else ""
    return f"<div><b>{escape(head)}</b>{lines}<table>{rows}</table></div>"
