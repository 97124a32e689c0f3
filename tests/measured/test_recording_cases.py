"""Recordings that failed once, with what is expected of them: shared/cases/recordings and reliability/13."""

import numpy as np
import pytest

import cosim
from cosim.errors import InputError
from tests.support.axis_rig import AxisLog, recorded

TRUTH = {"inertia": 0.8, "viscous": 1.1, "coulomb": 0.6, "offset": 0.05}


READ = [
    ("01-ns-stamps/ns_epoch.csv", "2024-06-10T06:13:20.123456789"),
    ("01-ns-stamps/pq_ts_ns.parquet", "2024-06-10T06:13:20.123456789"),
    ("01-ns-stamps/pq_uint64err.parquet", ""),
    ("03-mat-two-structs/mat_len.mat", ""),
    ("09-ros-exports/iso_time.csv", "2024-06-10T06:13:20"),
    ("09-ros-exports/rostopic.csv", "2024-06-10T06:13:20.123456789"),
    ("10-excel-leftovers/preamble.csv", "3 lines above the header in line 5 skipped, the first: 'Logger v2.1'"),
    ("10-excel-leftovers/trail2.csv", ""),
]


@pytest.mark.parametrize(("name", "note"), READ)
def test_cases_that_are_read_give_the_true_parameters(cases, name, note):
    data = cosim.read(cases / "recordings" / name)
    assert note in "\n".join(data.warnings)
    assert all(np.ptp(np.diff(run.time)) < 1e-9 and run.step == pytest.approx(0.002, rel=1e-9) for run in data.runs)
    found = {p["name"]: p for p in cosim.identify(data).to_dict()["parameters"]}
    assert set(found) == set(TRUTH)
    for parameter, value in TRUTH.items():
        low, high = found[parameter]["interval"]
        width = high - low  # one of twenty 95 % intervals misses; the next width beside it does not
        assert low - width / 2 <= value <= high + width / 2, parameter


REFUSED = [
    ("03-mat-two-structs/mat_two.mat", ("ur_a.q, ur_b.q", "ur_a.tau, ur_b.tau", "ur_a.t, ur_b.t")),
    ("03-mat-two-structs/mat_cell.mat", ("runs{1}.q, runs{2}.q", "runs{1}.tau, runs{2}.tau")),
    ("09-ros-exports/pq_list.parquet", ("position[1], position[2]", "effort[1], effort[2]")),
    ("10-excel-leftovers/us_nounit.csv", ('the unit that fits is "us" (500 Hz)', '[units] time = "us"')),
]


@pytest.mark.parametrize(("name", "words"), REFUSED)
def test_cases_that_stay_open_say_what_is_in_the_file(cases, name, words):
    with pytest.raises(InputError) as caught:
        cosim.read(cases / "recordings" / name)
    for word in words:
        assert word in str(caught.value)
    assert '"ms"' not in str(caught.value)


@pytest.mark.parametrize(("robot", "factor"), [("ur_a", 1.0), ("ur_b", 1.5)])
def test_either_robot_of_one_file_by_its_whole_name(cases, tmp_path, robot, factor):
    """ur_b holds 2 q and 3 tau of ur_a: inertia and friction per speed are 1.5 times as large."""
    columns = "\n".join(f'{role} = "{robot}.{name}"' for role, name in (("time", "t"), ("q", "q"), ("tau", "tau")))
    (tmp_path / "d.toml").write_text(f'device = "axis"\n[columns]\n{columns}\n')
    data = cosim.read(cases / "recordings/03-mat-two-structs/mat_two.mat", description=tmp_path / "d.toml")
    found = {p["name"]: p for p in cosim.identify(data).to_dict()["parameters"]}
    assert found["inertia"]["value"] == pytest.approx(0.8 * factor, rel=2e-3)
    assert found["viscous"]["value"] == pytest.approx(1.1 * factor, rel=1e-2)


def test_the_unit_that_fits_is_the_one_that_works(cases, tmp_path):
    path = cases / "recordings/10-excel-leftovers/us_nounit.csv"
    text = path.with_suffix(".toml").read_text() + '\n[units]\ntime = "us"\n'
    (tmp_path / "d.toml").write_text(text)
    assert cosim.read(path, description=tmp_path / "d.toml").runs[0].step == pytest.approx(0.002, rel=1e-12)


def test_a_table_in_utf_32_is_read(cases):
    data = cosim.read(cases / "reliability/13-internal-errors/utf16.csv")
    assert "encoding utf-32" in "\n".join(data.warnings) and len(data.runs[0]) == 2500


def test_a_time_column_in_several_units_is_refused(cases):
    with pytest.raises(InputError, match="in one unit throughout"):
        cosim.read(cases / "reliability/13-internal-errors/time-scale.csv")


DOUBTED = [
    ("05-encoder-glitch/zero_frames.csv", "jump", "2 rows that no motion can reach"),
    ("07-saturated-torque/sat.csv", "clipped", "tau sits at its extreme (-4, 4) in 76 % of the rows: saturated?"),
    ("08-held-samples/stale.csv", "held samples", "10800 rows (new about every 10 rows, 50 Hz)"),
]


@pytest.mark.parametrize(("name", "kind", "words"), DOUBTED)
def test_cases_that_were_read_into_false_intervals_are_doubted_and_repaired(cases, name, kind, words):
    data = cosim.read(cases / "recordings" / name)
    (doubt,) = [doubt for doubt in data.doubts if doubt.kind == kind]
    assert words in doubt.text and "wraps round" not in "\n".join(data.warnings)
    result = cosim.identify(data).to_dict()
    found = {p["name"]: p for p in result["parameters"]}
    assert doubt.to_dict() in result["doubts"]
    for parameter, value in TRUTH.items():
        low, high = found[parameter]["interval"]
        assert low - (high - low) / 2 <= value <= high + (high - low) / 2, parameter
    assert found["inertia"]["value"] == pytest.approx(0.8, rel=0.01)


DRAFTED = [name for name, *_ in (*READ, *DOUBTED)]


@pytest.mark.parametrize("name", DRAFTED)
def test_the_description_that_cosim_data_drafts_is_taken_as_it_is(cases, tmp_path, name):
    """From the file alone, without the description beside it: inertia as with that."""
    path = tmp_path / name.rpartition("/")[2]
    path.write_bytes((cases / "recordings" / name).read_bytes())
    found = cosim.data(path)
    assert found.recording is not None, found.to_dict()["problems"]
    found.save(tmp_path / "out")
    result = cosim.identify(path, description=tmp_path / "out/description.toml").to_dict()
    inertia = next(p for p in result["parameters"] if p["name"] == "inertia")
    assert inertia["value"] == pytest.approx(0.8, rel=0.02) and inertia["unit"] == "kg.m2"


def test_a_torque_that_is_cut_at_the_tenth_of_its_rows(cases, tmp_path):
    """The variant of case 07 that is not in the folder: +-19.9 N m in 10 % of the rows."""
    table = recorded(4, size=1.7)
    limit = float(np.quantile(np.abs(table.tau), 0.9))
    path = AxisLog(table.t, table.q, np.clip(table.tau, -limit, limit), table.rng).write(tmp_path / "a.csv")
    result = cosim.identify(path).to_dict()
    (doubt,) = [doubt for doubt in result["doubts"] if doubt["kind"] == "clipped"]
    assert doubt["done"] == "rows left out" and doubt["count"] == pytest.approx(0.1 * len(table.t), rel=0.02)
    for p in result["parameters"]:
        low, high = p["interval"]
        assert p["name"] == "slow" or low - (high - low) / 2 <= TRUTH[p["name"]] <= high + (high - low) / 2


def test_three_single_spikes_of_3_and_6_rad_and_codes_in_the_torque(tmp_path):
    """Variants of case 05 that are not in the folder."""
    table = recorded(5)
    q, tau = table.q.copy(), table.tau.copy()
    q[[1000, 5000, 9000]] += [3.0, -6.0, 6.0]
    tau[[2000, 6000, 8000]] = -9999.0
    result = cosim.identify(AxisLog(table.t, q, tau, table.rng).write(tmp_path / "a.csv")).to_dict()
    kinds = {doubt["kind"]: doubt["rows"] for doubt in result["doubts"]}
    assert kinds["jump"] == [1001, 5001, 9001] and kinds["sentinel"] == [2001, 6001, 8001]
    assert "wrap" not in kinds
    for p in result["parameters"]:
        low, high = p["interval"]
        assert p["name"] == "slow" or low - (high - low) / 2 <= TRUTH[p["name"]] <= high + (high - low) / 2
