"""Baseline: communication steps per second of the running system, for later comparison.

    python tests/benchmarks/steps_per_second.py [--seconds 20] [--rounds 5]

Medians over interleaved rounds of sallam-nodelay (two arms, two controllers, two channels, operator; 1 ms), all signals
recorded at every step, FMUs loaded once; the time is that of the run alone, initialisation included.
"""

import argparse
import platform
import statistics
import time

from cosim.compiled import execute as compiled
from cosim.execution import execute as python
from cosim.fmu import open_system
from cosim.master import run
from cosim.scenario import load_scenario, with_parameters

VARIANTS = [
    (
        f"{name}, FMI {fmi}, {algorithm}, {extrapolation}",
        executor,
        {"experiment.fmi": fmi, "experiment.algorithm": algorithm, "experiment.extrapolation": extrapolation},
    )
    for name, executor in (("Python executor", python), ("compiled executor", compiled))
    for fmi, algorithm, extrapolation in (
        (2, "gauss-seidel", "linear"),
        (2, "gauss-seidel", "hold"),
        (2, "jacobi", "hold"),
        (3, "gauss-seidel", "linear"),
    )
]


def measure(seconds: float, rounds: int) -> dict[str, list[float]]:
    """Wall-clock time [s] of each round of each variant."""
    base = with_parameters(load_scenario("sallam-nodelay"), {"experiment.stop": seconds, "experiment.record_every": 1})
    times: dict[str, list[float]] = {name: [] for name, _, _ in VARIANTS}
    systems = {fmi: open_system(with_parameters(base, {"experiment.fmi": fmi})) for fmi in (2, 3)}
    for _ in range(rounds + 1):
        for name, executor, values in VARIANTS:
            scenario = with_parameters(base, values)
            began = time.perf_counter()
            run(scenario, systems[values["experiment.fmi"]], executor=executor)
            times[name].append(time.perf_counter() - began)
    for system in systems.values():
        system.close()
    return {name: values[1:] for name, values in times.items()}  # the first round loads and builds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    print(
        f"{time.strftime('%Y-%m-%d')}, {platform.processor() or platform.machine()}, Python {platform.python_version()}"
    )
    print("| variant | steps/s | us/step | times real time |\n|---|---|---|---|")
    for name, values in measure(arguments.seconds, arguments.rounds).items():
        median, steps = statistics.median(values), arguments.seconds * 1000
        print(f"| {name} | {steps / median:.3g} | {median / steps * 1e6:.3g} | {arguments.seconds / median:.3g} |")


if __name__ == "__main__":
    main()
