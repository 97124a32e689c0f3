"""Builds FMUs from `fmu_src`: model.toml and model.c become .fmu files for FMI 2.0 and 3.0.

Nothing is imported before it is asked for.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from build_fmus.arms import arm_fmu, fitted_fmu
    from build_fmus.build import fmu_path
    from build_fmus.errors import BuildError
    from build_fmus.recording import recording_fmu
    from build_fmus.sources import models
    from build_fmus.starting import start_values

__all__ = ["BuildError", "arm_fmu", "fitted_fmu", "fmu_path", "models", "recording_fmu", "start_values"]
_HOME = {
    "BuildError": "errors",
    "arm_fmu": "arms",
    "fitted_fmu": "arms",
    "fmu_path": "build",
    "models": "sources",
    "recording_fmu": "recording",
    "start_values": "starting",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'build_fmus' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"build_fmus.{_HOME[name]}"), name)
