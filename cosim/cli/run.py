"""`cosim run`."""

import sys
from enum import StrEnum
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cosim.cli.shipped_names import ScenarioArgument

if TYPE_CHECKING:
    from collections.abc import Callable

    from cosim.engine.reference import RunProgress
    from cosim.wiring import Wiring

DEMONSTRATION = "sallam-stable"
OUTSIDE = "let an SSP name files outside its archive or folder"


class ExportFormat(StrEnum):
    """Further files of a result."""

    CSV = "csv"
    MAT = "mat"


def command(
    scenario: ScenarioArgument = DEMONSTRATION,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change a value; may be repeated")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder for the results (default: results/SCENARIO)")] = None,
    effects: Annotated[Path | None, typer.Option(help="effects file of close-loop")] = None,
    export: Annotated[list[ExportFormat] | None, typer.Option(help="also write result.csv or result.mat")] = None,
    report: Annotated[bool, typer.Option("--report/--no-report", help="write report.html")] = True,
    allow_outside: Annotated[bool, typer.Option("--allow-outside", help=OUTSIDE)] = False,
) -> None:
    """One co-simulation: summary.json, result.h5, report.html."""
    import cosim
    from cosim.cli.folder import made, named

    chosen = prepare(scenario, set_ or [], effects, allow_outside).scenario
    folder = made(out or named(chosen.name))
    with RunMeter(chosen.name) as progress:
        result = cosim.run(chosen, progress=progress)
    for message in result.raw.messages:
        say(f"warning: {message}")
    try:
        result.save(folder, export=[kind.value for kind in export or ()], report=report)
    finally:
        page = ": open report.html in a browser" if (folder / "report.html").is_file() else ""
        print(f"{result}\n  written to                    {folder}{page}")
    if result.failure is not None:
        raise result.failure
    if result.interrupted:
        sys.exit(130)


def prepare(name: str, overrides: list[str], effects: Path | None, allow_outside: bool = False) -> "Wiring":
    """The checked wiring of a scenario; its warnings are printed. Raises InputError with every problem found."""
    from cosim.api.runs import checked

    wiring = checked(name, overrides, effects, say, allow_outside)
    for warning in wiring.warnings:
        say(f"warning: {warning}")
    return wiring


def say(text: str) -> None:
    """Tell on stderr what is being done."""
    print(text, file=sys.stderr)


class RunMeter:
    """A progress bar with the real-time factor on stderr, where that is a terminal; else nothing."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.bar: Any = None
        self.task: Any = None
        self.last: int = 0

    def __enter__(self) -> "Callable[[RunProgress], None] | None":
        if not sys.stderr.isatty():
            return None
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[factor]}"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        self.bar.start()
        return self.tell

    def tell(self, progress: "RunProgress") -> None:
        """Show how far the run is; a run that begins anew is the twin."""
        if self.bar is None:
            return
        if self.task is None or progress.done < self.last:
            label = self.name if self.task is None else f"{self.name}, twin for the growth rate"
            if self.task is not None:
                self.bar.remove_task(self.task)
            self.task = self.bar.add_task(label, total=progress.total, factor="")
        self.last = progress.done
        self.bar.update(self.task, completed=progress.done, factor=f"{progress.factor:.3g} x real time")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.bar is not None:
            self.bar.stop()
