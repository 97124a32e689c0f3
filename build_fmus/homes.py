"""Where the sources of models are, and what FMUs built of them say of that."""

from functools import cache, lru_cache
from pathlib import Path

from build_fmus.errors import BuildError

GENERATOR = "haptic-cosim build-fmus"
"""The tool that our FMUs name."""


@cache
def source_root() -> Path:
    """The folder fmu_src, in a checkout beside this package and in a wheel likewise."""
    root = Path(__file__).resolve().parent.parent / "fmu_src"
    if not root.is_dir():
        raise BuildError(f"{root} is missing: the C sources of the FMUs are not installed")
    return root


@lru_cache(maxsize=256)
def is_path(model: str) -> bool:
    """Whether a model is named by its folder or Python file, `./MyController`, and not as one of ours."""
    return "/" in model or "\\" in model or model in (".", "..") or model.endswith(".py")
