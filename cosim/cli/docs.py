"""`cosim docs`."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    out: Annotated[Path, typer.Option(help="folder for the pages, HTML and Markdown")] = Path("results/docs"),
    browser: Annotated[bool, typer.Option("--open/--no-open", help="show it in the browser")] = True,
) -> None:
    """The manual: tutorial, how-to pages, reference (generated from this version's code), explanations; offline."""
    import webbrowser

    from cosim.cli.folder import made
    from cosim.cli.reference import reference_pages
    from cosim.report.manual import write_manual, written_pages

    first = write_manual([*written_pages(), *reference_pages()], made(out))
    print(f"the manual: {first}")
    if browser:
        webbrowser.open(first.resolve().as_uri())
