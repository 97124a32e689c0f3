"""`cosim compare`."""

import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    items: Annotated[
        list[str], typer.Argument(metavar="A B ...", help="result folders, scenarios, sweeps, tables of other tools")
    ],
    tolerance: Annotated[
        float | None, typer.Option(help="share of a signal's range, or of a map, that the others may be off")
    ] = None,
    time_tolerance: Annotated[
        float | None, typer.Option(help="s, half the width of the tube (default: what the samples leave open)")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder for the results (default: results/A-B)")] = None,
) -> None:
    """Results side by side: compare.json, report.html; exit code 1 where a tolerance is given and not met."""
    import cosim
    from cosim.cli.folder import named, results
    from cosim.cli.run import say

    name = "-".join(Path(item).resolve().name if Path(item).exists() else item for item in items)
    with results(out or named(name)) as folder:
        found = cosim.compare(items, tolerance=tolerance, time_tolerance=time_tolerance, progress=say)
    found.save(folder)
    print(f"{found}\nwritten to {folder}: open report.html in a browser")
    if found.agrees is False:
        print("error: not within the tolerance, or not with the same end (above)", file=sys.stderr)
        sys.exit(1)
