"""The exported system in Maestro, the co-simulation master of the INTO-CPS association: `pytest -m slow` only."""

import csv
import json
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

import cosim
from tests.support.needs import lacking, require

MAESTRO, COMMONS_IO = "3.1.1", "2.18.0"
PROJECT = f"""<project xmlns="http://maven.apache.org/POM/4.0.0"><modelVersion>4.0.0</modelVersion>
<groupId>a</groupId><artifactId>a</artifactId><version>1</version><dependencies>
<dependency><groupId>commons-io</groupId><artifactId>commons-io</artifactId><version>{COMMONS_IO}</version></dependency>
<dependency><groupId>org.into-cps.maestro</groupId><artifactId>maestro</artifactId><version>{MAESTRO}</version>
</dependency></dependencies></project>"""
ARMS = ("arm_l", "arm_r")
STOP = 2.0  # s
SAME = 1e-12  # rad; sums of another order differ by 1e-15


@pytest.fixture
def maestro(tmp_path):
    """A function that simulates a multi-model, with the path of its table. Maestro asks for a commons-io that is too
    old for it.
    """
    require("maestro")
    (tmp_path / "pom.xml").write_text(PROJECT)
    got = subprocess.run(
        ["mvn", "-q", "-B", "dependency:build-classpath", "-Dmdep.outputFile=classpath"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    if got.returncode:
        lacking("maestro", got.stdout[-200:])

    def simulated(multi_model: dict) -> Path:
        (tmp_path / "mm.json").write_text(json.dumps(multi_model))
        words = ["java", "-cp", (tmp_path / "classpath").read_text(), "org.intocps.maestro.Main", "import"]
        words += ["-output", "out", "--interpret", "sg1", "mm.json"]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (tmp_path / "out/outputs.csv").is_file(), done.stdout[-2000:] + done.stderr[-2000:]
        return tmp_path / "out/outputs.csv"

    return simulated


def multi_model(folder: Path, stop: float) -> dict:
    """What Maestro reads, of the structure of an unpacked SSP. Instances need names of their own."""
    structure = etree.parse(folder / "SystemStructure.ssd").getroot()
    space = {"ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription"}
    names = [element.get("name") for element in structure.iterfind(".//ssd:Component", space)]
    wires: dict[str, list[str]] = {}
    for wire in structure.iterfind(".//ssd:Connection", space):
        start, end = (
            f"{{{wire.get(f'{side}Element')}}}.{wire.get(f'{side}Element')}.{wire.get(f'{side}Connector')}"
            for side in ("start", "end")
        )
        wires.setdefault(start, []).append(end)
    return {
        "fmus": {f"{{{name}}}": (folder / f"resources/{name}.fmu").as_uri() for name in names},
        "connections": wires,
        "parameters": {},
        "algorithm": {"type": "fixed-step", "size": 0.001},
        "startTime": 0.0,
        "endTime": stop,
        "logVariables": {f"{{{name}}}.{name}": [f"q[{i}]" for i in (1, 2, 3)] for name in ARMS},
    }


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_system_is_the_same_in_maestro(maestro, tmp_path):
    """Both step every FMU with the values of the last communication point: only the order of sums may differ."""
    scenario = cosim.load("sallam-stable").with_values(
        {
            "experiment.stop": STOP,
            "experiment.record_every": 1,
            "experiment.algorithm": "jacobi",
            "experiment.extrapolation": "hold",
        }
    )
    cosim.export(scenario, tmp_path / "e", enumerations=False)
    zipfile.ZipFile(tmp_path / "e/sallam-stable.ssp").extractall(tmp_path / "system")
    with maestro(multi_model(tmp_path / "system", STOP)).open() as file:
        rows = list(csv.DictReader(file))
    result = cosim.run(scenario)
    for name in ARMS:
        theirs = np.array([[float(row[f"{{{name}}}.{name}.q[{i}]"]) for i in (1, 2, 3)] for row in rows])
        ours = result[f"{name}.q"]
        assert np.ptp(ours, axis=0).min() > 1e8 * SAME
        assert len(theirs) >= 1000 * STOP  # the last step may be missing: Maestro adds its times up
        np.testing.assert_allclose(theirs[: len(ours)], ours[: len(theirs)], rtol=0.0, atol=SAME)
