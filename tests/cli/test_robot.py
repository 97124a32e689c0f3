"""`cosim robot` and `cosim.robot`: what they find, write and refuse, and a co-simulation with the FMU that comes
out.
"""

import json

import numpy as np
import pytest

import cosim
from cosim.arm.serial_dynamics import forward_dynamics
from tests.arm.test_urdf import FAULTS, GOOD, JOINTS, LINKS, link, robot
from tests.support.commands import ended
from tests.support.probe import Importer
from tests.support.robots import apart

SCENARIO = """
connections = []
[experiment]
stop = 0.05
step = 1e-3
[components.arm]
fmu = "{fmu}"
parameters = {{ q_start = [0.3, -0.2], gravity = [0.0, 0.0, -1.62] }}
"""


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / "two.urdf"
    path.write_text(GOOD)
    return path


def test_it_writes_an_fmu_that_holds_the_arm(urdf, tmp_path, capsys):
    code, out, err = ended(capsys, "robot", urdf, "--out", tmp_path / "out")
    assert code == 0, err
    assert "2 moving joints (2 revolute) from base to b" in out and "two.fmu" in out
    found = json.loads((tmp_path / "out" / "robot.json").read_text())
    assert [joint["name"] for joint in found["joints"]] == ["j1", "j2"]
    assert found["tip"] == "b" and found["joints"][1]["mass"] == 1 and found["joints"][0]["upper"] == 1
    assert 0.05 < found["mass_matrix"]["diagonal_low"][0] < found["mass_matrix"]["diagonal_high"][0] < 0.2
    page = (tmp_path / "out" / "report.html").read_text()
    assert "j1" in page and 'id="figure-1"' in page

    fmu = Importer(tmp_path / "out" / "two.fmu", {"tau[1]": 0.7, "tau[2]": -0.3, "q_start[1]": 0.4})
    model = cosim.robot(urdf).model
    expected = forward_dynamics(model, np.array([0.4, 0.0]), np.zeros(2), np.array([0.7, -0.3]))
    assert apart(np.array([fmu.get("ddq[1]"), fmu.get("ddq[2]")]), expected) < 1e-13


def test_its_fmu_runs_in_a_scenario(urdf, tmp_path):
    fmu = cosim.robot(urdf).save(tmp_path / "out", fmi=2)
    path = tmp_path / "drop.toml"
    path.write_text(SCENARIO.format(fmu=fmu))
    result = cosim.run(path, record=["arm.q", "arm.x"])
    assert result["arm.q"].shape[1] == 2 and (result["arm.q"][-1] != [0.3, -0.2]).all()
    # on the moon the outer end falls by g t^2 / 2 times 3/2 or so: a rod about its end
    assert 0.5 < (result["arm.x"][0, 2] - result["arm.x"][-1, 2]) / (0.5 * 1.62 * 0.05**2) < 2.5


def test_tip_base_and_doubts(urdf, tmp_path, capsys):
    urdf.write_text(robot(*LINKS, link("c", ""), *JOINTS).replace("</robot>", "") + _fixed_tool() + "</robot>")
    code, out, err = ended(capsys, "robot", urdf, "--base", "a", "--tip", "c", "--out", tmp_path / "out", "--fmi", 2)
    assert code == 0, err
    assert "1 moving joint (1 revolute) from a to c; the tip is named" in out
    data = json.loads((tmp_path / "out" / "robot.json").read_text())
    assert data["fmi"] == 2 and data["tip_found"] == "named"


def _fixed_tool() -> str:
    return '<joint name="tool" type="fixed"><parent link="b"/><child link="c"/></joint>'


@pytest.mark.parametrize("kind", ["xacro", "two arms", "negative mass"])
def test_bad_input_ends_with_2_and_writes_nothing(kind, tmp_path, capsys):
    path = tmp_path / "r.urdf"
    path.write_text(FAULTS[kind][0])
    code, out, err = ended(capsys, "robot", path, "--out", tmp_path / "out")
    assert code == 2 and not out and FAULTS[kind][1][0] in err and not (tmp_path / "out").exists()


def test_unknown_versions_and_platforms_are_bad_input(urdf, tmp_path, capsys):
    for words in (("--fmi", "4"), ("--platform", "amiga")):
        code, _, err = ended(capsys, "robot", urdf, "--out", tmp_path / "out", *words)
        assert code == 2 and words[1] in err
