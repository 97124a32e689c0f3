"""A copy of an FMU with other start values, in the XML and in the binary."""

import zipfile
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from build_fmus.arms import cut_like
from build_fmus.build import BuildJob, build, check_platforms, source_files, token_of
from build_fmus.cache import store
from build_fmus.compiler import PLATFORMS
from build_fmus.errors import BuildError
from build_fmus.sources import model_table, models
from build_fmus.table import ModelTable, StartValue, override


def start_values(fmu: Path, values: Mapping[str, StartValue], out: Path) -> Path:
    """Write to `out` the FMU with other start values: by scalar ("coulomb[2]") or row ("coulomb": list or one number).

    The values are compiled in too, since an importer that relies on defaults does not set them. The FMU must therefore
    be one of ours, built from the present sources. Start values that it had of its own are kept. Raises BuildError.
    """
    description, platforms = _read(Path(fmu))
    version = 2 if description.get("fmiVersion", "").startswith("2") else 3
    name = description.get("modelName", "")
    if name not in models() or name == "Recording":
        raise BuildError(f"{fmu}: {name!r} is no model with start values of this package")
    names = {found for variable in description.iter() if (found := variable.get("name"))}
    table = cut_like(model_table(name), names)
    present = override(table, _present_values(description, version, table))
    token = token_of(source_files(BuildJob(present, version, ())))
    if token != description.get("guid", description.get("instantiationToken")):
        raise BuildError(
            f"{fmu} was built from other sources than the present ones; build it again with build-fmus {name}"
        )
    job = BuildJob(override(present, values), version, check_platforms(platforms))
    store(Path(out), build(job).read_bytes())
    return Path(out)


def _read(fmu: Path) -> tuple[ElementTree.Element, list[str]]:
    """Root of modelDescription.xml, and the platforms of the binaries."""
    try:
        with zipfile.ZipFile(fmu) as archive:
            root = ElementTree.fromstring(archive.read("modelDescription.xml"))
            folders = {name.split("/")[1] for name in archive.namelist() if name.startswith("binaries/")}
    except (OSError, KeyError, zipfile.BadZipFile, ElementTree.ParseError) as error:
        raise BuildError(f"{fmu} is no FMU: {error}") from error
    return root, [p.name for p in PLATFORMS.values() if {p.name, p.fmi2} & folders]


def _present_values(root: ElementTree.Element, version: int, table: ModelTable) -> dict[str, float]:
    """{scalar name: start value} of what can be set, as in the XML."""
    settable = {s.name for s in table.of("input", "parameter", "tunable")}
    found = {}
    for variable in root.iterfind("ModelVariables/*"):
        name, start = variable.get("name", ""), (variable[0] if version == 2 else variable).get("start")
        if name in settable and start is not None:
            found[name] = _number(start)
    return found


def _number(text: str) -> float:
    return {"true": 1.0, "false": 0.0}[text] if text in ("true", "false") else float(text)
