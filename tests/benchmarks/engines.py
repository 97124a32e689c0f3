"""Our executors beside other ways to run the same FMUs, microseconds per communication step of the whole system.

    python -m tests.benchmarks.engines [--seconds 20] [--rounds 5] [--only tiny|real]

Jacobi with held inputs and a step of 1 ms, which every engine can do; medians of interleaved rounds and of each round's
ratio to
the hand-written C master, in processor time, so that a busy machine troubles all alike. FMUs are loaded before; what is
timed is
the stepping loop (of our executors: the whole repeated run, start and result included; of libcosim, which steps in
threads, all
of them). Engines that are not installed are left out (extra `bench`).
"""

import argparse
import ctypes
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from cosim.engine.master import run
from cosim.engine.reference import execute as in_python
from cosim.exports.container import write_container
from cosim.exports.structure import component_fmus, write_ssp
from cosim.fmu import descriptions, extracted, open_system
from cosim.scenario import load_scenario, load_text
from cosim.wiring import wire
from tests.benchmarks.tiny import tiny_scenario

HERE = Path(__file__).parent
_KEPT: list = []  # instances live as long as the process
Runner = Callable[[], float]
"""Runs once and returns the seconds that the loop took."""


class Workload:
    """A wired system: its FMUs with start values compiled in, and who feeds whom."""

    def __init__(self, scenario, folder: Path) -> None:
        self.scenario, self.folder = scenario, folder
        self.wiring = wire(scenario, descriptions(scenario))
        self.steps = scenario.experiment.steps
        self.fmus = component_fmus(self.wiring)
        self.names = list(scenario.components)
        place = {name: i for i, name in enumerate(self.wiring.signals)}
        source = {str(link.target): place[str(link.source)] for link in self.wiring.links}
        self.inputs = {n: list(self.wiring.inputs(n)) for n in self.names}
        self.sources = {n: [source[f"{n}.{v}"] for v in self.inputs[n]] for n in self.names}
        self.outputs = {n: self.wiring.outputs(n) for n in self.names}

    def reference(self, name: str, variable: str) -> int:
        return self.wiring.descriptions[name].variables[variable].reference


def timed(action: Callable[[], object]) -> float:
    """Processor seconds of this thread: a busy machine takes time away, not processor time. What the action gives is
    freed after.
    """
    began = time.thread_time()
    result = action()
    took = time.thread_time() - began
    del result
    return took


# --- ways to run ------------------------------------------------------------------------------------------------------


def ours(case: Workload, executor=None) -> Runner:
    system = open_system(case.scenario)
    run(case.scenario, system, executor=executor)
    return lambda: timed(lambda: run(case.scenario, system, executor=executor))


def loaded(case: Workload, name: str):
    """An instance by fmpy, out of initialisation."""
    from fmpy import read_model_description
    from fmpy.fmi2 import FMU2Slave

    description = read_model_description(str(case.fmus[name]), validate=False)
    fmu = FMU2Slave(
        guid=description.guid,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName=name,
        unzipDirectory=str(extracted(case.fmus[name])),
    )
    fmu.instantiate()
    return fmu


def initialised(case: Workload):
    fmus = {name: loaded(case, name) for name in case.names}
    return fmus, partial(_restart, fmus)


def _restart(fmus) -> None:
    for fmu in fmus.values():
        fmu.reset()
        fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()


def fmpy_lists(case: Workload) -> Runner:
    """The straightforward loop: one setReal, doStep, getReal with lists per FMU and step."""
    fmus, restart = initialised(case)
    ins = {n: [case.reference(n, v) for v in case.inputs[n]] for n in case.names}
    outs = {n: [case.reference(n, v) for v in case.outputs[n]] for n in case.names}

    def loop(steps=case.steps) -> float:
        restart()
        values = [v for n in case.names for v in fmus[n].getReal(outs[n])]
        rows, began = [values], time.thread_time()
        for step in range(steps):
            for n in case.names:
                if ins[n]:
                    fmus[n].setReal(ins[n], [values[i] for i in case.sources[n]])
            for n in case.names:
                fmus[n].doStep(currentCommunicationPoint=step * 1e-3, communicationStepSize=1e-3)
            values = [v for n in case.names for v in fmus[n].getReal(outs[n])]
            rows.append(values)
        return time.thread_time() - began

    return shortened(case, loop)


def fmpy_variables(case: Workload) -> Runner:
    """One getReal and one setReal call per connection, and one getReal per kept signal that none reads."""
    fmus, restart = initialised(case)
    links = [
        (
            link.source.component,
            case.reference(link.source.component, link.source.variable),
            link.target.component,
            case.reference(link.target.component, link.target.variable),
        )
        for link in case.wiring.links
    ]
    read = {(n, r) for n, r, _, _ in links}
    others = [(n, r) for n in case.names for v in case.outputs[n] if (n, r := case.reference(n, v)) not in read]

    def loop(steps=case.steps) -> float:
        restart()
        rows, began = [], time.thread_time()
        for step in range(steps):
            row = []
            for a, source, b, target in links:
                value = fmus[a].getReal([source])
                fmus[b].setReal([target], value)
                row += value
            for fmu in fmus.values():
                fmu.doStep(currentCommunicationPoint=step * 1e-3, communicationStepSize=1e-3)
            for n, reference in others:
                row += fmus[n].getReal([reference])
            rows.append(row)
        return time.thread_time() - began

    return shortened(case, loop)


def shortened(case: Workload, loop) -> Runner:
    """A slow loop measured over a tenth of the steps."""
    steps = max(1, case.steps // 10)
    return lambda: loop(steps) * case.steps / steps


def c_master(case: Workload) -> Runner:
    """tests/benchmarks/master.c: loads the same FMUs by itself and keeps the same signals."""
    from fmpy import read_model_description

    library = compiled("master", case.folder)
    library.run.restype = ctypes.c_double
    folders = {n: extracted(case.fmus[n]) for n in case.names}
    found = {n: read_model_description(str(case.fmus[n]), validate=False) for n in case.names}
    kept: list = []

    def texts(values):
        kept.append((ctypes.c_char_p * len(case.names))(*[str(v).encode() for v in values]))
        return kept[-1]

    def lists(kind, values):
        kept.extend((kind * max(1, len(v)))(*v) for v in values)
        kept.append((ctypes.c_void_p * len(values))(*[ctypes.addressof(a) for a in kept[-len(values) :]]))
        return kept[-1]

    def sizes(values):
        return (ctypes.c_int64 * len(values))(*values)

    refs = {n: [case.reference(n, v) for v in case.inputs[n]] for n in case.names}
    outs = {n: [case.reference(n, v) for v in case.outputs[n]] for n in case.names}
    identifier = {n: found[n].coSimulation.modelIdentifier for n in case.names}
    arguments = (
        len(case.names),
        texts(folders[n] / "binaries" / "linux64" / f"{identifier[n]}.so" for n in case.names),
        texts(found[n].guid for n in case.names),
        texts(case.names),
        texts(f"file://{folders[n]}/resources" for n in case.names),
        sizes([len(refs[n]) for n in case.names]),
        lists(ctypes.c_uint, [refs[n] for n in case.names]),
        lists(ctypes.c_int64, [case.sources[n] for n in case.names]),
        sizes([len(outs[n]) for n in case.names]),
        lists(ctypes.c_uint, [outs[n] for n in case.names]),
        ctypes.c_int64(len(case.wiring.signals)),
        ctypes.c_int64(case.steps),
        ctypes.c_double(1e-3),
    )

    def once() -> float:
        assert kept  # what C points to
        table = np.empty((case.steps + 1, len(case.wiring.signals)))  # fresh memory each time, as a run has
        took = library.run(*arguments, ctypes.c_void_p(table.ctypes.data))
        if took < 0:
            raise SystemExit(f"the C master failed ({took:g})")
        return took

    return once


def compiled(name: str, folder: Path) -> ctypes.CDLL:
    """A C file of this folder as a library, optimised as our own are."""
    from build_fmus.compiler import find_compiler

    library = folder / f"{name}.so"
    command = (
        ["cc"]
        if subprocess.run(["which", "cc"], capture_output=True).returncode == 0
        else list(find_compiler().command)
    )
    subprocess.run(
        [*command, "-O2", "-ffp-contract=off", "-shared", "-fPIC", "-o", str(library), str(HERE / f"{name}.c"), "-ldl"],
        check=True,
    )
    return ctypes.CDLL(str(library))


def container(case: Workload) -> Runner:
    """fmpy's container of the same FMUs, stepped by our compiled loop."""
    path = write_container(case.wiring, case.folder / "container.fmu")
    scenario = load_text(f"""
        format = 1
        connections = []
        [experiment]
        stop = {case.scenario.experiment.stop}
        step = 0.001
        algorithm = "jacobi"
        extrapolation = "hold"
        [components.all]
        fmu = "{path}"
    """)
    system = open_system(scenario)
    run(scenario, system)
    return lambda: timed(lambda: run(scenario, system))


_LIBCOSIM = """
import sys, time
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
log_output_level(CosimLogLevel.ERROR)
execution = CosimExecution.from_ssp_file(sys.argv[1], step_size=1_000_000)
began = time.process_time()
execution.simulate_until(int(sys.argv[2]) * 1_000_000)
print(time.process_time() - began)
"""
_ECOS = """
import sys, time
from ecospy import EcosSimulation
with EcosSimulation(ssp_path=sys.argv[1], step_size=1e-3) as simulation:
    simulation.init()
    began = time.process_time()
    for _ in range(int(sys.argv[2])):
        simulation.step()
    print(time.process_time() - began)
"""


def elsewhere(case: Workload, script: str, path: Path) -> Runner:
    """A tenth of the steps by another engine in a process of its own, nothing kept of the signals."""
    steps = max(1, case.steps // 10)

    def once() -> float:
        done = subprocess.run([sys.executable, "-c", script, str(path), str(steps)], capture_output=True, text=True)
        if done.returncode != 0:
            raise OSError((done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1])
        return float(done.stdout.split()[-1]) * case.steps / steps

    return once


def libcosim(case: Workload) -> Runner:
    import zipfile

    folder = case.folder / "libcosim"
    zipfile.ZipFile(write_ssp(case.wiring, case.folder / "system.ssp")).extractall(folder)
    return elsewhere(case, _LIBCOSIM, folder)


def ecos(case: Workload) -> Runner:
    return elsewhere(case, _ECOS, write_ssp(case.wiring, case.folder / "ecos.ssp"))


def monolith(case: Workload) -> Runner:
    library = compiled("monolith", case.folder)

    def once() -> float:
        table = np.empty((case.steps + 1, 27))
        arguments = ctypes.c_int64(case.steps), ctypes.c_double(1e-3), ctypes.c_void_p(table.ctypes.data)
        return timed(lambda: library.run(*arguments))

    return once


def one_lane(case: Workload) -> Runner:
    """Our batch kernel compiled for one scenario: the same physics without FMI."""
    from build_fmus.library import library_path
    from cosim.sweeps import kernel

    library = kernel.prepared(ctypes.CDLL(str(library_path("kernel", ("-O3", "-fno-math-errno")))))
    usual = kernel._library

    def once() -> float:
        kernel._library = lambda: library
        try:
            began = time.process_time()  # it runs in a thread of its own
            kernel.run_batch(
                [case.wiring], [f"{arm}.{name}" for arm in ("arm_l", "arm_r") for name in ("q", "dq", "x")]
            )
            return time.process_time() - began
        finally:
            kernel._library = usual

    return once


def _tiny_loop(steps: int, h: float, arm) -> np.ndarray:
    """The tiny system in Python: what scipy and numba run; arm(x, force, h) -> x at the end of the step."""
    x, y, tau, ring = np.zeros((2, 6)), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 50, 3))
    f, table = np.array([1.0, 0.5, 0.0]), np.zeros((steps + 1, 27))
    for s in range(steps):
        old, old_y, old_tau, force = x.copy(), y.copy(), tau.copy(), f.copy()
        for k in range(2):
            x[k] = arm(old[k], old_tau[k] + (force if k == 0 else 0.0 * force), h)
            tau[k] = 5.0 * (old_y[1 - k] - old[k, :3]) - 0.1 * old[k, 3:]
            y[k] = ring[k, s % 50]
            ring[k, s % 50] = old[k, :3]
        f[0] = 1.0 if (s + 1) * h < 1.0 else 0.0
        f[1], f[2] = 0.5 * f[0], (s + 1) * h
        table[s + 1, :3] = f
        table[s + 1, 3:15] = x.ravel()
        table[s + 1, 15:21] = tau.ravel()
        table[s + 1, 21:] = y.ravel()
    return table


def with_scipy(case: Workload) -> Runner:
    """scipy's LSODA over each step, the rest in Python."""
    from scipy.integrate import odeint

    def rate(x, t, force):
        return np.concatenate([x[3:], (force - 0.2 * x[3:]) / 0.1])

    def arm(x, force, h):
        return odeint(rate, x, (0.0, h), (force,), rtol=1e-9, atol=1e-12)[1]

    steps = max(1, case.steps // 20)
    return lambda: timed(lambda: _tiny_loop(steps, 1e-3, arm)) * case.steps / steps


_NUMBA = """
import sys
from tests.benchmarks.engines import numba_seconds
print(numba_seconds(int(sys.argv[2])))
"""


def with_numba(case: Workload) -> Runner:
    """The same loop compiled by numba, Runge-Kutta 4, in a process of its own."""
    return elsewhere(case, _NUMBA, Path())


def numba_seconds(steps: int) -> float:
    from numba import njit

    @njit
    def rate(x, force):
        d = np.empty(6)
        d[:3] = x[3:]
        d[3:] = (force - 0.2 * x[3:]) / 0.1
        return d

    @njit
    def arm(x, force, h):
        k1 = rate(x, force)
        k2 = rate(x + 0.5 * h * k1, force)
        k3 = rate(x + 0.5 * h * k2, force)
        k4 = rate(x + h * k3, force)
        return x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)

    loop = njit(_tiny_loop)
    loop(10, 1e-3, arm)
    return timed(lambda: loop(steps, 1e-3, arm))


ENGINES: dict[str, Callable[[Workload], Runner]] = {
    "hand-written C master (dlopen)": c_master,
    "ours, compiled (default)": ours,
    "ours, Python executor": lambda case: ours(case, in_python),
    "fmpy, one get and set per FMU": fmpy_lists,
    "fmpy, one call per variable": fmpy_variables,
    "container FMU in our compiled loop": container,
    "libcosim": libcosim,
    "Ecos": ecos,
}
WITHOUT_FMI = {
    "tiny": {"monolithic C": monolith, "scipy odeint over each step": with_scipy, "numba": with_numba},
    "real": {"kernel, one lane (monolithic C)": one_lane},
}


def cases(which: str, seconds: float, folder: Path):
    if which == "tiny":
        return Workload(tiny_scenario(seconds), folder)
    values = {
        "experiment.stop": seconds,
        "experiment.algorithm": "jacobi",
        "experiment.extrapolation": "hold",
        "experiment.record_every": 1,
        "experiment.fmi": 2,
    }
    return Workload(load_scenario("sallam-stable").with_values(values), folder)


def measure(case: Workload, engines: dict[str, Callable[[Workload], Runner]], rounds: int) -> dict[str, list[float]]:
    """Microseconds per communication step, each round of each engine."""
    runners: dict[str, Runner] = {}
    for name, engine in engines.items():
        try:
            runners[name] = engine(case)
            runners[name]()
        except (ImportError, OSError) as error:
            print(f"{name}: left out, {error}", file=sys.stderr)
            runners.pop(name, None)
    _KEPT.append(runners)
    times: dict[str, list[float]] = {name: [] for name in runners}
    for _ in range(rounds):
        for name, once in runners.items():
            times[name].append(once() / case.steps * 1e6)
    return times


def figure(value: float) -> str:
    """Three significant digits, never an exponent."""
    return f"{float(f'{value:.3g}'):.12g}"


def report(title: str, times: dict[str, list[float]]) -> str:
    """A Markdown table of medians and of the medians of each round's ratio to the C master."""
    first = next(iter(times.values()))
    lines = [f"\n{title}\n", "| way | us per step | to the C master |", "|---|---|---|"]
    for name, values in times.items():
        ratio = statistics.median(v / f for v, f in zip(values, first))
        lines.append(f"| {name} | {figure(statistics.median(values))} | {figure(ratio)} |")
    return "\n".join(lines)


def machine() -> str:
    """Date, processor, cores, Python and load, as the page has them."""
    model = "unknown processor"
    if Path("/proc/cpuinfo").exists():
        model = next(
            (
                line.split(":")[1].strip()
                for line in Path("/proc/cpuinfo").read_text().splitlines()
                if "model name" in line
            ),
            model,
        )
    return (
        f"{time.strftime('%Y-%m-%d')}, {model}, {os.cpu_count()} cores, Python "
        f"{platform.python_version()}, load {os.getloadavg()[0]:.1f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="simulated time")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", choices=["tiny", "real"])
    parser.add_argument(
        "--ways",
        nargs="+",
        default=[""],
        help='those whose names hold one of these words, such as "C master" "ours, compiled"',
    )
    arguments = parser.parse_args()
    print(f"{machine()}, `--rounds {arguments.rounds}`")
    for which in [arguments.only] if arguments.only else ["tiny", "real"]:
        with tempfile.TemporaryDirectory(prefix="cosim-bench-") as folder:
            case = cases(which, arguments.seconds, Path(folder))
            title = (
                f"{which} FMUs: {len(case.names)} FMUs, {len(case.wiring.links)} "
                f"connections, {len(case.wiring.signals)} signals kept"
            )
            ways = {
                name: way
                for name, way in (ENGINES | WITHOUT_FMI[which]).items()
                if any(words in name for words in arguments.ways)
            }
            print(report(title, measure(case, ways, arguments.rounds)), flush=True)
    os._exit(0)  # fmpy's instances are freed in no good order at the end of a process


if __name__ == "__main__":
    main()
