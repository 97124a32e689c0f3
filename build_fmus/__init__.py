"""Builds FMUs from `fmu_src`: model.toml and model.c become .fmu files for FMI 2.0 and 3.0."""

from build_fmus.arms import arm_fmu, fitted_fmu
from build_fmus.build import fmu_path
from build_fmus.errors import BuildError
from build_fmus.recording import recording_fmu
from build_fmus.sources import models
from build_fmus.starting import start_values

__all__ = ["BuildError", "arm_fmu", "fitted_fmu", "fmu_path", "models", "recording_fmu", "start_values"]
