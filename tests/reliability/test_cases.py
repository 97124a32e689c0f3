"""The inputs that failed once (shared/cases/fmi and reliability), each with the value or the message that its README
expects. Kills and processes that stay have tests of their own: test_kills, test_hostile_fmus.
"""

import csv
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

import cosim
from cosim.errors import InputError
from tests.support.foreign import from_python

VALUES = {
    "11-enum-values/enum.toml": ("a.mode_seen", 20.0),
    "11-enum-values/enum.ssp": ("a.mode_seen", 20.0),
    "12-ssp-units-and-lost-parameters/unit.ssp": ("a.x", 0.25),
    "12-ssp-units-and-lost-parameters/prefix.ssp": ("a.x", 3.0),
    "21-fmi3-arrays/f3.toml": ("a.y[2]", 20.0),
    "21-fmi3-arrays/f3_set.toml": ("a.y[3]", 30.0),
}
REFUSED = {
    "fmi/12-ssp-units-and-lost-parameters/badval.ssp": "value to be a number, got '1,5'",
    "fmi/12-ssp-units-and-lost-parameters/ssvmiss.ssp": "a source that is there, got no file 'resources/none.ssv'",
    "fmi/13-ssp-start-time/start.ssp": "a startTime of 0 s, where every run starts, got 2 s",
    "fmi/22-real-into-integer/couple.toml": "'a.x -> b.n_in (round)'",
    "reliability/03-ssp-cache-not-atomic/crc.ssp": "Bad CRC-32",
    "reliability/13-internal-errors/stop_text.ssp": "stopTime to be a number, got 'abc'",
    "reliability/13-internal-errors/ssv.ssp": "expected ",
}
TOLD = {
    "fmi/12-ssp-units-and-lost-parameters/sysparam.ssp": "'k' of the top system is no variable there",
    "fmi/13-ssp-start-time/noexp.ssp": "names no stop time: 10 s is taken",
    "fmi/19-trace-outside-the-run/d_short.toml": "the recording ends at 1.95 s of 6 s",
}


def last(result, name):
    return float(np.asarray(result[name]).ravel()[-1])


@pytest.mark.parametrize("name", VALUES)
def test_the_value_is_the_one_expected(cases, name):
    signal, value = VALUES[name]
    assert last(cosim.run(cosim.load(cases / "fmi" / name)), signal) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_each_time_by_name(cases, name):
    for _ in range(2):
        with pytest.raises(InputError) as error:
            cosim.run(cosim.load(cases / name))
        assert REFUSED[name] in str(error.value)


@pytest.mark.parametrize("name", TOLD)
def test_it_is_told(cases, name):
    scenario = cosim.load(cases / name).with_values({} if "19-" in name else {"experiment.stop": 0.1})
    assert any(TOLD[name] in note for note in cosim.run(scenario).summary["notes"])


def test_stamps_since_1970_play_the_trace_that_counts_from_zero(cases):
    folder = cases / "fmi/19-trace-outside-the-run"
    delays = [cosim.run(cosim.load(folder / f"d_{n}.toml"))["channel_lr.delay_now"] for n in ("epoch2", "rel2")]
    np.testing.assert_allclose(*delays, atol=1e-6)
    assert np.ptp(delays[0]) > 0.1


def test_a_name_with_a_comma_has_one_column(cases, tmp_path):
    cosim.run(cosim.load(cases / "fmi/15-csv-export-comma/comma.toml")).save(tmp_path, report=False, export=["csv"])
    header, row, *_ = csv.reader((tmp_path / "result.csv").open())
    assert len(header) == len(row) and "a.der(x,1) [m]" in header


def test_a_warning_of_every_step_is_told_once(cases, tmp_path):
    result = cosim.run(cosim.load(cases / "fmi/16-fmu-warnings-unheard/warns.toml"))
    (message,) = result.summary["messages"]
    assert message["count"] == 1000 and "extrapolated" in message["text"]
    page = result.save(tmp_path) / "report.html"
    assert "extrapolated" in page.read_text(encoding="utf-8")


def test_dollars_and_markup_in_names_are_drawn(cases, tmp_path):
    folder = cases / "fmi/17-dollar-in-names"
    page = cosim.run(cosim.load(folder / "sc2.toml")).save(tmp_path / "r") / "report.html"
    text = page.read_text(encoding="utf-8")
    assert "_arm$1_$" in text and "<script>alert(1)</script>" not in text


def test_an_array_before_a_scalar_shifts_nothing(cases, tmp_path):
    folder = cases / "fmi/21-fmi3-arrays"
    file = from_python("pythonfmu3", (folder / "vecfirst.py").read_text(), tmp_path)
    assert file.name == "VecFirst.fmu"
    shutil.copy(folder / "vf.toml", tmp_path)
    result = cosim.run(cosim.load(tmp_path / "vf.toml"))
    assert last(result, "p.y") == 7.0
    np.testing.assert_allclose(result["p.v"][-1], [0.99, 1.98 * 2, 2.97 * 3], rtol=1e-12)


def command(folder, *words):
    words = [sys.executable, "-m", "cosim", *words]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=200)


@pytest.mark.parametrize(
    ("name", "words"), [("neg", "status -1"), ("rtsig", "signal 39"), ("pipe", ""), ("closefd", "")]
)
def test_what_an_fmu_does_to_its_process_is_its_error_and_the_rows_stay(cases, tmp_path, name, words):
    folder = cases / "reliability/11-apart-gaps"
    for file in ("s.toml", "good.fmu"):
        shutil.copy(folder / file, tmp_path)
    shutil.copy(folder / f"{name}.fmu", tmp_path / "evil.fmu")
    done = command(tmp_path, "run", "s.toml", "--out", "o", "--no-report")
    assert done.returncode in (0, 1) and "internal error" not in done.stderr
    assert words in done.stderr + done.stdout
    if done.returncode or name == "neg":
        assert "evil" in done.stderr
    assert len(cosim.open_result(tmp_path / "o").time) > 1


@pytest.mark.parametrize("name", ["evil_exit", "evil_segv"])
def test_an_export_survives_what_it_reads(cases, tmp_path, name):
    folder = cases / "reliability/05-export-unguarded"
    for file in ("s.toml", "good.fmu"):
        shutil.copy(folder / file, tmp_path)
    shutil.copy(folder / f"{name}.fmu", tmp_path / "evil.fmu")
    done = command(tmp_path, "export", "s.toml", "--out", "o")
    if done.returncode:
        assert done.returncode == 1 and "evil" in done.stderr
    else:
        assert (tmp_path / "o/s.ssp").is_file()


@pytest.mark.parametrize("name", ["07-all-points-failed-is-rc0/ev", "08-evaluator-imports-anything/ev"])
def test_an_evaluator_that_is_none_is_bad_input(cases, tmp_path, name):
    done = command(tmp_path, "sweep", str(cases / f"reliability/{name}.toml"), "--workers", "1", "--out", "o")
    assert done.returncode == 2 and "evaluator" in done.stderr


@pytest.mark.parametrize(
    ("name", "words"),
    [("emptyname", "a name for every variable, got an empty one"), ("start_text", "start to be a number, got 'abc'")],
)
def test_odd_descriptions_are_bad_input(cases, tmp_path, name, words):
    shutil.copy(cases / f"reliability/13-internal-errors/{name}.fmu", tmp_path / "a.fmu")
    (tmp_path / "s.toml").write_text('[experiment]\nstop = 0.1\n[components.a]\nfmu = "a.fmu"\n')
    for done in (command(tmp_path, "run", "s.toml", "--out", "o"), command(tmp_path, "fmu", "a.fmu")):
        assert done.returncode == 2 and words in done.stderr


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_memory_of_close_loop_grows_with_the_rows_where_many_effects_are_accepted(cases, tmp_path):
    """3.2 and 5.0 GB; of 200,000 rows it was over 14 GB, and grew faster than they."""
    assert command(tmp_path, "run", "identification", "--no-report", "--out", "r").returncode == 0
    made, gigabytes = cases / "reliability/06-close-loop-memory/mkcsv.py", []
    for rows in (200_000, 400_000):
        subprocess.run([sys.executable, made, "d.csv", str(rows), "r/result.h5"], cwd=tmp_path, check=True)
        words = [sys.executable, "-m", "cosim", "close-loop", "d.csv", "--no-replay", "--out", f"c{rows}"]
        process = subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        assert process.returncode == 0
        gigabytes.append(used.ru_maxrss * 1024 / 1e9)
    print(*(f"{x:.2f} GB" for x in gigabytes))
    assert len(json.loads((tmp_path / "c400000/closure.json").read_text())["effects"]) > 1
    assert gigabytes[0] < 4.0 and gigabytes[1] < 2 * gigabytes[0]
