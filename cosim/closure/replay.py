"""The recorded experiment again, as a co-simulation: the device's FMU with and without the effect that was found.

Recording FMUs play the reference and the feed-forward torque, a PDController FMU closes the loop around the drive:

- closed loop, where a law was found in the run (`cosim.closure.controller`): reference q_ref, gains of the law, what
  the law does not explain as feed-forward. Error: torque of the replay minus recorded torque.
- guided, where there is none: reference the recorded q, feed-forward the recorded torque, a soft PD keeps the drive
  on the recorded path. Error: the torque that it needs for that.

A sampled torque is held for a step, here as on the device: what a regression on samples calls lag holds half a step
that the replay already has (`without_hold`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from attrs import evolve, field, frozen

from cosim.closure.controller import RecordedController, difference, find_laws, injected, reference
from cosim.closure.drive import Drive, StartValue, StartValues, drive_of, stepped
from cosim.closure.model.smoothing import convolve, kernel, position_noise
from cosim.errors import InputError, RunError
from cosim.measured.recording import Recording, Run
from cosim.scenario import Algorithm, Component, Connection, Experiment, Extrapolation, Scenario
from cosim.signals import Signal

if TYPE_CHECKING:
    from cosim.engine.master import System

SETTLE = 0.2  # s at the start of every run that are not judged: velocity and presliding state are not recorded
GUIDE = 2 * np.pi * 4.0  # rad/s, natural frequency of the guiding PD
SMOOTH = (0.0, 1.5e-3, 2.5e-3, 4e-3, 6e-3)  # s, widths of the kernel over the path that guides
JITTER = 0.005  # of the torque: the largest share that encoder noise on that path may cause
BLOCK = 0.5  # s, blocks of the bootstrap
LATE = 0.7 / GUIDE  # s: half of the lag above which the guiding PD is unstable
LEAST = 0.5  # of the judged rows: a model that reaches fewer has no replay error
WIDE = 3  # joints of a PDController
LAGS = ("actuator_lag", "time_delay")
SIDES = ("before", "after")


@frozen(eq=False)
class Replay:
    """RMS% of torque on held-out rows per joint (nj,), of the models before and after, with 95 % intervals of the
    latter (nj, 2); nan for a model that could not be replayed. doubts: those of the warnings for which no effect is
    named for sure.

    Both torques passed the same filter; raw_before, raw_after: unfiltered. position_before, position_after: RMS of q
    [rad or m]. time (n,), tau, tau_before, tau_after (n, nj): the last run judged, for figures.
    """

    kind: str
    before: tuple[float, ...]
    after: tuple[float, ...]
    interval: tuple[tuple[float, float], ...]
    raw_before: tuple[float, ...]
    raw_after: tuple[float, ...]
    position_before: tuple[float, ...]
    position_after: tuple[float, ...]
    runs: tuple[str, ...]
    laws: tuple[RecordedController | None, ...] = ()
    warnings: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    time: np.ndarray = field(factory=lambda: np.zeros(0), repr=False)
    tau: np.ndarray = field(factory=lambda: np.zeros(0), repr=False)
    tau_before: np.ndarray = field(factory=lambda: np.zeros(0), repr=False)
    tau_after: np.ndarray = field(factory=lambda: np.zeros(0), repr=False)


@frozen(eq=False)
class _ReplayedRun:
    """What is played back to the loop of a run: q_ref, feed (n, nj), gains kp, kd and limit (nj,), samples of the
    velocity difference, cutoff [Hz] of its low-pass; guided: whether the PD only keeps the drive on the recorded path.
    """

    run: Run
    q_ref: np.ndarray
    feed: np.ndarray
    kp: tuple[float, ...]
    kd: tuple[float, ...]
    samples: int
    cutoff: float
    limit: tuple[float, ...]
    guided: bool


def replay(
    recording: Recording, before: Mapping[str, StartValue], after: Mapping[str, StartValue], width: float = 8e-3
) -> Replay | None:
    """Replay every run that has held-out rows with two sets of start values of the device's FMU.

    Errors are those of torques that passed a Gaussian kernel of standard deviation `width` [s], as for the torque
    error: the recorded torque contains the noise of its encoder and amplifier, the replay does not. None where the
    device has no FMU. A side that cannot be replayed is nan, and a warning says why. Raises RunError where neither can.
    """
    drive = drive_of(recording.device)
    if drive is None:
        return None
    laws = find_laws(recording)
    held = [run for run in recording.runs if run.test.any()]
    paths = [_recorded_loop(run, laws) if laws else _guided(run, drive.inertia(before)) for run in held]
    first = min(run.time[0] for run in recording.runs)
    runs = [_compared(drive, path, *(begun(x, path.run.time[0] - first) for x in (before, after))) for path in paths]
    return _summary(runs, laws or (), width)


def without_hold(parameters: Mapping[str, StartValue], step: float) -> StartValues:
    """Lags and delays of a sampled regression less the half step that a held torque already has; never negative."""
    changed = dict(parameters)
    for name in LAGS:
        if name in changed:
            value = np.asarray(changed[name], float)
            less = np.where(value > 0, np.maximum(value - step / 2, 0.0), 0.0)
            changed[name] = less.tolist() if value.ndim else float(less)
    return changed


def begun(parameters: Mapping[str, StartValue], start: float) -> StartValues:
    """Parameters of a run that begins `start` seconds into the recording: f (1 + d (start + t)) = f' (1 + d' t).

    With a time constant T: f (1 + d T (1 - exp(-(start + t)/T))) = f' (1 + d' T (1 - exp(-t/T))), d' = d exp(-start/T)
    f / f'.
    """
    drift, constant = (
        np.asarray(parameters.get(name, 0.0), float) for name in ("friction_drift", "friction_drift_time")
    )
    finite = np.where(constant > 0, constant, 1.0)
    grown = 1 + drift * np.where(constant > 0, -finite * np.expm1(-start / finite), start)
    drift = drift * np.where(constant > 0, np.exp(-start / finite), 1.0)
    changed = {
        name: np.asarray(parameters[name], float) * grown for name in ("viscous", "coulomb") if name in parameters
    }
    changed |= {"friction_drift": drift / grown}
    return (
        {**parameters, **{name: value.tolist() for name, value in changed.items()}} if drift.any() else dict(parameters)
    )


def _recorded_loop(run: Run, laws: Sequence[RecordedController]) -> _ReplayedRun:
    """The recorded reference and law; its terms beside the PD and what it does not explain are fed forward."""
    feed = np.stack([_feed(run, law, joint) for joint, law in enumerate(laws)], axis=1)
    gains = [tuple(getattr(law, name) for law in laws) for name in ("kp", "kd", "limit")]
    return _ReplayedRun(run, reference(run), feed, gains[0], gains[1], laws[0].samples, laws[0].cutoff, gains[2], False)


def _feed(run: Run, law: RecordedController, joint: int) -> np.ndarray:
    return law.feed(reference(run)[:, joint], run.q[:, joint], run.step) + injected(law, run, joint)


def _guided(run: Run, inertia: np.ndarray) -> _ReplayedRun:
    """The recorded position and torque, and gains that give the inertia (nj,) the frequency GUIDE, well damped."""
    samples = 2
    damping = 1.4 * GUIDE * inertia
    smooth = _smoothed(run, damping)
    feed = run.tau + damping * difference(smooth, run.step, samples)
    return _ReplayedRun(
        run, smooth, feed, tuple(GUIDE**2 * inertia), tuple(damping), samples, 0.0, (0.0,) * len(inertia), True
    )


def _smoothed(run: Run, damping: np.ndarray) -> np.ndarray:
    """The recorded path, smoothed just enough for little noise of the damping torque. It is continued beyond its ends
    by reflection, so that it does not stop there.

    Noise s of q makes noise s sqrt(H / (4 sqrt(pi) w^3)) of dq behind a Gaussian of width w.
    """
    noise, allowed = position_noise(run.q), JITTER * np.sqrt(np.mean(run.tau**2, axis=0))

    def quiet(width: float) -> bool:
        rate = np.sqrt(run.step / (4 * np.sqrt(np.pi) * width**3)) if width else 1 / (np.sqrt(2) * run.step)
        return bool((damping * noise * rate < allowed).all())

    width = next(filter(quiet, SMOOTH), SMOOTH[-1])
    weights = kernel(width / run.step)
    reach = len(weights) // 2
    return convolve(np.pad(run.q, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd"), weights)[
        reach : reach + len(run)
    ]


@frozen(eq=False)
class _ReplaySide:
    """One model through one run: tau, q (n, nj), nan from where it ended; why it ended early, else empty."""

    tau: np.ndarray
    q: np.ndarray
    ended: str = ""


@frozen(eq=False)
class _Compared:
    path: _ReplayedRun
    before: _ReplaySide
    after: _ReplaySide


def _compared(
    drive: Drive, path: _ReplayedRun, before: Mapping[str, StartValue], after: Mapping[str, StartValue]
) -> _Compared:
    """Both models through one run, each by itself."""
    from build_fmus.scratch import workspace
    from cosim.fmu import open_system

    with workspace() as folder:
        scenario = experiment(drive, path, folder)
        with open_system(scenario) as system:
            first, second = (_played(scenario, system, path, values) for values in (before, after))
            return _Compared(path, first, second)


def _played(
    scenario: Scenario, system: System, path: _ReplayedRun, parameters: Mapping[str, StartValue]
) -> _ReplaySide:
    from cosim.engine.master import run as execute

    values = stepped(parameters, path.run.step)
    try:
        given = {**values, **scenario.components["drive"].parameters}  # where it starts is the recording's
        changed = scenario.with_values({f"drive.{key}": value for key, value in given.items()})
        controllers = _controllers(path.q_ref.shape[1])
        result = execute(changed, system, record=[*(f"{name}.tau" for name in controllers), "drive.q"])
    except (InputError, RunError) as error:
        nothing = np.full_like(path.q_ref, np.nan)
        return _ReplaySide(nothing, nothing, str(error))
    tau = _column([result.vector(f"{name}.tau") for name in controllers], path)
    q = _column([result.vector("drive.q")], path)
    away = (np.abs(q - path.run.q) > np.ptp(path.run.q, axis=0).max()).any(axis=1)
    if away.any():
        first = int(np.argmax(away))
        tau[first:], q[first:] = np.nan, np.nan
        return _ReplaySide(tau, q, _unstable(path, first * path.run.step, values))
    return _ReplaySide(tau, q, str(result.failure or ("" if result.stopped_at is None else result.message)))


def _unstable(path: _ReplayedRun, time: float, values: Mapping[str, StartValue]) -> str:
    """In words: the drive was farther from the recorded path than that is wide."""
    late = float(np.max(np.add(*(np.asarray(values.get(name, 0.0)) for name in LAGS))))
    text = f"the loop is unstable: the drive had run away by t = {time:.3g} s"
    if path.guided and late > LATE:
        return (
            f"{text}, its torque comes {1e3 * late:.0f} ms late, too late for the "
            f"PD of {GUIDE / (2 * np.pi):.2g} Hz that guides it"
        )
    return f"{text}, {'the PD that guides it' if path.guided else 'the recorded law'} does not hold this model"


def _column(parts: Sequence[np.ndarray], path: _ReplayedRun) -> np.ndarray:
    """Recorded signals side by side on the rows of the run; rows that a run did not reach are nan."""
    values = np.column_stack(parts)[:, : path.q_ref.shape[1]]
    rows = np.full_like(path.q_ref, np.nan)
    rows[: len(values)] = values[: len(rows)]
    return rows


def experiment(drive: Drive, path: _ReplayedRun, folder: Path) -> Scenario:
    """The replay as a scenario: reference and feed-forward -> controller -> drive -> controller."""
    run, joints = path.run, path.q_ref.shape[1]
    parts = {
        "reference": played(run, path.q_ref, "rad", folder / "reference.csv"),
        "feed": played(run, path.feed, "N.m", folder / "feed.csv"),
        "drive": Component(model=drive.model, parameters=_start(path, drive)),
        **{
            name: Component(model="PDController", parameters=_gains(path, first))
            for first, name in zip(range(0, joints, WIDE), _controllers(joints), strict=True)
        },
    }
    settings = evolve(
        sampled(run), algorithm=Algorithm.GAUSS_SEIDEL, order=("reference", "feed", "drive", *_controllers(joints))
    )
    return Scenario("replay", settings, parts, _wires(drive, joints), folder=folder)


def played(run: Run, signals: np.ndarray, unit: str, file: Path) -> Component:
    """Signals (n, k) of a run played from a file that is written here, each sample held until the next."""
    names = tuple(f"y{k + 1}" for k in range(signals.shape[1]))
    table = np.column_stack([run.time - run.time[0], signals])
    np.savetxt(file, table, delimiter=",", header=",".join(("time", *names)), comments="", fmt="%.17g")
    return Component(recording=str(file), columns=names, unit=unit, interpolation=Extrapolation.HOLD)


def sampled(run: Run) -> Experiment:
    """A step for each sample of a run; a step's inputs are those of its beginning."""
    step = round(run.step * 1e9) / 1e9
    return Experiment(
        stop=(len(run) - 1) * step, step=step, algorithm=Algorithm.JACOBI, extrapolation=Extrapolation.HOLD
    )


def _start(path: _ReplayedRun, drive: Drive) -> dict[str, object]:
    """The recorded start, its velocity the mean over the first rows, and how many joints there are."""
    rows = min(8, len(path.run) - 1)
    speed = (path.run.q[rows] - path.run.q[0]) / (rows * path.run.step)
    return {**drive.fixed, **drive.start_of(path.run.q[0], speed)}


def _controllers(joints: int) -> list[str]:
    """Names of the controllers, each of WIDE joints."""
    return [f"controller{first // WIDE + 1}" for first in range(0, joints, WIDE)]


def _gains(path: _ReplayedRun, first: int) -> dict[str, object]:
    """Parameters of the PDController of joints from `first` on; joints that are not there have no gain."""

    def wide(values: Sequence[float]) -> list[float]:
        own = values[first : first + WIDE]
        return [float(v) for v in own] + [0.0] * (WIDE - len(own))

    return {
        "kp": wide(path.kp),
        "kd": wide(path.kd),
        "torque_limit": wide(path.limit),
        "difference_samples": path.samples,
        "velocity_cutoff": path.cutoff,
    }


def _wires(drive: Drive, joints: int) -> tuple[Connection, ...]:
    wires = []
    for j in range(joints):
        q, tau = drive.variable("q", j), drive.variable("tau", j)
        controller, k = _controllers(joints)[j // WIDE], j % WIDE + 1
        wires += [
            Connection(Signal("reference", f"y[{j + 1}]"), Signal(controller, f"q_ref[{k}]")),
            Connection(Signal("feed", f"y[{j + 1}]"), Signal(controller, f"tau_ff[{k}]")),
            Connection(Signal("drive", q), Signal(controller, f"q[{k}]")),
            Connection(Signal(controller, f"tau[{k}]"), Signal("drive", tau)),
        ]
    return tuple(wires)


@frozen(eq=False)
class _ReplayedRows:
    """Torque, position and smoothed torque (n, nj) on the judged rows of all runs."""

    tau: np.ndarray
    q: np.ndarray
    calm: np.ndarray

    @classmethod
    def of(cls, compared: Sequence[_Compared], width: float, pick: Callable[[_Compared], _ReplaySide | Run]) -> Self:
        """The judged rows of one side, or of the recording."""

        def smooth(c: _Compared) -> np.ndarray:
            return convolve(pick(c).tau, kernel(width / c.path.run.step))

        return cls(*(_judged(compared, x) for x in (lambda c: pick(c).tau, lambda c: pick(c).q, smooth)))

    @property
    def reached(self) -> np.ndarray:
        """Rows (n,) on which everything is known."""
        return np.asarray(np.isfinite(np.column_stack((self.tau, self.q, self.calm))).all(axis=1))

    def at(self, rows: np.ndarray, known: bool = True) -> _ReplayedRows:
        """The chosen rows; nan where the side does not count."""
        return _ReplayedRows(
            *(x[rows] if known else np.full_like(x[rows], np.nan) for x in (self.tau, self.q, self.calm))
        )


def _summary(compared: Sequence[_Compared], laws: tuple[RecordedController, ...], width: float) -> Replay:
    """Errors on the judged rows that every side reached, leaving out a side that reached too few. Raises RunError where
    both did.
    """
    sides = [_ReplayedRows.of(compared, width, attrgetter(side)) for side in SIDES]
    counts = [bool(len(side.tau)) and side.reached.mean() >= LEAST for side in sides]
    if not any(counts):
        first, second = (_reasons(compared, side) for side in SIDES)
        why = (
            first
            if first == second
            else [f"model {side}, {x}" for side, xs in zip(SIDES, (first, second), strict=True) for x in xs]
        )
        raise RunError("drive", None, "; ".join(why) or f"no held-out row after the first {SETTLE} s of a run")
    keep = np.all([side.reached for side, good in zip(sides, counts, strict=True) if good], axis=0)
    recorded = _ReplayedRows.of(compared, width, lambda c: c.path.run).at(keep)
    before, after = (side.at(keep, good) for side, good in zip(sides, counts, strict=True))
    size, last = max(round(BLOCK / compared[0].path.run.step), 1), compared[-1]
    shown = [getattr(last, side).tau * (1.0 if good else np.nan) for side, good in zip(SIDES, counts, strict=True)]
    error_before, error_after = (_percent(side.calm, recorded.calm) for side in (before, after))
    interval = _interval(after.calm - recorded.calm, recorded.calm, size)
    lost, worse = _lost(compared, counts, 1 - keep.mean()), _worse(error_before, error_after, interval)
    return Replay(
        kind="guided" if compared[0].path.guided else "closed loop",
        before=error_before,
        after=error_after,
        interval=interval,
        raw_before=_percent(before.tau, recorded.tau),
        raw_after=_percent(after.tau, recorded.tau),
        position_before=_rms(before.q - recorded.q),
        position_after=_rms(after.q - recorded.q),
        runs=tuple(c.path.run.name for c in compared),
        laws=laws,
        warnings=(*_notes(compared, laws), *lost.values(), *worse),
        doubts=(*(text for side, text in lost.items() if side == "after" and not counts[1]), *worse),
        time=last.path.run.time,
        tau=last.path.run.tau,
        tau_before=shown[0],
        tau_after=shown[1],
    )


def _judged(compared: Sequence[_Compared], pick: Callable[[_Compared], np.ndarray]) -> np.ndarray:
    """Held-out rows after the first SETTLE seconds of each run, below each other."""
    parts = []
    for c in compared:
        rows = c.path.run.test.copy()
        rows[: int(SETTLE / c.path.run.step)] = False
        parts.append(pick(c)[rows])
    return np.concatenate(parts)


def _rms(x: np.ndarray) -> tuple[float, ...]:
    return tuple(float(v) for v in np.sqrt(np.mean(x**2, axis=0)))


def _percent(replayed: np.ndarray, tau: np.ndarray) -> tuple[float, ...]:
    return tuple(100 * e / max(t, 1e-300) for e, t in zip(_rms(replayed - tau), _rms(tau), strict=True))


def _interval(error: np.ndarray, tau: np.ndarray, size: int) -> tuple[tuple[float, float], ...]:
    """95 % interval of RMS% by resampling blocks of `size` rows, 400 times."""
    count = max(len(error) // size, 1)
    blocks = [np.array_split(x**2, count) for x in (error, tau)]
    sums = [np.array([block.sum(axis=0) for block in part]) for part in blocks]
    draws = np.random.default_rng(0).integers(count, size=(400, count))
    spread = 100 * np.sqrt(sums[0][draws].sum(axis=1) / np.maximum(sums[1][draws].sum(axis=1), 1e-300))
    low, high = np.percentile(spread, (2.5, 97.5), axis=0)
    return tuple((float(a), float(b)) for a, b in zip(low, high, strict=True))


def _notes(compared: Sequence[_Compared], laws: tuple[RecordedController, ...]) -> tuple[str, ...]:
    notes = []
    for path in (c.path for c in compared):
        rest = [injected(law, path.run, joint) for joint, law in enumerate(laws)]
        share = max(
            (100 * np.sqrt(np.mean(x**2) / np.mean(path.run.tau[:, j] ** 2)) for j, x in enumerate(rest)), default=0.0
        )
        if share > 0:
            notes.append(
                f"{path.run.name}: the recorded torque holds an input of its own (pulses, feed-forward) of "
                f"{share:.0f} % RMS beside the law from q_ref; it is replayed as recorded"
            )
    if not laws:
        notes.append(
            "no law from q_ref gives the recorded torque: replayed with the recorded torque fed forward and a "
            "soft PD that holds the drive on the recorded path; the error is the torque it needs"
        )
    return tuple(notes)


def _lost(compared: Sequence[_Compared], counts: Sequence[bool], share: float) -> dict[str, str]:
    """Sides that ended early, and why in words; share: of the rows that are not judged."""
    notes = {}
    for side, good in zip(SIDES, counts, strict=True):
        if why := "; ".join(_reasons(compared, side)):
            what = (
                f"the replay of the model {side} ended early, {share:.0%} of the rows are not judged"
                if good
                else f"no replay of the model {side}"
            )
            notes[side] = f"{what}: {why}"
    return notes


def _worse(before: Sequence[float], after: Sequence[float], interval: Sequence[tuple[float, float]]) -> list[str]:
    """In words: joints whose replay is clearly worse with the model after."""
    pairs = zip(before, after, interval, strict=True)
    joints = [f"joint {j} {b:.2f} -> {a:.2f} %" for j, (b, a, (low, _)) in enumerate(pairs, 1) if low > b]
    if not joints:
        return []
    return [
        f"the replay is worse with the model after than before "
        f"({', '.join(joints)}) and so disagrees with the torque error: in a replay "
        "errors feed back through the controller and from joint to joint"
    ]


def _reasons(compared: Sequence[_Compared], side: str) -> list[str]:
    return [f"{c.path.run.name}: {text}" for c in compared if (text := getattr(c, side).ended)]
