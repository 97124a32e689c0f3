"""`compare`: runs, sweeps and files of other tools side by side."""

import json
from pathlib import Path

import numpy as np
import pytest

import cosim
from cosim.errors import InputError
from cosim.sweeps.shift import StabilityMap, pair_maps
from tests.support.commands import told

BRIEF = {"experiment.stop": 0.5}


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> Path:
    """Three results of one loop: as it is, again, and stiffer; without pages."""
    home = tmp_path_factory.mktemp("results")
    scenario = cosim.load("sallam-nodelay").with_values(BRIEF)
    for name, values in (("plain", {}), ("again", {}), ("stiff", {"controller_*.stiffness": 0.3})):
        cosim.run(scenario.with_values(values)).save(home / name, export=["csv"], report=False)
    return home


# --- runs -------------------------------------------------------------------------------------------------------------


def test_a_run_again_has_the_same_bits(folders, capsys, tmp_path):
    status, text = told(
        capsys, "compare", folders / "plain", folders / "again", "--tolerance", 0, "--out", tmp_path / "c"
    )
    assert status == 0 and "the same to the last bit" in text
    found = json.loads((tmp_path / "c" / "compare.json").read_text())
    assert found["agrees"] is True and found["pairs"][0]["same_bits"] is True and found["given"] == []
    assert "plain" in (tmp_path / "c" / "report.html").read_text()


def test_what_was_given_and_what_came_of_it(folders, tmp_path):
    found = cosim.compare([folders / "plain", folders / "stiff"])
    document = found.to_dict()
    assert {row["what"]: row["values"] for row in document["given"]} == {
        f"controller_{side}.stiffness[{k}]": [0.25, 0.3] for side in "lr" for k in (1, 2, 3)
    }
    first, other = (cosim.open_result(folders / name) for name in ("plain", "stiff"))
    apart = np.abs(first["arm_l.x[1]"] - other["arm_l.x[1]"])
    signal = document["pairs"][0]["signals"]["arm_l.x[1]"]
    assert signal["max_difference"] == apart.max() and signal["at"] == first.time[apart.argmax()]
    assert signal["rms_difference"] == pytest.approx(np.sqrt(np.mean(apart**2)), rel=1e-12)
    assert found.agrees is None and found.plot().axes
    page = (found.save(tmp_path / "c") / "report.html").read_text()
    assert "stiff against plain" in page and "controller_l.stiffness[1]" in page


def test_the_tolerance_at_its_edge_and_the_exit_code(folders, capsys, tmp_path):
    """The greatest share of a range is the tolerance that just suffices."""
    pair = cosim.compare([folders / "plain", folders / "stiff"]).found.pairs[0]
    edge = max(s.share for s in pair.signals)
    words = ("compare", folders / "plain", folders / "stiff", "--out", tmp_path / "c", "--tolerance")
    assert told(capsys, *words, edge * (1 + 1e-12))[0] == 0
    status, text = told(capsys, *words, edge * (1 - 1e-9))
    assert status == 1 and "1 of" in text and pair.worst.match.name in text
    assert told(capsys, *words, -1)[0] == 2


def test_outcomes_that_differ_are_a_difference(folders):
    first, other = (cosim.open_result(folders / name) for name in ("plain", "again"))
    other.summary["outcome"] = "growing"
    found = cosim.compare([first, other], tolerance=0.0)
    assert found.agrees is False and "it ends otherwise: growing" in str(found)


def test_a_table_of_another_tool(folders, tmp_path):
    """Other names, other units, other samples, another order: what is common is found, what is converted is told."""
    first = cosim.open_result(folders / "plain")
    rows = slice(None, None, 3)
    x = first["arm_l.x"][rows] * 1e3
    table = np.column_stack([first.time[rows], x[:, 2], x[:, 0], first["arm_r.x[2]"][rows]])
    header = "time,model.root.arm_l.x[3] [mm],model.root.arm_l.x[1] [mm],model.root.arm_r.x[2]"
    np.savetxt(tmp_path / "theirs.csv", table, delimiter=",", header=header, comments="", fmt="%.17g")
    found = cosim.compare([first, tmp_path / "theirs.csv"], tolerance=1e-12)
    document = found.to_dict()["pairs"][0]
    assert found.agrees and set(document["signals"]) == {"arm_l.x[1]", "arm_l.x[3]", "arm_r.x[2]"}
    assert document["signals"]["arm_l.x[1]"]["called"] == "model.root.arm_l.x[1]"
    assert "converted from mm to m" in " ".join(document["notes"]) and "only in sallam-nodelay" in " ".join(
        document["notes"]
    )
    table[20, 2] += 1.0
    np.savetxt(tmp_path / "theirs.csv", table, delimiter=",", header=header, comments="", fmt="%.17g")
    assert cosim.compare([first, tmp_path / "theirs.csv"], tolerance=1e-12).agrees is False


def test_our_own_csv_comes_back(folders):
    found = cosim.compare([folders / "plain", folders / "plain" / "result.csv"], tolerance=0.0)
    pair = found.found.pairs[0]
    assert found.agrees and pair.same and len(pair.signals) == len(cosim.open_result(folders / "plain").signals)


def test_scenarios_are_run(capsys, folders, tmp_path):
    spec = tmp_path / "mine.toml"
    spec.write_text(text_of(folders))
    status, text = told(capsys, "compare", spec, folders / "plain", "--tolerance", 0, "--out", tmp_path / "c")
    assert status == 0 and "running mine" in text


def text_of(folders: Path) -> str:
    from cosim.scenario import to_toml

    scenario = cosim.open_result(folders / "plain").scenario
    return to_toml(scenario).replace('name = "sallam-nodelay"', 'name = "mine"')


@pytest.mark.parametrize(
    ("items", "message"),
    [
        (["plain"], "two results or more"),
        (["plain", "nothing-of-that-name"], "a shipped scenario"),
        (["plain", "wrong.csv"], "signals of plain"),
        (["plain", "."], "result.h5"),
    ],
)
def test_bad_input_is_one_clear_error(folders, items, message):
    (folders / "wrong.csv").write_text("time,a,b\n0,1,2\n1,2,3\n2,3,4\n")
    paths = [folders / item if (folders / item).exists() else item for item in items]
    with pytest.raises(InputError, match=message):
        cosim.compare(paths)


def test_what_is_refused_leaves_no_folder_and_what_was_there_stays(folders, capsys, tmp_path):
    for out in (tmp_path / "new" / "deep", tmp_path / "there"):
        (tmp_path / "there").mkdir(exist_ok=True)
        status, _ = told(capsys, "compare", folders / "plain", "nothing-of-that-name", "--out", out)
        assert status == 2
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


def test_the_headline_names_a_signal_that_moves(folders):
    """A channel's constant delay is an output too; it differs by all of its range, the tips by what is of interest."""
    scenario = cosim.load("sallam-nodelay").with_values({**BRIEF, "channel_*.delay_mean": 0.1})
    items = [cosim.load("sallam-nodelay").with_values(BRIEF), scenario]
    found = cosim.compare(items)
    pair = found.found.pairs[0]
    still = [s for s in pair.signals if not s.moves and s.share > pair.worst.share]
    assert "channel_lr.delay_now" in [s.match.name for s in still] and pair.worst.moves
    assert pair.worst.match.name in str(found) and "delay_now" not in str(found).splitlines()[1]
    judged = str(cosim.compare(items, tolerance=0.01)).splitlines()[1]
    assert "first of those that vary" in judged and "delay_now" not in judged


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "[" * 5000, "{}", '{"sweep": 3}', '{"sweep": {"axes": []}}', '{"sweep": {"axes": [{}]}}']
)
@pytest.mark.parametrize("name", ["sweep.h5", "result.h5"])
def test_a_damaged_summary_is_bad_input(folders, tmp_path, name, text):
    """That of a run may lack any key: it is told beside the signals only."""
    (tmp_path / name).write_bytes((folders / "plain/result.h5").read_bytes())
    (tmp_path / "summary.json").write_text(text)
    if name == "result.h5" and text.startswith("{") and text != "{":
        assert cosim.open_result(tmp_path).summary.get("sweep") in (None, 3, {"axes": []}, {"axes": [{}]})
        return
    with pytest.raises(InputError, match="summary.json: expected the summary of a"):
        cosim.compare([tmp_path, tmp_path])


# --- sweeps -----------------------------------------------------------------------------------------------------------


def made(name: str, line, outcome=lambda x, y, edge: "growing" if y > edge(x) else "converged", y="y") -> StabilityMap:
    """A map over x in [0, 2] and y in [1, 3] whose boundary is y = line(x)."""
    x = np.linspace(0.0, 2.0, 41)
    axes = [
        {"name": "x", "unit": "N/m", "low": 0.0, "high": 2.0, "scale": "linear", "entries": [0.0, 2.0]},
        {"name": y, "unit": "s", "low": 1.0, "high": 3.0, "scale": "linear", "entries": [1.0, 3.0]},
    ]
    grid = [(a, b) for a in (0.0, 1.0, 2.0) for b in (1.25, 1.75, 2.25, 2.75)]
    columns = {"x": [a for a, _ in grid], y: [b for _, b in grid], "outcome": [outcome(a, b, line) for a, b in grid]}
    summary = {
        "sweep": {"name": name, "axes": axes, "trace": ["x", "y"], "set": {}, "scenario": "s"},
        "boundary": [[[float(a), float(line(a))] for a in x]],
        "boundary_labels": [""],
        "boundary_axes": ["x", y],
        "points": len(grid),
    }
    return StabilityMap(name, summary, columns)


def test_a_boundary_that_moved_up_by_a_tenth():
    found = pair_maps(made("a", lambda x: 1.5 + 0.5 * x), made("b", lambda x: 1.6 + 0.5 * x))
    (shift,) = found.shifts
    document = shift.to_dict()
    assert document["mean_shift"] == pytest.approx(0.1, abs=1e-12) and document["greatest_shift"] == pytest.approx(
        0.1, abs=1e-12
    )
    assert shift.alone == 0.0
    # as shares of the axes both lines have slope 1/2: the vertical 0.05 is that times the end points' own distance
    assert shift.distance == pytest.approx(0.05, abs=1e-12)
    assert found.agrees(0.05 + 1e-12) and not found.agrees(0.05 - 1e-12)


def test_equal_points_that_flip_are_counted():
    found = pair_maps(made("a", lambda x: 1.5), made("b", lambda x: 2.0))
    assert found.points == 12 and found.flipped == 3  # y = 1.75 at three x
    assert dict(found.changes) == {
        ("converged", "converged"): 3,
        ("growing", "converged"): 3,
        ("growing", "growing"): 6,
    }


def test_a_boundary_in_one_map_only():
    bare = made("b", lambda x: 2.0)
    bare.summary["boundary"].clear()
    bare.summary["boundary_labels"].clear()
    (shift,) = pair_maps(made("a", lambda x: 1.5), bare).shifts
    assert shift.distance == np.inf and shift.alone > 0.99 and shift.to_dict()["distance"] is None
    with pytest.raises(InputError, match="a sweep over x, y"):
        pair_maps(bare, made("c", lambda x: 2.0, y="z"))


def test_sweeps_with_and_without_viscosity(capsys, tmp_path):
    """Two sweeps of ours, one with more damping in the arms: its boundary lies at longer delays everywhere."""
    spec = tmp_path / "line.toml"
    spec.write_text(LINE)
    for name, viscous in (("smooth", 0.0), ("viscous", 0.002)):
        cosim.sweep(spec, workers=1, set={"arm_*.viscous": viscous}, folder=tmp_path / name).save(tmp_path / name)
    status, text = told(
        capsys, "compare", tmp_path / "smooth", tmp_path / "viscous", "--tolerance", 0.001, "--out", tmp_path / "c"
    )
    document = json.loads((tmp_path / "c" / "compare.json").read_text())
    shifts = [b["mean_shift"] for b in document["pairs"][0]["boundaries"]]
    assert status == 1 and len(shifts) == 2 and min(shifts) > 0.01 and document["agrees"] is False
    assert "moved by +" in text and "arm_*.viscous" in (tmp_path / "c" / "report.html").read_text()
    again = cosim.compare([tmp_path / "smooth", tmp_path / "smooth"], tolerance=0.0)
    assert again.agrees and again.to_dict()["pairs"][0]["flipped"] == 0 and again.plot().axes
    with pytest.raises(InputError, match="runs, or sweeps"):
        cosim.compare([tmp_path / "smooth", cosim.run(cosim.load("sallam-nodelay").with_values(BRIEF))])


LINE = """
format = 1
name = "line"
scenario = "sallam-nodelay"
evaluator = "spectrum"
[set]
"arm_*.q_start" = [0.0, 0.0, 0.0]
[[axes]]
name = "stiffness"
unit = "N/m"
paths = ["controller_*.stiffness"]
values = [0.2, 0.4]
[[axes]]
name = "delay"
unit = "s"
paths = ["channel_*.delay_mean"]
low = 0.05
high = 1.5
[boundary]
trace = ["delay"]
tolerance = 0.001
"""
