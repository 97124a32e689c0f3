"""Free simulation: the motion that the recorded torque alone makes of the device's FMU, with and without the effects.

No controller holds the model on the recorded path, so that errors of the torque add up over the whole run. The state at
the start is that which fits the first samples best. A drive that falls or runs away by itself has no free simulation.
"""

from collections.abc import Mapping
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
ROUNDS = 2  # of that fit; the state goes through the FMU nearly as a straight line


@frozen
class FreeSimulation:
    """RMS of the difference of the positions [rad or m] on reported rows, per joint (nj,); None for a model that ran
    away.
    """

    before: tuple[float, ...] | None
    after: tuple[float, ...] | None
    runs: tuple[str, ...]


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
    parts = [(part, part.time[0] - first) for run in recording.runs if (part := _reported(run)) is not None]
    found = [_errors(drive, part, *(begun(x, start) for x in (before, after))) for part, start in parts]
    if not found:
        return None
    sides = []
    for errors in zip(*found, strict=True):
        good = [e for e in errors if e is not None]
        whole = np.concatenate(good) if len(good) == len(found) else None
        sides.append(None if whole is None else tuple(float(v) for v in np.sqrt(np.mean(whole**2, axis=0))))
    if sides == [None, None]:
        return None
    return FreeSimulation(sides[0], sides[1], tuple(part.name for part, _ in parts))


def _reported(run: Run) -> Run | None:
    """The reported rows of a run, from the first to the last; None where there are too few."""
    rows = np.flatnonzero(run.test)
    return run.part(slice(int(rows[0]), int(rows[-1]) + 1)) if len(rows) > 2 * FIRST else None


def _errors(drive: Drive, run: Run, *sides: Mapping[str, StartValue]) -> list[np.ndarray | None]:
    """Simulated less recorded position (n, nj) of each model."""
    from build_fmus.scratch import workspace
    from cosim.fmu import open_system

    with workspace() as folder:
        scenario = _experiment(drive, run, folder)
        with open_system(scenario) as system:
            return [_error(scenario, system, drive, run, stepped(values, run.step)) for values in sides]


def _error(
    scenario: Scenario, system: "System", drive: Drive, run: Run, values: Mapping[str, StartValue]
) -> np.ndarray | None:
    time = run.step * np.arange(FIRST)
    short = evolve(scenario, experiment=evolve(scenario.experiment, stop=float(time[-1])))
    dq, q = np.polyfit(time, run.q[:FIRST], 1)
    try:
        for _ in range(ROUNDS):
            slope, offset = np.polyfit(time, _motion(short, system, drive, values, q, dq) - run.q[:FIRST], 1)
            q, dq = q - offset, dq - slope
        error = _motion(scenario, system, drive, values, q, dq) - run.q
    except (InputError, RunError):
        return None
    return error if (np.abs(error) < np.ptp(run.q, axis=0).max()).all() else None


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
