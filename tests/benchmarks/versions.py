"""Whether a version is slower than the one before: batch kernel, compiled loop, `cosim run`, in turns.

    python -m tests.benchmarks.versions OLD NEW [--only kernel] [--avx2]

OLD and NEW are folders with the project, both run by this Python. One process of each version stays alive and does the
same work in turns, so that a busy machine troubles both alike; some pairs of processes, since where one lies in memory
makes it faster or slower. Printed: medians of the processor time, and the median of the ratios of the turns with the
interval that holds the true one in 95 of 100 measurements.
"""

import argparse
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

COMMAND = "cosim run"
WORKER = """
import sys
import time
from cosim.engine.master import run
from cosim.fmu import open_system
from cosim.scenario import load_scenario
from cosim.sweeps import kernel

if "avx2" in sys.argv:
    from numpy._core._multiarray_umath import __cpu_features__ as has
    has["AVX512F"] = False

POINTS = {
    "channel_*.law": "constant", "operator.amplitude": 0.0, "arm_*.q_start": [0.0] * 3,
    "arm_l.dq_start": [0.01] * 3, "arm_r.dq_start": [-0.01] * 3,
}

def scenario(name, stop, **values):
    return load_scenario(name).with_values({"experiment.stop": stop, "experiment.record_every": 20} | values)

def batch(name):
    places = [{"controller_*.stiffness": 0.1 + 0.06 * i, "channel_*.delay_mean": 0.8 - 0.05 * i} for i in range(16)]
    return [system.wiring(scenario(name, 20.0, **POINTS, **place)) for place in places]

with open_system(scenario("sallam-stable", 20.0)) as system:
    record = ["arm_l.q", "arm_r.x", "controller_r.f"]
    lanes = batch("sallam-stable")
    single = scenario("sallam-stable", 10.0)
    work = {"kernel": lambda: kernel.run_batch(lanes, record), "loop": lambda: run(single, system, record=record)}
    for action in work.values():
        action()
    print("ready", flush=True)
    for line in sys.stdin:
        began = time.process_time()
        work[line.strip()]()
        print(time.process_time() - began, flush=True)
"""


class Version:
    """A version of the project in its folder, and a process of it that waits for work. vectors: "avx2", or what is
    widest here.
    """

    def __init__(self, home: Path, *vectors: str) -> None:
        self.home = home
        words = [sys.executable, "-c", WORKER, *vectors]
        self.process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=home)
        if self._answer() != "ready":
            raise SystemExit(f"{home}: the worker did not start")

    def _answer(self) -> str:
        return self.process.stdout.readline().strip() if self.process.stdout else ""

    def seconds(self, what: str) -> float:
        """Processor seconds of a piece of the worker's work."""
        if self.process.stdin:
            self.process.stdin.write(f"{what}\n")
            self.process.stdin.flush()
        return float(self._answer())

    def command(self) -> float:
        """Processor seconds of `cosim run`; it may keep compiled Python files, as installed it has them."""
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        with tempfile.TemporaryDirectory() as folder:
            words = ["run", "sallam-stable", "--set", "experiment.stop=4", "--no-report", "--out", folder]
            command = [sys.executable, "-m", "cosim", *words]
            subprocess.run(command, check=True, capture_output=True, cwd=self.home, env=environment)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def close(self) -> None:
        self.process.communicate()


def rounds(versions: tuple[Version, Version], what: str, count: int) -> list[tuple[float, float]]:
    """Seconds of both versions in turns, who begins in turns too."""
    found = []
    for turn in range(count):
        order = versions[:: -1 if turn % 2 else 1]
        seconds = {v: v.command() if what == COMMAND else v.seconds(what) for v in order}
        found.append((seconds[versions[0]], seconds[versions[1]]))
    return found


def row(pairs: list[tuple[float, float]]) -> str:
    """Medians [ms], median ratio and its interval (order statistics, binomial)."""
    ratios, n = sorted(new / old for old, new in pairs), len(pairs)
    reach = math.ceil(0.98 * math.sqrt(n))
    low, high = ratios[max(0, n // 2 - reach)], ratios[min(n - 1, n // 2 + reach)]
    medians = [1e3 * statistics.median(found) for found in zip(*pairs)]
    return f"{medians[0]:9.2f} {medians[1]:9.2f} {statistics.median(ratios):7.3f} ({low:.3f} .. {high:.3f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("old", type=Path, help="folder of the version before")
    parser.add_argument("new", type=Path, help="folder of the version after")
    parser.add_argument("--rounds", type=int, default=12, help="turns of a pair of processes")
    parser.add_argument("--pairs", type=int, default=4)
    parser.add_argument("--only", choices=["kernel", "loop"], help="16 points of a map in the kernel, or the loop")
    parser.add_argument("--avx2", action="store_true", help="the kernel as on a machine without AVX-512")
    options = parser.parse_args()
    works = [options.only] if options.only else ["kernel", "loop", COMMAND]
    found: dict[str, list[tuple[float, float]]] = {what: [] for what in works}
    vectors = ["avx2"] if options.avx2 else []
    for _ in range(options.pairs):
        versions = Version(options.old.absolute(), *vectors), Version(options.new.absolute(), *vectors)
        for what, some in found.items():
            some += rounds(versions, what, options.rounds)
        for version in versions:
            version.close()
    print(f"{'processor time':20s} {'old ms':>9s} {'new ms':>9s}   ratio (95 %)")
    for what, some in found.items():
        print(f"{what:20s} {row(some)}")


if __name__ == "__main__":
    main()
