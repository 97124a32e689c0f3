"""The Windows binary under Wine and the aarch64 one under QEMU give the bits of x86_64 Linux.

Own command: pytest -m platforms. Debian: apt install wine64 qemu-user libc6-arm64-cross.
"""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import pytest

from build_fmus import fmu_path
from build_fmus.compiler import PLATFORMS
from tests.support.needs import ARM_LIBRARIES, wine
from tests.support.paths import SUPPORT

pytestmark = [pytest.mark.slow, pytest.mark.platforms]

RUNNER = SUPPORT / "platform_runner.c"
HEADERS = Path(fmpy.__file__).parent / "c-code"


def zig(target: str, *arguments: str) -> None:
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        target,
        "-O1",
        "-ffp-contract=off",
        f"-I{HEADERS}",
        *arguments,
    ]
    subprocess.run(command, check=True)


def outputs(tmp_path: Path, name: str, model: str, start: dict[str, float], wanted: list[str]) -> str:
    """Hexadecimal outputs of the model's binary for a platform."""
    platform = PLATFORMS[name]
    fmu = fmu_path(model, 3, [name])
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path / name)
    library = tmp_path / name / "binaries" / name / f"{model}{platform.suffix}"
    runner = tmp_path / (f"runner-{name}" + (".exe" if "windows" in name else ""))
    zig(platform.target, str(RUNNER), "-o", str(runner), *([] if "windows" in name else ["-ldl"]))
    description = fmpy.read_model_description(fmu)
    reference = {v.name: v.valueReference for v in description.modelVariables}
    words = [*(f"{reference[k]}:{v}" for k, v in start.items()), "/", *(str(reference[w]) for w in wanted)]
    command = {
        "x86_64-linux": [],
        "x86_64-windows": [wine()],
        "aarch64-linux": ["qemu-aarch64", "-L", str(ARM_LIBRARIES)],
    }[name]
    environment = os.environ | {"WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all"}
    done = subprocess.run(
        [*command, str(runner), str(library), description.guid, *words],
        capture_output=True,
        text=True,
        env=environment,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.replace("\r", "")


MODELS = [
    (
        "PhantomArm",
        {
            "q_start[2]": 0.3,
            "dq_start[1]": 1.0,
            "dq_start[3]": -0.7,
            "stribeck[1]": 0.01,
            "stribeck_velocity[1]": 0.2,
            "hysteresis[2]": 0.01,
            "hysteresis_length[2]": 0.01,
            "ripple_sin[3]": 0.01,
            "ripple_order[3]": 7.0,
        },
        ["q[1]", "q[2]", "q[3]", "dq[1]", "dq[2]", "dq[3]", "x[1]"],
    ),
    ("Operator", {"amplitude[1]": 0.5, "frequency": 1.3}, ["f[1]"]),
]


@pytest.mark.parametrize(("model", "start", "wanted"), MODELS, ids=[m[0] for m in MODELS])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("x86_64-windows", marks=pytest.mark.needs("wine")),
        pytest.param("aarch64-linux", marks=pytest.mark.needs("qemu")),
    ],
)
def test_platforms_give_the_same_bits(tmp_path, name, model, start, wanted):
    here = outputs(tmp_path, "x86_64-linux", model, start, wanted)
    assert len(set(here.split())) > 15  # something moves
    assert outputs(tmp_path, name, model, start, wanted) == here
