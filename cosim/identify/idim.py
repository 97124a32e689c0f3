"""IDIM-LS for one joint as the authors of EMPS process it (Janot, Gautier, Brunot 2019): the published reference.

q through a Butterworth 4 low-pass of 100 Hz with zero phase, central differences, the first 49 rows dropped, every column
and the force decimated by 10 (Chebyshev I of order 8, zero phase, 0.8 of the new Nyquist frequency), ordinary least
squares with sgn(dq), all rows. The start-up of these filters at the first and last rows is part of the published figures.
"""

import numpy as np
from attrs import frozen

from cosim.measured.recording import Recording, Run

CUTOFF, DROPPED, FACTOR = 100.0, 49, 10


@frozen(eq=False)
class Idim:
    """params (inertia, viscous, coulomb, offset, gravity ...), relative errors [%] on training and held-out rows.

    other_*: the errors of another parameter vector on exactly these rows, which makes two processings comparable.
    """

    params: np.ndarray
    train: float
    held_out: float
    other_train: float
    other_held_out: float
    text: str = "IDIM-LS (Janot et al. 2019): Butterworth 4 at 100 Hz zero phase, decimated by 10, sgn(dq), all rows"


def idim(recording: Recording, other: np.ndarray) -> Idim | None:
    """IDIM-LS of an `axis` recording, beside the errors of the parameters `other`; None where the rate is too low for it."""
    if recording.device != "axis" or any(run.step > 1.3e-3 for run in recording.runs):
        return None
    gravity = recording.description.gravity
    train = [_decimated(run, rows, gravity) for run in recording.runs if (rows := _stretch(run.train)) is not None]
    held = [_decimated(run, rows, gravity) for run in recording.runs if (rows := _stretch(run.test)) is not None]
    y, tau = (np.concatenate(parts) for parts in zip(*train, strict=True))
    params = np.linalg.lstsq(y, tau, rcond=None)[0]
    y_held, tau_held = (np.concatenate(parts) for parts in zip(*held, strict=True)) if held else (y[:0], tau[:0])
    return Idim(params, _error(y, tau, params), _error(y_held, tau_held, params), _error(y, tau, other),
                _error(y_held, tau_held, other))  # fmt: skip


def _stretch(rows: np.ndarray) -> slice | None:
    """The rows as one slice, None where they are too few to filter."""
    marked = np.flatnonzero(rows)
    return slice(marked[0], marked[-1] + 1) if len(marked) > 40 * FACTOR else None


def _decimated(run: Run, rows: slice, gravity: bool) -> tuple[np.ndarray, np.ndarray]:
    from scipy.signal import butter, filtfilt

    forward, backward = butter(4, CUTOFF, fs=1 / run.step)
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

    forward, backward = cheby1(8, 0.05, 0.8 / FACTOR)
    smooth = filtfilt(forward, backward, signal, padlen=24)
    return smooth[(len(signal) - 1) % FACTOR :: FACTOR]


def _error(y: np.ndarray, tau: np.ndarray, params: np.ndarray) -> float:
    """100 |tau - y params| / |tau| [%]."""
    return float(100 * np.linalg.norm(tau - y @ params) / np.linalg.norm(tau)) if len(tau) else float("nan")
