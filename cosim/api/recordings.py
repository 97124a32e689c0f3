"""Measured data: read, identified, and the loop closed with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from attrs import frozen

from cosim.api.card import card
from cosim.closure import effects_file
from cosim.closure.closure import Closure, Options
from cosim.closure.closure import close_loop as closed
from cosim.closure.document import answer, sentence
from cosim.effects import Effect, library
from cosim.identification.document import document, verdict
from cosim.identification.identification import Identification, Parameter, identify_as_paper
from cosim.identification.identification import identify as identified
from cosim.identification.idim import Idim, idim
from cosim.identification.method import adjusted, suggested
from cosim.measured import Recording
from cosim.measured import read as read_files
from cosim.measured.survey import Survey, survey
from cosim.results.saving import save_files, write_json, write_text
from cosim.results.tables import TABLES, ResultTable, table_files

if TYPE_CHECKING:
    from cosim.report.canvas import MplFigure

Files = Recording | str | Path | Iterable[str | Path]
"""A recording that was read, or its files."""


def read(files: str | Path | Iterable[str | Path], description: str | Path | None = None) -> Recording:
    """Recordings as one data set; `warnings` holds every repair and doubt in words.

    description: a TOML file that says what the columns are (default: the one of the same stem beside the data).
    Raises InputError with what is wrong where.
    """
    return read_files(_paths(files), (), description)


def data(files: str | Path | Iterable[str | Path], description: str | Path | None = None) -> DataSurvey:
    """What recordings hold and what is doubtful: columns, guessed units and why, runs, rates, ranges.

    Raises InputError where a file cannot be read at all; a recording that its description does not fit is a result.
    """
    return DataSurvey(survey(_paths(files), None if description is None else Path(description)))


@final
@frozen(eq=False, repr=False)
class DataSurvey:
    """What files hold, and a description of them that `identify` takes."""

    found: Survey

    @property
    def recording(self) -> Recording | None:
        """The recording, None where it cannot be read as described."""
        return self.found.recording

    @property
    def description(self) -> str:
        """The text of a description file; empty where one was given or lies beside the data."""
        return self.found.draft

    def to_dict(self) -> dict[str, Any]:
        """The content of data.json."""
        return self.found.to_dict()

    def save(self, folder: str | Path) -> Path:
        """Write data.json and report.html, and description.toml where none is there yet; returns the folder."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "description.toml"
        files: dict[str, Callable[[Path], object]] = {
            "report.html": self._write_page,
            "data.json": lambda file: write_json(self.to_dict(), file, indent=1),
        }
        if self.description and not path.exists():
            files["description.toml"] = lambda file: write_text(self.description, file)
        save_files(folder, files)
        return folder

    def _write_page(self, path: Path) -> Path:
        from cosim.report.data import data_report
        from cosim.report.html import write_report

        return write_report(data_report(self.found), path)

    def __str__(self) -> str:
        """What `cosim data` prints."""
        return "\n".join(self.found.lines())

    def __repr__(self) -> str:
        return f"<DataSurvey {', '.join(self.found.files)}: {len(self.found.columns)} columns>"

    def _repr_html_(self) -> str:
        rows = {c.name: f"{c.role or '-'} {c.unit} {c.why}" for c in self.found.columns}
        return card("\n".join(self.found.lines()[-3:]), rows)


def _paths(files: str | Path | Iterable[str | Path]) -> list[Path]:
    return [Path(files)] if isinstance(files, (str, Path)) else [Path(file) for file in files]


def _recording(data: Files, test: Files | None, description: str | Path | None) -> Recording:
    """The recording with the files of `test` held out."""
    if isinstance(data, Recording) and test is None:
        return data
    held = () if test is None else test.files if isinstance(test, Recording) else _paths(test)
    if isinstance(data, Recording):
        return read_files(data.files, held, data.description)
    return read_files(_paths(data), held, description)


def identify(
    data: Files,
    test: Files | None = None,
    *,
    description: str | Path | None = None,
    cutoff: float | None = None,
    velocity_cutoff: float | None = None,
    smooth_sign: float | None = None,
    robust: bool = False,
    physical: bool = False,
) -> IdentificationResult:
    """Taati's identification: parameters with honest intervals, torque error on rows that were held out.

    data, test: recordings, or their files; test is held out (default: the split column, else the second half).
    cutoff [Hz]: low-pass over both sides; velocity_cutoff [Hz]: low-pass before differentiation; smooth_sign [rad/s]:
    keep all rows, the sign of dq smoothed over this speed; robust: Huber weights; physical: M > 0 and friction that
    dissipates.
    Raises InputError where the data cannot be identified from.
    """
    recording = _recording(data, test, description)
    method = adjusted(suggested(recording), cutoff, velocity_cutoff, smooth_sign, robust, physical)
    found, paper = identified(recording, method), identify_as_paper(recording)
    return IdentificationResult(found, paper, idim(recording, found.params[: len(paper.params)]))


@final
@frozen(eq=False, repr=False)
class IdentificationResult:
    """An identification beside the paper's own estimator and, where the controller is known, IDIM-LS."""

    found: Identification
    paper: Identification
    reference: Idim | None = None

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the parameters by name."""
        return {str(p.label): p.value for p in self.found.parameters}

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % intervals of the parameters by name."""
        return {str(p.label): (float(p.interval[0]), float(p.interval[1])) for p in self.found.parameters}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Repairs, doubts, and what the data cannot tell."""
        return tuple(self.found.warnings)

    def to_dict(self) -> dict[str, Any]:
        """The content of identification.json."""
        return document(self.found, self.paper, self.reference)

    def plot(self) -> MplFigure:
        """The figure of the report: measured and predicted torque of every joint over time."""
        from cosim.report.canvas import drawn
        from cosim.report.identify import torque_figure

        return drawn(torque_figure(self.found))

    def save(self, folder: str | Path, *, export: Iterable[str] = ()) -> Path:
        """Write report.html and identification.json; returns the folder.

        export: the parameters as a table in further files, "csv" or "parquet".
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        files: dict[str, Callable[[Path], object]] = {"report.html": self._write_page}
        files |= table_files("identification", export, self._table)
        files["identification.json"] = lambda path: write_json(self.to_dict(), path, indent=1)
        save_files(folder, files, ["report.html", *(f"identification.{ending}" for ending in TABLES)])
        return folder

    def _table(self) -> ResultTable:
        names = ("parameter", "value", "low", "high", "std", "std_white", "unit")
        rows = [
            (p["name"], p["value"], *(p["interval"] or (None, None)), p["std"], p["std_white"], p["unit"])
            for p in self.to_dict()["parameters"]
        ]
        return ResultTable.of(names, rows)

    def _write_page(self, path: Path) -> Path:
        from cosim.report.html import write_report
        from cosim.report.identify import page

        return write_report(page(self.found, self.paper, self.reference), path)

    def __str__(self) -> str:
        """What `cosim identify` prints."""
        names = [f"  {p.label!s:14s} {p.value: .6g}  {_interval(p)} {p.unit}" for p in self.found.parameters]
        return "\n".join([verdict(self.found), *names])

    def __repr__(self) -> str:
        return (
            f"<IdentificationResult {', '.join(self.found.recording.joints)}: {len(self.found.parameters)} parameters>"
        )

    def _repr_html_(self) -> str:
        rows = {str(p.label): f"{p.value:.6g}  {_interval(p)} {p.unit}" for p in self.found.parameters}
        return card(verdict(self.found), rows)


def _interval(parameter: Parameter) -> str:
    low, high = parameter.interval
    return f"no interval ({', '.join(parameter.withheld)})" if parameter.withheld else f"[{low: .6g}, {high: .6g}]"


def close_loop(
    data: Files,
    test: Files | None = None,
    *,
    effects: str | Path | None = None,
    description: str | Path | None = None,
    own_effects: Iterable[str | Path] = (),
    replay: bool = True,
    progress: Callable[[str], None] | None = None,
) -> ClosureResult:
    """Residual, missing effect, effect added, error before and after on rows that were held out.

    data, test: recordings, or their files; effects: effects.toml of an earlier pass, from which the search starts;
    own_effects: Python files with effects of your own; replay: whether the FMUs replay the recorded experiment;
    progress: called with what is being done; `print` will do.
    Raises InputError where the files cannot be read. A verdict "refused" says why in `warnings`.
    """
    known: tuple[Effect, ...] = library([Path(file) for file in own_effects])
    recording = _recording(data, test, description)
    previous = effects_file.load(Path(effects), known, recording) if effects is not None else ()
    tell = progress or (lambda text: None)
    return ClosureResult(closed(recording, Options(effects=known, previous=previous, replayed=replay, progress=tell)))


@final
@frozen(eq=False, repr=False)
class ClosureResult:
    """The loop closed with a recording: the verdict, and what it rests on."""

    closure: Closure

    @property
    def verdict(self) -> str:
        """One of "effect_found", "model_complete", "unexplained", "refused"."""
        return self.closure.verdict.answer.value

    @property
    def effects(self) -> list[dict[str, Any]]:
        """The effects as closure.json has them."""
        return self.to_dict()["effects"]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Repairs, doubts, withdrawn names and their reasons."""
        return self.closure.warnings

    def to_dict(self) -> dict[str, Any]:
        """The content of closure.json, but for `fmu`, the names of the FMUs that `save` writes."""
        return answer(self.closure)

    def plot(self) -> MplFigure:
        """The figure of the report: held-out torque error of every joint before and after."""
        from cosim.report.canvas import drawn
        from cosim.report.closure import error_figure

        return drawn(error_figure(self.closure), 150.0)

    def save(self, folder: str | Path, *, export: Iterable[str] = ()) -> ClosureResult:
        """Write closure.json, effects.toml, the FMUs with the effect and report.html.

        export: the parameters of the effects as a table in further files, "csv" or "parquet".
        Returns what was written: an FMU that cannot be built is one more warning.
        """
        from cosim.report.closure import save

        tables = table_files("closure", export, self._table)
        written = ClosureResult(save(self.closure, folder))
        save_files(Path(folder), tables, [f"closure.{ending}" for ending in TABLES])
        return written

    def _table(self) -> ResultTable:
        names = ("effect", "joints", "parameter", "value", "low", "high", "level", "indistinguishable_from")
        rows = []
        for effect in self.effects:
            joints, alike = " ".join(map(str, effect["joints"])), " ".join(effect["indistinguishable_from"])
            for name, value in effect["parameters"].items():
                low, high = effect["interval"].get(name) or (None, None)
                rows.append((effect["name"], joints, name, value, low, high, effect["level"], alike))
        return ResultTable.of(names, rows)

    def __str__(self) -> str:
        """What `cosim close-loop` prints."""
        return sentence(self.closure)

    def __repr__(self) -> str:
        return f"<ClosureResult {self.verdict}: {', '.join(e['name'] for e in self.effects) or 'no effect'}>"

    def _repr_html_(self) -> str:
        return card(str(self), {e["name"]: f"joints {e['joints']}, {e['parameters']}" for e in self.effects})
