"""Reading measured data: every kind of bad file is a clear error or a repair with a name."""

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.measured import PhantomDevice, RecordingDescription, parse_description, read

STEP = 1e-3
HEADER = "time,q1,q2,q3,tau1,tau2,tau3"
AXIS = {"device": "axis", "columns": {"time": "t", "q": ["q"], "tau": ["tau"]}}


def arm_columns(rows=2000):
    """A plausible PHANToM recording, (rows, 7)."""
    time = np.arange(rows) * STEP
    q = np.stack([0.3 * np.sin(2 * time + j) + 0.4 for j in range(3)], axis=1)
    return np.column_stack([time, q, 0.05 * np.cos(2 * time[:, None] + np.arange(3))])


def write(path, table, header=HEADER, fmt="%.9g"):
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt=fmt)
    return path


def message(call) -> str:
    with pytest.raises(InputError) as caught:
        call()
    return str(caught.value)


def warned(recording, *words):
    text = "\n".join(recording.warnings)
    for word in words:
        assert word in text, f"{word!r} not in:\n{text}"


def test_plain_file_needs_no_description(tmp_path):
    recording = read([write(tmp_path / "a.csv", arm_columns())])
    run = recording.runs[0]
    assert (
        recording.device == PhantomDevice() and run.q.shape == (2000, 3) and run.step == pytest.approx(STEP, rel=1e-12)
    )
    assert run.test.sum() == 1000 and not run.test[:1000].any()  # the contract: second half held out
    warned(recording, "second half")


def test_test_files_are_held_out_whole(tmp_path):
    recording = read([write(tmp_path / "a.csv", arm_columns())], test=[write(tmp_path / "b.csv", arm_columns())])
    assert not recording.runs[0].test.any() and recording.runs[1].test.all()


def test_a_file_cannot_be_fitted_and_held_out(tmp_path):
    path = write(tmp_path / "a.csv", arm_columns())
    assert "not fitted" in message(lambda: read([path], test=[path]))


def test_parquet_mat_and_csv_agree(tmp_path):
    import pyarrow
    from pyarrow import parquet
    from scipy.io import savemat

    table, names = arm_columns(), HEADER.split(",")
    parquet.write_table(pyarrow.table({n: table[:, k] for k, n in enumerate(names)}), tmp_path / "a.parquet")
    savemat(tmp_path / "a.mat", {n: table[:, k] for k, n in enumerate(names)})
    savemat(tmp_path / "b.mat", {"time": table[:, 0], "q": table[:, 1:4], "tau": table[:, 4:]})  # matrices: q1 q2 q3
    write(tmp_path / "a.csv", table, fmt="%.17g")
    expected = read([tmp_path / "a.csv"]).runs[0]
    for name in ("a.parquet", "a.mat", "b.mat"):
        run = read([tmp_path / name]).runs[0]
        assert np.array_equal(run.q, expected.q) and np.array_equal(run.tau, expected.tau)


def test_description_beside_the_file_units_and_scale(tmp_path):
    table = arm_columns()
    table[:, 1:4] = np.rad2deg(table[:, 1:4])
    table[:, 4:] *= 2.7
    write(tmp_path / "a.csv", table)
    (tmp_path / "a.toml").write_text(
        'device = "phantom"\n[columns]\nq = ["q1", "q2", "q3"]\ntau = ["tau1", "tau2", "tau3"]\n'
        '[units]\nq = "deg"\ntau = "V"\n[scale]\ntau = 0.37037037037\n'
    )
    run = read([tmp_path / "a.csv"]).runs[0]
    assert np.allclose(run.q, arm_columns()[:, 1:4], atol=1e-8) and np.allclose(
        run.tau, arm_columns()[:, 4:], atol=1e-8
    )


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"devise": "axis"}, "did you mean 'device'"),
        ({"device": "axes"}, "did you mean 'axis'"),
        (AXIS | {"units": {"q": "degs"}}, "or 'deg'?"),
        (AXIS | {"units": {"q": "counts"}}, "give [scale].q"),
        (AXIS | {"units": {"q": "N"}}, "expected a unit of"),
        ({"device": "axis", "columns": {"time": "t", "q": ["q", "r"], "tau": ["tau"]}}, "1 column(s)"),
        ({"device": "regressor", "columns": {"time": "t", "q": ["q"], "tau": ["tau"]}}, "regressor columns or a rigid"),
        ({"device": "axis", "columns": {"time": "t", "tau": ["tau"]}}, "columns].q"),
        ({"parameters": "declared"}, "8 trusted parameters"),
        ({"parameters": "declared", "declared_pi": [1.0, 2.0]}, "8 numbers"),
        (AXIS | {"parameters": "declared"}, "for device 'phantom' also 'declared'"),
        (AXIS | {"gravity": "yes"}, "true or false"),
        ({"device": "axis", "columns": {"tiem": "t", "q": ["q"], "tau": ["tau"]}}, "did you mean 'time'"),
        (AXIS | {"configuration": "URR"}, "did you mean 'UR'"),
    ],
)
def test_bad_descriptions_say_what_to_do(table, words):
    assert words in message(lambda: parse_description(table, "d.toml"))


def test_all_problems_of_a_description_come_at_once():
    text = message(lambda: parse_description({"devise": 1, "device": "axes", "gravity": 3}, "d.toml"))
    assert len(text.splitlines()) >= 3


def test_broken_toml(tmp_path):
    write(tmp_path / "a.csv", arm_columns())
    (tmp_path / "a.toml").write_text("device = \n")
    assert "TOML" in message(lambda: read([tmp_path / "a.csv"]))


def test_missing_and_misspelt_columns(tmp_path):
    path = write(tmp_path / "a.csv", arm_columns(), header="time,q1,q2,q3,torque1,tau2,tau3")
    text = message(lambda: read([path]))
    assert ("tau1" in text and "the file has: time, q1" in text) or "did you mean" in text


def test_missing_columns_name_the_description_in_the_folder(tmp_path):
    path = write(tmp_path / "a.csv", arm_columns(), header="t,a,b,c,d,e,f")
    (tmp_path / "other.toml").write_text("")
    assert "other.toml" in message(lambda: read([path]))


def test_text_in_numbers_is_named_with_its_row(tmp_path):
    lines = write(tmp_path / "a.csv", arm_columns()).read_text().splitlines()
    cells = lines[43].split(",")
    lines[43] = ",".join([*cells[:2], "oops", *cells[3:]])
    (tmp_path / "a.csv").write_text("\n".join(lines))
    text = message(lambda: read([tmp_path / "a.csv"]))
    assert "column 'q2', row 43" in text and "'oops'" in text


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "empty file"),
        (HEADER + "\n", "header only"),
        ("1,2,3,4,5,6,7\n1,2,3,4,5,6,7\n", "add a header line"),
        ("time,q1,q1,q3,tau1,tau2,tau3\n1,2,3,4,5,6,7\n", "twice: q1"),
        (HEADER + "\n1,2,3\n", "a table of equal rows"),
    ],
)
def test_files_that_are_no_tables(tmp_path, content, words):
    (tmp_path / "a.csv").write_text(content)
    assert words in message(lambda: read([tmp_path / "a.csv"]))


def test_absent_file_and_unknown_kind(tmp_path):
    write(tmp_path / "recording.csv", arm_columns())
    assert "recording.csv" in message(lambda: read([tmp_path / "recordin.csv"]))
    (tmp_path / "a.xlsx").write_text("x")
    assert ".parquet" in message(lambda: read([tmp_path / "a.xlsx"]))
    (tmp_path / "a.mat").write_bytes(b"not a mat file at all")
    assert "MAT file" in message(lambda: read([tmp_path / "a.mat"]))
    (tmp_path / "a.parquet").write_bytes(b"PAR0")
    assert "Parquet" in message(lambda: read([tmp_path / "a.parquet"]))


def test_comment_lines_and_semicolons(tmp_path):
    text = write(tmp_path / "a.csv", arm_columns()).read_text().replace(",", ";")
    (tmp_path / "a.csv").write_text("% made by a rig\n# at noon\n" + text)
    recording = read([tmp_path / "a.csv"])
    warned(recording, "2 comment lines")
    assert np.allclose(recording.runs[0].q, arm_columns()[:, 1:4], atol=1e-8)


def test_decimal_commas_are_read(tmp_path):
    text = write(tmp_path / "a.csv", arm_columns()).read_text()
    (tmp_path / "b.csv").write_text(text.replace(",", ";").replace(".", ","))
    plain, comma = (read([tmp_path / name]) for name in ("a.csv", "b.csv"))
    warned(comma, "decimal comma")
    assert np.array_equal(comma.runs[0].q, plain.runs[0].q) and np.array_equal(comma.runs[0].tau, plain.runs[0].tau)


def test_decimal_commas_between_commas_are_refused(tmp_path):
    rows = "".join(f"0,{k:03d},0,5\n" for k in range(100))
    (tmp_path / "a.csv").write_text("t,q\n" + rows)
    assert "a decimal comma?" in message(lambda: read([tmp_path / "a.csv"]))


def test_gap_splits_the_run(tmp_path):
    table = np.delete(arm_columns(), slice(800, 900), axis=0)
    recording = read([write(tmp_path / "a.csv", table)])
    assert [len(run) for run in recording.runs] == [800, 1100]
    warned(recording, "1 gaps in time (longest 0.101 s", "split there")


def test_lost_samples_are_resampled(tmp_path):
    table = np.delete(arm_columns(), [500, 501, 1200], axis=0)
    recording = read([write(tmp_path / "a.csv", table)])
    warned(recording, "non-uniform time stamps", "cubic splines")
    # PCHIP over a gap of 3 ms of a 2 rad/s sine of 0.3 rad: error below h^2 q'' / 8 = 1.4e-6 rad
    assert len(recording.runs[0]) == 2000 and np.abs(recording.runs[0].q - arm_columns()[:, 1:4]).max() < 1.5e-6


def test_jittered_stamps_are_resampled_to_the_true_signal(tmp_path):
    rng = np.random.default_rng(1)
    time = np.sort(np.arange(2000) * STEP + rng.uniform(-0.3, 0.3, 2000) * STEP)
    q = np.stack([0.3 * np.sin(2 * time + j) + 0.4 for j in range(3)], axis=1)
    table = np.column_stack([time, q, 0.05 * np.cos(2 * time[:, None] + np.arange(3))])
    run = read([write(tmp_path / "a.csv", table, fmt="%.12g")]).runs[0]
    expected = np.stack([0.3 * np.sin(2 * run.time + j) + 0.4 for j in range(3)], axis=1)
    assert np.ptp(np.diff(run.time)) < 1e-12 and np.abs(run.q - expected).max() < 1e-6


def test_rounded_stamps_count_as_even(tmp_path):
    table = arm_columns()
    table[:, 0] = np.round(table[:, 0] * 1.00003, 5)
    recording = read([write(tmp_path / "a.csv", table)])
    warned(recording, "second half")
    assert not any("non-uniform" in text for text in recording.warnings)


def test_duplicate_rows_are_dropped_by_name(tmp_path):
    table = np.repeat(arm_columns(), np.where(np.arange(2000) % 100 == 7, 2, 1), axis=0)
    recording = read([write(tmp_path / "a.csv", table)])
    warned(recording, "20 rows repeat a time stamp")
    assert len(recording.runs[0]) == 2000


def test_coarse_time_stamps_are_an_error_where_rows_are_lost(tmp_path):
    kept = np.sort(np.random.default_rng(4).choice(2000, 1200, replace=False))
    table = arm_columns()[kept]
    table[:, 0] = np.round(table[:, 0], 2)
    assert "too few digits" in message(lambda: read([write(tmp_path / "a.csv", table)]))


def test_coarse_time_stamps_of_even_rows_become_an_even_grid(tmp_path):
    table = arm_columns()
    table[:, 0] = np.floor(table[:, 0] * 100 + 1e-6) / 100
    recording = read([write(tmp_path / "a.csv", table)])
    warned(recording, "stamps tell when rows arrived")
    # The line through the 200 steps has their slope to 1 / (2000 * 200) of a step.
    assert recording.runs[0].step == pytest.approx(STEP, rel=1e-4)
    assert np.array_equal(recording.runs[0].q, read([write(tmp_path / "b.csv", arm_columns())]).runs[0].q)


def test_unsorted_time_is_sorted_by_name(tmp_path):
    table = arm_columns()
    table[[300, 301]] = table[[301, 300]]
    recording = read([write(tmp_path / "a.csv", table)])
    warned(recording, "sorted by time")
    assert np.allclose(recording.runs[0].q, arm_columns()[:, 1:4], atol=1e-8)
    shuffled = read([write(tmp_path / "b.csv", np.random.default_rng(0).permutation(arm_columns()))])
    assert np.allclose(shuffled.runs[0].q, arm_columns()[:, 1:4], atol=1e-8)


def test_a_clock_that_starts_again_means_two_recordings(tmp_path):
    recording = read([write(tmp_path / "a.csv", np.concatenate([arm_columns(), arm_columns(1500)]))])
    assert [len(run) for run in recording.runs] == [2000, 1500]
    warned(recording, "starts again at row(s) 2001")


def test_run_column_separates(tmp_path):
    table = np.concatenate([arm_columns(), arm_columns()])
    labels = np.repeat([1.0, 2.0], 2000)
    path = write(tmp_path / "a.csv", np.column_stack([table, labels]), header=HEADER + ",trial")
    columns = {"q": ["q1", "q2", "q3"], "tau": ["tau1", "tau2", "tau3"], "run": "trial"}
    assert len(read([path], description=parse_description({"columns": columns}, "d")).runs) == 2


def test_split_column(tmp_path):
    lines = write(tmp_path / "a.csv", arm_columns()).read_text().splitlines()
    rows = [f"{line},{'train' if k < 1500 else 'test'}" for k, line in enumerate(lines[1:])]
    (tmp_path / "a.csv").write_text("\n".join([lines[0] + ",split", *rows]))
    columns = {"q": ["q1", "q2", "q3"], "tau": ["tau1", "tau2", "tau3"], "split": "split"}
    description = parse_description({"columns": columns}, "d")
    assert read([tmp_path / "a.csv"], description=description).runs[0].test.sum() == 500
    (tmp_path / "b.csv").write_text((tmp_path / "a.csv").read_text().replace("test", "tset"))
    assert "train or test" in message(lambda: read([tmp_path / "b.csv"], description=description))


def test_few_missing_values_are_filled_many_are_cut(tmp_path):
    table = arm_columns()
    table[100:103, 4] = np.nan
    table[900:1000, 2] = np.inf
    recording = read([write(tmp_path / "a.csv", table)])
    warned(recording, "missing values interpolated (tau1 3)", "100 rows with missing values")
    assert [len(run) for run in recording.runs] == [900, 1000] and all(
        np.isfinite(run.tau).all() for run in recording.runs
    )


def test_a_channel_that_is_mostly_empty_is_an_error(tmp_path):
    table = arm_columns()
    table[300:1500, 5] = np.nan
    assert "tau2: expected numbers, got 60 %" in message(lambda: read([write(tmp_path / "a.csv", table)]))


def test_rows_without_time_are_dropped(tmp_path):
    table = arm_columns()
    table[700, 0] = np.nan
    warned(read([write(tmp_path / "a.csv", table)]), "1 rows without a time dropped")


def test_wrapped_angles_are_unwrapped_by_name(tmp_path):
    time = np.arange(3000) * STEP
    angle = 2 * time**2
    table = np.column_stack([time, np.mod(angle + np.pi, 2 * np.pi) - np.pi, np.cos(angle)])
    recording = read([write(tmp_path / "a.csv", table, header="t,q,tau")], description=parse_description(AXIS, "d"))
    warned(recording, "wraps round", "unwrapped")
    assert np.allclose(recording.runs[0].q[:, 0], angle, atol=1e-7)


def test_constant_channels_are_errors(tmp_path):
    table = arm_columns()
    table[:, 2] = 0.3
    table[:, 6] = 0.0
    text = message(lambda: read([write(tmp_path / "a.csv", table)]))
    assert "'q2'" in text and "stuck encoder" in text and "'tau3'" in text and "dead torque channel" in text


@pytest.mark.parametrize(
    ("column", "factor", "words"),
    [
        (slice(1, 4), 180 / np.pi, 'units] q = "deg"'),
        (slice(4, 7), 1e3, "mN"),
        (slice(0, 1), 1e3, 'units] time = "ms"'),
        (slice(0, 1), 1e-6, "units] of time"),
    ],
)
def test_wrong_units_are_named(tmp_path, column, factor, words):
    table = arm_columns()
    table[:, column] *= factor
    assert words in message(lambda: read([write(tmp_path / "a.csv", table)]))


def test_velocity_in_degrees_is_found_by_comparison(tmp_path):
    time = np.arange(3000) * STEP
    table = np.column_stack([time, np.sin(3 * time), np.rad2deg(3 * np.cos(3 * time)), np.cos(time)])
    description = parse_description(
        {"device": "axis", "columns": {"time": "t", "q": ["q"], "tau": ["tau"], "dq": ["dq"]}}, "d"
    )
    path = write(tmp_path / "a.csv", table, header="t,q,dq,tau")
    assert "is it in deg" in message(lambda: read([path], description=description))


def test_too_short(tmp_path):
    assert "at least 64 rows" in message(lambda: read([write(tmp_path / "a.csv", arm_columns(40))]))


def test_held_torque_is_recentred(tmp_path):
    path = write(tmp_path / "a.csv", arm_columns())
    run = read([path], description=parse_description({"torque_held": True}, "d")).runs[0]
    plain = read([path], description=RecordingDescription()).runs[0]
    assert np.allclose(run.tau[1:], (plain.tau[1:] + plain.tau[:-1]) / 2)


def test_interleaved_splits_are_doubted(tmp_path):
    table = arm_columns(8000)
    lines = write(tmp_path / "a.csv", table).read_text().splitlines()
    rows = [f"{line},{'train' if (k // 1000) % 2 == 0 else 'test'}" for k, line in enumerate(lines[1:])]
    (tmp_path / "a.csv").write_text("\n".join([lines[0] + ",split", *rows]))
    columns = {"q": ["q1", "q2", "q3"], "tau": ["tau1", "tau2", "tau3"], "split": "split"}
    warned(read([tmp_path / "a.csv"], description=parse_description({"columns": columns}, "d")), "not independent")


def test_rows_outside_the_training_range_are_counted(tmp_path):
    table = arm_columns()
    table[1500:, 1] *= 1.6
    warned(read([write(tmp_path / "a.csv", table)]), "held-out rows leave the range of q")


SHIPPED = [
    ("emps/emps_train.csv", "emps/emps.toml"),
    ("emps/emps_test_pulses.csv", "emps/emps.toml"),
    ("mis_tool_cable/Tool_4_Maryland_L_2_00.csv", "mis_tool_cable/mis_tool_cable.toml"),
    ("mis_tool_cable/Tool_5_Maryland_L_2_23.csv", "mis_tool_cable/mis_tool_cable.toml"),
    ("dfki_pendulum_1dof/gravity_comp.csv", "dfki_pendulum_1dof/dfki_pendulum_1dof.toml"),
    ("dfki_pendulum_1dof/pd_1Nm_fail.csv", "dfki_pendulum_1dof/dfki_pendulum_1dof.toml"),
    ("residual_ready/emps_j1.csv", None),
    *((f"residual_ready/staubli_tx40_j{j}.csv", None) for j in range(1, 7)),
]


@pytest.mark.parametrize(("name", "description"), SHIPPED)
def test_shared_sets_load_with_their_descriptions(shared_data, name, description):
    recording = read([shared_data / name], description=None if description is None else shared_data / description)
    assert recording.runs
    for run in recording.runs:
        assert np.isfinite(run.q).all() and np.isfinite(run.tau).all() and len(run) >= 64
