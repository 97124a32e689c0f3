"""Free simulation: the motion that the recorded torque alone makes of the device's FMU, with and without the effects.

No controller holds the model on the recorded path, so that errors of the torque add up over the whole run. The state at
the start is that which fits the first samples best. A drive that falls or runs away by itself has no free simulation.

An offset or Coulomb level that is off by d moves a drive with viscous friction f away at d / f, however good the rest
of the model is, and levels change from one hour to the next. `levelled` is what remains with the run's own two levels:
the error of the model's form.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve, frozen

from cosim.closure.drive import Drive, StartValue, drive_of, stepped
from cosim.closure.replay import begun, played, sampled
from cosim.errors import InputError, RunError
from cosim.measured.recording import Recording, Run
from cosim.scenario import Component, Connection, Scenario
from cosim.signals import Signal

if TYPE_CHECKING:
    from cosim.engine.master import System

FIRST = 20  # samples that the state at the start is fitted to (EMPS benchmark)
ROUNDS = 2  # of that fit and of that of the levels; both go through the FMU nearly as straight lines
LEVEL = 1e-3  # of the torque: step of the finite differences by the levels


Levels = tuple[float, float]
"""What is added to torque_offset and coulomb [N.m]."""


@frozen(eq=False)
class LevelledRun:
    """What the free simulation of one joint leaves (n, 1) [rad or m] with the run's own levels."""

    error: np.ndarray
    levels: Levels


@frozen
class LevelledError:
    """RMS of the position [rad or m] over all runs, each with its own levels."""

    rms: float
    levels: tuple[Levels, ...]


@frozen
class FreeSimulation:
    """RMS of the difference of the positions [rad or m] on reported rows, per joint (nj,); None for a model that ran
    away.

    levelled_before, levelled_after: the same with the reported runs' own levels; None for more than one joint.
    """

    before: tuple[float, ...] | None
    after: tuple[float, ...] | None
    runs: tuple[str, ...]
    levelled_before: LevelledError | None = None
    levelled_after: LevelledError | None = None


@frozen(eq=False)
class DrivenRun:
    """A run whose recorded torque drives the device's FMU, open for simulations with several models."""

    scenario: Scenario
    system: "System"
    drive: Drive
    run: Run

    def error(self, values: Mapping[str, StartValue]) -> np.ndarray | None:
        """Simulated less recorded position (n, nj) with start values of the FMU; None where it runs away."""
        values, run = stepped(values, self.run.step), self.run
        time = run.step * np.arange(FIRST)
        short = evolve(self.scenario, experiment=evolve(self.scenario.experiment, stop=float(time[-1])))
        dq, q = np.polyfit(time, run.q[:FIRST], 1)
        try:
            for _ in range(ROUNDS):
                moved = _motion(short, self.system, self.drive, values, q, dq)
                slope, offset = np.polyfit(time, moved - run.q[:FIRST], 1)
                q, dq = q - offset, dq - slope
            error = _motion(self.scenario, self.system, self.drive, values, q, dq) - run.q
        except (InputError, RunError):
            return None
        return error if (np.abs(error) < np.ptp(run.q, axis=0).max()).all() else None

    def levelled(self, values: Mapping[str, StartValue]) -> LevelledRun | None:
        """The error with the two levels that make it least (Gauss and Newton); None where the model runs away."""
        size = LEVEL * float(np.sqrt(np.mean(self.run.tau**2)))
        error, levels = self.error(values), np.zeros(2)
        for _ in range(ROUNDS):
            moved = [self.error(shifted(values, *(levels + size * unit))) for unit in np.eye(2)]
            if error is None or any(e is None for e in moved):
                break
            slopes = np.hstack([(e - error) / size for e in moved if e is not None])
            found = levels - np.linalg.lstsq(slopes, error[:, 0], rcond=None)[0]
            new = self.error(shifted(values, *found))
            if new is None or (new**2).sum() >= (error**2).sum():
                break
            error, levels = new, found
        return None if error is None else LevelledRun(error, (float(levels[0]), float(levels[1])))


def shifted(values: Mapping[str, StartValue], offset: float, coulomb: float) -> dict[str, StartValue]:
    """Start values of one joint with other levels."""
    changes = {"torque_offset": offset, "coulomb": coulomb}
    return {**values, **{name: float(np.sum(values.get(name, 0.0))) + change for name, change in changes.items()}}


@contextmanager
def driven(drive: Drive, run: Run) -> Iterator[DrivenRun]:
    """The recorded torque of a run, held between samples, and the drive's FMU, loaded."""
    from build_fmus.scratch import workspace
    from cosim.fmu import open_system

    with workspace() as folder:
        scenario = _experiment(drive, run, folder)
        with open_system(scenario) as system:
            yield DrivenRun(scenario, system, drive, run)


def simulate(
    recording: Recording, before: Mapping[str, StartValue], after: Mapping[str, StartValue]
) -> FreeSimulation | None:
    """Both models driven by the recorded torque over the reported rows. None where the device has no FMU, or where
    both models leave the recorded path by more than its range.
    """
    drive = drive_of(recording.device)
    if drive is None:
        return None
    first = min(run.time[0] for run in recording.runs)
    parts = [part for run in recording.runs if (part := _reported(run)) is not None]
    plain: list[list[np.ndarray | None]] = [[], []]
    level: list[list[LevelledRun | None]] = [[], []]
    for part in parts:
        with driven(drive, part) as free:
            for side, values in enumerate(begun(x, part.time[0] - first) for x in (before, after)):
                plain[side].append(free.error(values))
                if len(recording.joints) == 1:
                    level[side].append(free.levelled(values))
    sides = [_rms(errors) for errors in plain]
    if sides == [None, None]:
        return None
    names = tuple(part.name for part in parts)
    return FreeSimulation(sides[0], sides[1], names, _levels(level[0]), _levels(level[1]))


def _rms(errors: Sequence[np.ndarray | None]) -> tuple[float, ...] | None:
    """Per joint, over all runs; None where there is none or the model ran away in one."""
    good = [e for e in errors if e is not None]
    if not good or len(good) < len(errors):
        return None
    return tuple(float(v) for v in np.sqrt(np.mean(np.concatenate(good) ** 2, axis=0)))


def _levels(found: Sequence[LevelledRun | None]) -> LevelledError | None:
    left = _rms([x and x.error for x in found])
    return None if left is None else LevelledError(left[0], tuple(x.levels for x in found if x is not None))


def _reported(run: Run) -> Run | None:
    """The reported rows of a run, from the first to the last; None where there are too few."""
    rows = np.flatnonzero(run.test)
    return run.part(slice(int(rows[0]), int(rows[-1]) + 1)) if len(rows) > 2 * FIRST else None


def _motion(
    scenario: Scenario, system: "System", drive: Drive, values: Mapping[str, StartValue], q: np.ndarray, dq: np.ndarray
) -> np.ndarray:
    """Position (n, nj) from a state at the start. Raises InputError, or RunError where the run does not reach its
    end.
    """
    from cosim.engine.master import run as execute

    changed = {f"drive.{key}": value for key, value in {**values, **drive.start_of(q, dq)}.items()}
    result = execute(scenario.with_values(changed), system, record=["drive.q"])
    if result.failure or result.stopped_at is not None:
        raise RunError("drive", result.stopped_at, str(result.failure or result.message))
    return result.vector("drive.q")[:, : len(q)]


def _experiment(drive: Drive, run: Run, folder: Path) -> Scenario:
    """The recorded torque, held between samples -> drive."""
    wires = tuple(
        Connection(Signal("torque", f"y[{j + 1}]"), Signal("drive", drive.variable("tau", j)))
        for j in range(run.tau.shape[1])
    )
    parts = {
        "torque": played(run, run.tau, "N.m", folder / "torque.csv"),
        "drive": Component(model=drive.model, parameters=drive.fixed),
    }
    return Scenario("free simulation", sampled(run), parts, wires, folder=folder)
