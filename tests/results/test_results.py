"""Results on disk: what is written comes back, with units and provenance; nothing half-written stays."""

import json

import numpy as np
import pytest
from scipy.io import loadmat

from cosim.engine.master import run
from cosim.engine.outcome import Outcome
from cosim.engine.reference import execute
from cosim.errors import InputError
from cosim.results.files import export_csv, export_mat, read_h5, write_h5
from tests.support.fakes import MODELS, FakeSystem, oscillator


@pytest.fixture(scope="module")
def result():
    made = oscillator(stop=0.5, record_every=5)
    return run(made, FakeSystem(made, MODELS), executor=execute)


def test_hdf5_comes_back_to_the_bit(result, tmp_path):
    again = read_h5(write_h5(result, tmp_path / "deep" / "r.h5"))
    assert again.outcome is Outcome.BOUNDED and again.scenario == result.scenario and again.stopped_at is None
    assert np.array_equal(again.time, result.time) and list(again.signals) == list(result.signals)
    assert all(np.array_equal(again.signals[n], result.signals[n]) for n in result.signals)
    assert dict(again.units) == dict(result.units)
    assert [f.model for f in again.fmus] == ["Mass", "Spring"]


def test_hdf5_opens_without_cosim(result, tmp_path):
    import h5py

    with h5py.File(write_h5(result, tmp_path / "r.h5")) as file:
        assert file["signals/mass/x"].shape == (101, 1) and file["signals/mass/x"].attrs["unit"] == "m"
        assert file["time"].attrs["unit"] == "s" and "[experiment]" in file.attrs["scenario"]
        assert {"python", "numpy", "fmpy"} <= set(json.loads(file.attrs["versions"]))
        assert file.attrs["seed"] == 0 and file.attrs["command"]


def test_a_full_disk_leaves_no_file(result, tmp_path, monkeypatch):
    from cosim.results import files as results

    monkeypatch.setattr(results, "_write", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(OSError, match="No space"):
        write_h5(result, tmp_path / "r.h5")
    assert list(tmp_path.iterdir()) == []


def test_other_files_are_refused(tmp_path):
    (tmp_path / "r.h5").write_text("nothing")
    with pytest.raises(InputError, match="a result of cosim"):
        read_h5(tmp_path / "r.h5")


def test_csv_holds_every_bit(result, tmp_path):
    path = export_csv(result, tmp_path / "r.csv")
    header = path.read_text().splitlines()[0]
    assert header == "time [s],mass.x [m],mass.v [m/s],mass.domain [1],spring.f [N]"
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert np.array_equal(table[:, 1], result.signals["mass.x"]) and np.array_equal(table[:, 0], result.time)


def test_mat_holds_structs(result, tmp_path):
    content = loadmat(export_mat(result, tmp_path / "r.mat"), simplify_cells=True)
    assert np.array_equal(content["signals"]["mass"]["x"], result.signals["mass.x"])
    assert content["units"]["spring"]["f"] == "N" and content["outcome"] == "bounded"
