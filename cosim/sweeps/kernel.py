"""The batch kernel: many scenarios of the built-in loop at once, in the vector lanes of fmu_src/kernel/kernel.c.

It runs the same schedule on the same laws as the FMUs and gives their bits, without FMI. It applies to arms with rigid
joints and without encoders, whatever their friction, P-like controllers, channels of every semantics, hands and
environments, and components that nothing is wired into (an operator that does not feel the arm), whose signals are
computed beforehand by the FMUs themselves. `refusal` says why it does not apply; then the co-simulation does.
"""

from __future__ import annotations

import ctypes
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
from attrs import frozen

from cosim.engine.master import Result
from cosim.engine.native import Arena
from cosim.engine.outcome import Outcome
from cosim.engine.reference import Ending
from cosim.engine.table import SignalTable
from cosim.signals import stem
from cosim.sweeps.lane import Feed, LaneComponent, LanePlaces, LaneSetting
from cosim.sweeps.lane_layout import LaneLayout, lane_layout
from cosim.sweeps.native_kernel import (
    NativeComponent,
    NativeCourse,
    NativeJob,
    NativeSign,
    kinds,
    prepared,
)
from cosim.sweeps.structure import of_structure
from cosim.wiring import Wiring
from cosim.wiring.schedule import seconds

_ARM_LAW = {
    *("pi", "mounting", "payload", "base_tilt", "gravity_compensation", "workspace_limits", "internal_steps"),
    *("viscous", "coulomb", "coulomb_velocity", "stiffness", "damping", "q_start", "dq_start"),
    *("contact_stiffness", "contact_damping", "contact_normal", "contact_distance"),
    *("tau", "f", "f_command", "x_ref"),
    *("coulomb_form", "stribeck", "stribeck_velocity", "stribeck_exponent", "coulomb_asymmetry", "viscous_asymmetry"),
    *("torque_offset", "load_friction", "position_friction_sin", "position_friction_cos", "position_torque"),
    *("position_torque_quadratic", "position_torque_cubic", "position_torque_sin", "position_torque_cos"),
    *("ripple_sin", "ripple_cos", "ripple_order", "hysteresis", "hysteresis_length", "hysteresis_exponent"),
    *("hysteresis_ratio", "hysteresis_tilt", "quadratic_drag", "friction_drift", "friction_drift_time"),
    *("torque_gain", "torque_deadband", "stop_stiffness", "stop_damping", "stop_angle", "stop_side"),
    *("coupling_viscous", "coupling_coulomb", "coupling_stiffness", "coupling_velocity"),
}
"""What may differ from the table in the kernel's arm: not what makes a joint elastic, late or limited, nor encoders."""
_CHOSEN = {"stribeck_exponent": (1.0, 2.0), "coulomb_form": (0.0, 1.0), "stop_side": (-1.0, 1.0)}
"""The numbers that the arm takes for them."""
_MOST_OUTPUTS = 12  # of a series
_LEAST_BOUND = 1e5
"""The kernel watches the outputs that it computes; others (packets in flight, ages) stay below this."""
_BLOCKS = 6  # of an envelope, SIGN_BLOCKS in fmu_src/kernel/sign.h
_LOOKS = tuple(2.0**-half for half in np.arange(0.0, 3.5, 0.5))
"""Shares of the run after which the sign of a growth rate is looked for: from an eighth of it to all of it."""
_MOST_BYTES = 1 << 30  # of the table of one call, which lies in memory


@cache
def _library() -> ctypes.CDLL:
    from build_fmus.library import library_path, vectors

    return prepared(ctypes.CDLL(str(library_path("kernel", ("-O3", "-fno-math-errno", *vectors()[1])))))


def lanes() -> int:
    """How many scenarios one call runs at once on this machine."""
    return int(_library().lanes())


# --- does it apply? ---------------------------------------------------------------------------------------------------


def refusal(wiring: Wiring, record: Sequence[str] = ()) -> str | None:
    """Why the kernel cannot run a scenario, in words for the user; None where it can. `record`: signals wanted."""
    if wiring.scenario.experiment.bound < _LEAST_BOUND:
        return f"experiment.bound is {wiring.scenario.experiment.bound:g}, and the kernel watches what it computes only"
    found = _structure(wiring, tuple(record))
    if found.reason is not None:
        return found.reason
    for part in found.parts:
        if (reason := _unfit(part.starting(wiring), wiring)) is not None:
            return f"{part.name}: {reason}"
    return found.unseen


@frozen
class _Structure:
    """What the kernel says to a wiring whatever its start values.

    reason: why it does not apply; unseen: what it does not compute, which is said after what start values are unfit.
    """

    parts: tuple[LaneComponent, ...]
    reason: str | None
    unseen: str | None


@of_structure
def _structure(wiring: Wiring, record: tuple[str, ...]) -> _Structure:
    parts = LaneComponent.all(wiring)
    return _Structure(parts, _too_large(wiring, record), _unseen(wiring, parts, record))


def _too_large(wiring: Wiring, record: Sequence[str]) -> str | None:
    kept = sum(name in record or stem(name) in record for name in wiring.signals)
    from build_fmus.library import vectors

    if (size := 8 * vectors()[0] * kept * wiring.scenario.experiment.rows) <= _MOST_BYTES:
        return None
    return f"the table of a batch would take {size / 1e9:.3g} GB of memory (experiment.record_every makes it shorter)"


def _unseen(wiring: Wiring, parts: Sequence[LaneComponent], record: Sequence[str]) -> str | None:
    places = LanePlaces.of(wiring, parts)
    for link in wiring.links:
        if str(link.source) not in places.number:
            return f"{link.source} is wired, which the kernel does not compute"
        if link.scaled:
            return f"{link.source} is changed on the way, which the kernel does not compute"
    stems = {stem(name) for name in places.number}
    missing = [name for name in record if name not in places.number and name not in stems]
    return f"{missing[0]} is to be recorded, which the kernel does not compute" if missing else None


def _unfit(part: LaneComponent, wiring: Wiring) -> str | None:
    if wiring.scenario.components[part.name].step_multiple != 1:
        return "it has a step multiple"
    if not part.model and part.inputs:
        own = wiring.scenario.components[part.name]
        return f"{own.kind if own.model else 'a foreign FMU'} feels what is wired into it"
    if not part.model:
        return f"it has more than {_MOST_OUTPUTS} outputs" if len(part.outputs) > _MOST_OUTPUTS else None
    return _UNFIT.get(part.model, _fit)(part)


def _fit(part: LaneComponent) -> str | None:
    return None


def _unfit_arm(part: LaneComponent) -> str | None:
    variables = part.description.variables
    for name, value in part.starts.items():
        if stem(name) not in _ARM_LAW and value != variables[name].start:
            return f"its {name} is {value!r}"
        if value not in _CHOSEN.get(stem(name), (value,)):
            return f"its {name} is {value!r}"
    if part.number("contact_stiffness") > 0 and not any(part.number(f"contact_normal[{i}]") for i in (1, 2, 3)):
        return "its contact_normal is zero"
    return None


def _unfit_channel(part: LaneComponent) -> str | None:
    if "delay" in part.inputs:
        return "its input delay is wired"
    if part.choice("law") == "recorded":
        return "its delay is recorded"
    if part.loses and not part.packets:
        return "it loses samples of a plain time delay"
    low, high = part.number("delay_min"), part.number("delay_max")
    if part.choice("law") != "constant" and high < low:
        return "its delay_max is below its delay_min"
    if part.choice("law") == "random_walk" and part.number("delay_step") > high - low:
        return "its delay_step is longer than its delays"
    return None


def _unfit_operator(part: LaneComponent) -> str | None:
    return "its stop_time is before its start_time" if part.number("stop_time") < part.number("start_time") else None


def _unfit_environment(part: LaneComponent) -> str | None:
    length = sum(part.number(f"normal[{i}]") ** 2 for i in (1, 2, 3))
    return "its normal is zero" if part.choice("surface") == "wall" and length <= 1e-12 else None


_UNFIT = {
    "PhantomArm": _unfit_arm,
    "VariableDelayChannel": _unfit_channel,
    "Operator": _unfit_operator,
    "Environment": _unfit_environment,
}
"""Start values that the FMUs refuse, or that the kernel does not compute, of each of its models."""


# --- running ----------------------------------------------------------------------------------------------------------


def run_batch(wirings: Sequence[Wiring], record: Sequence[str], workers: int = 1) -> list[Result]:
    """The results of many scenarios that differ in parameters only, in their order.

    wirings: of scenarios with the same components, connections and experiment, each of which `refusal` accepts; record:
    signals to keep, `arm_l.q` or `arm_l.q[1]`; workers: threads (the kernel holds no lock of Python's).
    """
    return [result for result, _ in _runs(wirings, record, workers)]


@frozen
class TwinRuns:
    """A run and its twin. growth: rate [1/s] with the ends of its interval, where its sign was decided on the way."""

    result: Result
    twin: Result
    growth: tuple[float, float, float] | None = None


def run_pairs(
    pairs: Sequence[tuple[Wiring, Wiring]], record: Sequence[str], level: float | None = None
) -> list[TwinRuns]:
    """Runs and their twins; with a level only until the sign of the growth rate is decided (fmu_src/kernel/sign.h)."""
    quantile = 0.0
    if level is not None and lanes() > 1:
        from scipy.special import stdtrit

        quantile = float(stdtrit(_BLOCKS - 1, 0.5 + 0.5 * level))
    runs = _runs([wiring for pair in pairs for wiring in pair], record, 1, quantile)
    return [TwinRuns(result, twin, growth) for (result, growth), (twin, _) in zip(runs[::2], runs[1::2])]


def _lane_stride(count: int, numbers: int) -> int:
    """Doubles that a lane's rows of so many numbers take, LANE_STRIDE of fmu_src/kernel/rows.h."""
    return count * (-(-numbers // 4) * 4) + 8


_LaneRun = tuple[Result, tuple[float, float, float] | None]


def _runs(wirings: Sequence[Wiring], record: Sequence[str], workers: int, quantile: float = 0.0) -> list[_LaneRun]:
    layout = lane_layout(wirings[0], tuple(record))
    settings = [LaneSetting.of(wiring, layout.parts, _FEED) for wiring in wirings]
    batches = _batches(settings)
    tasks = [[settings[i] for i in batch] for batch in batches]
    found = _each(lambda settings: _run_lanes(settings, layout, quantile), tasks, workers)
    results = {i: result for batch, some in zip(batches, found) for i, result in zip(batch, some)}
    return [results[i] for i in range(len(wirings))]


def _each(
    action: Callable[[list[LaneSetting]], list[_LaneRun]], tasks: Sequence[list[LaneSetting]], workers: int
) -> list[list[_LaneRun]]:
    """Results in the order of the tasks; without threads where one would do, for its memory and cache start cold."""
    if min(workers, len(tasks)) < 2:
        return [action(task) for task in tasks]
    with ThreadPoolExecutor(max_workers=workers) as pool:
        return list(pool.map(action, tasks))


def _batches(settings: Sequence[LaneSetting]) -> list[list[int]]:
    """Indices of settings that share what all lanes must share, as many as there are lanes."""
    alike = defaultdict(list)
    for i, setting in enumerate(settings):
        alike[setting.shared].append(i)
    width = lanes()
    return [group[k : k + width] for group in alike.values() for k in range(0, len(group), width)]


def _course(values: Sequence[float], steps: int, step_ns: int) -> tuple[np.ndarray, np.ndarray]:
    """Delays and losses by the law that the FMU has too."""
    delays, lost, walk = np.empty((steps + 1, 1)), np.empty(steps + 1), np.empty(2)
    law = NativeCourse(*values, walk=walk.ctypes.data)
    _library().course(ctypes.byref(law), steps, step_ns, delays.ctypes.data, lost.ctypes.data)
    return delays, lost


_FEED = Feed(_course)


def _run_lanes(settings: Sequence[LaneSetting], layout: LaneLayout, quantile: float) -> list[_LaneRun]:
    began = time.perf_counter()
    call = _Call(settings, layout, quantile)
    _library().run(ctypes.byref(call.job), layout.sources)
    wall = (time.perf_counter() - began) / len(settings)
    return [call.run(lane, wall) for lane in range(len(settings))]


class _Call:
    """One call of the kernel: C's layout of up to `lanes()` settings, and the arrays that must outlive the call.

    Lanes that are left over repeat the last two settings (a run and its twin may not be parted); their results are not
    looked at. quantile: Student's, for the sign of the growth of pairs of lanes; 0: they are no pairs.
    """

    def __init__(self, settings: Sequence[LaneSetting], layout: LaneLayout, quantile: float) -> None:
        self.layout, self.places, self.timetable = layout, layout.places, layout.timetable
        self.settings, self.width, self.quantile = settings, lanes(), quantile
        self.filled = [*settings, *list(settings[-2:]) * self.width][: self.width]
        self.wiring, self.parts = settings[0].wiring, settings[0].parts
        self.experiment = self.wiring.scenario.experiment
        self.arena = Arena()
        self.rows = self.experiment.rows
        self.table = np.empty((self.width, self.rows, len(self.timetable.names)))
        self.ended, self.outcome = np.zeros(self.width, np.int64), np.zeros(self.width, np.int64)
        self.signs = (NativeSign * (self.width // 2))() if quantile else None
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

    def _looks(self) -> tuple[int, int, int, int, float]:
        """Where signs are kept, at which rows they are looked for, how many rates are followed, the quantile."""
        if self.signs is None:
            return 0, 0, 0, 0, 0.0
        power = np.empty((len(self.signs), self.rows + 1))
        power[:, 0] = 0.0
        for sign, sums in zip(self.signs, power):
            sign.power = self.arena.array(sums)
        looks = [int(share * (self.rows - 1)) for share in _LOOKS]
        where = self.arena.structures(self.signs), self.arena.indices(looks)
        return *where, len(looks), len(self.layout.rates), self.quantile

    def _component(self, i: int) -> NativeComponent:
        part, kind = self.parts[i], kinds(_library())[self.parts[i].model]
        native = NativeComponent(
            kind=kind,
            n_inputs=len(part.inputs),
            inputs=self.arena.indices(part.places(part.inputs)),
            n_outputs=part.count,
            first=self.places.first[i],
        )
        if part.model:
            self._give_starts(native, i)
        if self._series(i):
            self._give_series(native, i)
        if part.model == "VariableDelayChannel":
            self._give_history(native, i)
        return native

    def _give_starts(self, native: NativeComponent, i: int) -> None:
        """Start values that any lane gives, of every lane."""
        parts = [setting.parts[i] for setting in self.filled]
        names = list(parts[0].starts)
        if all(list(part.starts) == names for part in parts):
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
        longest = max(float(values.max()) for values in self._series(i))
        steps = min(int(np.ceil(longest * 1e9 / self.wiring.schedule.step_ns)), self.experiment.steps)
        native.capacity = 1 << (steps + 4).bit_length()
        native.history = self.arena.zeros(self.width * _lane_stride(native.capacity, native.n_inputs))
        native.stamps = self.arena.array(np.zeros(native.capacity))
        if self.parts[i].packets:
            native.packets = self.arena.zeros(self.width * _lane_stride(native.capacity, 1 + native.n_inputs))
            losses = [setting.lost[i] for setting in self.filled]
            if any(lost is not None for lost in losses):
                none = np.zeros(self.experiment.steps + 1)
                native.lost = self.arena.pointers([self.arena.array(none if lost is None else lost) for lost in losses])

    def run(self, lane: int, wall: float) -> _LaneRun:
        """What became of a lane, and its growth where the sign was decided."""
        sign = self.signs[lane // 2] if self.signs else None
        growth = (sign.rate, sign.low, sign.high) if sign and sign.sign else None
        return self._result(lane, wall), growth

    def _result(self, lane: int, wall: float) -> Result:
        """The result of a lane, worded as the co-simulation would."""
        ended, steps = int(self.ended[lane]), self.experiment.steps
        outcome = (None, Outcome.DIVERGED, Outcome.DOMAIN_EXIT, None)[self.outcome[lane]]
        at = seconds(ended, self.wiring.schedule.step_ns)
        message = {
            Outcome.DIVERGED: f"a value passed {self.experiment.bound:g} at t = {at:.9g} s",
            Outcome.DOMAIN_EXIT: f"an arm left the domain of its model at t = {at:.9g} s",
        }.get(outcome, "")
        return self.timetable.result(
            self.settings[lane].wiring,
            SignalTable.of(self.table[lane]),
            Ending(min(ended, steps), outcome, message),
            wall,
        )
