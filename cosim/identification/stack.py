"""The rows of all runs below each other: filtered, decimated, with marks for what is fitted and what is held out."""

from collections.abc import Sequence

import numpy as np
from attrs import evolve, frozen

from cosim.identification.linear_model import LinearModel
from cosim.identification.method import Method
from cosim.identification.models import linear_model
from cosim.identification.regressor import RegressorColumns, slow_columns
from cosim.measured.device import Device
from cosim.measured.filtering import FilteredMotion, derivative, motion, near_reversal, widened
from cosim.measured.label import Label
from cosim.measured.recording import Recording, Run

FEW_LEFT = 0.05  # of the rows of a joint that are left away from reversals: then all are kept, which is told
BLOCK = 1 << 16  # rows whose columns are held at once


@frozen(eq=False)
class Stack:
    """Linear model of a recording: y (n, nj, p), tau, its rate and the rate of that (n, nj); n counts time
    stamps of all runs.

    keep (n, nj): settled rows away from reversals; settled (n,): rows past the filters' start-up; whole (n, nj): rows
    whose torque no filter mixes with a clipped one; test (n,): held out; run (n,): number of the run; time (n,) [s]; q,
    dq (n, nj) as filtered; step [s] between rows.
    """

    y: np.ndarray
    tau: np.ndarray
    tau_rate: np.ndarray
    tau_bend: np.ndarray
    keep: np.ndarray
    settled: np.ndarray
    whole: np.ndarray
    test: np.ndarray
    run: np.ndarray
    time: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    step: float
    labels: tuple[Label, ...]
    units: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def fit(self) -> np.ndarray:
        """Equations to fit on, (n, nj)."""
        return self.keep & ~self.test[:, None]

    @property
    def held_out(self) -> np.ndarray:
        """Equations to judge on, (n, nj), with the same treatment of reversals."""
        return self.keep & self.test[:, None]

    def equations(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """y (m, p), tau (m,), joint (m,), time-stamp number (m,) of the marked equations (n, nj)."""
        stamp, joint = np.nonzero(rows)
        return self.y[rows], self.tau[rows], joint, stamp


def stack(recording: Recording, method: Method) -> Stack:
    """All runs through the method's filters."""
    model = linear_model(recording.device, recording.description)
    motions = [_motion(recording, run, method) for run in recording.runs]
    speed = np.sqrt(np.concatenate([m.dq**2 for m in motions]).mean(axis=0))
    pieces = [_piece(model, m, method, speed, number) for number, m in enumerate(motions)]
    first = pieces[0]
    joined = Stack(
        y=np.concatenate([piece.y for piece in pieces]),
        tau=np.concatenate([piece.tau for piece in pieces]),
        tau_rate=np.concatenate([piece.tau_rate for piece in pieces]),
        tau_bend=np.concatenate([piece.tau_bend for piece in pieces]),
        keep=np.concatenate([piece.keep for piece in pieces]),
        settled=np.concatenate([piece.settled for piece in pieces]),
        whole=np.concatenate([piece.whole for piece in pieces]),
        test=np.concatenate([piece.test for piece in pieces]),
        run=np.concatenate([piece.run for piece in pieces]),
        time=np.concatenate([piece.time for piece in pieces]),
        q=np.concatenate([piece.q for piece in pieces]),
        dq=np.concatenate([piece.dq for piece in pieces]),
        step=first.step,
        labels=first.labels,
        units=first.units,
    )
    return _with_rows(joined, recording.joints)


def _motion(recording: Recording, run: Run, method: Method) -> FilteredMotion:
    found = motion(recording, run, method.before)
    return found if method.both_sides else evolve(found, tau=run.tau)


def _piece(model: LinearModel, moved: FilteredMotion, method: Method, speed: np.ndarray, number: int) -> Stack:
    n, step = len(moved.time), moved.step
    head, tail = (
        min(sum(rows), n // 8) for rows in zip(method.low_pass.settle(step), method.before.settle(step), strict=True)
    )
    before, after = (sum(rows) for rows in zip(method.low_pass.spread(step), method.before.spread(step), strict=True))
    settled = (np.arange(n) >= head) & (np.arange(n) < n - tail)
    whole = _whole(moved.run, method, (before, after))
    keep = method.reversals.keep(moved, (before, after), speed) & settled[:, None] & whole
    keep &= _beyond_dead_band(moved.run, method, (before, after))
    every = method.low_pass.decimation(step)
    pick = slice(None, None, every)
    columns, rate, bend = _in_blocks(model, moved, method, speed, every)
    return Stack(
        y=columns.y,
        tau=columns.tau,
        tau_rate=rate,
        tau_bend=bend,
        keep=keep[pick],
        settled=settled[pick],
        whole=whole[pick],
        test=moved.run.test[pick],
        run=np.full(len(columns.tau), number),
        time=moved.time[pick],
        q=moved.q[pick],
        dq=moved.dq[pick],
        step=step * every,
        labels=columns.labels,
        units=columns.units,
    )


def _in_blocks(
    model: LinearModel, moved: FilteredMotion, method: Method, speed: np.ndarray, every: int
) -> tuple[RegressorColumns, np.ndarray, np.ndarray]:
    """The model's columns, the rate of tau and the rate of that (m, nj), at every `every`-th row.

    Columns at all rows of a long recording would need gigabytes: they are formed for BLOCK rows at a time, with the
    rows beside them that the filter sees.
    """
    before, after = (rows + 2 for rows in method.low_pass.memory(moved.step))
    blocks, rates, bends = [], [], []
    for start in range(0, len(moved.time), BLOCK // every * every):
        stop = min(start + BLOCK // every * every, len(moved.time))
        first = max(start - before, 0)
        part = moved.part(slice(first, stop + after))
        columns = model.columns(part, method.low_pass, method.reversals.smoothing)
        columns = _with_tail(columns, model.device, part, method, speed)
        own = slice(start - first, stop - first, every)
        blocks.append(evolve(columns, y=columns.y[own].copy(), tau=columns.tau[own].copy()))
        rates.append(method.low_pass.rate(part.tau, moved.step)[own].copy())
        bends.append(method.low_pass.rate(derivative(part.tau, moved.step), moved.step)[own].copy())
    y, tau = np.concatenate([b.y for b in blocks]), np.concatenate([b.tau for b in blocks])
    return evolve(blocks[0], y=y, tau=tau), np.concatenate(rates), np.concatenate(bends)


def _whole(run: Run, method: Method, reach: tuple[int, int]) -> np.ndarray:
    """Rows (n, nj) whose filtered torque holds no clipped value.

    Rows are chosen by the torque, but in contiguous stretches that end a filter's reach away from the limit: noise that
    lasts shorter than that does not choose them, so that what is left is not biased.
    """
    if run.clipped is None or not method.reversals.heed_clipping:
        return np.ones(run.tau.shape, bool)
    return ~np.stack([widened(rows, reach) for rows in run.clipped.T], axis=1)


def _beyond_dead_band(run: Run, method: Method, reach: tuple[int, int]) -> np.ndarray:
    """Rows (n, nj) away from errors within a servo's dead band, where its output is not known."""
    if run.servo is None:
        return np.ones(run.tau.shape, bool)
    errors = run.tau / np.abs(run.servo)
    return ~np.stack([near_reversal(error, run.step, reach, method.dead_band) for error in errors.T], axis=1)


def _with_tail(
    columns: RegressorColumns, device: Device, moved: FilteredMotion, method: Method, speed: np.ndarray
) -> RegressorColumns:
    """A column `slow` per joint where the law of the sign is not known: what a smooth sign differs by from sgn(dq) on
    the slowest rows.
    """
    slowest = method.reversals.slowest(speed)
    if slowest is None or not slowest.all():
        return columns
    tail = method.low_pass.low(slow_columns(moved.dq, slowest), moved.step)
    labels = [device.label("slow", joint) for joint in range(len(speed))]
    unit = columns.units[columns.labels.index(coulomb_label(labels[0]))]
    return evolve(
        columns,
        y=np.concatenate([columns.y, tail], axis=2),
        labels=(*columns.labels, *labels),
        units=(*columns.units, *[unit] * len(labels)),
    )


def coulomb_label(slow: Label) -> Label:
    """The Coulomb friction that a `slow` column belongs to."""
    return evolve(slow, name="coulomb")


def without(full: Stack, labels: tuple[Label, ...]) -> Stack:
    """The stack with some columns taken out."""
    kept = [k for k, label in enumerate(full.labels) if label not in labels]
    return with_columns(full, kept)


def with_columns(full: Stack, kept: Sequence[int]) -> Stack:
    """The stack with these columns alone."""
    return evolve(
        full,
        y=full.y[:, :, list(kept)],
        labels=tuple(full.labels[k] for k in kept),
        units=tuple(full.units[k] for k in kept),
    )


def _with_rows(full: Stack, joints: tuple[str, ...]) -> Stack:
    """Where leaving out reversals leaves less than a twentieth of the rows of a joint, all its rows are kept, with a
    note.
    """
    keep, notes = full.keep.copy(), []
    for j, joint in enumerate(joints):
        train = full.settled & ~full.test & full.whole[:, j]
        if full.fit[:, j].sum() < max(FEW_LEFT * train.sum(), 3 * full.y.shape[2]):
            keep[:, j] = full.settled & full.whole[:, j]
            notes.append(
                f"{joint}: almost all rows are near a reversal; none left out, Coulomb friction is not reliable"
            )
    return evolve(full, keep=keep, notes=tuple(notes))


def everything(full: Stack) -> Stack:
    """The same rows with none left out at reversals; clipped ones stay out."""
    return evolve(full, keep=full.settled[:, None] & full.whole)
