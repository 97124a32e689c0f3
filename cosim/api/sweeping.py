"""Batch sweeps of stability: points in parallel, boundaries, a table."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from attrs import evolve, frozen

from cosim.api.card import card
from cosim.errors import InputError, Problem
from cosim.opening import named_file
from cosim.results.files import write_table
from cosim.results.frames import table_frame
from cosim.results.saving import save_files, write_json
from cosim.results.tables import TABLES, ResultTable, table_files
from cosim.sweeps.campaign import Campaign, Curve, SweepProgress, every_choice, first_point, run_sweep, task_of
from cosim.sweeps.evaluate import check, origin
from cosim.sweeps.pool import function
from cosim.sweeps.spec import Sweep, load_sweep
from cosim.sweeps.table import columns, kernel_replay, summary, units

if TYPE_CHECKING:
    import pandas

    from cosim.report.canvas import MplFigure
    from cosim.sweeps.pool import Workers


def sweep(
    spec: Sweep | str | Path,
    *,
    workers: int | None = None,
    dask: str | None = None,
    folder: str | Path | None = None,
    set: Mapping[str, object] | None = None,
    effects: str | Path | None = None,
    evaluator: str | Path | None = None,
    progress: Callable[[SweepProgress], None] | None = None,
) -> SweepTable:
    """Carry out a batch sweep: every point by twin runs, in worker processes or on a Dask cluster.

    workers: processes (default: one a core); dask: address of a scheduler; folder: where what is computed is
    kept, so that the same call goes on after an interruption (default: a temporary one); set: fixed values to change.
    evaluator: a Python file of your own, whose function `evaluate(task, points)` gives a result for every point
    ("FILE.py:function" where it has another name); progress: called with how far the sweep is; `print` will do.
    Raises InputError where the sweep or its scenario is wrong, or `folder` holds another sweep.
    """
    found = described(spec, set or {}, effects, evaluator)
    from build_fmus.scratch import workspace

    if folder is not None:
        return carried_out(found, how(found), Path(folder), workers, dask, progress)
    with workspace() as kept:
        return carried_out(found, how(found), kept, workers, dask, progress)


def described(
    spec: Sweep | str | Path,
    changed: Mapping[str, object],
    effects: str | Path | None = None,
    evaluator: str | Path | None = None,
) -> Sweep:
    """A shipped sweep by name, or a TOML file by path, with fixed values changed, an effects file, an own evaluator.

    Raises InputError with every problem found.
    """
    found = spec if isinstance(spec, Sweep) else load_sweep(str(spec))
    chosen = found.effects if effects is None else str(Path(effects).resolve())
    own = found.evaluator if evaluator is None else _own(str(evaluator))
    given = dict(found.changes) | dict(changed)
    return evolve(found, set=dict(found.set) | dict(changed), effects=chosen, evaluator=own, changes=given)


def _own(name: str) -> str:
    """The evaluator of a file, with its full path. Raises InputError where there is none."""
    file, _, chosen = name.rpartition(":") if ".py:" in name else (name, "", "")
    path = Path(file).resolve()
    full = f"{path}:{chosen or 'evaluate'}"
    try:
        wanted = "a Python file, named .py"
        if named_file(path, wanted, "evaluator").suffix == ".py" and callable(function(full)):
            return full
        problem = Problem("evaluator", wanted, repr(file))
    except InputError:
        raise
    except AttributeError:
        problem = Problem(str(path), f"a function {chosen or 'evaluate'}(task, points)", "none of that name")
    except Exception as error:  # noqa: BLE001 - whatever a file of the user's raises when it is loaded
        problem = Problem(str(path), "a Python file that can be loaded", f"{type(error).__name__}: {error}")
    raise InputError(problem)


def how(spec: Sweep) -> str:
    """How the points will be computed, in words. Raises InputError where the first point does not fit the scenario."""
    return check(task_of(spec), first_point(spec))


def carried_out(
    spec: Sweep,
    said: str,
    folder: Path,
    workers: int | None,
    dask: str | None,
    progress: Callable[[SweepProgress], None] | None,
) -> SweepTable:
    """The sweep as `sweep` carries it out, after `how` has said how the points will be computed."""
    pool, words = _pool(workers, dask)
    with pool:
        source = origin(task_of(spec), every_choice(spec))
        return SweepTable(run_sweep(spec, folder, pool, f"{said}; {words}", tell=progress, origin=source))


def _pool(workers: int | None, dask: str | None) -> tuple[Workers, str]:
    """The workers, and what they are in words."""
    if dask:
        from cosim.sweeps.cluster import DaskPool

        return DaskPool(dask), f"Dask cluster at {dask}"
    from cosim.sweeps.pool import LocalPool

    count = workers or os.cpu_count() or 1
    return LocalPool(count, lambda: import_module("h5py")), f"{count} local process{'es' if count > 1 else ''}"


@final
@frozen(eq=False, repr=False)
class SweepTable:
    """A sweep that was carried out: a row a point."""

    campaign: Campaign

    @property
    def summary(self) -> dict[str, Any]:
        """The content of summary.json."""
        return summary(self.campaign)

    @property
    def boundary(self) -> list[list[list[float]]]:
        """The traced boundaries: lines of vertices (x, y) in the units of the axes."""
        return self.summary["boundary"]

    @property
    def failure(self) -> str | None:
        """Why there is no result at all: the words of the first point, where every point failed."""
        return self.campaign.failure

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was odd: lines of the journal that were damaged."""
        return self.campaign.warnings

    @property
    def columns(self) -> dict[str, list[Any]]:
        """The table by columns: axes, outcome, growth_rate, evidence, replay, ..."""
        return columns(self.campaign)

    def __len__(self) -> int:
        return len(self.campaign.points)

    def to_dataframe(self) -> pandas.DataFrame:
        """A row a point; units in `attrs`. Needs pandas."""
        return table_frame(self.columns, units(self.campaign))

    def plot(self) -> MplFigure:
        """The figure of the report: the map with its boundary, or the crossings along the last axis."""
        from cosim.report.canvas import drawn
        from cosim.report.sweep import overview

        return drawn(overview(self.campaign))

    def save(self, folder: str | Path, *, export: Iterable[str] = (), report: bool = True) -> Path:
        """Write sweep.h5, report.html and summary.json, the last when all else is there; returns the folder.

        export: the table in further files, "csv" or "parquet".
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        campaign = self.campaign
        names = {"sweep": campaign.sweep.name, "scenario": campaign.sweep.scenario}
        files: dict[str, Callable[[Path], object]] = {
            "sweep.h5": lambda path: write_table(self.columns, units(campaign), names, path),
        }
        files |= table_files("sweep", export, lambda: ResultTable(self.columns, units(campaign)))
        if report:
            files["report.html"] = self._write_page
        stale = ["report.html", *(f"sweep.{ending}" for ending in TABLES)]
        save_files(folder, files | {"summary.json": lambda path: write_json(self.summary, path)}, stale)
        return folder

    def _write_page(self, path: Path) -> Path:
        from cosim.report.html import write_report
        from cosim.report.sweep import sweep_report

        return write_report(sweep_report(self.campaign), path)

    def __str__(self) -> str:
        """What `cosim sweep` prints."""
        rows = _rows(self.campaign)
        width = max(len(name) for name, _ in rows)
        return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)

    def __repr__(self) -> str:
        return f"<SweepTable {self.campaign.sweep.name}: {len(self)} points, {len(self.boundary)} boundary lines>"

    def _repr_html_(self) -> str:
        return card(self.campaign.sweep.title or self.campaign.sweep.name, dict(_rows(self.campaign)))


def _rows(campaign: Campaign) -> list[tuple[str, str]]:
    outcomes = Counter(found.outcome for found in campaign.findings)
    said = ", ".join(f"{count} {name}" for name, count in sorted(outcomes.items()))
    rows = [("points", f"{len(campaign.points)} ({campaign.known_before} known before): {said}")]
    rows += [("executor", campaign.executor)]
    if (replay := kernel_replay(campaign)) is not None:
        largest = replay["largest_relative_difference"]
        words = "they end differently" if largest is None else f"largest relative difference {largest:.2g}"
        rows += [("replayed", f"{replay['points']} of the kernel's points by the FMUs: {words}")]
    return rows + [(f"boundary {curve.label}".strip(), _curve(curve)) for curve in campaign.curves[:10]]


def _curve(curve: Curve) -> str:
    if not curve.lines:
        where = "none in the range"
    elif len(curve.lines[0][0]) == 1:
        where = ", ".join(f"{line[0][0]:.5g}" for line in curve.lines)
    else:
        where = f"{len(curve.lines)} curve(s)"
    if curve.audit is None:
        return where
    return f"{where}, missed area below {100 * curve.audit.bound:.2g} % ({100 * curve.audit.level:g} % confidence)"
