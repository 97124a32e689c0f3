"""`cosim sweep`."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cosim.cli.folder import TableFormat
from cosim.cli.shipped_names import SweepArgument

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.progress import Progress, TaskID

    from cosim.sweeps.campaign import SweepProgress


def command(
    spec: SweepArgument,
    workers: Annotated[int | None, typer.Option(min=1, help="worker processes (default: one a core)")] = None,
    dask: Annotated[str | None, typer.Option(metavar="ADDRESS", help="scheduler of an existing Dask cluster")] = None,
    out: Annotated[
        Path | None, typer.Option(help="folder for the results (default: results/SPEC); the same again: resumes")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change a fixed value; may be repeated")
    ] = None,
    effects: Annotated[Path | None, typer.Option(help="effects file of close-loop")] = None,
    evaluator: Annotated[
        str | None,
        typer.Option(metavar="FILE.py", help="own evaluate(task, points); FILE.py:NAME for another function"),
    ] = None,
    export: Annotated[
        list[TableFormat] | None, typer.Option(help="also write the points as sweep.csv or sweep.parquet")
    ] = None,
    report: Annotated[bool, typer.Option("--report/--no-report", help="write report.html")] = True,
) -> None:
    """A batch stability sweep: summary.json, sweep.h5, report.html; kill it at any time and run it again."""
    from cosim.api.sweeping import carried_out, described, how
    from cosim.cli.folder import made, named
    from cosim.scenario import parse_override

    chosen = described(spec, dict(map(parse_override, set_ or ())), effects, evaluator)
    folder = made(out or named(chosen.name))
    said = how(chosen)
    print(f"{chosen.name}: {said}", file=sys.stderr)
    try:
        with _PointsMeter(chosen.name) as progress:
            table = carried_out(chosen, said, folder, workers, dask, progress)
    except KeyboardInterrupt:
        kept = f"what was computed is kept in {folder}: run the same command again to go on"
        print(f"interrupted; {kept}", file=sys.stderr)
        sys.exit(130)
    for warning in table.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    table.save(folder, export=[kind.value for kind in export or ()], report=report)
    print(f"{table}\nwritten to  {folder}")
    if table.failure is not None:
        print(f"error: every point failed; the first: {table.failure}", file=sys.stderr)
        sys.exit(1)


class _PointsMeter:
    """Points, rate and time left on stderr: a bar on a terminal, a line every ten seconds elsewhere."""

    def __init__(self, name: str) -> None:
        self.name, self.told = name, 0.0
        self.bar: Progress | None = None
        self.task: TaskID | None = None

    def __enter__(self) -> "Callable[[SweepProgress], None]":
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn

            self.bar = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.fields[words]}"),
                console=Console(stderr=True),
                transient=True,
            )
            self.bar.start()
            self.task = self.bar.add_task(self.name, words="")
        return self.tell

    def tell(self, progress: "SweepProgress") -> None:
        """Show how far the sweep is; the number of points grows while a boundary is traced."""
        words = str(progress)
        if self.bar is not None and self.task is not None:
            self.bar.update(self.task, completed=progress.done, total=progress.asked, words=words)
        elif progress.wall - self.told > 10.0:
            self.told = progress.wall
            print(f"{self.name}: {words}", file=sys.stderr)

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.stop()
