"""The C code under the address and undefined-behaviour sanitizers, called in any order with any values."""

import shutil
import subprocess
from pathlib import Path

import pytest

from build_fmus import models
from build_fmus.build import BuildJob, source_files
from build_fmus.sources import model_table
from tests.support.paths import SUPPORT

pytestmark = pytest.mark.needs("gcc")
FLAGS = [
    "-std=c99",
    "-g",
    "-O1",
    "-ffp-contract=off",
    "-fsanitize=address,undefined,float-cast-overflow",
    "-fno-sanitize-recover=all",
]


def fuzz(model: str, version: int, folder: Path, seeds: int, rounds: int) -> None:
    table = model_table(model)
    for name, data in source_files(BuildJob(table, version, ())).items():
        (folder / name).write_bytes(data)
    shutil.copy(SUPPORT / "fuzz.c", folder)
    define = [f"-DFUZZ_FMI{version}"]
    subprocess.run(["gcc", *FLAGS, *define, "fuzz.c", "-lm", "-o", "fuzz"], cwd=folder, check=True)
    for seed in range(seeds):
        done = subprocess.run(["./fuzz", str(seed), str(rounds)], cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, f"{model}, FMI {version}, seed {seed}:\n{done.stderr[-3000:]}"
        calls, accepted = (int(word) for word in done.stdout.replace(",", "").split() if word.isdigit())
        assert calls > rounds / 3 and accepted > calls / 20  # the walk gets somewhere


@pytest.mark.parametrize("version", [2, 3])
def test_any_order_of_calls(version, tmp_path):
    """The short version, on a continuous model with every kind of variable but few of them."""
    fuzz("Operator", version, tmp_path, seeds=2, rounds=20_000)


@pytest.mark.slow
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("model", models())
def test_any_order_of_calls_of_every_model(model, version, tmp_path):
    fuzz(model, version, tmp_path, seeds=5, rounds=200_000)
