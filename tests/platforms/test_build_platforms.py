"""The same bits on other platforms: the binaries inside one FMU, run natively, under Wine and under QEMU.

A command of its own: pytest -m platforms. Debian: apt install wine64 qemu-user libc6-arm64-cross.
"""

import subprocess
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from fmpy import read_model_description

from build_fmus import fmu_path
from build_fmus.compiler import PLATFORMS, find_compiler, this_platform
from tests.support.needs import ARM_LIBRARIES, wine
from tests.support.paths import SUPPORT

pytestmark = [pytest.mark.slow, pytest.mark.platforms]
HEADERS = Path(find_spec("fmpy").origin).parent / "c-code"

# a life with friction, hysteresis, encoders, an elastic joint, random delays: everything that computes
STARTS = {
    "PhantomArm": {
        "coulomb": 0.01,
        "viscous": 1e-3,
        "stribeck": 0.01,
        "hysteresis": 0.005,
        "q_start": [0.1, 0.3, 0.4],
        "ripple_sin": 0.002,
        "gravity_compensation": 1,
        "encoder_resolution": 1e-4,
    },
    "SerialArm": {"coulomb": 0.01, "stribeck": 0.01, "ripple_sin": 0.002, "q_start": [0.1, 0.3, 0.4, *[0.0] * 9]},
    "VariableDelayChannel": {"law": "random_walk", "delay_min": 0.0, "delay_max": 0.05},
    "AxisDrive": {"coulomb": 0.01, "stribeck": 0.01, "hysteresis": 0.005},
    "Operator": {"amplitude": 0.3, "frequency": 3.0, "hand_mass": 1.0, "grip_stiffness": 100.0, "hand_stiffness": 10.0},
    "Excitation": {"amplitude": 0.1, "frequency": 3.3, "phase": 0.7, "ramp": 1.0},
}


def driver(platform: str, folder: Path) -> Path:
    compiler, chosen = find_compiler(), PLATFORMS[platform]
    program = folder / f"play-{platform}{'.exe' if 'windows' in platform else ''}"
    command = [
        *compiler.command,
        "-target",
        chosen.target,
        "-std=c99",
        "-O1",
        f"-I{HEADERS}",
        str(SUPPORT / "play.c"),
        "-o",
        str(program),
        *(["-ldl"] if "linux" in platform else []),
    ]
    subprocess.run(command, check=True, capture_output=True)
    return program


def play(model: str, platform: str, folder: Path, runner: list[str]) -> dict[str, str]:
    """{variable: bits} after 2000 steps with the library of that platform."""
    fmu = fmu_path(model, 3, [this_platform(), "aarch64-linux", "x86_64-windows"], start=STARTS.get(model))
    description = read_model_description(str(fmu))
    name = f"binaries/{platform}/{model}{PLATFORMS[platform].suffix}"
    library = Path(zipfile.ZipFile(fmu).extract(name, folder))
    reals = {
        v.name: v.valueReference
        for v in description.modelVariables
        if v.type == "Float64" and v.causality != "independent"
    }
    inputs = [
        str(v.valueReference)
        for v in description.modelVariables
        if v.causality == "input" and v.type == "Float64" and not v.name.startswith("der(") and v.min is None
    ]
    done = subprocess.run(
        [
            *runner,
            str(driver(platform, folder)),
            str(library),
            description.guid,
            "2000",
            ",".join(inputs) or "-",
            ",".join(map(str, reals.values())),
        ],
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode == 0, done.stderr[-1000:]
    found = dict(line.split() for line in done.stdout.splitlines())
    return {name: found[str(reference)] for name, reference in reals.items()}


@pytest.mark.needs("qemu")
@pytest.mark.parametrize("model", STARTS)
def test_arm_linux(model, tmp_path):
    here = play(model, this_platform(), tmp_path, [])
    assert play(model, "aarch64-linux", tmp_path, ["qemu-aarch64", "-L", str(ARM_LIBRARIES)]) == here


@pytest.mark.needs("wine")
@pytest.mark.parametrize("model", STARTS)
def test_windows(model, tmp_path):
    here = play(model, this_platform(), tmp_path, [])
    assert play(model, "x86_64-windows", tmp_path, [wine()]) == here
