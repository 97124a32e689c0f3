"""`cosim close-loop`: residual, missing effect, effect added, error before and after."""

import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    data: Annotated[
        list[Path], typer.Argument(help="Recordings (CSV, Parquet, MAT); a .toml of the same stem describes them.")
    ],
    test: Annotated[list[Path] | None, typer.Option(help="Recordings that are held out.")] = None,
    description: Annotated[Path | None, typer.Option(help="Description file (CONTRACT.md, measured data).")] = None,
    effects: Annotated[
        Path | None, typer.Option(help="effects.toml of an earlier pass: the search starts from it.")
    ] = None,
    effect_file: Annotated[list[Path] | None, typer.Option(help="Python file with effects of your own.")] = None,
    replay: Annotated[bool, typer.Option(help="Replay the experiment with the FMUs.")] = True,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("close-loop"),
) -> None:
    """Trace the residual of a recording to a missing effect, add it to the FMU, report the error before and after."""
    from cosim.cli.folder import made
    from cosim.closure import effects_file
    from cosim.closure.closure import Options, close_loop
    from cosim.closure.document import sentence
    from cosim.effects import library
    from cosim.measured import read
    from cosim.report.closure import save

    known = library(effect_file or ())
    recording = read(data, test or (), description)
    previous = effects_file.load(effects, known, recording) if effects else ()
    made(out)
    closure = close_loop(recording, Options(effects=known, previous=previous, replayed=replay, progress=_tell))
    _tell("writing the results")
    closure = save(closure, out)
    for text in closure.warnings:
        print(f"warning: {text}", file=sys.stderr)
    print(sentence(closure))
    print(f"results: {out}")


def _tell(text: str) -> None:
    print(f"  {text}", file=sys.stderr, flush=True)
