"""FMUs of models: ours, and the user's own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from cosim.errors import InputError, Problem, RunError


def build(
    models: str | Path | Iterable[str | Path],
    folder: str | Path | None = None,
    *,
    fmi: int | None = None,
    platforms: Iterable[str] = (),
    progress: Callable[[str], None] | None = None,
) -> tuple[Path, ...]:
    """Build models: names of ours, folders with a model.toml (`./MyController`), Python files with a class for
    pythonfmu.

    folder: for fmi2/NAME.fmu and fmi3/NAME.fmu (default: they stay in the cache); fmi: 2 or 3 (default: both);
    platforms: FMI 3 names (default: this machine). Returns the files. Raises InputError for a model that is not there
    or has a mistake, with file and line, RunError where nothing can be built.
    """
    from build_fmus.errors import BadRequestError, BuildError
    from build_fmus.several import built

    named = [models] if isinstance(models, (str, Path)) else list(models)
    versions, out = [fmi] if fmi else [2, 3], None if folder is None else Path(folder)
    try:
        return tuple(built([_text(m) for m in named], versions, list(platforms), out, progress))
    except BadRequestError as error:
        raise InputError([Problem("model", "one that can be built", text) for text in error.problems]) from None
    except BuildError as error:
        raise RunError("build", None, str(error)) from None


def _text(model: str | Path) -> str:
    """A path as the builder takes it: `Path("MyController")` is a folder here, never one of our models."""
    return str(model) if isinstance(model, str) else str(model.absolute())
