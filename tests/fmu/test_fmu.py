"""Instances of real FMUs through cosim.fmu: files, both versions side by side, errors in the FMU's own words."""

import ctypes
import shutil
import zipfile

import numpy as np
import pytest

from build_fmus.build import fmu_path
from cosim.engine.master import run
from cosim.engine.outcome import Outcome
from cosim.engine.reference import execute
from cosim.errors import InputError, RunError
from cosim.fmu import describe, extracted, load, open_system, read_columns
from cosim.scenario import load_scenario


def instance_of(fmi, name="c"):
    return load(name, describe(fmu_path("PLikeController", fmi)))


def test_both_versions_are_described_alike():
    two, three = (describe(fmu_path("PhantomArm", fmi)) for fmi in (2, 3))
    assert two.integrates and three.integrates and two.takes_slopes and three.takes_slopes
    assert two.stems("output") == three.stems("output") and two.stems("parameter") == three.stems("parameter")
    for name in two.names("output") + two.names("parameter"):
        a, b = two.variables[name], three.variables[name]
        assert (a.unit, a.start, a.minimum, a.maximum, a.feedthrough, a.items) == (
            b.unit,
            b.start,
            b.minimum,
            b.maximum,
            b.feedthrough,
            b.items,
        )
    assert two.variables["q[1]"].feedthrough == () and two.variables["q[1]"].unit.name == "rad"


@pytest.mark.parametrize("fmi", [2, 3])
def test_errors_carry_name_time_and_words(fmi):
    instance = instance_of(fmi, "right")
    other = instance_of(fmi, "other")  # loaded later: must not hear what the first one says
    instance.wire(["x[1]"], [], ["f[1]"])
    instance.start({})
    instance.begin()
    instance.step(0.0, 0.5)
    instance.inputs[:] = np.nan
    with pytest.raises(RunError) as caught:
        instance.set()
    assert caught.value.fmu == "right" and caught.value.time == 0.5 and "x[1] = nan" in str(caught.value)
    assert not other.said()
    instance.close()
    other.close()


@pytest.mark.parametrize("fmi", [2, 3])
def test_reset_forgets(fmi):
    instance = instance_of(fmi)
    instance.wire(["x_ref[1]"], ["x_ref[1]"], ["f[1]"])
    found = []
    for stiffness in ({"stiffness[1]": 3.0}, {}, {"stiffness[1]": 3.0}):
        instance.start(stiffness)
        instance.begin()
        instance.inputs[:], instance.slopes[:] = 1.0, 2.0
        instance.set()
        instance.step(0.0, 0.5)
        instance.get()
        found.append(instance.outputs[0])
    assert found == [6.0, 0.5, 6.0]  # K (1 + 2 * 0.5), the default K being 0.25 N/m
    instance.close()


def test_versions_mix_and_files_replace_models(tmp_path):
    """A third-party file in place of ours, of the other FMI version: the same bits."""
    made = load_scenario("sallam-stable").with_values({"experiment.stop": 1.0})
    shutil.copy(fmu_path("PLikeController", 3), tmp_path / "mine.fmu")
    mixed = made.with_values({"controller_*.fmu": str(tmp_path / "mine.fmu")})
    one, other = run(made), run(mixed)
    assert {f.fmi for f in other.fmus} == {"2.0", "3.0"}
    assert all(np.array_equal(one.signals[n], other.signals[n]) for n in one.signals)


def test_files_that_are_no_fmus_are_refused(tmp_path):
    (tmp_path / "a.fmu").write_text("nothing")
    with zipfile.ZipFile(tmp_path / "b.fmu", "w") as archive:
        archive.writestr("readme.txt", "nothing")
    for name in ("a.fmu", "b.fmu"):
        with pytest.raises(InputError, match="an FMU"):
            describe(tmp_path / name)


def test_extraction_is_kept_and_absolute(tmp_path, monkeypatch):
    path = fmu_path("PLikeController", 2)
    monkeypatch.setenv("COSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    folder = extracted(path)
    assert folder.is_absolute() and (folder / "modelDescription.xml").is_file() and extracted(path) == folder
    assert str(tmp_path) in str(folder)


def test_a_system_runs_many_scenarios_and_leaves_the_working_directory():
    from pathlib import Path

    here = Path.cwd()
    made = load_scenario("sallam-nodelay").with_values({"experiment.stop": 0.5})
    with open_system(made) as system:
        first = run(made, system)
        loaded = dict(system.loaded)
        run(made.with_values({"controller_*.stiffness": 0.5, "experiment.algorithm": "jacobi"}), system)
        again = run(made, system)
        assert system.loaded == loaded
    assert all(np.array_equal(first.signals[n], again.signals[n]) for n in first.signals) and Path.cwd() == here


def test_columns_of_a_recording(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("# said\ntime, a,b\n0,1,2\n1,3,4\n")
    assert read_columns(path, "time", ["b", "a"]).tolist() == [[0.0, 2.0, 1.0], [1.0, 4.0, 3.0]]
    with pytest.raises(InputError, match="did you mean 'time'"):
        read_columns(path, "tim", ["a"])
    path.write_text("time,a\n0,x\n")
    with pytest.raises(InputError, match="a number"):
        read_columns(path, "time", ["a"])


def test_columns_of_a_recording_in_another_format(tmp_path):
    from scipy.io import savemat

    time = np.arange(50) * 0.5  # slower than a robot's recording, as a trace of delays is
    savemat(tmp_path / "a.mat", {"trace": {"time": time, "delay": np.column_stack([time + 1, time + 2])}})
    table = read_columns(tmp_path / "a.mat", "time", ["delay[2]", "trace.delay[1]"])
    assert np.array_equal(table, np.column_stack([time, time + 2, time + 1]))
    told: list[str] = []
    (tmp_path / "b.csv").write_text("time;delay\n0,5;1,25\n1,5;2,25\n")
    assert read_columns(tmp_path / "b.csv", "time", ["delay"], told.append).tolist() == [[0.5, 1.25], [1.5, 2.25]]
    assert "decimal comma" in told[0]


STEP_2 = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
STEP_3 = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_bool, *[ctypes.c_void_p] * 4
)


def cutting(fmi, early):
    """A doStep that carries out nothing and stops in the middle of the step from 5 ms on."""

    def step(component, time, size, *rest):
        if time < 0.005:
            return 0
        if fmi == 3:
            ctypes.c_bool.from_address(rest[3]).value = early
            ctypes.c_double.from_address(rest[4]).value = time + size / 2
        return 0 if early else 2

    return (STEP_2 if fmi == 2 else STEP_3)(step)


@pytest.mark.parametrize("executor", [None, execute], ids=["C", "Python"])
@pytest.mark.parametrize(
    ("fmi", "early", "status", "how"),
    [
        (2, False, lambda kind: 0.0055, "discarded at t = 0.0055 s"),
        (2, False, None, "discarded at a time that the FMU does not tell"),
        (3, False, None, "discarded at t = 0.0055 s"),
        (3, True, None, "returned early, which was not allowed, at t = 0.0055 s"),
    ],
)
def test_a_step_cut_short_is_told(fmi, early, status, how, executor):
    made = load_scenario("sallam-stable").with_values(
        {"experiment.stop": 0.01, "experiment.record_every": 1, "experiment.fmi": fmi}
    )
    with open_system(made) as system:
        instance, step = (
            system.instance("controller_r", system.wiring(made).descriptions["controller_r"]),
            cutting(fmi, early),
        )
        instance.fmu._functions[f"fmi{fmi}DoStep"] = step
        instance.fmu.getRealStatus = status
        result = run(made, system, executor=executor)
    assert result.outcome is Outcome.FAILED and len(result.time) == 6
    words = f"FMU controller_r at t = 0.005 s: step cut short, {how}; take a shorter communication step"
    assert result.message == f"{words} (experiment.step, or controller_r.step_multiple)"
