"""`cosim data`: what a file holds, and a description of it that `identify` takes as it is."""

import json
import tomllib

import numpy as np
import pytest

import cosim
from cosim.measured import parse_description
from cosim.measured.template import Draft, text
from tests.support.axis_rig import FAULTS, recorded
from tests.support.commands import ended


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """A recording without a description, in degrees and milliseconds, with words beside the numbers."""
    path = tmp_path_factory.mktemp("survey") / "log.csv"
    x = FAULTS["dropout"](recorded(5), 2.0)
    rows = zip(1e3 * x.t, np.rad2deg(x.q), x.tau, strict=True)
    path.write_text("stamp,joint_pos,effort,state\n" + "\n".join(f"{a:.6g},{b:.9g},{c:.6g},run" for a, b, c in rows))
    return path


def test_columns_units_and_doubts_are_told_with_reasons(table):
    found = cosim.data(table).to_dict()
    columns = {column["name"]: column for column in found["columns"]}
    assert {name: c["role"] for name, c in columns.items()} == {
        "stamp": "time",
        "joint_pos": "q",
        "effort": "tau",
        "state": "",
    }
    assert columns["stamp"]["unit"] == "ms" and "500 Hz" in columns["stamp"]["why"]
    assert columns["joint_pos"]["unit"] == "deg" and "turns" in columns["joint_pos"]["why"]
    assert found["runs"][0]["rate"] == pytest.approx(500, rel=1e-6) and found["problems"] == []
    assert "jump" in {doubt["kind"] for doubt in found["doubts"]}


def test_the_description_is_taken_by_identify_and_never_overwritten(table, tmp_path):
    cosim.data(table).save(tmp_path)
    path = tmp_path / "description.toml"
    found = cosim.identify(table, description=path)
    assert found.parameters["inertia"] == pytest.approx(0.8, rel=0.01)
    path.write_text("# mine\n")
    cosim.data(table).save(tmp_path)
    assert path.read_text() == "# mine\n" and json.loads((tmp_path / "data.json").read_text())["runs"]


def rows(*columns):
    return "".join(",".join(map(str, row)) + "\n" for row in zip(*columns, strict=True))


def test_a_name_in_another_language_is_told_by_its_unit_and_a_long_one_by_its_last_word(tmp_path):
    t = [f"{k / 500:.3f}" for k in range(500)]
    values = [f"{(k % 101) / 7:.6f}" for k in range(500)]
    (tmp_path / "a.csv").write_text("X_Value,Stelling [deg],motor_current\n" + rows(t, values, values[::-1]))
    found = cosim.data(tmp_path / "a.csv")
    roles = {column["name"]: (column["role"], column["unit"]) for column in found.to_dict()["columns"]}
    assert roles == {"X_Value": ("time", "s"), "Stelling [deg]": ("q", "deg"), "motor_current": ("tau", "A")}
    assert found.recording is not None and found.recording.description.torque_unit == "A"


def test_columns_beside_those_that_are_described_are_named(tmp_path):
    """Of two robots in one file neither is taken in silence."""
    t = [f"{k / 500:.3f}" for k in range(500)]
    a, b = ([f"{(k % n) / 7:.6f}" for k in range(500)] for n in (101, 97))
    (tmp_path / "a.csv").write_text("t,left.q,right.q,left.tau,right.tau\n" + rows(t, a, b, b, a))
    found = cosim.data(tmp_path / "a.csv")
    assert "not described: right.q look like q as well; described is left.q" in str(found)
    assert len(found.to_dict()["not_described"]) == 2


def test_what_no_column_is_found_for_is_one_problem(tmp_path):
    (tmp_path / "a.csv").write_text("t,u1,tau\n" + "".join(f"{k / 500:.3f},{k % 7},{k % 9}\n" for k in range(500)))
    (problem,) = cosim.data(tmp_path / "a.csv").to_dict()["problems"]
    assert "[columns].q: expected the names of the columns" in problem


def test_a_file_that_its_guesses_do_not_fit_is_told_not_refused(tmp_path):
    (tmp_path / "x.csv").write_text("a,b\n" + "\n".join(f"{k},{k}" for k in range(100)))
    found = cosim.data(tmp_path / "x.csv")
    assert found.recording is None and "the columns" in str(found) and found.to_dict()["problems"]


@pytest.mark.parametrize("servo", [False, True])
def test_every_line_that_is_commented_out_is_a_key_that_descriptions_have(servo):
    """The template with all its comments taken away parses, so that no key in it is misspelt: a servo has no tau."""
    columns = {role: (role,) for role in ("time", "q", "tau", "dq", "ddq", "q_ref", "run", "split", "supply")}
    draft = text(Draft("axis", columns, {"tau": "duty"}, {}, "x.csv"))
    keys = [line.removeprefix("# ") for line in draft.splitlines() if " = " in line or line.startswith(("[", "# ["))]
    of_servo = keys.index(next(line for line in keys if line.startswith("[servo]")))
    end = keys.index(next(line for line in keys if line.startswith("[mounted]")))
    keys = keys if servo else keys[:of_servo] + keys[end:]
    without = ("configuration", "parameters", "What", *(("tau = [",) if servo else ()))
    description = parse_description(
        tomllib.loads("\n".join(line for line in keys if not line.startswith(without))), "template"
    )
    assert description.columns.mass == "mass" and description.supply == 12.0 and description.torque_unit == "N.m"
    assert (description.servo is not None) == servo and description.mounted.temperature == 20.0


def test_the_command_prints_what_comes_next(table, tmp_path, capsys):
    code, said, _ = ended(capsys, "data", table, "--out", tmp_path)
    assert code == 0 and str(cosim.data(table)) in said
    assert f"next: cosim identify {table} --description {tmp_path / 'description.toml'}" in said


def test_the_command_leaves_with_2_where_the_description_does_not_fit(tmp_path, capsys):
    (tmp_path / "x.csv").write_text("a,b\n" + "\n".join(f"{k},{k}" for k in range(100)))
    code, _, err = ended(capsys, "data", tmp_path / "x.csv", "--out", tmp_path)
    assert code == 2 and (tmp_path / "data.json").is_file()
    assert "--description" in err
