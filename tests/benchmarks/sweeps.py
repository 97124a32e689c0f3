"""What sweeps cost: kernel against the fmpy loop, a second core, a map by brute force, a traced boundary, start-up,
commands.

    python -m tests.benchmarks.sweeps [--quick] [--agree] [--kernel] [--traced]

Processor seconds, so that a busy machine troubles all alike; wall-clock time beside where a user waits for it.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cosim.analysis.twin import twin_of
from cosim.analysis.verdict import judge
from cosim.engine.master import run
from cosim.fmu import open_system
from cosim.scenario import load_scenario
from cosim.sweeps import kernel
from cosim.sweeps.evaluate import EVALUATORS, _signals, setup, simulation
from cosim.sweeps.lane_refusal import lane_refusal
from cosim.sweeps.points import Point, PointResult
from cosim.sweeps.pool import LocalPool, Task
from tests.benchmarks.engines import Workload, figure, fmpy_lists, machine, timed

PAPER = {
    "experiment.stop": 20.0,
    "arm_*.q_start": [0.0, 0.0, 0.0],
    "operator.amplitude": 0.0,
    "arm_l.dq_start": [0.01, 0.01, 0.01],
    "arm_r.dq_start": [-0.01, -0.01, -0.01],
}
SPEC = """
format = 1
title = "benchmark"
description = "gain against delay, the paper's loop, 20 s"
scenario = "sallam-nodelay"
{level}
[set]
"experiment.stop" = 20.0
"arm_*.q_start" = [0.0, 0.0, 0.0]
"operator.amplitude" = 0.0
"arm_l.dq_start" = [0.01, 0.01, 0.01]
"arm_r.dq_start" = [-0.01, -0.01, -0.01]
[[axes]]
name = "stiffness"
unit = "N/m"
paths = ["controller_*.stiffness"]
low = 0.1
high = 1.0
{count}
[[axes]]
name = "delay"
unit = "s"
paths = ["channel_*.delay_mean"]
low = 0.05
high = 0.8
{count}
{design}
"""


def parts(rounds: int, folder: Path) -> list[tuple[str, float]]:
    """Milliseconds of processor time of the parts of a sweep's point, and of the fmpy loop on the same scenario."""
    base = load_scenario("sallam-nodelay").with_values(PAPER)
    loop = fmpy_lists(
        Workload(base.with_values({"experiment.algorithm": "jacobi", "experiment.extrapolation": "hold"}), folder)
    )
    found: dict[str, list[float]] = {}
    with open_system(base) as system:
        wirings = [system.wiring(base.with_values(dict(p.values))) for p in places(kernel.lanes())]
        record = _signals(wirings[0])
        twins = kernel.run_batch([system.wiring(twin_of(w)) for w in wirings], record)
        run(base, system)
        for _ in range(rounds):

            def note(name, seconds):
                return found.setdefault(name, []).append(1e3 * seconds)

            note("fmpy loop, one get and set per FMU", loop())
            note("compiled co-simulation", timed(lambda: run(base, system, record=record)))
            began = time.process_time()
            results = kernel.run_batch(wirings, record)
            note("batch kernel, per scenario", (time.process_time() - began) / len(wirings))
            note("verdict (judge)", timed(lambda: [judge(*pair) for pair in zip(results, twins)]) / len(wirings))
            short = base.with_values({"experiment.stop": 0.001})
            run(short, system)
            note("start of a repeated run", timed(lambda: [run(short, system) for _ in range(20)]) / 20)
    return [(name, statistics.median(values)) for name, values in found.items()]


def places(count: int) -> list[Point]:
    """Points of the map, gain and delay different in each."""
    rng = np.random.default_rng(1)
    gains, delays = np.linspace(0.1, 1.0, count), rng.permutation(np.linspace(0.05, 0.8, count))
    return [
        Point((), (("controller_*.stiffness", float(k)), ("channel_*.delay_mean", float(d))))
        for k, d in zip(gains, delays)
    ]


def batch(task: Task, points: Sequence[Point]) -> list[PointResult]:
    """An evaluator that runs the kernel alone."""
    wired = [setup(task, point).wiring for point in points]
    return [PointResult(result.outcome.value) for result in kernel.run_batch(wired, _signals(wired[0]))]


FRICTION = {
    "stribeck": 0.002,
    "stribeck_velocity": 0.05,
    "coulomb": 0.002,
    "hysteresis": 0.003,
    "hysteresis_length": 0.02,
}
OVERTAKING = {
    "law": "uniform",
    "delay_min": 0.01,
    "delay_max": 0.1,
    "delay_interval": 0.02,
    "semantics": "newest_packet",
}
LOSSY = OVERTAKING | {"loss_to_bad": 0.01, "loss_to_good": 0.2}
KINDS: dict[str, tuple[str, dict[str, object], list[str]]] = {
    "the paper's loop": ("sallam-nodelay", PAPER, ["controller_*.stiffness"]),
    "contact: hand and wall": ("contact", {"experiment.stop": 20.0}, ["controller_*.stiffness"]),
    "contact, one internal step": (
        "contact",
        {"experiment.stop": 20.0, "arm_*.internal_steps": 1, "operator.internal_steps": 1},
        ["controller_*.stiffness"],
    ),
    "Stribeck and hysteresis": (
        "sallam-nodelay",
        PAPER | {f"arm_*.{k}": v for k, v in FRICTION.items()},
        ["arm_*.payload"],
    ),
    "newest packet, seeds": ("sallam-stable", {f"channel_*.{k}": v for k, v in OVERTAKING.items()}, ["channel_*.seed"]),
    "newest packet, seeds, losses": (
        "sallam-stable",
        {f"channel_*.{k}": v for k, v in LOSSY.items()},
        ["channel_*.seed"],
    ),
    "PD+d, hand and wall": ("controllers", {}, ["channel_*.delay_mean"]),
    "waves, hand and wall": ("controllers", {"controller_*.model": "WaveController"}, ["channel_*.delay_mean"]),
    "two arms of seven joints": ("panda", {}, ["channel_*.delay_mean"]),
    "PHANToM, arm of seven joints": ("phantom-panda", {}, ["channel_*.delay_mean"]),
}
"""Kinds of scenarios that the kernel runs: a scenario, values, the path that differs from lane to lane."""


def kernel_against_cosimulation(rounds: int) -> list[tuple[str, float, float, float, bool]]:
    """Of each kind: processor ms of a run of 20 s in the kernel and in the compiled co-simulation, the median ratio of
    interleaved rounds, whether a lane has the bits of the FMUs.
    """
    rows = []
    for kind, (name, values, paths) in KINDS.items():
        base = load_scenario(name).with_values(values | {"experiment.stop": 20.0, "experiment.record_every": 5})
        with open_system(base) as system:
            start = {
                "controller_*.stiffness": 0.25 if "contact" not in kind else 150.0,
                "arm_*.payload": 0.01,
                "channel_*.delay_mean": 0.05,
            }
            count = 2 * kernel.lanes()

            def lane(k):
                return base.with_values({p: k + 1 if "seed" in p else start[p] * (1.0 + 0.01 * k) for p in paths})

            lanes = [lane(k) for k in range(count)]
            wirings = [system.wiring(one) for one in lanes]
            record = _signals(wirings[0])
            assert lane_refusal(wirings[0], record) is None, kind
            found, whole = kernel.run_batch(wirings, record)[1], run(lanes[1], system, record=record)
            same = all(found.signals[n].tobytes() == whole.signals[n].tobytes() for n in found.signals)
            times = []
            for round_ in range(1, rounds + 1):  # of seeds that no round had before, whose delays are not known yet
                fresh = [system.wiring(lane(k + round_ * count if "seed" in paths[0] else k)) for k in range(count)]
                ours = timed(lambda: kernel.run_batch(fresh, record)) / count
                times.append((ours, timed(lambda: run(lanes[1], system, record=record))))
        ours, theirs = (1e3 * statistics.median(some) for some in zip(*times))
        rows.append((kind, ours, theirs, statistics.median(slow / fast for fast, slow in times), same))
    return rows


def cores(evaluator: str, rounds: int) -> float:
    """How many times the points a second that two worker processes do of what one does, by the clock, shortest rounds
    of each.
    """
    task, points = Task(evaluator, "sallam-nodelay", PAPER), places(12 * kernel.lanes())
    with LocalPool(1) as one, LocalPool(2) as two:
        walls: dict[LocalPool, list[float]] = {one: [], two: []}
        for _ in range(rounds):
            for workers, some in walls.items():
                began = time.perf_counter()
                for _ in workers.answers(task, points, kernel.lanes()):
                    pass
                some.append(time.perf_counter() - began)
    return min(walls[one]) / min(walls[two])


def command(*words: str) -> tuple[float, float]:
    """Wall-clock and processor seconds of a command, its workers included; it may keep compiled Python files, as
    installed it has them.
    """
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, "-m", "cosim", *words], check=True, capture_output=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.perf_counter() - began, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def repeated(count: int, folder: Path, *words: str) -> tuple[float, float, float, float]:
    """Wall-clock seconds of a command, median, least and most of `count` runs after a first one, and median processor
    seconds.

    {out} among the words is a folder of each run's own.
    """
    runs = [
        command(*(word.format(out=folder / f"{words[0]}-{k}-{time.monotonic_ns()}") for word in words))
        for k in range(count + 1)
    ][1:]
    wall, processor = zip(*runs)
    return statistics.median(wall), min(wall), max(wall), statistics.median(processor)


BOUNDARY = {"count": "", "design": '[boundary]\ntrace = ["stiffness", "delay"]\ncells = 6'}
SWEPT = ("--workers", "2", "--no-report", "--out", "{out}")


def traced(folder: Path) -> tuple[str, float, float, float, float]:
    """The boundary traced with `sign_level`, fifteen times."""
    (folder / "traced.toml").write_text(SPEC.format(level="sign_level = 0.95", **BOUNDARY))
    return "boundary traced, two workers", *repeated(15, folder, "sweep", str(folder / "traced.toml"), *SWEPT)


def commands(folder: Path, count: int) -> list[tuple[str, float, float, float, float]]:
    grid = {"count": f"count = {count}", "design": "[grid]"}
    (folder / "map.toml").write_text(SPEC.format(level="sign_level = 0.95", **grid))
    (folder / "whole.toml").write_text(SPEC.format(level="", **grid))
    (folder / "whole_traced.toml").write_text(SPEC.format(level="", **BOUNDARY))
    return [
        ("cosim --help", *repeated(9, folder, "--help")),
        (
            "cosim run, 20 s, no report",
            *repeated(
                9, folder, "run", "sallam-stable", "--set", "experiment.stop=20", "--no-report", "--out", "{out}"
            ),
        ),
        traced(folder),
        ("the same, every run to its end", *repeated(5, folder, "sweep", str(folder / "whole_traced.toml"), *SWEPT)),
        (f"map {count} x {count}, two workers", *repeated(3, folder, "sweep", str(folder / "map.toml"), *SWEPT)),
        ("the same, every run to its end", *repeated(3, folder, "sweep", str(folder / "whole.toml"), *SWEPT)),
    ]


def contradictions(count: int) -> tuple[int, int, list[str]]:
    """Points of the map; those whose signs agree with and without `sign_level`; the others whose interval, run to the
    end, leaves out zero.
    """
    base = {"evaluator": EVALUATORS["simulation"], "scenario": "sallam-nodelay", "set": PAPER}
    gains, delays = np.linspace(0.1, 1.0, count), np.linspace(0.05, 0.8, count)
    agreed, wrong = 0, []
    for k in gains:
        points = [Point((), (("controller_*.stiffness", float(k)), ("channel_*.delay_mean", float(d)))) for d in delays]
        pairs = zip(points, simulation(Task(**base), points), simulation(Task(**base, sign_level=0.95), points))
        for point, whole, early in pairs:
            same = whole.growth_rate * early.growth_rate > 0
            agreed += same
            if not same and not whole.low <= 0.0 <= whole.high:
                wrong.append(f"{point.values}: {whole.growth_rate:.4g} and {early.growth_rate:.4g} 1/s")
    return count**2, agreed, wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a 20 x 20 map and two rounds")
    parser.add_argument("--agree", action="store_true", help="whether runs that end early have the signs of whole ones")
    parser.add_argument("--kernel", action="store_true", help="kinds of scenarios in the kernel, beside co-simulation")
    parser.add_argument("--traced", action="store_true", help="the traced boundary alone, by the clock")
    given = parser.parse_args()
    quick = given.quick
    if given.kernel:
        print("| 20 s of | kernel, ms | compiled co-simulation, ms | ratio | same bits |\n|---|---|---|---|---|")
        for kind, *figures, same in kernel_against_cosimulation(3 if quick else 9):
            print(f"| {kind} | {' | '.join(map(figure, figures))} | {'yes' if same else 'NO'} |", flush=True)
        return
    if given.agree:
        points, agreed, wrong = contradictions(20 if quick else 50)
        print(
            f"{points} points, {agreed} signs agree, {len(wrong)} contradict the interval of the whole run",
            *wrong,
            sep="\n",
        )
        return
    if given.traced:
        with tempfile.TemporaryDirectory(prefix="cosim-bench-") as name:
            what, *figures = traced(Path(name))
        median, least, most, processor = (f"{x:.2f} s" for x in figures)
        print(f"{machine()}\n{what}: {median} ({least} to {most}), processor {processor}")
        return
    print(f"{machine()}{', `--quick`' if quick else ''}\n")
    with tempfile.TemporaryDirectory(prefix="cosim-bench-") as name:
        rows = parts(2 if quick else 5, Path(name))
        loop = dict(rows)["fmpy loop, one get and set per FMU"]
        print("| per 20 s scenario | processor ms | the fmpy loop takes times |\n|---|---|---|")
        for part, value in rows:
            print(f"| {part} | {figure(value)} | {figure(loop / value)} |")
        print("\n| points a second, two worker processes against one | times |\n|---|---|")
        for what, evaluator in (
            ("kernel alone", f"{Path(__file__).resolve()}:batch"),
            ("kernel, twin, verdict", EVALUATORS["simulation"]),
        ):
            print(f"| {what} | {figure(cores(evaluator, 3 if quick else 12))} |", flush=True)
        print("\n| command | wall-clock s, median | least | most | processor s |\n|---|---|---|---|---|", flush=True)
        for words, *figures in commands(Path(name), 20 if quick else 50):
            print(f"| {words} | {' | '.join(f'{x:.2f}' for x in figures)} |", flush=True)
    os._exit(0)


if __name__ == "__main__":
    main()
