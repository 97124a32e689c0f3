"""`cosim docs`."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    page: Annotated[str, typer.Argument(help="the page to begin with, `scenario-keys`, say")] = "index",
    out: Annotated[Path, typer.Option(help="folder for the pages, HTML and Markdown")] = Path("results/docs"),
    browser: Annotated[bool, typer.Option("--open/--no-open", help="show it in the browser")] = True,
) -> None:
    """The manual: tutorial, how-to pages, reference (generated from this version's code), explanations; offline."""
    import webbrowser

    from cosim.cli.folder import made
    from cosim.cli.reference import reference_pages
    from cosim.errors import InputError, Problem, did_you_mean
    from cosim.report.manual import write_manual, written_pages

    pages = [*written_pages(), *reference_pages()]
    names = [one.slug for one in pages]
    if page not in names:
        raise InputError(Problem("page", "a page of the manual", repr(page), did_you_mean(page, names)))
    shown = write_manual(pages, made(out)).with_name(f"{page}.html")
    print(f"the manual: {shown}")
    if browser:
        webbrowser.open(shown.resolve().as_uri())
