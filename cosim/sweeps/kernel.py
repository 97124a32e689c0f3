"""The batch kernel: many scenarios of the built-in loop at once, in the vector lanes of fmu_src/kernel/kernel.c.

It runs the same schedule on the same laws as the FMUs and gives their bits, without FMI. It applies to PHANToMs with
rigid joints and without encoders, whatever their friction, to serial arms whose commands are not late, all controllers
of ours, channels of every semantics, hands and environments, and components that nothing is wired into (an operator
that does not feel the arm), whose signals are computed beforehand by the FMUs themselves. `lane_refusal` says why it
does not apply; then the co-simulation does.
"""

from __future__ import annotations

import ctypes
import math
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from attrs import frozen

from cosim.engine.master import Result
from cosim.engine.native import Arena
from cosim.engine.outcome import Outcome
from cosim.engine.reference import Ending
from cosim.engine.table import SignalTable
from cosim.errors import RunError
from cosim.sweeps.lane import CHANNELS, Feed
from cosim.sweeps.lane_delays import longest
from cosim.sweeps.lane_layout import LaneLayout, lane_layout
from cosim.sweeps.lane_setting import LaneSetting
from cosim.sweeps.memory import ReusedMemory
from cosim.sweeps.native_kernel import (
    NativeComponent,
    NativeCourse,
    NativeJob,
    NativeSign,
    kinds,
    prepared,
)
from cosim.wiring import Wiring
from cosim.wiring.schedule import seconds

_REFUSED = 4  # outcome of a lane
_BLOCKS = 6  # of an envelope, SIGN_BLOCKS in fmu_src/kernel/sign.h
_LOOKS = tuple(2.0**-half for half in np.arange(0.0, 3.5, 0.5))
"""Shares of the run after which the sign of a growth rate is looked for: from an eighth of it to all of it."""


@cache
def _library() -> ctypes.CDLL:
    from build_fmus.library import library_path, vectors

    return prepared(ctypes.CDLL(str(library_path("kernel", ("-O3", "-fno-math-errno", *vectors()[1])))))


def lanes() -> int:
    """How many scenarios one call runs at once on this machine."""
    return int(_library().lanes())


def run_batch(wirings: Sequence[Wiring], record: Sequence[str], workers: int = 1) -> list[Result]:
    """The results of many scenarios that differ in parameters only, in their order.

    wirings: of scenarios with the same components, connections and experiment, each of which `lane_refusal` accepts;
    record: signals to keep, `arm_l.q` or `arm_l.q[1]`; workers: threads (the kernel holds no lock of Python's). Raises
    RunError where start values are refused.
    """
    runs = _runs(wirings, record, workers)
    if any(run.refused for run in runs):
        raise RunError(wirings[0].scenario.name, 0.0, "start values that an FMU refuses")
    return [run.result for run in runs]


@frozen
class TwinRuns:
    """A run and its twin. growth: rate [1/s] with the ends of its interval, where its sign was decided on the way;
    refused: an FMU refuses the start values, and says why.
    """

    result: Result
    twin: Result
    growth: tuple[float, float, float] | None = None
    refused: bool = False


@frozen
class _EndOfPairs:
    """When pairs of runs end: Student's quantile of the level, and of each pair the part of the rate that half its
    interval may be.
    """

    quantile: float
    parts: tuple[float, ...]

    def of(self, runs: Sequence[int]) -> _EndOfPairs:
        """For some of the runs, by their numbers: a run and its twin, and so on."""
        return _EndOfPairs(self.quantile, tuple(self.parts[k // 2] for k in runs[::2]))


def run_pairs(
    pairs: Sequence[tuple[Wiring, Wiring]],
    record: Sequence[str],
    level: float | None = None,
    parts: Sequence[float] | None = None,
) -> list[TwinRuns]:
    """Runs and their twins; with a level only until the sign of the growth rate is decided (fmu_src/kernel/sign.h).

    parts: for each pair the part of the rate that half its interval may be at most (default: however wide it is).
    """
    ending = None
    if level is not None and lanes() > 1:
        ending = _EndOfPairs(student(level), tuple(parts or [np.inf] * len(pairs)))
    runs = _runs([wiring for pair in pairs for wiring in pair], record, 1, ending)
    return [
        TwinRuns(one.result, twin.result, one.growth, one.refused or twin.refused)
        for one, twin in zip(runs[::2], runs[1::2])
    ]


def student(level: float) -> float:
    """Two-sided quantile of Student's t for the slopes of `_BLOCKS` blocks: five degrees of freedom, for which its
    distribution has a closed form (Abramowitz and Stegun 26.7.3; scipy.special is long to import).

    Newton from below, where that form is concave; with more digits than are given, where the machine has them.
    """
    half, angle, step = 2.0 * np.arctan(np.longdouble(1.0)), np.longdouble(0.0), np.longdouble(1.0)
    while step > 1e-16:
        beside = np.sin(angle) * np.cos(angle) * (3.0 + 2.0 * np.cos(angle) ** 2) / 3.0
        step = (half * level - angle - beside) / (8.0 * np.cos(angle) ** 4 / 3.0)
        angle += step
    return float(np.sqrt(np.longdouble(5.0)) * np.tan(angle))


def _lane_stride(count: int, numbers: int) -> int:
    """Doubles that a lane's rows of so many numbers take, LANE_STRIDE of fmu_src/kernel/rows.h."""
    return count * (-(-numbers // 4) * 4) + 8


@frozen
class _LaneRun:
    """What became of a lane; see `TwinRuns`."""

    result: Result
    growth: tuple[float, float, float] | None
    refused: bool


def _runs(
    wirings: Sequence[Wiring], record: Sequence[str], workers: int, ending: _EndOfPairs | None = None
) -> list[_LaneRun]:
    layout = lane_layout(wirings[0], tuple(record))
    settings = [LaneSetting.of(wiring, layout.parts, FEED) for wiring in wirings]
    batches = _batches(settings)
    tasks = [([settings[i] for i in batch], ending.of(batch) if ending else None) for batch in batches]
    found = _each(lambda task: _run_lanes(task[0], layout, task[1]), tasks, workers)
    results = {i: result for batch, some in zip(batches, found) for i, result in zip(batch, some)}
    return [results[i] for i in range(len(wirings))]


_LaneTask = tuple[list[LaneSetting], _EndOfPairs | None]


def _each(
    action: Callable[[_LaneTask], list[_LaneRun]], tasks: Sequence[_LaneTask], workers: int
) -> list[list[_LaneRun]]:
    """Results in the order of the tasks; without threads where one would do, for its memory and cache start cold."""
    if min(workers, len(tasks)) < 2:
        return [action(task) for task in tasks]
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(max_workers=workers) as pool:
        return list(pool.map(action, tasks))


def _batches(settings: Sequence[LaneSetting]) -> list[list[int]]:
    """Indices of settings that share what all lanes must share, as many as there are lanes."""
    alike = defaultdict(list)
    for i, setting in enumerate(settings):
        alike[setting.shared].append(i)
    width = lanes()
    return [group[k : k + width] for group in alike.values() for k in range(0, len(group), width)]


_MEMORY = ReusedMemory()


def _course(values: Sequence[float], steps: int, step_ns: int) -> np.ndarray:
    """Delays by the law that the FMU has too, infinite where a sample is lost."""
    delays, walk = _MEMORY.empty(steps + 1), np.empty(2)
    law = NativeCourse(*values, walk=walk.ctypes.data)
    _library().course(ctypes.byref(law), steps, step_ns, delays.ctypes.data)
    return delays.reshape(-1, 1)


FEED = Feed(_course)
"""What is computed beforehand, for all calls of a process."""


def _run_lanes(settings: Sequence[LaneSetting], layout: LaneLayout, ending: _EndOfPairs | None) -> list[_LaneRun]:
    began = time.perf_counter()
    call = _Call(settings, layout, ending)
    _library().run(ctypes.byref(call.job), layout.sources)
    wall = (time.perf_counter() - began) / len(settings)
    return [call.run(lane, wall) for lane in range(len(settings))]


class _Call:
    """One call of the kernel: C's layout of up to `lanes()` settings, and the arrays that must outlive the call.

    Lanes that are left over repeat the last two settings (a run and its twin may not be parted); their results are not
    looked at. ending: of pairs of lanes; None: they are no pairs.
    """

    def __init__(self, settings: Sequence[LaneSetting], layout: LaneLayout, ending: _EndOfPairs | None) -> None:
        self.layout, self.places, self.timetable = layout, layout.places, layout.timetable
        self.settings, self.width, self.ending = settings, lanes(), ending
        self.filled = [*settings, *list(settings[-2:]) * self.width][: self.width]
        self.wiring, self.parts = settings[0].wiring, settings[0].parts
        self.experiment = self.wiring.scenario.experiment
        self.arena = Arena()
        self.rows = self.experiment.rows
        shape = self.width, self.rows, len(self.timetable.names)
        self.table = _MEMORY.empty(math.prod(shape)).reshape(shape)
        self.ended, self.outcome = np.zeros(self.width, np.int64), np.zeros(self.width, np.int64)
        self.signs = (NativeSign * (self.width // 2))() if ending else None
        self.job = self._job()

    def _job(self) -> NativeJob:
        schedule = self.wiring.schedule
        components = (NativeComponent * len(self.parts))(*[self._component(i) for i in range(len(self.parts))])
        work = self.arena.zeros(len(self.parts) * int(_library().part_size()) // 8)
        return NativeJob(
            self.arena.structures(components),
            len(self.parts),
            self.layout.turns,
            self.arena.zeros(2 * self.places.count * self.width),
            self.places.count,
            self.arena.array(self.table),
            self.rows,
            len(self.timetable.names),
            self.experiment.record_every,
            self.experiment.steps,
            schedule.step_ns,
            self.experiment.bound,
            self.arena.array(self.ended),
            self.arena.array(self.outcome),
            *self._looks(),
            work,
        )

    def _looks(self) -> tuple[int, int, int, int, int, float]:
        """Where signs are kept, at which rows they are looked for, how many rates and limits are followed, what ends a
        pair.
        """
        if self.signs is None or self.ending is None:
            return 0, 0, 0, 0, 0, 0.0
        parts = [*self.ending.parts, *self.ending.parts[-1:] * self.width]
        power = np.empty((len(self.signs), self.rows + 1))
        power[:, 0] = 0.0
        for sign, sums, part in zip(self.signs, power, parts):
            sign.power, sign.part = self.arena.array(sums), part
        looks = [int(share * (self.rows - 1)) for share in _LOOKS]
        where = self.arena.structures(self.signs), self.arena.indices(looks)
        followed = len(self.layout.rates), len(self.layout.saturated)
        return *where, len(looks), *followed, self.ending.quantile

    def _component(self, i: int) -> NativeComponent:
        part, kind = self.parts[i], kinds(_library())[self.parts[i].model]
        native = NativeComponent(
            kind=kind,
            n_inputs=len(part.inputs),
            inputs=self.layout.inputs[i],
            n_outputs=self.places.counts[i],
            first=self.places.first[i],
            outputs=self.layout.outputs[i],
        )
        if part.model:
            self._give_starts(native, i)
        if self._series(i):
            self._give_series(native, i)
        if part.model == "SerialArm":
            native.serial = self.arena.zeros(int(_library().serial_size()) // 8)
        if part.model in CHANNELS:
            self._give_history(native, i)
        return native

    def _give_starts(self, native: NativeComponent, i: int) -> None:
        """Start values that any lane gives, of every lane."""
        parts = [setting.parts[i] for setting in self.filled]
        names = list(parts[0].starts)
        if all(part is parts[0] for part in parts):
            rows = [list(parts[0].starts.values())] * self.width
        elif all(list(part.starts) == names for part in parts):
            rows = [list(part.starts.values()) for part in parts]
        else:
            names = list(dict.fromkeys(name for part in parts for name in part.starts))
            rows = [[part.number(name) for name in names] for part in parts]
        native.n_starts, native.started = len(names), self.arena.indices(parts[0].places(names))
        native.starts = self.arena.aligned(np.array(rows, dtype=float).T)

    def _series(self, i: int) -> list[np.ndarray]:
        """The series of every lane; empty where the component has none."""
        return [series for setting in self.filled if (series := setting.series[i]) is not None]

    def _give_series(self, native: NativeComponent, i: int) -> None:
        series = self._series(i)
        native.series = self.arena.pointers([self.arena.array(values) for values in series])
        native.series_step = self.arena.indices([int(len(values) > 1) for values in series])

    def _give_history(self, native: NativeComponent, i: int) -> None:
        """Room for the samples that the longest delay reaches back to, or for all of the run."""
        reach = max(longest(delays) for delays in self._series(i))
        steps = min(int(np.ceil(reach * 1e9 / self.wiring.schedule.step_ns)), self.experiment.steps)
        native.capacity = 1 << (steps + 4).bit_length()
        native.history = self.arena.zeros(self.width * _lane_stride(native.capacity, native.n_inputs))
        native.stamps = self.arena.array(np.zeros(native.capacity))
        if self.parts[i].packets:
            native.packets = self.arena.zeros((3 * native.capacity + 1) * self.width)

    def run(self, lane: int, wall: float) -> _LaneRun:
        """What became of a lane."""
        sign = self.signs[lane // 2] if self.signs else None
        growth = (sign.rate, sign.low, sign.high) if sign and sign.sign else None
        return _LaneRun(self._result(lane, wall), growth, bool(self.outcome[lane] == _REFUSED))

    def _result(self, lane: int, wall: float) -> Result:
        """The result of a lane, worded as the co-simulation would."""
        ended, steps = int(self.ended[lane]), self.experiment.steps
        outcome = {1: Outcome.DIVERGED, 2: Outcome.DOMAIN_EXIT}.get(int(self.outcome[lane]))
        return self.timetable.result(
            self.settings[lane].wiring,
            SignalTable.of(self.table[lane]),
            Ending(min(ended, steps), outcome, self._message(outcome, ended)),
            wall,
        )

    def _message(self, outcome: Outcome | None, ended: int) -> str:
        if outcome is None:
            return ""
        at = seconds(ended, self.wiring.schedule.step_ns)
        if outcome is Outcome.DIVERGED:
            return f"a value passed {self.experiment.bound:g} at t = {at:.9g} s"
        return f"an arm left the domain of its model at t = {at:.9g} s"
