"""`cosim data`: what a recording holds, what is doubtful, and a description of it."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    files: Annotated[list[Path], typer.Argument(help="recordings of one kind: text, Parquet, MAT, HDF5, NPZ, bags")],
    description: Annotated[
        Path | None, typer.Option(help="what the columns are (TOML); default: beside the data, else guessed")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder for the results (default: results/STEM)")] = None,
) -> None:
    """What recordings hold and what is doubtful: data.json, report.html and a description that identify takes."""
    import shlex
    import sys

    import cosim
    from cosim.cli.folder import named, results

    with results(out or named(files[0].stem)) as folder:
        kept = (folder / "description.toml").exists()
        found = cosim.data(files, description)
    found.save(folder)
    print(f"{found}\nwritten: {folder / 'data.json'}, {folder / 'report.html'}")
    given = description
    if found.description:
        given = folder / "description.toml"
        print(f"kept, as it was there already: {given}" if kept else f"written: {given}")
    if found.recording is None:
        print("set the columns and units right in a description, then pass it with --description", file=sys.stderr)
        sys.exit(2)
    said = "" if given is None else f" --description {shlex.quote(str(given))}"
    print(f"next: cosim identify {' '.join(shlex.quote(str(file)) for file in files)}{said}")
