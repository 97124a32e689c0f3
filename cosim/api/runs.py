"""Scenarios loaded and run: `load`, `run`, `open_result`, and the result of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from attrs import evolve, field, frozen

from cosim.analysis.twin import judged_run, verdict_signals
from cosim.api.asked import asked
from cosim.api.card import card
from cosim.engine.isolation import runner
from cosim.engine.master import Result
from cosim.engine.outcome import Outcome
from cosim.engine.reference import RunProgress
from cosim.errors import InputError, Problem, RunError
from cosim.fmu import descriptions, open_system
from cosim.opening import named_file, read_json
from cosim.results.files import export_csv, export_mat, read_h5, read_starts, write_h5
from cosim.results.frames import as_dataframe, as_dataset
from cosim.results.saving import save_files, write_json
from cosim.results.summary import Judged, simulated_time, summary
from cosim.scenario import Scenario, draft, load_scenario
from cosim.wiring import Wiring, check, wire
from cosim.wiring.wiring import resolved_starts

if TYPE_CHECKING:
    import pandas
    import xarray

    from cosim.report.canvas import MplFigure

EXPORTS: Mapping[str, Callable[[Result, Path], Path]] = {"csv": export_csv, "mat": export_mat}
"""Further files of a result, by their ending."""


def load(scenario: str | Path, effects: str | Path | None = None, *, allow_outside: bool = False) -> Scenario:
    """A shipped scenario by name, or a TOML or SSP file by path; `effects`: an effects.toml of `close_loop` for it.

    allow_outside: whether an SSP may name files outside its archive or folder.
    Raises InputError with every problem found.
    """
    return load_scenario(scenario, (), None if effects is None else Path(effects), allow_outside)


def loaded(scenario: Scenario | str | Path) -> Scenario:
    """A scenario as it is, or what `load` gives for its name or path."""
    return scenario if isinstance(scenario, Scenario) else load(scenario)


def checked(
    scenario: str | Path,
    overrides: Sequence[str] = (),
    effects: Path | None = None,
    say: Callable[[str], None] = print,
    allow_outside: bool = False,
) -> Wiring:
    """The checked wiring of a scenario with `path=value` overrides; FMUs that are missing are built (`say` tells).

    allow_outside: see `load`. Raises InputError with the problems of the file and those of the wiring together.
    """
    drafted, problems = draft(scenario, overrides, effects, allow_outside)
    wiring: Wiring | None = None
    found: list[Problem] = []
    if drafted is not None:
        try:
            wiring, found = check(drafted, descriptions(drafted, say))
        except InputError as error:
            found = list(error.problems)
        except Exception:  # what is wrong already may make the rest impossible
            if not problems:
                raise
    if problems or wiring is None:
        known = {(p.expected, p.got) for p in problems}
        raise InputError([*problems, *(p for p in found if (p.expected, p.got) not in known)])
    return wiring


def run(
    scenario: Scenario | str | Path,
    *,
    record: Iterable[str] | None = None,
    progress: Callable[[RunProgress], None] | None = None,
) -> RunResult:
    """Run a co-simulation and its twin, whose start is moved slightly, so that the growth of small disturbances shows.

    record: signals to keep, `arm_l.x` or `arm_l.x[1]` (default: all); the verdict is the same whatever is kept.
    progress: called now and then with how far the run is; `print` will do.
    Raises InputError where the scenario does not fit its FMUs, RunError where an FMU cannot be started. A run that
    diverges, or that an FMU ends early, is a result: see `outcome` and `failure`.
    """
    chosen = loaded(scenario)
    names = None if record is None else list(record)
    with open_system(chosen) as system:
        more = [] if names is None else verdict_signals(system.wiring(chosen))
        wanted = None if names is None else list(dict.fromkeys([*names, *more]))
        judged = judged_run(chosen, system, progress, wanted, simulate=runner(chosen))
    if names is not None:
        judged = evolve(judged, result=judged.result.only(names))
    return RunResult(judged.result, summary(judged), resolved_starts(judged.wiring), judged)


def open_result(folder: str | Path) -> RunResult:
    """The result in a folder that `cosim run`, or `save`, has written. Raises InputError where there is none."""
    folder = Path(folder)
    file = folder / "result.h5" if folder.is_dir() else folder
    named_file(file, "a folder with a result.h5 of `cosim run`", advice="run a scenario first")
    beside = file.with_name("summary.json")
    return RunResult(
        read_h5(file), read_json(beside, "the summary of a run") if beside.exists() else {}, read_starts(file)
    )


def _write_page(judged: Judged, path: Path) -> Path:
    from cosim.report.html import write_report
    from cosim.report.run import run_report

    return write_report(run_report(judged), path)


@final
@frozen(eq=False, repr=False)
class RunResult:
    """A co-simulation with what is known of it.

    summary: the content of summary.json; starts: every start value as it was resolved, `arm_l.pi[1]` -> value.
    """

    raw: Result
    summary: dict[str, Any]
    starts: Mapping[str, float | str] = field(factory=dict)
    judged: Judged | None = None

    @property
    def scenario(self) -> Scenario:
        """The scenario that was run."""
        return self.raw.scenario

    @property
    def time(self) -> np.ndarray:
        """Time of the recorded rows, (n,) [s]."""
        return self.raw.time

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the recorded signals, `arm_l.x[1]`."""
        return tuple(self.raw.signals)

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of every recorded signal: `result.units["arm_l.x[1]"]` is "m"."""
        return self.raw.units

    @asked
    def __getitem__(self, name: str) -> np.ndarray:
        """A signal: `arm_l.x[1]` as (n,), `arm_l.x` as (n, 3). Raises InputError for a name that was not recorded."""
        if name in self.raw.signals:
            return self.raw.signals[name]
        return self.raw.vector(name)

    @property
    def outcome(self) -> Outcome:
        """How the run ended; its `advice` says what that means."""
        return self.raw.outcome

    @property
    def growth_rate(self) -> float | None:
        """Growth rate of small disturbances [1/s], negative where they die out; None where there is no verdict."""
        return self.summary.get("growth_rate")

    @property
    def interval(self) -> tuple[float, float] | None:
        """95 % interval of the growth rate [1/s]."""
        found = self.summary.get("growth_rate_interval")
        return None if found is None else (found[0], found[1])

    @property
    def failure(self) -> RunError | None:
        """The error of an FMU that ended the run; None where none did."""
        return self.raw.failure

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the run."""
        return self.raw.interrupted

    def to_dataframe(self) -> pandas.DataFrame:
        """A row a recorded time [s], a column a signal; units in `attrs`. Needs pandas."""
        return as_dataframe(self.raw)

    def to_dataset(self) -> xarray.Dataset:
        """A variable a signal over `time`, vectors along a dimension of their own; units in `attrs`. Needs xarray."""
        return as_dataset(self.raw)

    @asked
    def plot(self, *signals: str) -> MplFigure:
        """Signals over time, `arm_l.x` or `arm_l.x[1]`; without a name the figure of the report: tips of both arms and
        their distance, or else the recorded signals. Raises InputError for names that were not recorded.
        """
        from cosim.report.canvas import drawn
        from cosim.report.run import chosen

        return drawn(chosen(self.raw, signals))

    @asked
    def save_plot(
        self,
        path: str | Path,
        signals: Iterable[str] = (),
        *,
        width: float = 85.0,
        height: float | None = None,
        together: bool = False,
    ) -> Path:
        """Write the figure of `plot` for a paper; the ending of the path says the format; returns the path.

        width, height [mm]; together: all signals in one plot. Raises InputError for names that were not recorded,
        signals of different units in one plot, and endings that are not known.
        """
        from cosim.report.canvas import save_figure
        from cosim.report.run import chosen

        return save_figure(chosen(self.raw, list(signals), together), Path(path), width, height)

    @asked
    def save_movie(self, path: str | Path, *, speed: float = 1.0) -> Path:
        """Write the arms in motion as a movie, `speed` times as fast as they were; returns the path.

        The ending is .gif, or one that ffmpeg knows. Raises InputError where no arm was recorded, or without ffmpeg.
        """
        from cosim.report.canvas import save_movie
        from cosim.report.motion import playback

        wiring = self.judged.wiring if self.judged else wire(self.scenario, descriptions(self.scenario))
        play = playback(self.raw, wiring)
        if play is None:
            wish = "a run that recorded q and x of an arm"
            raise InputError(Problem("--movie", wish, "one without", "see `record` of the scenario"))
        return save_movie(play, Path(path), speed)

    @asked
    def save(self, folder: str | Path, *, export: Iterable[str] = (), report: bool = True) -> Path:
        """Write result.h5, report.html and summary.json, the last when all else is there; returns the folder.

        What an earlier run has left there goes first.

        export: further files, "csv" or "mat". Raises OSError where a file cannot be written; the others are written.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        files: dict[str, Callable[[Path], object]] = {
            "result.h5": lambda path: write_h5(self.raw, path, self.starts),
        }
        for ending in export:
            if ending not in EXPORTS:
                raise InputError(Problem("export", " or ".join(EXPORTS), repr(ending)))
            files[f"result.{ending}"] = lambda path, write=EXPORTS[ending]: write(self.raw, path)
        if report and self.judged is not None:
            files["report.html"] = partial(_write_page, self.judged)
        files["summary.json"] = lambda path: write_json(self.summary, path)
        save_files(folder, files, [f"result.{ending}" for ending in EXPORTS] + ["report.html"])
        return folder

    def __str__(self) -> str:
        """What `cosim run` prints."""
        experiment = self.scenario.experiment
        lines = [f"{self.scenario.name}: {self.outcome.value}: {self.outcome.advice}"]
        if self.raw.message:
            lines.append(f"  {self.raw.message}")
        if self.growth_rate is not None:
            low, high = self.interval or (float("nan"), float("nan"))
            rate = f"{self.growth_rate:+.4g} 1/s  (95 %: {low:+.4g} to {high:+.4g})"
            lines.append(f"  growth of small disturbances  {rate}")
        if tracked := self.summary.get("tracking_rmse"):
            lines.append(f"  tracking, RMS of |x_l - x_r|  {tracked['total'] * 1e3:.4g} mm")
        how = f"steps of {experiment.step * 1e3:g} ms, {experiment.algorithm.value}, {experiment.extrapolation.value}"
        lines.append(
            f"  simulated                     {simulated_time(self.raw):g} s in {self.raw.wall_time:.2f} s, {how}"
        )
        return "\n".join(lines)

    def __repr__(self) -> str:
        size = f"{len(self.time)} rows, {len(self.signals)} signals"
        return f"<RunResult {self.scenario.name}: {self.outcome.value}, {size}>"

    def _repr_html_(self) -> str:
        return card(
            str(self),
            {"rows": len(self.time), "signals": ", ".join(dict.fromkeys(n.partition("[")[0] for n in self.signals))},
        )
