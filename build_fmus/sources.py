"""The C sources of a model as one flat folder: model, shared glue, FMI headers, generated table."""

import importlib.util
import os
import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from build_fmus.cache import key_of, remembered
from build_fmus.errors import BadRequestError, BuildError, SourceError
from build_fmus.homes import is_path, source_root
from build_fmus.table import ModelTable, load_table, suggestion

GENERATED = "model_table.h"
INCLUDE = re.compile(rb'^[ \t]*#[ \t]*include[ \t]+"([^"]+)"', re.MULTILINE)


def models() -> list[str]:
    """Names of the models: the folders of fmu_src with a table."""
    return sorted(folder.name for folder in source_root().iterdir() if (folder / "model.toml").is_file())


def is_model(name: str) -> bool:
    """Whether one of ours has this name."""
    root = source_root()
    return any(folder.name == name for folder in root.iterdir()) and (root / name / "model.toml").is_file()


def home_of(model: str) -> Path:
    """The folder of a model: one of ours by its name, any by its path. Raises BadRequestError where there is none."""
    if not is_path(model):
        if not is_model(model):
            raise BadRequestError(f"no model {model!r}{suggestion(model, models())}; there are {', '.join(models())}")
        return source_root() / model
    if not (Path(model) / "model.toml").is_file():
        raise BadRequestError(f"{model}: no folder of a model (model.toml, model.c); `cosim new controller` writes one")
    return Path(model).resolve()


def model_table(model: str) -> ModelTable:
    """The variable table of a model; read again where a table of the sources has changed. Raises BuildError."""
    path = home_of(model) / "model.toml"
    read = (path, *source_root().glob("shared/*.toml"))
    return _table(path, tuple(p.stat().st_mtime_ns for p in read if p.is_file()))


@lru_cache(maxsize=32)
def _table(path: Path, changed: tuple[int, ...]) -> ModelTable:
    """As read before by any process, as long as no table beside it or in the shared folder has changed."""
    shared = source_root() / "shared"
    files = [path, *sorted(path.parent.glob("*.toml")), *sorted(shared.glob("*.toml"))]
    try:
        read = key_of(*(x for file in files if file.is_file() for x in (file.name, file.read_bytes())))
    except OSError:
        return load_table(path, shared)  # which says what cannot be read
    return remembered("tables", read, lambda: load_table(path, shared))


def model_files(home: Path, fmi: int, extra: Mapping[str, bytes] | None = None) -> dict[str, bytes]:
    """{file name: contents} of what a model compiles from: fmi2.c or fmi3.c and all its includes, in one flat folder.

    home: the folder of the model; `extra` stands in for files of it. The generated table is left out. Raises
    SourceError for an include that is not found or two files of one name.
    """
    root = source_root()
    folders = [home, root / "shared", _headers()]
    found: dict[str, Path] = {}
    files: dict[str, bytes] = {}
    waiting = [(root / "shared", f"fmi{fmi}.c")]
    while waiting:
        folder, wanted = waiting.pop()
        name = Path(wanted).name
        if name == GENERATED:
            continue
        if extra and name in extra:
            waiting += [(home, match.decode()) for match in INCLUDE.findall(extra[name]) if name not in files]
            files[name] = INCLUDE.sub(_flat, extra[name])
            continue
        path = _resolve(wanted, [folder, *folders])
        if found.setdefault(name, path) != path and not found[name].samefile(path):
            raise SourceError(f"{home.name}: two source files share a name: {found[name]} and {path}")
        if name not in files:
            files[name], included = _flattened(path, path.stat().st_mtime_ns)
            waiting += [(path.parent, one) for one in included]
    return files


@lru_cache(maxsize=256)
def _flattened(path: Path, changed: int) -> tuple[bytes, tuple[str, ...]]:
    """A source file with includes without folders, and what it includes; most models share most files."""
    data = path.read_bytes()
    return INCLUDE.sub(_flat, data), tuple(match.decode() for match in INCLUDE.findall(data))


def _resolve(wanted: str, folders: list[Path]) -> Path:
    for folder in folders:
        path = Path(os.path.normpath(folder / wanted))
        if path.is_file():
            return path
    raise SourceError(f"{folders[0]}: the included file {wanted} is not there")


def _flat(match: re.Match[bytes]) -> bytes:
    """The same include without folders."""
    return match[0].replace(match[1], match[1].rsplit(b"/", 1)[-1])


def _headers() -> Path:
    spec = importlib.util.find_spec("fmpy")
    folder = Path(spec.origin).parent / "c-code" if spec and spec.origin else Path()
    if not (folder / "fmi3Functions.h").is_file():
        raise BuildError("the FMI headers are missing: they come with the Python package fmpy (pip install fmpy)")
    return folder


def readme_of(home: Path) -> str:
    """README.md of a model: its equations. Raises SourceError where it is missing."""
    path = home / "README.md"
    if not path.is_file():
        raise SourceError(f"{path} is missing: the equations of the model belong into its FMU")
    return path.read_text(encoding="utf-8")


def licence() -> bytes:
    """The licence of this project, from the checkout or from the installed package."""
    beside = Path(__file__).resolve().parent.parent / "LICENSE"
    if beside.is_file():
        return beside.read_bytes()
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        text = distribution("haptic-cosim").read_text("licenses/LICENSE")
    except PackageNotFoundError:
        text = None
    return (text or "MIT License, Copyright (c) 2026 The haptic-cosim authors\n").encode()
