"""The rows of all runs on one pile: filtered, decimated, with marks for what is fitted and what is held out."""

import numpy as np
from attrs import evolve, frozen

from cosim.identification import regressor
from cosim.identification.method import Method
from cosim.identification.regressor import RegressorColumns, slow_columns
from cosim.measured.filtering import FilteredMotion, motion
from cosim.measured.recording import Recording, Run


@frozen(eq=False)
class Stack:
    """Linear model of a recording: y (n, nj, p), tau and its rate (n, nj); n counts time stamps of all runs.

    keep (n, nj): settled rows away from reversals; settled (n,): rows past the filters' start-up; test (n,): held out;
    run (n,): number of the run; time (n,) [s]; q, dq (n, nj) as filtered; step [s] between rows.
    """

    y: np.ndarray
    tau: np.ndarray
    tau_rate: np.ndarray
    keep: np.ndarray
    settled: np.ndarray
    test: np.ndarray
    run: np.ndarray
    time: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    step: float
    names: tuple[str, ...]
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
    motions = [_motion(recording, run, method) for run in recording.runs]
    speed = np.sqrt(np.concatenate([m.dq**2 for m in motions]).mean(axis=0))
    pieces = [_piece(recording, m, method, speed, number) for number, m in enumerate(motions)]
    columns = ("y", "tau", "tau_rate", "keep", "settled", "test", "run", "time", "q", "dq")
    joined = {name: np.concatenate([getattr(piece, name) for piece in pieces]) for name in columns}
    first = pieces[0]
    return _with_rows(Stack(**joined, step=first.step, names=first.names, units=first.units), recording.joints)


def _motion(recording: Recording, run: Run, method: Method) -> FilteredMotion:
    found = motion(recording, run, method.before)
    return found if method.both_sides else evolve(found, tau=run.tau)


def _piece(recording: Recording, moved: FilteredMotion, method: Method, speed: np.ndarray, number: int) -> Stack:
    model = regressor.columns(recording, moved, method.low_pass, method.reversals.smoothing)
    n, step = len(moved.time), moved.step
    head, tail = (
        min(sum(rows), n // 8) for rows in zip(method.low_pass.settle(step), method.before.settle(step), strict=True)
    )
    spread = tuple(sum(rows) for rows in zip(method.low_pass.spread(step), method.before.spread(step), strict=True))
    settled = (np.arange(n) >= head) & (np.arange(n) < n - tail)
    keep = method.reversals.keep(moved, spread, speed) & settled[:, None]
    model = _with_tail(model, moved, method, speed)
    pick = slice(None, None, method.low_pass.decimation(step))
    return Stack(
        y=model.y[pick],
        tau=model.tau[pick],
        tau_rate=method.low_pass.rate(moved.tau, step)[pick],
        keep=keep[pick],
        settled=settled[pick],
        test=moved.run.test[pick],
        run=np.full(len(model.tau[pick]), number),
        time=moved.time[pick],
        q=moved.q[pick],
        dq=moved.dq[pick],
        step=step * (pick.step or 1),
        names=model.names,
        units=model.units,
    )


def _with_tail(model: RegressorColumns, moved: FilteredMotion, method: Method, speed: np.ndarray) -> RegressorColumns:
    """A column `slow` per joint where the law of the sign is not known: what a smoothed sign leaves at the slowest
    rows.
    """
    slowest = method.reversals.slowest(speed)
    if slowest is None or not slowest.all():
        return model
    tail = method.low_pass.low(slow_columns(moved.dq, slowest), moved.step)
    names = ["slow"] if len(speed) == 1 else [f"slow[{j + 1}]" for j in range(len(speed))]
    return evolve(
        model,
        y=np.concatenate([model.y, tail], axis=2),
        names=(*model.names, *names),
        units=(*model.units, *[model.units[model.names.index(coulomb_name(names[0]))]] * len(names)),
    )


def coulomb_name(slow: str) -> str:
    """Name of the Coulomb friction that a `slow` column belongs to."""
    return slow.replace("slow", "coulomb")


def without(full: Stack, names: tuple[str, ...]) -> Stack:
    """The stack with some columns taken out."""
    kept = [k for k, name in enumerate(full.names) if name not in names]
    return evolve(
        full, y=full.y[:, :, kept], names=tuple(full.names[k] for k in kept), units=tuple(full.units[k] for k in kept)
    )


def _with_rows(full: Stack, joints: tuple[str, ...]) -> Stack:
    """Where leaving out reversals leaves less than a twentieth of the rows of a joint, its rows are all kept, and
    told.
    """
    train, keep, notes = full.settled & ~full.test, full.keep.copy(), []
    for j, joint in enumerate(joints):
        if full.fit[:, j].sum() < max(0.05 * train.sum(), 3 * full.y.shape[2]):
            keep[:, j] = full.settled
            notes.append(
                f"{joint}: almost all rows are near a reversal; none left out, Coulomb friction is not reliable"
            )
    return evolve(full, keep=keep, notes=tuple(notes))


def everything(full: Stack) -> Stack:
    """The same rows with none left out at reversals."""
    return evolve(full, keep=np.repeat(full.settled[:, None], full.tau.shape[1], axis=1))
