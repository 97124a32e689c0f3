"""FMUs that misbehave, compiled from tests/support/hostile.c, and a scenario of two of them."""

import re
import zipfile
from functools import cache
from pathlib import Path

from build_fmus.cache import cache_folder, key_of
from build_fmus.compiler import PLATFORMS, compile_library, find_compiler, this_platform
from build_fmus.scratch import workspace
from tests.support.paths import SUPPORT

WAYS = re.search(r"enum \{(.*?)\}", (SUPPORT / "hostile.c").read_text(), re.DOTALL)[1].replace(",", " ").split()
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="hostile" guid="{hostile}">
<CoSimulation modelIdentifier="hostile" canHandleVariableCommunicationStepSize="true"/>
<ModelVariables>
<ScalarVariable name="u" valueReference="0" causality="input" variability="continuous"><Real start="0"/>
</ScalarVariable>
<ScalarVariable name="y" valueReference="1" causality="output" variability="continuous"><Real/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="2"/></Outputs></ModelStructure>
</fmiModelDescription>
"""


@cache
def library(way: str) -> bytes:
    """The shared library that misbehaves in that way; compiled once per content."""
    compiler, chosen, source = find_compiler(), PLATFORMS[this_platform()], (SUPPORT / "hostile.c").read_bytes()
    kept = cache_folder() / "test-libraries" / f"{key_of(source, compiler.identity, way)[:24]}{chosen.suffix}"
    if not kept.is_file():
        kept.parent.mkdir(parents=True, exist_ok=True)
        with workspace() as work:
            (work / "hostile.c").write_bytes(source)
            made, flags = work / "made", ("-std=gnu99", "-Wno-pedantic", f"-DWAY={WAYS.index(way)}", "-lm")
            compile_library(compiler, chosen, work, "hostile.c", made, cache_folder(), flags)
            kept.write_bytes(made.read_bytes())
    return kept.read_bytes()


def fmu(way: str, path: Path) -> Path:
    """Write the FMU."""
    chosen = PLATFORMS[this_platform()]
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION)
        archive.writestr(f"binaries/{chosen.fmi2 or 'linux64'}/hostile{chosen.suffix}", library(way))
    return path


def scenario(way: str, folder: Path, stop: float = 0.2, beside: str = "HONEST") -> Path:
    """Write `s.toml`, in which `evil` misbehaves behind `good`; 200 steps of a millisecond."""
    fmu(beside, folder / "good.fmu")
    fmu(way, folder / "evil.fmu")
    path = folder / "s.toml"
    path.write_text(f"""
        connections = ["good.y -> evil.u"]
        [experiment]
        stop = {stop}
        step = 0.001
        algorithm = "jacobi"
        extrapolation = "hold"
        [components.good]
        fmu = "good.fmu"
        [components.evil]
        fmu = "evil.fmu"
    """)
    return path
