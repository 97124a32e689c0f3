"""A linear map for an FMU that keeps what it does not show: from its answers to pulses.

A pulse in one input, one step long, is answered by h[0] = D, h[k] = C A^(k-1) B. Answers that end are a shift register
(FIR); others are realised by the eigensystem realisation algorithm (Ho and Kalman 1966; Juang and Pappa 1985) behind a
shift register for the dead time, with the least order that predicts what the outputs add up to. The memory found is
what acts from the inputs on the outputs: nothing else can act in a loop.
"""

from collections.abc import Iterator

import numpy as np
from attrs import frozen
from scipy.linalg import block_diag

from cosim.analysis.lone_fmu import LoneFmu
from cosim.analysis.sparse import Sparse, sparse
from cosim.analysis.step_fmu import StepFmu

HORIZON = 1.0
"""Time [s] over which answers are watched, at most MOST steps."""
MOST = 2000
ACCURACY = 1e-6
"""Part of an output by which the realised map may miss what a step in an input adds up to."""
_PULSES = (1e-1, 1e-3, 1e-5)
"""Amplitudes [unit of the input]: the largest at which doubling it doubles the answer is taken."""
_LATER = 37
"""A pulse after so many steps must be answered as one at the start."""
_SHORT = 20
"""Steps for which answers to pulses of different sizes are compared."""
_BLOCKS = 60
"""Rows and columns of blocks in the Hankel matrix."""


class NotLinearError(Exception):
    """The answers of an FMU to pulses are not those of a linear map that stays the same; the text says why."""


def realised(one: LoneFmu, outputs: tuple[str, ...], sloped: tuple[int, ...]) -> StepFmu:
    """The map of an FMU from its inputs (and their slopes) to the chosen outputs.

    Raises NotLinearError, RunError.
    """
    steps = int(np.clip(round(HORIZON / one.step), 20, MOST))
    rows = [one.instance.output_names.index(name) for name in outputs]
    answers = _Answers(one, rows, steps, len(sloped))
    h = answers.all(_size(answers))
    map_, order, residual = _map(h)
    names, m = tuple(one.instance.input_names), len(one.base)
    a, b, c, d = map_
    late = int(np.flatnonzero(np.any(h != 0.0, axis=(1, 2)))[0]) if np.any(h) else 0
    delay = _pure_delay(h[:, :, :m])
    origin = f"answers to pulses over {steps} steps: order {order}, residual {residual:.1e}"
    if delay is not None:
        origin = f"a delay of {delay * one.step:g} s, recognised by its answers to pulses"
    elif late:
        origin += f"; its outputs follow {late} step{'s' * (late > 1)} ({late * one.step:g} s) later"
    return StepFmu(
        *(names, outputs, sloped, one.step, a, b[:, :m], b[:, m:], c, d[:, :m], d[:, m:], origin),
        None if delay is None else delay * one.step,
        late,
        np.rint(h[:, :, :m].sum(axis=0)),
    )


@frozen
class _Answers:
    """Answers of an FMU alone to pulses: of its inputs, then of the slopes of those on lines."""

    one: LoneFmu
    rows: list[int]
    steps: int
    slopes: int

    def to(self, column: int, size: float, at: int = 0, steps: int | None = None) -> np.ndarray:
        """Per unit, half the difference of a pulse and its opposite, (steps, p)."""
        m, steps = len(self.one.base), (steps or self.steps) + at
        added, slopes = np.zeros((steps, m)), np.zeros((steps, self.slopes))
        (added if column < m else slopes)[at, column % m if column < m else column - m] = size
        up, down = (self.one.respond(sign * added, sign * slopes)[at:, self.rows] for sign in (1.0, -1.0))
        return (up - down) / (2.0 * size)

    def columns(self) -> Iterator[int]:
        """Pulses that can be given: of real inputs, and of slopes."""
        m = len(self.one.base)
        yield from np.flatnonzero(self.one.real).tolist()
        yield from range(m, m + self.slopes)

    def all(self, size: float) -> np.ndarray:
        """h (steps, p, m + slopes). Raises NotLinearError where a later pulse is answered otherwise."""
        h = np.zeros((self.steps, len(self.rows), len(self.one.base) + self.slopes))
        for column in self.columns():
            h[:, :, column] = self.to(column, size)
        h[np.abs(h) < 1e-13 * np.abs(h).max(initial=0.0)] = 0.0
        later = self.to(first := next(self.columns()), size, _LATER)
        if np.abs(later - h[:, :, first]).max() > 1e-6 * np.abs(h[:, :, first]).max(initial=0.0) + 1e-12:
            raise NotLinearError("answers a pulse otherwise after a while: it changes in time")
        return h


def _size(answers: _Answers) -> float:
    """The largest amplitude at which the answer to a pulse is in proportion to it. Raises NotLinearError."""
    for size in _PULSES:
        if all(_alike(*(answers.to(c, part, steps=_SHORT) for part in (size, 0.5 * size))) for c in answers.columns()):
            return size
    raise NotLinearError("does not answer small pulses in proportion")


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.abs(one - other).max() <= 1e-5 * np.abs(one).max() + 1e-12)


def _map(h: np.ndarray) -> tuple[tuple[np.ndarray | Sparse, ...], int, float]:
    """A, B, C, D of answers h (n, p, m), their order and residual. Raises NotLinearError where none fits."""
    n, _, m = h.shape
    moved = np.flatnonzero(np.any(h != 0.0, axis=(1, 2)))
    last = int(moved[-1]) if len(moved) else 0
    if last < n // 2:
        return _shift_register(h[: last + 1]), m * last, 0.0
    late = int(np.flatnonzero(np.any(h[1:] != 0.0, axis=(1, 2)))[0])  # whole steps of dead time beside D
    a, b, c, residual = _least_order(h, late)
    if not late:
        return (a, b, c, h[0]), len(a), residual
    shift, enter = np.eye(m * late, k=-m), np.vstack([np.eye(m), np.zeros((m * (late - 1), m))])
    leave = np.hstack([np.zeros((m, m * (late - 1))), np.eye(m)])
    whole = np.asarray(block_diag(shift, a))
    whole[m * late :, : m * late] = b @ leave
    b = np.vstack([enter, np.zeros((len(a), m))])
    return (whole, b, np.hstack([np.zeros((len(c), m * late)), c]), h[0]), len(whole), residual


def _shift_register(h: np.ndarray) -> tuple[Sparse, ...]:
    """Answers that end: the last inputs are kept, newest first."""
    n, p, m = h.shape
    kept = n - 1
    if not kept:
        return tuple(sparse.csr_array(x) for x in (np.zeros((0, 0)), np.zeros((0, m)), np.zeros((p, 0)), h[0]))
    shift = sparse.eye_array(m * kept, k=-m, format="csr")
    enter = sparse.vstack([sparse.eye_array(m), sparse.csr_array((m * (kept - 1), m))])
    return shift, enter, sparse.csr_array(np.hstack(list(h[1:]))), sparse.csr_array(h[0])


def _least_order(h: np.ndarray, first: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """A, B, C of h[first + 1:] with the least order whose sums are right. Raises NotLinearError."""
    rest = h[first + 1 :]
    blocks = min(_BLOCKS, len(rest) // 2 - 1)
    whole = np.block([[rest[i + j] for j in range(blocks)] for i in range(blocks)])
    ahead = np.block([[rest[i + j + 1] for j in range(blocks)] for i in range(blocks)])
    u, s, vt = np.linalg.svd(whole, full_matrices=False)
    p, m = rest.shape[1:]
    best = np.inf
    for order in range(1, int(np.sum(s > 1e-12 * s[0])) + 1):
        root = np.sqrt(s[:order])
        a = (u[:, :order] / root).T @ ahead @ (vt[:order].T / root)
        b, c = (root[:, None] * vt[:order])[:, :m], (u[:, :order] * root)[:p]
        residual = _residual(rest, a, b, c, h)
        best = min(best, residual)
        if residual <= ACCURACY:
            return a, b, c, residual
    raise NotLinearError(f"has a memory that no linear map of order {len(s)} fits (residual {best:.1e})")


def _residual(rest: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray, h: np.ndarray) -> float:
    """Greatest part of each output by which the sums of the answers (what a step does) are missed."""
    state, found = b, np.empty_like(rest)
    with np.errstate(all="ignore"):
        for k in range(len(rest)):
            found[k] = c @ state
            state = a @ state
        missed = np.abs(np.cumsum(found - rest, axis=0)).max(axis=(0, 2))
    size = np.abs(np.cumsum(h, axis=0)).max(axis=(0, 2))
    return float(np.nan_to_num(np.max(missed / np.maximum(size, 1e-300)), nan=np.inf))


def _pure_delay(h: np.ndarray) -> float | None:
    """Steps by which every output shows one input later and does nothing else; None where it does more.

    Two neighbouring values stand for a line between two samples.
    """
    found = set()
    for output in range(h.shape[1]):
        column = np.flatnonzero(np.any(h[:, output] != 0.0, axis=0))
        if len(column) != 1:
            return None
        answer = h[:, output, column[0]]
        taps = np.flatnonzero(answer)
        if taps[-1] - taps[0] > 1 or abs(answer.sum() - 1.0) > 1e-9:
            return None
        found.add(round(float(answer @ np.arange(len(answer))), 9))
    return found.pop() if len(found) == 1 else None
