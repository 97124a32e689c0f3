"""Time and memory of commands over the number of rows of a recording of three joints.

    python -m tests.benchmarks.recording_size [COMMAND ...] [--rows N ...] [--kind SUFFIX ...]

COMMAND: `read`, `data`, `identify`, `close-loop` (default: `read` and `identify`); rows: 50,000, 200,000, 800,000 and
1,500,000; kind of file: csv and parquet (also npz, mat, h5). Each run is a process of its own; its processor time and
its largest memory are those that the operating system counted.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from cosim.arm import dynamics
from cosim.arm.parameters import parameter_set
from cosim.identification.excitation import taati
from cosim.identification.regressor import friction_columns

ROWS = (50_000, 200_000, 800_000, 1_500_000)
STEP, COUNT, NOISE = 0.001, 2 * np.pi / 20000, 1e-3  # s, rad, N m
READ = "import sys, cosim; cosim.read(sys.argv[1])"


def columns(rows: int) -> dict[str, np.ndarray]:
    """A PHANToM moved by Taati's excitation: time, q1..q3, tau1..tau3 (rows,)."""
    t = STEP * np.arange(rows)
    rng, vector, excitation = np.random.default_rng(0), parameter_set("UR").vector, taati(duration=60.0)
    q, tau = np.empty((rows, 3)), np.empty((rows, 3))
    for part in np.array_split(np.arange(rows), max(rows // 50_000, 1)):
        place, dq, ddq = excitation.motion(t[part])
        y = np.concatenate([dynamics.regressor(place, dq, ddq), friction_columns(dq, 0.01)], axis=2)
        q[part], tau[part] = place, y @ vector
    q = np.round(q / COUNT) * COUNT
    tau += NOISE * rng.normal(size=tau.shape)
    return {"time": t, **{f"q{k + 1}": q[:, k] for k in range(3)}, **{f"tau{k + 1}": tau[:, k] for k in range(3)}}


def written(table: dict[str, np.ndarray], path: Path) -> Path:
    """The table in a file of the kind that the suffix names."""
    if path.suffix == ".npz":
        np.savez(path, **table)
    elif path.suffix == ".h5":
        import h5py

        with h5py.File(path, "w") as file:
            for name, values in table.items():
                file[name] = values
    elif path.suffix == ".mat":
        from scipy.io import savemat

        savemat(path, table)
    else:
        import pyarrow as pa
        from pyarrow import csv, parquet

        write = parquet.write_table if path.suffix == ".parquet" else csv.write_csv
        write(pa.table(table), path)
    return path


def measured(arguments: list[str], folder: Path) -> tuple[float, float, float, int]:
    """Elapsed and processor time [s], largest memory [GB] and exit code of a Python process."""
    begin = time.perf_counter()
    with (folder / "output").open("wb") as output:
        streams = [(os.POSIX_SPAWN_DUP2, output.fileno(), 1), (os.POSIX_SPAWN_DUP2, output.fileno(), 2)]
        child = os.posix_spawn(sys.executable, [sys.executable, *arguments], os.environ, file_actions=streams)
        _, status, usage = os.wait4(child, 0)
    elapsed = time.perf_counter() - begin
    return elapsed, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024 / 1e9, os.waitstatus_to_exitcode(status)


def called(command: str, file: Path, folder: Path) -> list[str]:
    """Arguments of Python for a command on a file."""
    return ["-c", READ, str(file)] if command == "read" else ["-m", "cosim", command, str(file), "--out", str(folder)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commands", nargs="*", default=["read", "identify"])
    parser.add_argument("--rows", nargs="+", type=int, default=ROWS)
    parser.add_argument("--kind", nargs="+", default=["csv", "parquet"])
    given = parser.parse_args()
    print("| command | file | rows | elapsed [s] | processor [s] | memory [GB] | exit |\n|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        for rows in given.rows:
            table = columns(rows)
            for kind in given.kind:
                file = written(table, Path(name) / f"recording.{kind}")
                for command in given.commands:
                    elapsed, processor, memory, code = measured(called(command, file, Path(name)), Path(name))
                    row = f"{elapsed:.1f} | {processor:.1f} | {memory:.2f} | {code}"
                    print(f"| {command} | {kind} | {rows:,} | {row} |", flush=True)
                file.unlink()


if __name__ == "__main__":
    main()
