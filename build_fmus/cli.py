"""The command `build-fmus`."""

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated

import typer

from build_fmus.errors import BuildError

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def build_fmus(
    model: Annotated[list[str] | None, typer.Argument(help="Models to build; all where none is named.")] = None,
    fmi: Annotated[int | None, typer.Option(help="FMI version, 2 or 3; both where none is named.")] = None,
    platform: Annotated[
        list[str] | None,
        typer.Option(
            help="x86_64-linux, aarch64-linux, x86_64-windows, x86_64-darwin, aarch64-darwin; this machine by default."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for fmi2/MODEL.fmu and fmi3/MODEL.fmu.")] = Path("."),
    debug: Annotated[bool, typer.Option(help="Show tracebacks.")] = False,
) -> None:
    """Compile and zip FMUs."""
    try:
        for line in build_all(model or [], [fmi] if fmi else [2, 3], platform or [], out):
            print(line)
    except BuildError as error:
        if debug:
            raise
        print(f"build-fmus: {error}", file=sys.stderr)
        raise typer.Exit(2) from error


def build_all(wanted: list[str], versions: list[int], platforms: list[str], out: Path) -> list[str]:
    """Build and copy; one line for each FMU. Raises BuildError."""
    from build_fmus.build import check_platforms, fmu_path
    from build_fmus.sources import models

    platforms = list(check_platforms(platforms))
    pairs = [(name, version) for version in versions for name in wanted or models()]

    def one(pair: tuple[str, int]) -> str:
        name, version = pair
        built = fmu_path(name, version, platforms, lambda text: print(text, file=sys.stderr, flush=True))
        return copy(built, out / f"fmi{version}" / f"{name}.fmu")

    with ThreadPoolExecutor(min(4, os.cpu_count() or 1)) as pool:
        return list(pool.map(one, pairs))


def copy(built: Path, target: Path) -> str:
    from build_fmus.cache import store

    data = built.read_bytes()
    store(target, data)
    return f"{target}  {len(data) / 1024:.0f} kB"


def main() -> None:
    """Entry point. Exit codes: 0 done, 2 bad input or no way to build, 130 interrupted."""
    try:
        app()
    except KeyboardInterrupt:
        print("build-fmus: interrupted", file=sys.stderr)
        sys.exit(130)
