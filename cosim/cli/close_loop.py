"""`cosim close-loop`: residual, missing effect, effect added, error before and after."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.folder import TableFormat


def command(
    data: Annotated[
        list[Path], typer.Argument(help="Recordings (CSV, Parquet, MAT); a .toml of the same stem describes them.")
    ],
    test: Annotated[list[Path] | None, typer.Option(help="Recordings that are held out.")] = None,
    description: Annotated[
        Path | None, typer.Option(help="what the columns are (TOML; cosim docs description-format)")
    ] = None,
    effects: Annotated[
        Path | None, typer.Option(help="effects.toml of an earlier pass: the search starts from it.")
    ] = None,
    effect_file: Annotated[list[Path] | None, typer.Option(help="Python file with effects of your own.")] = None,
    export: Annotated[
        list[TableFormat] | None,
        typer.Option(help="also write the parameters of the effects as closure.csv or closure.parquet"),
    ] = None,
    replay: Annotated[bool, typer.Option(help="Replay the experiment with the FMUs.")] = True,
    out: Annotated[Path | None, typer.Option(help="Folder of the results (default: results/STEM-closure).")] = None,
) -> None:
    """Trace the residual of a recording to a missing effect, add it to the FMU, report the error before and after."""
    import cosim
    from cosim.cli.folder import named, results

    with results(out or named(f"{data[0].stem}-closure")) as folder:
        found = cosim.close_loop(
            data,
            test,
            effects=effects,
            description=description,
            own_effects=effect_file or (),
            replay=replay,
            progress=_tell,
        )
    _tell("writing the results")
    written = found.save(folder, export=[kind.value for kind in export or ()])
    for text in written.warnings:
        print(f"warning: {text}", file=sys.stderr)
    print(f"{written}\nresults: {folder}")


def _tell(text: str) -> None:
    print(f"  {text}", file=sys.stderr, flush=True)
