"""Results side by side: runs, sweeps, and files of other tools."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from attrs import evolve, frozen

from cosim.api.card import card
from cosim.api.runs import RunResult, load, open_result, run
from cosim.api.sweeping import SweepTable, sweep
from cosim.errors import InputError, Problem
from cosim.opening import read_toml
from cosim.results.compared import ComparedRun, RunsCompared
from cosim.results.pairs import Tolerance, pair
from cosim.results.saving import save_files, write_json
from cosim.results.traces import Traces, read_traces
from cosim.scenario import Scenario, shipped
from cosim.scenario.ssp_grammar import STRUCTURE
from cosim.sweeps.shift import MapsCompared, StabilityMap, pair_maps, read_map

if TYPE_CHECKING:
    from cosim.report.canvas import MplFigure

Compared = RunResult | SweepTable | Scenario | str | Path
"""A result, a scenario to run, or by name or path: a result folder, a scenario, a sweep, a file of another tool."""


def compare(
    items: Sequence[Compared],
    *,
    tolerance: float | None = None,
    time_tolerance: float | None = None,
    names: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> ComparisonResult:
    """Compare results with the first one: runs and files of other tools signal by signal, sweeps by their maps.

    items: results, or names and paths: a folder of `cosim run` or `cosim sweep`, a scenario or a sweep (carried out
    now), a table of another tool with a time column. tolerance: how far a signal may leave the reference, as a share of
    its range (see `cosim.results.pairs.Tolerance`), or a boundary its place, as a share of the map; time_tolerance [s]:
    half the width of the tube; names: what to call the items. Raises InputError where they cannot be compared.
    """
    if len(items) < 2:
        raise InputError(Problem("compare", "two results or more", str(len(items))))
    for name, value in (("--tolerance", tolerance), ("--time-tolerance", time_tolerance)):
        if value is not None and not 0.0 <= value < float("inf"):
            raise InputError(Problem(name, "zero or a positive number", str(value)))
    kinds = [_kind(item) for item in items]
    if len({kind in _SWEEPS for kind in kinds}) > 1:
        raise InputError(Problem("compare", "runs, or sweeps", "both", "compare them apart"))
    opened = [_opened(item, kind, progress or (lambda text: None)) for item, kind in zip(items, kinds)]
    called = _distinct(list(names) if names else [_label(item, found) for item, found in zip(items, opened)])
    if len(called) != len(opened):
        raise InputError(Problem("names", f"{len(opened)}, one an item", str(len(called))))
    maps = [_map(name, found) for name, found in zip(called, opened) if isinstance(found, (SweepTable, StabilityMap))]
    if maps:
        pairs = tuple(pair_maps(maps[0], other) for other in maps[1:])
        return ComparisonResult(MapsCompared(tuple(maps), pairs, tolerance))
    runs = [_run(name, found) for name, found in zip(called, opened)]
    asked = None if tolerance is None else Tolerance(tolerance, time_tolerance)
    found = tuple(pair(runs[0].traces, other.traces, asked) for other in runs[1:])
    return ComparisonResult(RunsCompared(tuple(runs), found, asked))


# --- what is compared -------------------------------------------------------------------------------------------------


class ComparedKind(Enum):
    """What an item is, before anything is opened or carried out."""

    RUN = "a run that was carried out"
    TABLE = "a sweep that was carried out"
    RUN_FOLDER = "the folder of a run, or its result.h5"
    SWEEP_FOLDER = "the folder of a sweep, or its sweep.h5"
    SCENARIO = "a scenario"
    SWEEP = "a sweep"
    TRACES = "a table of another tool"


_SWEEPS = (ComparedKind.TABLE, ComparedKind.SWEEP_FOLDER, ComparedKind.SWEEP)


def _kind(item: Compared) -> ComparedKind:
    """What an item is; nothing is carried out."""
    if isinstance(item, (RunResult, SweepTable, Scenario)):
        kinds = {RunResult: ComparedKind.RUN, SweepTable: ComparedKind.TABLE, Scenario: ComparedKind.SCENARIO}
        return kinds[type(item)]
    path = Path(item)
    if (path / "sweep.h5").is_file() or (path.name == "sweep.h5" and path.is_file()):
        return ComparedKind.SWEEP_FOLDER
    if (path.is_dir() and not (path / STRUCTURE).is_file()) or (path.suffix == ".h5" and path.is_file()):
        return ComparedKind.RUN_FOLDER
    if _is_sweep(path, str(item)):
        return ComparedKind.SWEEP
    if path.suffix in (".toml", ".ssp", ".ssd") or not path.is_file():
        return ComparedKind.SCENARIO
    return ComparedKind.TRACES


def _opened(
    item: Compared, kind: ComparedKind, say: Callable[[str], None]
) -> RunResult | SweepTable | StabilityMap | Traces:
    """An item as a result: opened, read, or carried out now."""
    if isinstance(item, (RunResult, SweepTable)):
        return item
    if isinstance(item, Scenario):
        return run(item)
    path = Path(item)
    match kind:
        case ComparedKind.SWEEP_FOLDER:
            return read_map(path if path.is_dir() else path.parent)
        case ComparedKind.RUN_FOLDER:
            return open_result(path)
        case ComparedKind.SWEEP:
            say(f"carrying out the sweep {item}")
            return sweep(item)
        case ComparedKind.SCENARIO:
            scenario = load(item)
            say(f"running {scenario.name}")
            return run(scenario)
        case _:
            return read_traces(path)


def _is_sweep(path: Path, name: str) -> bool:
    if path.suffix == ".toml" and path.is_file():
        try:
            return "axes" in read_toml(path)
        except InputError:
            return False
    return not path.exists() and name in {entry.stem for entry in shipped("sweeps")}


def _label(item: Compared, found: object) -> str:
    if isinstance(item, RunResult):
        return item.scenario.name
    if isinstance(item, SweepTable):
        return item.campaign.sweep.name
    if isinstance(item, Scenario):
        return item.name
    path = Path(item)
    return (
        path.resolve().name if path.is_dir() else path.parent.name if path.suffix == ".h5" else path.stem or str(item)
    )


def _distinct(names: list[str]) -> list[str]:
    return [
        name if names.count(name) == 1 else f"{name} ({names[: k + 1].count(name)})" for k, name in enumerate(names)
    ]


def _map(name: str, found: SweepTable | StabilityMap) -> StabilityMap:
    return StabilityMap(name, found.summary, found.columns)


def _run(name: str, found: RunResult | SweepTable | StabilityMap | Traces) -> ComparedRun:
    if isinstance(found, Traces):
        return ComparedRun(evolve(found, name=name))
    assert isinstance(found, RunResult)  # sweeps were told apart before
    return ComparedRun(Traces.of(name, found.raw), found.summary, found.starts)


# --- the result -------------------------------------------------------------------------------------------------------


@final
@frozen(eq=False, repr=False)
class ComparisonResult:
    """Runs or sweeps against the first of them."""

    found: RunsCompared | MapsCompared

    @property
    def agrees(self) -> bool | None:
        """Whether all keep to the tolerance; None where none was asked for."""
        return self.found.agrees

    def to_dict(self) -> dict[str, Any]:
        """The content of compare.json."""
        return self.found.to_dict()

    def plot(self) -> MplFigure:
        """The vector that differs most, of all runs; or the boundaries of all maps."""
        from cosim.report.canvas import drawn
        from cosim.report.compare import overview

        return drawn(overview(self.found))

    def save(self, folder: str | Path) -> Path:
        """Write report.html and compare.json; returns the folder."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        files: dict[str, Callable[[Path], object]] = {
            "report.html": self._write_page,
            "compare.json": lambda path: write_json(self.to_dict(), path),
        }
        save_files(folder, files)
        return folder

    def _write_page(self, path: Path) -> Path:
        from cosim.report.compare import comparison_report
        from cosim.report.html import write_report

        return write_report(comparison_report(self.found), path)

    def __str__(self) -> str:
        """What `cosim compare` prints."""
        return str(self.found)

    def __repr__(self) -> str:
        return f"<ComparisonResult: {len(self.found.pairs)} against {self.found.pairs[0].reference.name}>"

    def _repr_html_(self) -> str:
        return card(str(self), {})
