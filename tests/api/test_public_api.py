"""The public API: a page of Python that does what each main command does; lazy; and the commands give what it gives."""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import FunctionType

import numpy as np
import pytest

import cosim
from cosim.results.files import read_h5, read_table
from tests.support.commands import ended
from tests.support.paths import DATA

STAUBLI = DATA / "staubli_tx40" / "staubli_tx40_j6.csv"
SHORT = {"experiment.stop": 2.0, "channel_*.delay_mean": 0.1}


@pytest.mark.parametrize("wrong", [None, 3, b"x", object()], ids=lambda wrong: type(wrong).__name__)
@pytest.mark.parametrize("name", sorted(n for n in cosim.__all__ if isinstance(getattr(cosim, n), FunctionType)))
def test_what_no_function_takes_is_one_clear_error(name, wrong, tmp_path):
    more = (tmp_path,) if name in ("export", "live") else ("Mine",) if name == "new" else ()
    with pytest.raises(cosim.InputError, match=rf"{name}\(\): \w+: expected .*, got .*\({type(wrong).__name__}\)"):
        getattr(cosim, name)(wrong, *more)


def test_arguments_deeper_inside_are_looked_at_too_and_what_is_as_good_is_taken():
    scenario = cosim.load("sallam-nodelay").with_values({"experiment.stop": 0.02})
    wrong = (
        lambda: cosim.run(scenario, record=[3]),
        lambda: cosim.compare([scenario, scenario], tolerance="a"),
        lambda: cosim.sweep("gain-delay", workers="two"),
        lambda: cosim.stability(scenario, pose=3),
        lambda: scenario.with_values(None),
        lambda: cosim.run(scenario)[3],
        lambda: cosim.run(scenario).save(None),
    )
    for call in wrong:
        with pytest.raises(cosim.InputError, match="expected"):
            call()
    assert cosim.compare([scenario, scenario], tolerance=np.float32(0.0)).agrees
    assert cosim.run(scenario, record=(name for name in ["arm_l.x"])).signals == tuple(
        f"arm_l.x[{k}]" for k in (1, 2, 3)
    )


def test_a_function_can_be_sent_to_another_process():
    assert pickle.loads(pickle.dumps(cosim.run)) is cosim.run and cosim.run.__name__ == "run"


@pytest.fixture(scope="module")
def ladder():
    return cosim.sweep("gain-ladder", workers=2)


def test_a_page_of_python_does_what_the_commands_do(ladder, tmp_path):
    scenario = cosim.load("sallam-nodelay").with_values(SHORT)
    result = cosim.run(scenario)
    tips, frame = result["arm_l.x"], result.to_dataframe()
    stability = cosim.stability(scenario).to_dict()
    table = ladder.to_dataframe()
    recording = cosim.read(STAUBLI)
    identification = cosim.identify(recording)
    closure = cosim.close_loop(recording, replay=False)
    system = cosim.export(scenario, tmp_path / "export").ssp

    assert tips.shape == (len(result.time), 3)
    assert list(frame["arm_l.x[1]"]) == list(tips[:, 0])
    assert stability["spectrum"]["abscissa"] < 0.0
    assert len(table) == 18
    assert set(table["outcome"]) >= {"converged", "domain_exit"}
    assert set(identification.parameters) >= {"viscous", "coulomb"}
    assert closure.verdict == "effect_found"
    assert closure.effects[0]["name"] == "joint_coupling"
    assert system.stat().st_size > 10_000


@pytest.fixture(scope="module")
def result():
    return cosim.run(cosim.load("sallam-nodelay").with_values(SHORT), record=["arm_l.x", "operator.f[1]"])


def test_signals_are_arrays_with_units(result):
    assert result.signals == ("operator.f[1]", "arm_l.x[1]", "arm_l.x[2]", "arm_l.x[3]")
    assert result["arm_l.x[2]"].shape == result.time.shape
    np.testing.assert_array_equal(result["arm_l.x"][:, 1], result["arm_l.x[2]"])
    assert (result.units["arm_l.x[1]"], result.units["operator.f[1]"]) == ("m", "N")
    with pytest.raises(cosim.InputError, match="did you mean 'arm_l.x'"):
        result["arm_l.xx"]


def test_the_verdict_is_the_same_whatever_is_recorded(result):
    whole = cosim.run(result.scenario)
    assert (result.outcome, result.growth_rate, result.interval) == (whole.outcome, whole.growth_rate, whole.interval)
    assert result.summary["tracking_rmse"] == whole.summary["tracking_rmse"]
    np.testing.assert_array_equal(result["arm_l.x"], whole["arm_l.x"])


def test_a_result_comes_back_from_its_folder(result, tmp_path):
    result.save(tmp_path)
    again = cosim.open_result(tmp_path)
    assert again.summary == json.loads(json.dumps(result.summary))
    assert (again.outcome, again.signals, again.starts) == (result.outcome, result.signals, result.starts)
    np.testing.assert_array_equal(again["arm_l.x"], result["arm_l.x"])
    assert again.scenario == result.scenario
    with pytest.raises(cosim.InputError, match=r"result\.h5"):
        cosim.open_result(tmp_path / "nothing")


def test_the_file_holds_the_outcome_of_the_verdict_and_every_start_value(result, tmp_path):
    result.save(tmp_path, report=False)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert read_h5(tmp_path / "result.h5").outcome.value == summary["outcome"] == "converged"
    assert result.starts["channel_lr.delay_mean"] == 0.1  # set by the caller
    assert result.starts["controller_l.stiffness[2]"] == 0.25  # by the scenario
    assert result.starts["arm_l.encoder_resolution[3]"] == 0.0  # by the FMU alone


def test_frames_and_datasets_keep_values_and_units(result):
    frame = result.to_dataframe()
    assert frame.index.name == "time"
    assert frame.attrs["units"]["arm_l.x[1]"] == "m"
    data = result.to_dataset()
    np.testing.assert_array_equal(data["arm_l.x"].sel({"arm_l.x.element": 3}), result["arm_l.x[3]"])
    assert data["arm_l.x"].attrs["units"] == "m"
    assert data["time"].attrs["units"] == "s"


def test_plots_are_figures_and_pages_are_written(result, tmp_path):
    figure = result.plot()
    figure.savefig(tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 5_000
    assert len(figure.axes) == 2  # the local arm's tip and the operator's force: nothing of the remote arm was recorded
    assert "<b>sallam-nodelay" in result._repr_html_()


def test_progress_is_told_to_anyone_who_prints(capsys):
    cosim.run(cosim.load("sallam-nodelay").with_values({"experiment.stop": 30.0}), progress=print)
    said = capsys.readouterr().out.splitlines()
    assert said
    assert all(" of 30 s" in line for line in said)


@pytest.mark.parametrize("progress", [lambda: None, 3])
def test_progress_that_cannot_be_told_is_refused_before_the_run(progress):
    with pytest.raises(cosim.InputError, match="progress"):
        cosim.run("sallam-nodelay", progress=progress)


def test_a_failed_run_is_a_result_that_keeps_its_rows():
    scenario = cosim.load("sallam-nodelay").with_values({"experiment.stop": 40.0, "channel_*.delay_mean": 9.0})
    with pytest.raises(cosim.InputError, match="buffer"):
        cosim.run(scenario)
    wild = {"controller_*.stiffness": 500.0, "channel_*.delay_mean": 0.3, "arm_*.workspace_limits": True}
    away = cosim.run(cosim.load("sallam-nodelay").with_values(wild))
    assert away.outcome is cosim.Outcome.DOMAIN_EXIT
    assert 10 < len(away.time) < 6001
    assert away.time[-1] <= away.summary["stopped_at"] < 30.0


# --- the command line is a thin layer ---------------------------------------------------------------------------------


def command(capsys, *words) -> str:
    """Standard output of a command."""
    code, out, _ = ended(capsys, *words)
    assert code == 0
    return out


def test_run_prints_and_writes_what_the_call_returns(tmp_path, capsys):
    said = command(capsys, "run", "sallam-nodelay", "--set", "experiment.stop=2.0", "--no-report", "--out", tmp_path)
    result = cosim.run(cosim.load("sallam-nodelay").with_values({"experiment.stop": 2.0}))
    kept = [line for line in str(result).splitlines() if "simulated" not in line]  # which tells the wall time
    assert kept == [line for line in said.splitlines() if "simulated" not in line and "written to" not in line]
    written = cosim.open_result(tmp_path)
    for key in ("outcome", "growth_rate", "growth_rate_interval", "tracking_rmse", "fmus", "added_delay", "notes"):
        assert json.loads(json.dumps(result.summary[key])) == written.summary[key], key
    assert all(np.array_equal(written[name], result[name]) for name in result.signals)


def test_stability_prints_and_writes_what_the_call_returns(tmp_path, capsys):
    words = ("--set", "experiment.stop=5.0", "--no-report", "--out", tmp_path)
    said = command(capsys, "stability", "sallam-unstable", *words)
    found = cosim.stability(cosim.load("sallam-unstable").with_values({"experiment.stop": 5.0}))
    assert str(found) in said
    assert json.loads((tmp_path / "stability.json").read_text()) == json.loads(json.dumps(found.to_dict()))


def test_a_sweep_prints_and_writes_what_the_call_returns(ladder, tmp_path, capsys):
    said = command(capsys, "sweep", "gain-ladder", "--workers", "2", "--no-report", "--out", tmp_path)
    written = read_table(tmp_path / "sweep.h5")
    assert {name: list(values) for name, values in ladder.columns.items()} == written
    assert said.splitlines()[:2] == str(ladder).splitlines()[:2]


def test_identify_and_close_loop_print_and_write_what_the_calls_return(tmp_path, capsys):
    said = command(capsys, "identify", STAUBLI, "--out", tmp_path / "i")
    found = cosim.identify(STAUBLI)
    assert str(found) in said
    assert json.loads((tmp_path / "i" / "identification.json").read_text()) == json.loads(json.dumps(found.to_dict()))
    said = command(capsys, "close-loop", STAUBLI, "--no-replay", "--out", tmp_path / "c")
    closed = cosim.close_loop(STAUBLI, replay=False)
    assert str(closed) in said
    written = json.loads((tmp_path / "c" / "closure.json").read_text())
    assert {k: v for k, v in written.items() if k != "fmu"} == json.loads(json.dumps(closed.to_dict()))


def test_every_main_command_has_its_function():
    from cosim.cli import COMMANDS

    functions = {"run": "run", "stability": "stability", "sweep": "sweep", "identify": "identify", "export": "export"}
    functions |= {
        "close-loop": "close_loop",
        "robot": "robot",
        "data": "data",
        "fmu": "inspect",
        "new": "new",
        "verify": "verify",
        "compare": "compare",
    }
    without = {"list", "show", "arm", "cache", "docs", "live", "plot"}  # they show what other calls know
    assert set(functions) | without == set(COMMANDS)
    assert all(callable(getattr(cosim, name)) for name in functions.values())


# --- lazy -------------------------------------------------------------------------------------------------------------


def test_nothing_heavy_is_imported_before_it_is_asked_for():
    program = "import cosim, sys; print([m for m in ('numpy', 'fmpy', 'scipy', 'matplotlib') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_import_takes_less_than_a_tenth_of_a_second():
    def seconds(program: str) -> float:
        """Processor time of the process: other processes do not count."""
        before = os.times()
        subprocess.run([sys.executable, "-c", program], check=True)
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system

    added = [seconds("import cosim") - seconds("pass") for _ in range(7)]
    assert sorted(added)[3] < 0.1


def test_every_public_name_is_there_and_only_those_are_listed():
    assert sorted(cosim.__all__) == dir(cosim)
    assert all(getattr(cosim, name) is not None for name in cosim.__all__)
    with pytest.raises(AttributeError, match="no attribute 'simulate'"):
        cosim.simulate()


# --- the notebook -----------------------------------------------------------------------------------------------------


def test_the_tour_runs_from_first_cell_to_last(tmp_path):
    import nbformat
    from nbclient import NotebookClient

    path = Path(cosim.__file__).parent / "api" / "tour.ipynb"
    notebook = nbformat.read(path, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)  # none are kept in the file
    client = NotebookClient(
        notebook, timeout=280, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()
    texts = "".join(str(out) for cell in notebook.cells for out in cell.get("outputs", ()))
    assert "position_torque" in texts  # the effect that was hidden is found
    assert "image/png" in texts
