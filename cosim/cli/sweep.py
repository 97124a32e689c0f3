"""`cosim sweep`."""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.progress import Progress, TaskID

    from cosim.sweep.campaign import Campaign, Curve, SweepProgress
    from cosim.sweep.pool import Workers
    from cosim.sweep.spec import Sweep


def command(
    spec: Annotated[str, typer.Argument(help="name of a shipped sweep, or a TOML file")],
    workers: Annotated[int | None, typer.Option(min=1, help="worker processes (default: one a core)")] = None,
    dask: Annotated[str | None, typer.Option(metavar="ADDRESS", help="scheduler of an existing Dask cluster")] = None,
    out: Annotated[
        Path | None, typer.Option(help="folder for the results (default: results/SPEC); the same again: resumes")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change a fixed value; may be repeated")
    ] = None,
    effects: Annotated[Path | None, typer.Option(help="effects file of close-loop")] = None,
    report: Annotated[bool, typer.Option("--report/--no-report", help="write report.html")] = True,
) -> None:
    """A batch stability sweep: summary.json, sweep.h5, report.html; kill it at any time and run it again."""
    from cosim.cli.folder import made
    from cosim.sweep.campaign import first_point, run_sweep, task_of
    from cosim.sweep.evaluate import check, origin

    sweep = _prepared(spec, set_ or [], effects)
    folder = made(out or Path("results") / sweep.name)
    how = check(task_of(sweep), first_point(sweep))
    print(f"{sweep.name}: {how}", file=sys.stderr)
    pool, words = _pool(workers, dask)
    try:
        with pool, _PointsMeter(sweep.name) as tell:
            source = origin(task_of(sweep), first_point(sweep))
            campaign = run_sweep(sweep, folder, pool, f"{how}; {words}", tell=tell, origin=source)
    except KeyboardInterrupt:
        print(
            f"interrupted; what was computed is kept in {folder}: run the same command again to go on", file=sys.stderr
        )
        sys.exit(130)
    _write(campaign, folder, report)
    print(_spoken(campaign, folder))


def _prepared(spec: str, overrides: list[str], effects: Path | None) -> "Sweep":
    from attrs import evolve

    from cosim.scenario import parse_override
    from cosim.sweep.spec import load_sweep

    sweep = load_sweep(spec)
    fixed = dict(sweep.set) | dict(parse_override(text) for text in overrides)
    return evolve(sweep, set=fixed, effects=str(effects.resolve()) if effects else sweep.effects)


def _pool(workers: int | None, dask: str | None) -> "tuple[Workers, str]":
    """Who works, and that in words."""
    if dask:
        from cosim.sweep.cluster import DaskPool

        return DaskPool(dask), f"Dask cluster at {dask}"
    from cosim.sweep.pool import LocalPool

    count = workers or os.cpu_count() or 1
    return LocalPool(count), f"{count} local process{'es' if count > 1 else ''}"


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
        left = f"{progress.left:.0f} s left" if progress.left < 1e6 else ""
        words = f"{progress.done} of {progress.asked} points, {progress.rate:.3g}/s {left}"
        if self.bar is not None and self.task is not None:
            self.bar.update(self.task, completed=progress.done, total=progress.asked, words=words)
        elif progress.wall - self.told > 10.0:
            self.told = progress.wall
            print(f"{self.name}: {words}", file=sys.stderr)

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.stop()


def _write(campaign: "Campaign", folder: Path, report: bool) -> None:
    """Table, report, and summary.json last, so that it stands for a complete folder."""
    import json

    from cosim.results.files import write_table
    from cosim.sweep.table import columns, summary, units

    write_table(
        columns(campaign),
        units(campaign),
        {"sweep": campaign.sweep.name, "scenario": campaign.sweep.scenario},
        folder / "sweep.h5",
    )
    if report:
        from cosim.report.html import write_report
        from cosim.report.sweep import sweep_report

        write_report(sweep_report(campaign), folder / "report.html")
    text = json.dumps(summary(campaign), indent=2, ensure_ascii=False, allow_nan=False)
    (folder / "summary.json").write_text(text + "\n", encoding="utf-8")


def _spoken(campaign: "Campaign", folder: Path) -> str:
    from collections import Counter

    from cosim.sweep.table import kernel_replay

    outcomes = Counter(f.outcome for f in campaign.findings)
    said = ", ".join(f"{count} {name}" for name, count in sorted(outcomes.items()))
    rows = [("points", f"{len(campaign.points)} ({campaign.known_before} known before): {said}")]
    rows += [("executor", campaign.executor)]
    if (replay := kernel_replay(campaign)) is not None:
        largest = replay["largest_relative_difference"]
        words = "they end differently" if largest is None else f"largest relative difference {largest:.2g}"
        rows += [("replayed", f"{replay['points']} of the kernel's points by the FMUs: {words}")]
    for curve in campaign.curves[:10]:
        where = _along(curve) if curve.lines and len(curve.lines[0][0]) == 1 else f"{len(curve.lines)} curve(s)"
        audit = (
            f", missed area below {100 * curve.audit.bound:.2g} % ({100 * curve.audit.level:g} % confidence)"
            if curve.audit
            else ""
        )
        rows += [(f"boundary {curve.label}".strip(), (where if curve.lines else "none in the range") + audit)]
    rows += [("results", str(folder))]
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def _along(curve: "Curve") -> str:
    return ", ".join(f"{line[0][0]:.5g}" for line in curve.lines)
