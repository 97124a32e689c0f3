"""Whether the FMU carries what is left over the position without a name, as a table: decided on fitted rows alone.

The fitted rows are cut into stretches, about as long as the report is and four at least. Each is left out in turn:
the model with and without the table is fitted to the others and drives the FMU through the one left out, from its first
samples on, with its own levels (`cosim.closure.simulation`). The table is taken where it leaves less, by more than SAME
standard errors of the logarithms of the ratios.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from attrs import evolve, frozen

from cosim.closure.drive import JointDrive, drive_of
from cosim.closure.fitted import start_values, without
from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.model import Model, with_choices
from cosim.closure.model.table import PositionTable
from cosim.closure.replay import begun, without_hold
from cosim.closure.simulation import FIRST, driven
from cosim.closure.verdict import ClosureVerdict, intervals
from cosim.effects.constants import SAME
from cosim.measured import Label, Recording

STRETCHES = 4  # at least, of the fitted rows


@frozen(eq=False)
class CarriedTable:
    """The table beside the named effects: the model with it, its parameters with 95 % intervals, whether it is `taken`.

    errors: RMS of the free simulation of each stretch left out, with the stretch's own levels, without and with the
    table (k, 2) [rad or m]. why: in words, what spoke for it or against it.
    """

    model: Model
    parameters: dict[Label, float]
    interval: dict[Label, tuple[float, float]]
    errors: np.ndarray
    taken: bool
    why: str


def carried_table(
    recording: Recording, verdict: ClosureVerdict, progress: Callable[[str], None] = lambda text: None
) -> CarriedTable | None:
    """The table of a verdict that leaves a torque over the position of its joint for sure. None where nothing of the
    kind is left, or where the FMU has no table.
    """
    left = any(x.sure and "q1" in x.signals for x in verdict.leftovers)
    if not left or not isinstance(drive_of(recording.device), JointDrive):
        return None
    progress("simulating stretches left out, with and without a torque over the position")
    model, _ = verdict.models()
    fitted = model.setting.motion.q[~model.setting.motion.test, 0]
    choice = ChosenEffect(PositionTable(float(fitted.min()), float(fitted.max())), (0,))
    wide = evolve(with_choices(model, (*model.choices, choice)), tangents=False)
    errors = _left_out(recording, model, wide)
    values, interval = intervals(wide, len(wide.choices) - 1)
    taken, why = _judged(errors)
    return CarriedTable(wide, values, interval, errors, taken, why)


def _judged(errors: np.ndarray) -> tuple[bool, str]:
    if len(errors) < STRETCHES:
        return False, "a torque over the position is left out of the FMU: too few fitted rows to judge it by simulation"
    ratio = np.log(errors[:, 1] / errors[:, 0])
    sure = -ratio.mean() / max(ratio.std(ddof=1) / np.sqrt(len(ratio)), 1e-12)
    change = f"{100 * np.expm1(ratio.mean()):+.0f} % ({sure:.1f} standard errors) in {len(errors)} stretches left out"
    if sure > SAME:
        return True, f"the FMU carries a torque over the position without a name: free simulation {change}"
    return False, f"a torque over the position without a name is left out of the FMU: free simulation {change}"


def _left_out(recording: Recording, *models: Model) -> np.ndarray:
    """RMS (k, models) of the free simulation of each stretch, with its own levels, by models that have not seen it.
    Where it runs away the range of the motion, which is the least that it is off.
    """
    drive = drive_of(recording.device)
    assert drive is not None, "asked for only where there is a table"
    motion = models[0].setting.motion
    begin = min(run.time[0] for run in recording.runs)
    out = []
    for number, first, stop in _stretches(recording):
        run = recording.runs[number].part(slice(first, stop))
        blocks = _blocks(models[0], number, first, stop)
        with driven(drive, run) as free:
            row = []
            for model in models:
                values = without_hold(start_values(recording, without(model, blocks)), motion.sample)
                found = free.levelled(begun(values, run.time[0] - begin))
                row.append(float(np.ptp(run.q) if found is None else np.sqrt(np.mean(found.error**2))))
        out.append(row)
    return np.array(out).reshape(-1, len(models))


def _stretches(recording: Recording) -> list[tuple[int, int, int]]:
    """(run, first row, row after the last) of contiguous fitted rows, about equally long."""
    spans = [(k, *_longest(~run.test)) for k, run in enumerate(recording.runs)]
    fitted, reported = sum(stop - first for _, first, stop in spans), max(int(run.test.sum()) for run in recording.runs)
    length = max(min(fitted / STRETCHES, reported), 10 * FIRST)
    out = []
    for k, first, stop in spans:
        cuts = np.linspace(first, stop, max(round((stop - first) / length), 1) + 1).astype(int)
        out += [(k, int(a), int(b)) for a, b in pairwise(cuts) if b - a > FIRST]
    return out


def _longest(marks: np.ndarray) -> tuple[int, int]:
    """First row and row after the last of the longest contiguous part that is marked; (0, 0) where there is none."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marks, [False])).astype(int)))
    parts = sorted(zip(edges[::2], edges[1::2], strict=True), key=lambda part: part[0] - part[1])
    return (int(parts[0][0]), int(parts[0][1])) if parts else (0, 0)


def _blocks(model: Model, number: int, first: int, stop: int) -> np.ndarray:
    """Fitted blocks (T,) that hold rows of a stretch of run `number`, samples first to stop."""
    rows, motion = model.setting.rows, model.setting.motion
    sample = (rows.index - motion.bounds[number][0]) * motion.stride
    inside = (motion.run[rows.index] == number) & (sample >= first) & (sample < stop) & ~rows.test
    return np.isin(np.arange(rows.train_blocks), rows.block[inside])


def with_table(verdict: ClosureVerdict, table: CarriedTable) -> ClosureVerdict:
    """The verdict whose model has the table as well: one set of parameters, all fitted beside it."""
    places = {c.key: k for k, c in enumerate(table.model.choices)}
    findings = []
    for found in verdict.findings:
        values, interval = intervals(table.model, places[found.choice.key])
        findings.append(evolve(found, parameters=values, interval=interval))
    return evolve(verdict, findings=tuple(findings), model=table.model, best=table.model)
