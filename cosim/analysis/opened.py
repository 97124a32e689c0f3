"""A scenario's loop opened at its channels: the smallest sampled loop in which their delays are the only unknown.

Every channel is replaced by one that shows at once what is sent, plus w; the map of the co-simulation over a step
(`step_loop`) then says what is sent at the next step. With x what the channels are sent and z all that the master and
the FMUs hold, z+ = A z + B w and x = C z. Displacements that no force of the loop sees, which the FMUs hold for ever,
are divided out; what neither w drives nor x shows is left out by balanced truncation, and the part missed is told.
"""

from collections.abc import Mapping

import numpy as np
from attrs import frozen

from cosim.analysis.linear_fmu import is_channel
from cosim.analysis.sampled_loop import SampledLoop
from cosim.analysis.sparse import sparse
from cosim.analysis.step_fmu import StepFmu
from cosim.analysis.step_loop import StepLoop, step_loop
from cosim.analysis.stepped import Stepped
from cosim.wiring import Wiring

FREQUENCIES = np.geomspace(1e-5, np.pi, 250)
"""Where responses are compared [rad/step]."""
_STILL = 1e-7
"""Singular value of the map less one, over the largest, below which a displacement stays for ever; and part of an
increment below which none shows it. What that neglects is part of `missed`.
"""
_MOST = 1500
"""Numbers that a map may hold for its equations to be made small."""
_MISSED = 1e-6
"""Part of the response that may be missed: what differences of FMUs are right to."""
_KEPT = 1e-12
"""Hankel singular value, over the largest, from which a state is kept."""


class NotOpenError(Exception):
    """The loop is not one of constant parts and channels, so that no statement on delays can be made; says why."""


@frozen
class OpenedLoop:
    """The loop over all signals that its channels carry, in their order, as `channels` says: name and inputs of each.

    missed: greatest part of the response, at any frequency, by which the small loop differs from the whole one.
    """

    loop: SampledLoop
    channels: Mapping[str, tuple[str, ...]]
    missed: float

    @property
    def owner(self) -> tuple[int, ...]:
        """For each signal the number of its channel."""
        return tuple(k for k, signals in enumerate(self.channels.values()) for _ in signals)


def opened(wiring: Wiring, discrete: Stepped) -> OpenedLoop:
    """The opened loop of a wiring whose FMUs are known by their maps. Raises NotOpenError."""
    whole, channels = _whole(wiring, discrete)
    loop, missed = _smallest(whole, [whole.places[n] for n in channels])
    return OpenedLoop(loop, channels, missed)


def gains(wiring: Wiring, discrete: Stepped, frequencies: np.ndarray) -> np.ndarray:
    """Eigenvalues of the loop opened at its channels at frequencies [rad/step], shape (frequencies, signals).

    What is sent, x, answers what is shown, y, as x = G y; channels of d steps close the loop where an eigenvalue of G
    is exp(i d frequency). With y = x + w, x = H w is the loop without delay, so that G = (1 + H)^-1 H. That loop need
    not come to rest. Raises NotOpenError.
    """
    from scipy.sparse.linalg import splu

    whole, channels = _whole(wiring, discrete)
    sent, rest = _parted(whole, [whole.places[n] for n in channels])
    within = whole.matrix.tocsr()[rest]
    a, b = within[:, rest].tocsc(), within[:, sent].toarray().astype(complex)
    c, one = whole.matrix.tocsr()[sent][:, rest], sparse.eye_array(len(rest), format="csc")
    found = []
    for turn in frequencies:
        response = c @ splu((np.exp(1j * turn) * one - a).tocsc()).solve(b)
        found.append(np.linalg.eigvals(np.linalg.solve(np.eye(len(sent)) + response, response)))
    return np.array(found)


def _whole(wiring: Wiring, discrete: Stepped) -> tuple[StepLoop, dict[str, tuple[str, ...]]]:
    """The map over a step with open channels, and their inputs by name. Raises NotOpenError."""
    names = [n for n in wiring.scenario.components if is_channel(wiring.descriptions[n])]
    names = [n for n in names if n in discrete.fmus and discrete.fmus[n].delay is not None]
    if not names:
        raise NotOpenError("the loop has no channel")
    if discrete.loop is None:
        raise NotOpenError(discrete.why)
    if discrete.unproven:
        raise NotOpenError(f"the state of {', '.join(discrete.unproven)} cannot be saved, so that nothing is proven")
    fmus = {n: _open(fmu) if n in names else fmu for n, fmu in discrete.fmus.items()}
    whole = step_loop(wiring, fmus)
    if len(whole.phases) > 1:
        raise NotOpenError("its components step at different multiples of the communication step")
    return whole, {n: fmus[n].inputs for n in names}


def _parted(whole: StepLoop, places: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """Places in the map of what is sent, and of all else. Raises NotOpenError."""
    sent = np.concatenate([np.arange(*place) for place in places])
    if abs(whole.matrix.tocsr()[sent][:, sent]).sum():
        raise NotOpenError("a signal passes two channels within a step")
    return sent, np.setdiff1d(np.arange(whole.matrix.shape[0]), sent)


def _open(fmu: StepFmu) -> StepFmu:
    """A channel that shows the newest sample plus its state w; its state after the step is that sample."""
    m, now = len(fmu.inputs), np.zeros((len(fmu.inputs), len(fmu.sloped)))
    now[list(fmu.sloped), range(len(fmu.sloped))] = fmu.step
    assert fmu.shows is not None
    maps = np.zeros((m, m)), np.eye(m), now, fmu.shows, fmu.shows, fmu.shows @ now
    return StepFmu(fmu.inputs, fmu.outputs, fmu.sloped, fmu.step, *maps, fmu.origin)


def _smallest(whole: StepLoop, places: list[tuple[int, int]]) -> tuple[SampledLoop, float]:
    if whole.matrix.shape[0] > _MOST:
        raise NotOpenError(f"the map of its FMUs over a step holds {whole.matrix.shape[0]} numbers, more than {_MOST}")
    matrix = whole.matrix.toarray()
    sent, rest = _parted(whole, places)
    a, b, c = matrix[np.ix_(rest, rest)], matrix[np.ix_(rest, sent)], matrix[np.ix_(sent, rest)]
    moved, moved_now = c @ (a - np.eye(len(a))), c @ b
    whole_loop = SampledLoop(a, b, moved, moved_now, whole.period)
    while len(kept := _moving(a, moved)) < len(a):
        a, b, moved = kept @ a @ kept.T, kept @ b, moved @ kept.T
    size = float(np.abs(np.linalg.eigvals(a)).max())
    if not size < 1.0:
        raise NotOpenError(f"without delay it does not come to rest (greatest eigenvalue {size:.9g} a step)")
    small = balanced(SampledLoop(a, b, moved, moved_now, whole.period))
    missed = apart(small.increments(FREQUENCIES), whole_loop.increments(FREQUENCIES))
    if missed > _MISSED:
        raise NotOpenError(
            f"its equations are not known well enough: a small loop misses a part of {missed:.2g} of them"
        )
    return small, missed


def _moving(a: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Orthonormal rows that see all but the displacements v with A v = v that no increment shows."""
    _, sizes, rows = np.linalg.svd(a - np.eye(len(a)))
    shown = np.linalg.norm(moved @ rows.T, axis=0)
    return rows[(sizes >= _STILL * sizes[0]) | (shown >= _STILL * np.linalg.norm(moved))]


def balanced(loop: SampledLoop) -> SampledLoop:
    """The loop without the states that w hardly drives or x hardly shows (Moore 1981, by square roots of Gramians)."""
    from scipy.linalg import solve_discrete_lyapunov

    a, b, c = loop.transition, loop.drive, loop.moved
    reach = _root(solve_discrete_lyapunov(a, b @ b.T))
    view = _root(solve_discrete_lyapunov(a.T, c.T @ c))
    u, sizes, v = np.linalg.svd(view.T @ reach)
    kept = int(np.sum(sizes > _KEPT * sizes[0]))
    scale = sizes[:kept] ** -0.5
    left, right = (scale[:, None] * u[:, :kept].T) @ view.T, reach @ v[:kept].T * scale
    return SampledLoop(left @ a @ right, left @ b, c @ right, loop.moved_now, loop.step)


def _root(gramian: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    return vectors * np.sqrt(np.maximum(values, 0.0))


def apart(response: np.ndarray, other: np.ndarray) -> float:
    """Greatest difference of two responses (frequencies, p, p) over the size of the second, at any frequency."""
    size = np.linalg.norm(other, 2, axis=(1, 2))
    return float(np.max(np.linalg.norm(response - other, 2, axis=(1, 2)) / np.maximum(size, 1e-300)))
