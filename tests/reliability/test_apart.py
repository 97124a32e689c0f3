"""Files that crash or stop their library: one clear error, and this process lives on."""

import os
import signal
from pathlib import Path

import h5py
import numpy as np
import pytest

import cosim
from cosim import apart
from cosim.apart import UnreadableError, read_apart
from cosim.errors import InputError, Problem
from cosim.measured import hdf5
from cosim.results import files

pytestmark = [pytest.mark.needs("proc"), pytest.mark.usefixtures("children_crash")]  # of systems that fork


@pytest.fixture
def path(tmp_path) -> Path:
    """A good file."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = np.arange(400) * 1e-3
    return tmp_path / "a.h5"


def test_what_is_read_comes_back_to_the_bit(path):
    arrays = [
        np.array([1.5, np.nan, -0.0, np.inf]),
        np.arange(6, dtype=">i2").reshape(2, 3).T,
        np.array([2**64 - 1], np.uint64),
        np.array(["é", "abc"]),
        np.array([b"x", b""]),
        np.array(["2024-06-10T06:13:20.002"], "datetime64[ns]"),
        np.array([True, False]),
        np.zeros((0, 3)),
        np.array(2.5, np.longdouble),
    ]
    given = {"arrays": arrays, "é": [None, 1, 2.5, "a", float("inf")], "number": np.float64(0.1)}
    found = read_apart(lambda: given, path)
    assert {key: found[key] for key in ("é", "number")} == {key: given[key] for key in ("é", "number")}
    for one, other in zip(arrays, found["arrays"], strict=True):
        assert one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()


def test_what_the_reader_says_is_said_here(path):
    problem = Problem("a", "b", "c", "d")

    def refuses():
        raise InputError(problem)

    def fails():
        raise KeyError("no such thing")

    with pytest.raises(InputError) as caught:
        read_apart(refuses, path)
    assert caught.value.problems == (problem,)
    with pytest.raises(UnreadableError, match="damaged .KeyError: 'no such thing'"):
        read_apart(fails, path)
    with pytest.raises(UnreadableError, match="an array of object"):
        read_apart(lambda: np.array([path]), path)


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL])
def test_a_crash_is_told(path, number):
    with pytest.raises(UnreadableError, match=f"library crashes .signal {signal.Signals(number).name}"):
        read_apart(lambda: os.kill(os.getpid(), number), path)


def test_a_library_that_does_not_end_is_ended(path, monkeypatch):
    def busy():
        while True:
            pass

    monkeypatch.setattr(apart, "LEAST", 0.1)
    with pytest.raises(UnreadableError, match="does not end .1 s of processor time"):
        read_apart(busy, path)
    monkeypatch.setattr(apart, "WAITING", 0.5)
    with pytest.raises(UnreadableError, match="hangs"):
        read_apart(lambda: signal.pause(), path)


def test_a_file_that_asks_for_more_memory_than_there_is_is_refused(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("t", (2**45,), "f4", chunks=(1024,))
    with pytest.raises(InputError, match="a.h5: /t: expected an array that can be read, got .*MemoryError"):
        hdf5.read_hdf5(tmp_path / "a.h5").columns["/t"]


def test_recordings_and_results_that_crash_hdf5_are_bad_input(path, monkeypatch):
    def crash(*_):
        os.kill(os.getpid(), signal.SIGSEGV)

    monkeypatch.setattr(hdf5, "_listed", crash)
    with pytest.raises(cosim.InputError, match="a.h5: expected an HDF5 file, got one on which its library crashes"):
        cosim.read(path)
    for name, read in {"_stored": files.read_h5, "_columns": files.read_table, "_starts": files.read_starts}.items():
        monkeypatch.setattr(files, name, crash)
        with pytest.raises(cosim.InputError, match="of cosim, got one on which its library crashes .signal SIGSEGV"):
            read(path)
