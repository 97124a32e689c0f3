"""The C sources of a model as one flat folder: model, shared glue, FMI headers, generated table."""

import importlib.util
from pathlib import Path

from build_fmus.errors import BuildError

HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}


def source_root() -> Path:
    """The folder fmu_src, in a checkout beside this package and in a wheel likewise."""
    root = Path(__file__).resolve().parent.parent / "fmu_src"
    if not root.is_dir():
        raise BuildError(f"{root} is missing: the C sources of the FMUs are not installed")
    return root


def models() -> list[str]:
    """Names of the models: the folders of fmu_src with a table."""
    return sorted(path.parent.name for path in source_root().glob("*/model.toml"))


def model_files(model: str, fmi: int) -> dict[str, bytes]:
    """{file name: contents} of what a model compiles from, less the generated table."""
    root = source_root()
    other = f"fmi{5 - fmi}.c"
    paths = [p for p in sorted((root / "shared").iterdir()) if p.suffix in (".c", ".h") and p.name != other]
    paths += [p for p in sorted((root / model).iterdir()) if p.suffix in (".c", ".h")]
    paths += [_headers() / name for name in HEADERS[fmi]]
    names = [p.name for p in paths]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise BuildError(f"{model}: two source files share a name: {', '.join(twice)}")
    return {p.name: p.read_bytes() for p in paths}


def _headers() -> Path:
    spec = importlib.util.find_spec("fmpy")
    folder = Path(spec.origin).parent / "c-code" if spec and spec.origin else Path()
    if not (folder / "fmi3Functions.h").is_file():
        raise BuildError("the FMI headers are missing: they come with the Python package fmpy (pip install fmpy)")
    return folder


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
