"""The command `build-fmus`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from build_fmus.errors import BadRequestError, BuildError
from build_fmus.interruption import INTERRUPTED, leave_when_told, stop_when_told

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def build_fmus(
    model: Annotated[
        list[str] | None,
        typer.Argument(help="Models, by name or by the path of a folder; all of ours by default."),
    ] = None,
    fmi: Annotated[int | None, typer.Option(help="FMI version, 2 or 3; both where none is named.")] = None,
    platform: Annotated[
        list[str] | None,
        typer.Option(
            help="x86_64-linux, aarch64-linux, x86_64-windows, x86_64-darwin, aarch64-darwin; this machine by default."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for fmi2/MODEL.fmu and fmi3/MODEL.fmu.")] = Path("results/fmus"),
    debug: Annotated[bool, typer.Option(help="Show tracebacks.")] = False,
) -> None:
    """Compile and zip FMUs."""
    try:
        for line in build_all(model or [], [fmi] if fmi else [2, 3], platform or [], out):
            print(line)
    except (BuildError, KeyboardInterrupt) as error:
        if debug:
            raise
        print(f"build-fmus: {str(error) or 'interrupted'}", file=sys.stderr)
        raise typer.Exit(_exit_code(error)) from error


def _exit_code(error: BaseException) -> int:
    """2: what was asked for does not exist; 1: it cannot be built here; 130: interrupted."""
    return INTERRUPTED if isinstance(error, KeyboardInterrupt) else 2 if isinstance(error, BadRequestError) else 1


def build_all(wanted: list[str], versions: list[int], platforms: list[str], out: Path) -> list[str]:
    """Build and copy; one line for each FMU. Raises BuildError."""
    from build_fmus.several import built

    files = built(wanted, versions, platforms, out, lambda text: print(text, file=sys.stderr, flush=True))
    return [f"{file}  {file.stat().st_size / 1024:.0f} kB" for file in files]


def platforms_apart(words: list[str]) -> list[str]:
    """`--platform A B` as `--platform A --platform B`; only names of platforms count, since models may follow."""
    from build_fmus.compiler import PLATFORMS

    result: list[str] = []
    for word in words:
        again = word in PLATFORMS and result[-2:-1] == ["--platform"]
        result += ["--platform", word] if again else [word]
    return result


def main() -> None:
    """Entry point. Exit codes: 0 done, 1 it cannot be built here, 2 bad input, 130 interrupted."""
    stop_when_told()  # no compiler and no folder stays behind
    try:
        app(args=platforms_apart(sys.argv[1:]), prog_name="build-fmus")
    finally:
        leave_when_told()
