"""The Reference FMUs of the Modelica Association, compiled from the sources in tests/data/reference_fmus."""

from pathlib import Path

from build_fmus.compiler import PLATFORMS, this_platform
from tests.support.foreign import library, packed
from tests.support.paths import DATA

SOURCES = DATA / "reference_fmus"


def built(model: str, version: int, folder: Path) -> Path:
    """MODEL.fmu for FMI 2.0 or 3.0, co-simulation, in the folder."""
    home = SOURCES / model
    more = [str(SOURCES / "src/cosimulation.c"), str(home / "model.c"), f"-I{SOURCES / 'include'}", f"-I{home}"]
    more += [f"-DFMI_VERSION={version}", "-DDISABLE_PREFIX", "-DNDEBUG"]
    binary = library(str(SOURCES / f"src/fmi{version}Functions.c"), *more)
    place = PLATFORMS[this_platform()].folder(version) or ""
    description = (home / f"FMI{version}.xml").read_text(encoding="utf-8")
    return packed(folder / f"{model}.fmu", description, binary, place, model)
