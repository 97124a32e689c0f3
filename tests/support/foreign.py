"""FMUs as others make them, compiled from C or exported from Python for a test."""

import os
import subprocess
import sys
import zipfile
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from xml.sax.saxutils import quoteattr

import fmpy

from build_fmus.compiler import PLATFORMS, find_compiler, this_platform

_HERE = Path(__file__).parent
_HEADERS = Path(fmpy.__file__).parent / "c-code"


@cache
def library(source: str, *flags: str) -> bytes:
    """The shared library of a C source beside this file."""
    platform, compiler = PLATFORMS[this_platform()], find_compiler()
    target = ("-target", platform.target) if compiler.cross else ()
    file = Path(mkdtemp()) / f"m{platform.suffix}"
    command = [*compiler.command, *target, "-shared", "-fPIC", "-O1", "-ffp-contract=off", *flags, f"-I{_HEADERS}"]
    subprocess.run([*command, str(_HERE / source), "-o", str(file)], check=True, capture_output=True)
    return file.read_bytes()


def packed(path: Path, description: str, binary: bytes | None, folder: str, identifier: str = "m") -> Path:
    """An FMU of a model description and a binary for one platform (None: no binary) under its model identifier."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        if binary is not None:
            archive.writestr(f"binaries/{folder}/{identifier}{PLATFORMS[this_platform()].suffix}", binary)
    return path


def attributes(**values: object) -> str:
    return "".join(f" {key}={quoteattr(str(value))}" for key, value in values.items() if value is not None)


UNITS = (
    '<UnitDefinitions><Unit name="m"><BaseUnit m="1"/></Unit><Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>'
    '<Unit name="Pa"><BaseUnit kg="1" m="-1" s="-2"/></Unit><Unit name="K"><BaseUnit K="1"/></Unit>'
    '<Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit></UnitDefinitions>'
)
X = ("x", 0, "output", "Real", {"unit": "m"})
U = ("u", 1, "input", "Real", {"start": 1, "unit": "m"})


def fmi2(
    path: Path,
    variables: Sequence[tuple[str, int, str, str, Mapping[str, object]]] = (X, U),
    mode: int = 0,
    bare: bool = False,
    types: str = "",
    experiment: str = "",
    units: str = "",
    **capabilities: object,
) -> Path:
    """An FMU of foreign_two.c. variables: (name, reference, causality, type, attributes of its type)."""
    entries = ""
    for n, r, c, t, more in variables:
        shared = attributes(name=n, valueReference=r, causality=c, variability=_variability(c, t))
        entries += f"<ScalarVariable{shared}><{t}{attributes(**more)}/></ScalarVariable>"
    outputs = "".join(f'<Unknown index="{k}"/>' for k, v in enumerate(variables, 1) if v[2] == "output")
    unit_definitions = f"<UnitDefinitions>{units}</UnitDefinitions>" if units else UNITS
    description = (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" modelName={quoteattr(path.stem)} '
        f'guid="g"><CoSimulation modelIdentifier="m"{attributes(**capabilities)}/>{unit_definitions}{types}{experiment}'
        f"<ModelVariables>{entries}</ModelVariables><ModelStructure><Outputs>{outputs}</Outputs></ModelStructure>"
        "</fmiModelDescription>"
    )
    flags = [f"-DMODE={mode}", *(["-DBARE"] if bare else [])]
    return packed(path, description, library("foreign_two.c", *flags), PLATFORMS[this_platform()].fmi2 or "")


def _variability(causality: str, kind: str) -> str:
    return "fixed" if causality == "parameter" else "continuous" if kind == "Real" else "discrete"


ARRAYS = (
    '<Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>'
    '<UInt64 name="n" valueReference="9" causality="structuralParameter" variability="fixed" start="3"/>'
    '<Float64 name="A" valueReference="1" causality="parameter" variability="fixed" start="1 0 0 0 1 0 0 0 1">'
    '<Dimension valueReference="9"/><Dimension valueReference="9"/></Float64>'
    '<Float64 name="u" valueReference="2" causality="input" start="0"><Dimension valueReference="9"/></Float64>'
    '<Float64 name="y" valueReference="3" causality="output"><Dimension valueReference="9"/></Float64>'
    '<UInt8 name="small" valueReference="7" causality="input" start="0"/><UInt8 name="small_seen" valueReference="8" '
    'causality="output"/><Int64 name="large" valueReference="10" causality="parameter" variability="fixed" start="1"/>'
    '<Int64 name="large_seen" valueReference="11" causality="output"/>'
    '<Float64 name="told" valueReference="12" causality="output"/>'
)


def fmi3(path: Path, variables: str = ARRAYS, outputs: Sequence[int] = (3, 8, 11, 12), experiment: str = "") -> Path:
    """An FMU of foreign_three.c. outputs: references of the variables that are outputs."""
    listed = "".join(f'<Output valueReference="{reference}"/>' for reference in outputs)
    description = (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="3.0" modelName="{path.stem}" '
        'instantiationToken="t"><CoSimulation modelIdentifier="m" canHandleVariableCommunicationStepSize="true"/>'
        f"{experiment}<ModelVariables>{variables}</ModelVariables><ModelStructure>{listed}</ModelStructure>"
        "</fmiModelDescription>"
    )
    return packed(path, description, library("foreign_three.c"), this_platform())


def from_python(exporter: str, source: str, folder: Path) -> Path:
    """An FMU that `pythonfmu` or `pythonfmu3` makes of a Python class; the file is named after the class."""
    file = folder / f"{exporter}_{folder.name}.py"  # a module's name is known once to an interpreter
    file.write_text(source, encoding="utf-8")
    command = [sys.executable, "-m", exporter, "build", "-f", str(file), "-d", str(folder)]
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, "PYTHONWARNINGS": "ignore"})
    return next(folder.glob("*.fmu"))
