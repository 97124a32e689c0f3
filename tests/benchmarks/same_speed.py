"""Whether a version of the project computes the shipped scenarios as fast as another.

    python -m tests.benchmarks.same_speed OLD/.venv/bin/cosim NEW/.venv/bin/cosim [--times 7] [--only TEXT]

`cosim run SCENARIO --no-report`, both versions in turn on the same machine, so that its load is the same for both: of
the scenario as it is, and of one that is `LONGER` times as long. What the longer one takes more is the co-simulation
with its twin and verdict; what is left of the shorter one is the start of the command. Medians and their ratios; the
last line is that of all scenarios together, and the exit code is 1 where its ratio of the co-simulation, of the whole
command's processor time or of its elapsed time is above 1.02. FMUs and Python's bytecode are compiled before, by a run
that does not count: an installed program finds both.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import cosim
from tests.benchmarks.same_bits import shipped

MOST = 1.02
LONGER = 6
PARTS = ("simulated", "start", "processor", "elapsed")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("old", type=Path, help="`cosim` of the version before")
    parser.add_argument("new", type=Path, help="`cosim` of the version after")
    parser.add_argument("--times", type=int, default=7, help="runs of each")
    parser.add_argument("--only", default="", help="scenarios whose name contains this text")
    options = parser.parse_args()
    found = []
    print(f"{'s':28s}" + "".join(f"{part + ': old':>16s} {'new':>7s} {'ratio':>6s}" for part in PARTS))
    with tempfile.TemporaryDirectory() as folder:
        for scenario in (name for name in shipped(options.old) if options.only in name):
            found.append(measured((options.old, options.new), scenario, options.times, Path(folder)))
            print(row(scenario, found[-1]), flush=True)
    whole = np.sum(found, axis=0)
    print(row(f"all {len(found)}", whole))
    judged = whole[[part != "start" for part in PARTS]]
    return int(bool(np.any(judged[:, 1] / judged[:, 0] > MOST)))


def measured(programs: tuple[Path, Path], scenario: str, times: int, folder: Path) -> np.ndarray:
    """Medians [s] of `PARTS`, (4, 2), each old and new: processor time of the co-simulation, of the start and of the
    whole command at the scenario's own length, and the command's elapsed time.
    """
    stop = cosim.load(scenario).experiment.stop
    commands = [
        [
            str(program),
            "run",
            scenario,
            "--no-report",
            "--out",
            str(folder),
            "--set",
            f"experiment.stop={factor * stop}",
        ]
        for program in programs
        for factor in (1, LONGER)
    ]
    for command in commands:
        spent(command)
    seconds = np.array([[spent(command) for command in commands] for _ in range(times)]).reshape(times, 2, 2, 2)
    short, longer = seconds[:, :, 0, 0], seconds[:, :, 1, 0]
    simulated = np.median(longer - short, axis=0) / (LONGER - 1)
    whole = np.median(seconds[:, :, 0], axis=0)
    return np.array([simulated, whole[:, 0] - simulated, whole[:, 0], whole[:, 1]])


def spent(command: list[str]) -> tuple[float, float]:
    """Processor time [s] of a command and of its children, and its elapsed time."""
    begin = time.perf_counter()
    settings = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    process = subprocess.Popen(command, env=settings, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    return used.ru_utime + used.ru_stime, time.perf_counter() - begin


def row(name: str, seconds: np.ndarray) -> str:
    """A line for the medians of `measured`."""
    return f"{name:28s}" + "".join(f"{old:16.3f} {new:7.3f} {new / old:6.3f}" for old, new in seconds)


if __name__ == "__main__":
    sys.exit(main())
