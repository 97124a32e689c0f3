"""Where FMU files are: models and recordings built where they are missing, archives extracted once."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import numpy as np

from cosim.errors import InputError, Problem, RunError, did_you_mean
from cosim.measured.reader import signals
from cosim.scenario import Component, Scenario

Progress = Callable[[str], None]


def fmu_file(component: Component, scenario: Scenario, progress: Progress | None = None) -> Path:
    """The .fmu file of a component; models and recordings are built where they are missing.

    Raises InputError for a model or file that is not there, RunError where it cannot be built.
    """
    from build_fmus.errors import BuildError

    try:
        if component.fmu is not None:
            return (scenario.folder / component.fmu).resolve()
        if component.recording is not None:
            return _recording(component, scenario.folder / component.recording, scenario, progress)
        return _model(component.model or "", scenario.experiment.fmi, progress)
    except BuildError as error:
        raise RunError(component.kind, None, f"cannot be built: {error}") from None


_BUILT: dict[tuple[str, int], Path] = {}  # files of models found or built by this process


def _model(model: str, fmi: int, progress: Progress | None) -> Path:
    path = _BUILT.get((model, fmi))
    if path is None or not path.is_file():
        path = _BUILT[model, fmi] = _built(model, fmi, progress)
    return path


def _built(model: str, fmi: int, progress: Progress | None) -> Path:
    from build_fmus.build import fmu_path
    from build_fmus.sources import models

    if model not in models():
        raise InputError(Problem("model", "one of " + ", ".join(models()), repr(model), did_you_mean(model, models())))
    return fmu_path(model, fmi, progress=progress)


def _recording(component: Component, path: Path, scenario: Scenario, progress: Progress | None) -> Path:
    """A Recording FMU that plays columns of a measured file over its time column as outputs y[1], y[2], ..."""
    from build_fmus import recording_fmu

    table = read_columns(path, component.time, component.columns, progress)
    columns = {f"y[{i + 1}]": table[:, i + 1] * component.scale for i in range(len(component.columns))}
    units = dict.fromkeys(columns, component.unit or "1")
    return recording_fmu(
        table[:, 0], columns, units, component.interpolation.value, scenario.experiment.fmi, progress=progress
    )


def read_columns(path: Path, time: str, names: Sequence[str], progress: Progress | None = None) -> np.ndarray:
    """Time [s] and columns of a measured file of any kind, as (rows, 1 + columns). Raises InputError."""
    stamps, values = signals(path, time, names, progress or (lambda _: None))
    return np.column_stack([stamps, values])


def extracted(path: Path) -> Path:
    """Folder with the contents of an FMU, extracted once per content (absolute, kept in the cache)."""
    from build_fmus.cache import cache_folder
    from build_fmus.unpacking import UnpackError, unpack

    folder = cache_folder() / "extracted" / digest(str(path), *stamp(path))[:24]
    if not folder.is_dir():
        try:
            unpack(path, folder)
        except (OSError, UnpackError) as error:
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
