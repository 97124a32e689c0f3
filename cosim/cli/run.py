"""`cosim run`."""

import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from cosim.engine.reference import RunProgress
    from cosim.results.summary import Judged
    from cosim.wiring import Wiring

DEMONSTRATION = "sallam-stable"


class Export(StrEnum):
    """Further files of a result."""

    CSV = "csv"
    MAT = "mat"


def command(
    scenario: Annotated[str, typer.Argument(help="name of a shipped scenario, or a TOML file")] = DEMONSTRATION,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change a value; may be repeated")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder for the results (default: results/SCENARIO)")] = None,
    effects: Annotated[Path | None, typer.Option(help="effects file of close-loop")] = None,
    export: Annotated[list[Export] | None, typer.Option(help="also write result.csv or result.mat")] = None,
    report: Annotated[bool, typer.Option("--report/--no-report", help="write report.html")] = True,
) -> None:
    """One co-simulation: summary.json, result.h5, report.html."""
    from cosim.cli.folder import made
    from cosim.engine.isolation import runner
    from cosim.fmu import open_system
    from cosim.stability.twin import judged_run

    wiring = prepare(scenario, set_ or [], effects)
    folder = made(out or Path("results") / wiring.scenario.name)
    with open_system(wiring.scenario) as system, RunMeter(wiring.scenario.name) as progress:
        judged = judged_run(wiring.scenario, system, progress, simulate=runner(wiring.scenario))
    lost = _write(judged, folder, export or [], report)
    print(_spoken(judged, folder))
    if lost:
        raise OSError(f"not written: {'; '.join(lost)}; free space, or name another folder with --out, and run again")
    if judged.result.failure is not None:
        raise judged.result.failure
    if judged.interrupted:
        sys.exit(130)


def prepare(name: str, overrides: list[str], effects: Path | None) -> "Wiring":
    """The checked wiring of a scenario, FMUs built where they are missing; problems of the file and of the wiring
    together.
    """
    from cosim.errors import InputError
    from cosim.fmu import descriptions
    from cosim.scenario import draft
    from cosim.wiring import check

    scenario, problems = draft(name, overrides, effects)
    wiring, found = None, []
    if scenario is not None:
        try:
            wiring, found = check(scenario, descriptions(scenario, _say))
        except InputError as error:
            found = list(error.problems)
        except Exception:  # what is wrong already may make the rest impossible
            if not problems:
                raise
    if problems or wiring is None:
        known = {(p.expected, p.got) for p in problems}
        raise InputError([*problems, *(p for p in found if (p.expected, p.got) not in known)])
    for warning in wiring.warnings:
        _say(f"warning: {warning}")
    return wiring


def _say(text: str) -> None:
    print(text, file=sys.stderr)


class RunMeter:
    """A progress bar with the real-time factor on stderr, where that is a terminal; else nothing."""

    def __init__(self, name: str) -> None:
        self.name, self.last = name, 0
        self.bar: Progress | None = None
        self.task: TaskID | None = None

    def __enter__(self) -> Callable[["RunProgress"], None] | None:
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

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.stop()


def _write(judged: "Judged", folder: Path, exports: list[Export], report: bool) -> list[str]:
    """Every file of the run, summary.json last; those that could not be written, and why (a full disk)."""
    from cosim.cli.folder import words

    lost = []
    for name, write in _files(judged, exports, report).items():
        try:
            write(folder / name)
        except (OSError, RuntimeError) as error:  # the latter from HDF5
            (folder / name).unlink(missing_ok=True)
            lost.append(f"{folder / name}: {words(error)}")
    return lost


def _files(judged: "Judged", exports: list[Export], report: bool) -> dict[str, Callable[[Path], object]]:
    """The names of a run's files with what writes each."""
    from cosim.results.files import export_csv, export_mat, write_h5

    files: dict[str, Callable[[Path], object]] = {"result.h5": lambda path: write_h5(judged.result, path)}
    for kind in exports:
        export = export_csv if kind is Export.CSV else export_mat
        files[f"result.{kind.value}"] = lambda path, export=export: export(judged.result, path)
    if report:
        files["report.html"] = lambda path: _write_report(judged, path)
    return files | {"summary.json": lambda path: _write_summary(judged, path)}


def _write_report(judged: "Judged", path: Path) -> None:
    from cosim.report.html import write_report
    from cosim.report.run import run_report

    write_report(run_report(judged), path)


def _write_summary(judged: "Judged", path: Path) -> None:
    import json

    from cosim.results.summary import summary

    text = json.dumps(summary(judged), indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def _spoken(judged: "Judged", folder: Path) -> str:
    """The summary for the terminal."""
    from cosim.results.summary import simulated_time

    result, experiment = judged.result, judged.result.scenario.experiment
    lines = [f"{result.scenario.name}: {judged.outcome.value}: {judged.outcome.advice}"]
    if result.message:
        lines.append(f"  {result.message}")
    if judged.growth_rate is not None:
        low, high = judged.interval or (float("nan"), float("nan"))
        lines.append(
            f"  growth of small disturbances  {judged.growth_rate:+.4g} 1/s  (95 %: {low:+.4g} to {high:+.4g})"
        )
    if judged.tracking is not None:
        lines.append(f"  tracking, RMS of |x_l - x_r|  {judged.tracking.total * 1e3:.4g} mm")
    lines.append(
        f"  simulated                     {simulated_time(result):g} s in {result.wall_time:.2f} s, "
        f"steps of {experiment.step * 1e3:g} ms, "
        f"{experiment.algorithm.value}, {experiment.extrapolation.value}"
    )
    page = ": open report.html in a browser" if (folder / "report.html").is_file() else ""
    lines.append(f"  written to                    {folder}{page}")
    return "\n".join(lines)
