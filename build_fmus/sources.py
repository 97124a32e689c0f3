"""The C sources of a model as one flat folder: model, shared glue, FMI headers, generated table."""

import importlib.util
import re
from collections.abc import Mapping
from pathlib import Path

from build_fmus.errors import BuildError
from build_fmus.table import ModelTable, load_table

GENERATED = "model_table.h"
INCLUDE = re.compile(rb'^[ \t]*#[ \t]*include[ \t]+"([^"]+)"', re.MULTILINE)


def source_root() -> Path:
    """The folder fmu_src, in a checkout beside this package and in a wheel likewise."""
    root = Path(__file__).resolve().parent.parent / "fmu_src"
    if not root.is_dir():
        raise BuildError(f"{root} is missing: the C sources of the FMUs are not installed")
    return root


def models() -> list[str]:
    """Names of the models: the folders of fmu_src with a table."""
    return sorted(path.parent.name for path in source_root().glob("*/model.toml"))


def model_table(model: str) -> ModelTable:
    """The variable table of one of our models."""
    return load_table(source_root() / model / "model.toml")


def model_files(model: str, fmi: int, extra: Mapping[str, bytes] | None = None) -> dict[str, bytes]:
    """{file name: contents} of what a model compiles from: fmi2.c or fmi3.c and all its includes, in one flat folder.

    `extra` stands in for files of the model's folder. The generated table is left out. Raises BuildError for an
    include that is not found or two files of one name.
    """
    root = source_root()
    folders = [root / model, root / "shared", _headers()]
    found: dict[str, Path] = {}
    files: dict[str, bytes] = {}
    waiting = [(root / "shared", f"fmi{fmi}.c")]
    while waiting:
        folder, wanted = waiting.pop()
        name = Path(wanted).name
        if name == GENERATED:
            continue
        if extra and name in extra:
            waiting += [(root / model, match.decode()) for match in INCLUDE.findall(extra[name]) if name not in files]
            files[name] = INCLUDE.sub(_flat, extra[name])
            continue
        path = _resolve(wanted, [folder, *folders])
        if found.setdefault(name, path) != path:
            raise BuildError(f"{model}: two source files share a name: {found[name]} and {path}")
        if name not in files:
            data = path.read_bytes()
            files[name] = INCLUDE.sub(_flat, data)
            waiting += [(path.parent, match.decode()) for match in INCLUDE.findall(data)]
    return files


def _resolve(wanted: str, folders: list[Path]) -> Path:
    for folder in folders:
        if (folder / wanted).is_file():
            return (folder / wanted).resolve()
    raise BuildError(f"{folders[0]}: the included file {wanted} is not there")


def _flat(match: re.Match[bytes]) -> bytes:
    """The same include without folders."""
    return match[0].replace(match[1], match[1].rsplit(b"/", 1)[-1])


def _headers() -> Path:
    spec = importlib.util.find_spec("fmpy")
    folder = Path(spec.origin).parent / "c-code" if spec and spec.origin else Path()
    if not (folder / "fmi3Functions.h").is_file():
        raise BuildError("the FMI headers are missing: they come with the Python package fmpy (pip install fmpy)")
    return folder


def readme_of(model: str) -> str:
    """README.md of the model: its equations. Raises BuildError where it is missing."""
    path = source_root() / model / "README.md"
    if not path.is_file():
        raise BuildError(f"{path} is missing: the equations of the model belong into its FMU")
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
