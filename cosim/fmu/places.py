"""Where FMU files are: models and recordings built where they are missing, archives extracted once."""

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cosim.errors import InputError, Problem, RunError, did_you_mean
from cosim.scenario import Component, Scenario, joints_of

if TYPE_CHECKING:
    from build_fmus.build import BuildJob

Progress = Callable[[str], None]


def fmu_file(component: Component, scenario: Scenario, progress: Progress | None = None) -> Path:
    """The .fmu file of a component; models and recordings are built where they are missing.

    Raises InputError for a model or file that is not there and for a mistake in a model of the user's own, RunError
    where it cannot be built.
    """
    from build_fmus.errors import BuildError

    try:
        if component.fmu is not None:
            return (scenario.folder / component.fmu).resolve()
        if component.recording is not None:
            from build_fmus.build import build

            return build(recording_job(component, scenario, progress), progress)
        if component.own:
            return own_model(component.model_path(scenario.folder), scenario.experiment.fmi, progress)
        return _model(component.model or "", joints_of(component), scenario.experiment.fmi, progress)
    except BuildError as error:
        raise RunError(component.kind, None, f"cannot be built: {error}") from None


_BUILT: dict[tuple[str, int | None, int], Path] = {}  # files of models found or built by this process


_OWN: dict[tuple[str, int], tuple[object, Path | InputError]] = {}
"""Models of the user's own: state of the sources, and the FMU that was made of them or what is wrong with them."""


def own_model(path: Path, fmi: int, progress: Progress | None = None) -> Path:
    """The FMU of a folder or Python file of the user's own, built again where a file in it has changed.

    Raises InputError for a mistake in them, BuildError where nothing can be built.
    """
    from build_fmus.build import fmu_path
    from build_fmus.errors import BadRequestError

    state = tuple(sorted((str(file), *stamp(file)) for file in ([path] if path.is_file() else path.glob("*"))))
    known = _OWN.get((str(path), fmi))
    if known is None or known[0] != state or (isinstance(known[1], Path) and not known[1].is_file()):
        try:
            known = state, fmu_path(str(path), fmi, progress=progress)
        except BadRequestError as error:
            known = state, InputError(Problem("model", "one that can be built", f"this: {error}"))
        _OWN[str(path), fmi] = known
    if isinstance(known[1], InputError):
        raise known[1]
    return known[1]


def _model(model: str, joints: int | None, fmi: int, progress: Progress | None) -> Path:
    path = _BUILT.get((model, joints, fmi))
    if path is None or not path.is_file():
        path = _BUILT[model, joints, fmi] = _built(model, joints, fmi, progress)
    return path


def _built(model: str, joints: int | None, fmi: int, progress: Progress | None) -> Path:
    from build_fmus.unchanged import unchanged_file

    return unchanged_file(f"{model} {joints} {fmi}", lambda: _fitted(model, joints, fmi, progress))


def _fitted(model: str, joints: int | None, fmi: int, progress: Progress | None) -> Path:
    from build_fmus.arms import fitted_fmu
    from build_fmus.sources import is_model, models

    if not is_model(model):
        near = did_you_mean(model, models()) or "a model of your own goes by its path, ./NAME"
        raise InputError(Problem("model", "one of " + ", ".join(models()), repr(model), near))
    return fitted_fmu(model, joints, fmi, progress=progress)


def recording_job(component: Component, scenario: Scenario, progress: Progress | None = None) -> "BuildJob":
    """How to build the Recording of a component: columns of its file over the time column as outputs y[1], y[2], ...

    Raises InputError, BuildError.
    """
    from build_fmus.recording import recording_job as job

    table = played(component, scenario.folder / (component.recording or ""), scenario, progress)
    columns = {f"y[{i + 1}]": table[:, i + 1] * component.scale for i in range(len(component.columns))}
    units = dict.fromkeys(columns, component.unit or "1")
    return job(table[:, 0], columns, units, component.interpolation.value, scenario.experiment.fmi)


def played(component: Component, path: Path, scenario: Scenario, progress: Progress | None = None) -> np.ndarray:
    """Time of the run [s] and columns of a recording, (rows, 1 + columns), moved by `offset` and repeated where that is
    wished. Raises InputError where recording and run have no time in common.
    """
    table = read_columns(path, component.time, component.columns, progress).copy()
    table[:, 0] += component.offset
    stop, first, last = scenario.experiment.stop, float(table[0, 0]), float(table[-1, 0])
    if component.repeat and len(table) > 1:
        return _repeated(table, stop)
    if first > stop or last < 0.0:
        got, begin = f"stamps from {first:.10g} to {last:.10g} s", component.offset - first
        raise InputError(
            Problem(str(path), f"stamps within the run, 0 to {stop:g} s", got, f"offset = {begin:.10g} begins it at 0")
        )
    return table


def _repeated(table: np.ndarray, stop: float) -> np.ndarray:
    """The table again and again until the stop time, a typical step between its last row and its first."""
    period = table[-1, 0] - table[0, 0] + float(np.median(np.diff(table[:, 0])))
    begin = table[0, 0] - period * math.ceil(max(table[0, 0], 0.0) / period)
    times = max(1, math.ceil((stop - begin) / period))
    found = np.tile(table, (times, 1))
    found[:, 0] += begin - table[0, 0] + np.repeat(np.arange(times) * period, len(table))
    return found


def recording_warnings(component: Component, scenario: Scenario) -> tuple[str, ...]:
    """What the user should know of a recording that does not fill the run."""
    if component.recording is None or component.repeat:
        return ()
    table = played(component, scenario.folder / component.recording, scenario)
    first, last, stop = float(table[0, 0]), float(table[-1, 0]), scenario.experiment.stop
    step = float(np.median(np.diff(table[:, 0]))) if len(table) > 1 else 0.0
    found = []
    if first > step:
        found.append(f"the recording begins at {first:.6g} s; its first values stand before")
    if last < stop - step:
        found.append(f"the recording ends at {last:.6g} s of {stop:g} s; its last values stay (or repeat = true)")
    return tuple(found)


def read_columns(path: Path, time: str, names: Sequence[str], progress: Progress | None = None) -> np.ndarray:
    """Time [s] and columns of a measured file of any kind, as (rows, 1 + columns). Raises InputError."""
    table, notes = _read_columns(str(path), stamp(path) if path.is_file() else (0, 0), time, tuple(names))
    if progress is not None:
        for note in notes:
            progress(note)
    return table


@lru_cache(maxsize=8)
def _read_columns(
    path: str, _: tuple[int, int], time: str, names: tuple[str, ...]
) -> tuple[np.ndarray, tuple[str, ...]]:
    from cosim.measured.reader import signals  # most scenarios play no recording

    notes: list[str] = []
    stamps, values = signals(Path(path), time, names, notes.append)
    return np.column_stack([stamps, values]), tuple(notes)


def extracted(path: Path) -> Path:
    """Folder with the contents of an FMU, extracted once per content (absolute, kept in the cache)."""
    from build_fmus.cache import cache_folder
    from build_fmus.errors import BuildError
    from build_fmus.unpacking import unpack

    folder = cache_folder() / "extracted" / digest(str(path), *stamp(path))[:24]
    if not folder.is_dir():
        try:
            unpack(path, folder)
        except (OSError, BuildError) as error:
            raise RunError(path.name, None, f"cannot be extracted: {error}") from None
    return folder.resolve()


def stamp(path: Path) -> tuple[int, int]:
    """Time of the last change and size of a file."""
    state = path.stat()
    return state.st_mtime_ns, state.st_size


@lru_cache(maxsize=256)
def digest(path: str, modified: int, size: int) -> str:
    """SHA-256 of a file; read once for each change of it."""
    return sha256(Path(path).read_bytes()).hexdigest()
