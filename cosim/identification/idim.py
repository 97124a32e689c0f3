"""IDIM-LS for one joint as the authors of EMPS process it (Janot, Gautier, Brunot 2019): the published reference.

q through a Butterworth 4 low-pass of 100 Hz with zero phase, central differences, the first 49 rows dropped, every
column and the force decimated by 10 (Chebyshev I of order 8, zero phase, 0.8 of the new Nyquist frequency), ordinary
least squares with sgn(dq), all rows. The start-up of these filters at the first and last rows is part of the published
figures.
"""

import numpy as np
from attrs import evolve, frozen

from cosim.measured.device import AxisDevice
from cosim.measured.recording import Recording, Run

CUTOFF, DROPPED, FACTOR = 100.0, 49, 10
SLOWEST = 1.3e-3  # s: the new Nyquist frequency is then 38 Hz; of slower recordings no motion is left below it
PADDED = 40 * FACTOR  # rows: the start-up of both filters at either end
RegressorRows = tuple[np.ndarray, np.ndarray]
"""Columns (m, p) and force (m,)."""


@frozen(eq=False)
class IdimFit:
    """params (inertia, viscous, coulomb, offset, gravity ...) and their relative errors [%] on training and held-out
    rows.
    """

    params: np.ndarray
    train: float
    held_out: float


@frozen(eq=False)
class Idim:
    """published: as the authors do it; other: another parameter vector on exactly these rows; recentred: the authors'
    way with the force averaged over one sample either side of its stamp, as a digital controller holds it.
    """

    published: IdimFit
    other: IdimFit
    recentred: IdimFit | None
    text: str = "IDIM-LS (Janot et al. 2019): Butterworth 4 at 100 Hz zero phase, decimated by 10, sgn(dq), all rows"


def idim(recording: Recording, other: np.ndarray) -> Idim | None:
    """IDIM-LS of an `axis` recording, beside the errors of the parameters `other`; None where the rate is too low for
    it, or torques were clipped.
    """
    axis = recording.device
    if not isinstance(axis, AxisDevice) or any(run.step > SLOWEST or run.clipped is not None for run in recording.runs):
        return None
    train, held = _rows(recording, axis, False), _rows(recording, axis, True)
    if train is None:
        return None
    published = _fit(train, held)
    centred = None
    if not recording.description.torque_held:
        middle = evolve(recording, runs=tuple(evolve(run, tau=_middle(run.tau)) for run in recording.runs))
        rows = _rows(middle, axis, False)
        assert rows is not None, "the same rows as above"
        centred = _fit(rows, _rows(middle, axis, True))
    return Idim(published, _judged(other, train, held), centred)


def _middle(tau: np.ndarray) -> np.ndarray:
    return np.concatenate([tau[:1], (tau[1:] + tau[:-1]) / 2])


def _rows(recording: Recording, axis: AxisDevice, test: bool) -> RegressorRows | None:
    """Decimated regressor (m, p) and force (m,) of the training or the held-out rows of all runs."""
    marked = [(run, _stretch(run.test if test else run.train)) for run in recording.runs]
    parts = [_decimated(run, rows, axis.pendulum) for run, rows in marked if rows is not None]
    if not parts:
        return None
    return np.concatenate([y for y, _ in parts]), np.concatenate([tau for _, tau in parts])


def _fit(train: RegressorRows, held: RegressorRows | None) -> IdimFit:
    y, tau = train
    return _judged(np.linalg.lstsq(y, tau, rcond=None)[0], train, held)


def _judged(params: np.ndarray, train: RegressorRows, held: RegressorRows | None) -> IdimFit:
    return IdimFit(params, _error(*train, params), float("nan") if held is None else _error(*held, params))


def _stretch(rows: np.ndarray) -> slice | None:
    """The rows as one slice, None where they are too few to filter."""
    marked = np.flatnonzero(rows)
    return slice(marked[0], marked[-1] + 1) if len(marked) > PADDED else None


def _decimated(run: Run, rows: slice, gravity: bool) -> RegressorRows:
    from scipy.signal import butter, filtfilt

    forward, backward = np.asarray(butter(4, CUTOFF, fs=1 / run.step, output="ba"))
    q = filtfilt(forward, backward, run.q[rows, 0], padlen=12)
    dq = np.gradient(q, run.step)
    columns = [np.gradient(dq, run.step), dq, np.sign(dq), np.ones_like(dq)]
    columns += [np.sin(q), np.cos(q)] if gravity else []
    signals = np.column_stack([*columns, run.tau[rows, 0]])[DROPPED:]
    kept = np.column_stack([_decimate(signal) for signal in signals.T])
    return kept[:, :-1], kept[:, -1]


def _decimate(signal: np.ndarray) -> np.ndarray:
    """As MATLAB's `decimate`: filtered both ways, then the rows that end on the last one."""
    from scipy.signal import cheby1, filtfilt

    forward, backward = np.asarray(cheby1(8, 0.05, 0.8 / FACTOR, output="ba"))
    smooth = filtfilt(forward, backward, signal, padlen=24)
    return smooth[(len(signal) - 1) % FACTOR :: FACTOR]


def _error(y: np.ndarray, tau: np.ndarray, params: np.ndarray) -> float:
    """100 |tau - y params| / |tau| [%]."""
    return float(100 * np.linalg.norm(tau - y @ params) / np.linalg.norm(tau))
