"""A loop of several axes taken apart: turned signals of the channels, in which it is several loops beside one another.

A channel shows all its signals with one age, so that any constant combination of them is delayed as they are. Where
matrices T_c, one a channel, make the response T^-1 H(z) T fall into blocks of one signal of each channel, the loop is
that many loops that do not know of each other (equal sides at rest: along the principal axes of J M^-1 J^T).

One may drive another, as long as nothing comes back: the first dies out by itself, then what it drives does. So the
blocks decide the stability of a response that is block triangular too (an arm that leans on a wall).
"""

import itertools
from collections.abc import Iterator

import numpy as np
from attrs import cmp_using, field, frozen

from cosim.analysis.opened import FREQUENCIES, OpenedLoop, apart, balanced
from cosim.analysis.sampled_loop import SampledLoop

_APART = 1e-8
"""Part of the response that may lie between two loops for them to count as separate (directional derivatives of the
FMUs give 1e-12).
"""
_LOOKED = np.exp([1e-3, 3e-3, 1e-2])
"""Real z > 1 where the response is real and the turns are looked for."""


def _turns(values: object) -> tuple[np.ndarray, ...]:
    return tuple(np.array(turn, dtype=float) for turn in values)  # type: ignore[attr-defined]


@frozen
class LoopPart:
    """One of the loops; `turns[c]` (signals, k): signals of channel c as combinations of the k that this loop has.

    `owner`: the channel of each signal of the loop.
    """

    loop: SampledLoop
    turns: tuple[np.ndarray, ...] = field(
        converter=_turns, eq=cmp_using(lambda a, b: all(map(np.array_equal, a, b)), class_name="Turns")
    )

    @property
    def owner(self) -> tuple[int, ...]:
        """For each signal of this loop the number of its channel."""
        return tuple(c for c, turn in enumerate(self.turns) for _ in range(turn.shape[1]))


def parted(opened: OpenedLoop) -> tuple[LoopPart, ...]:
    """The loops into which an opened loop falls, slowest first; the whole of it where it does not fall apart."""
    owner = np.array(opened.owner)
    channels = [np.flatnonzero(owner == k) for k in range(len(opened.channels))]
    for turn in _axes(opened.loop, channels):
        parts = [_part(opened.loop, turn, channels, axis) for axis in range(len(channels[0]))]
        if joined_apart(opened.loop, parts) < _APART:
            return tuple(sorted(parts, key=lambda part: -_slowness(part.loop)))
    return (LoopPart(opened.loop, [np.eye(len(places)) for places in channels]),)


def together(part: LoopPart) -> tuple[SampledLoop, ...]:
    """The loops into which a part falls where all its channels show one age: what two equal sides do with and against
    one another; itself where it does not fall apart.
    """
    loop, half = part.loop, part.loop.channels // 2
    if len(part.turns) != 2 or part.owner.count(0) != half or part.owner.count(1) != half:
        return (loop,)
    one = np.eye(half)
    turn = np.sqrt(0.5) * np.block([[one, one], [one, -one]])  # its own inverse
    places = slice(half), slice(half, 2 * half)
    response = turn @ loop.increments(FREQUENCIES) @ turn
    across = response.copy()
    for place in places:
        across[:, place, place] = 0.0
    if apart(response - across, response) >= _APART:
        return (loop,)
    return tuple(_turned(loop, turn[:, place], turn[place]) for place in places)


def joined_apart(whole: SampledLoop, parts: "list[LoopPart] | tuple[LoopPart, ...]") -> float:
    """Greatest part of the response of a whole loop that is neither in its parts, in some order, nor in what a part
    does to later ones; inf where these do not make a whole.
    """
    turn = np.hstack([np.vstack([_placed(part, c) for c in range(len(part.turns))]) for part in parts])
    if turn.shape != (whole.channels, whole.channels) or np.linalg.cond(turn) > 1e6:
        return np.inf
    response = whole.increments(FREQUENCIES)
    left = np.linalg.inv(turn) @ response @ turn
    ends = np.cumsum([0, *(part.loop.channels for part in parts)])
    places = [slice(*pair) for pair in itertools.pairwise(ends.tolist())]
    for part, place in zip(parts, places):
        left[:, place, place] -= part.loop.increments(FREQUENCIES)
    size = np.linalg.norm(response, 2, axis=(1, 2))
    missed = np.array([[np.max(np.linalg.norm(left[:, a, b], axis=(1, 2)) / size) for b in places] for a in places])
    for first, later in itertools.combinations(_order(missed), 2):
        left[:, places[later], places[first]] = 0.0
    return apart(response - turn @ left @ np.linalg.inv(turn), response)


def _order(missed: np.ndarray) -> list[int]:
    """The order of parts in which the later ones do least to the earlier: first whom the others drive least."""
    order, rest = list[int](), list(range(len(missed)))
    while rest:
        order.append(min(rest, key=lambda k: max((missed[k, other] for other in rest if other != k), default=0.0)))
        rest.remove(order[-1])
    return order


def _placed(part: LoopPart, channel: int) -> np.ndarray:
    """The turn of one channel in the columns of all signals of the part."""
    found = np.zeros((len(part.turns[channel]), part.loop.channels))
    found[:, [k for k, c in enumerate(part.owner) if c == channel]] = part.turns[channel]
    return found


def _axes(loop: SampledLoop, channels: list[np.ndarray]) -> Iterator[np.ndarray]:
    """Turns (signals, signals) that may take the loop apart: the signals as they are, and those along its own axes."""
    size = len(channels[0])
    if size > 1 and all(len(places) == size for places in channels):
        yield np.eye(loop.channels)
        if (turn := _own_axes(loop, channels)) is not None:
            yield turn


def _own_axes(loop: SampledLoop, channels: list[np.ndarray]) -> np.ndarray | None:
    """The eigenvectors of once round all channels; None where they are complex."""
    real = [_real(loop, z) for z in _LOOKED]
    around = real[0][np.ix_(channels[0], channels[0])]
    for k in range(len(channels)):  # once round all channels, each crossing at its own z
        nxt = channels[(k + 1) % len(channels)]
        crossing = real[k % len(real)][np.ix_(nxt, channels[k])]
        around = crossing if k == 0 else crossing @ around
    values, vectors = np.linalg.eig(around)
    if np.abs(np.imag(values)).max() > 1e-9 * np.abs(values).max():
        return None
    whole, turn = np.zeros((loop.channels, loop.channels)), np.real(vectors)
    for k, places in enumerate(channels):
        whole[np.ix_(places, places)] = turn / np.linalg.norm(turn, axis=0)
        nxt = channels[(k + 1) % len(channels)]
        turn = real[0][np.ix_(nxt, places)] @ turn
        if not np.all(np.linalg.norm(turn, axis=0) > 0.0):
            return None
    return whole


def _real(loop: SampledLoop, z: float) -> np.ndarray:
    inner = np.linalg.solve(z * np.eye(len(loop.transition)) - loop.transition, loop.drive)
    return loop.moved @ inner + loop.moved_now


def _part(loop: SampledLoop, turn: np.ndarray, channels: list[np.ndarray], axis: int) -> LoopPart:
    columns = [int(places[axis]) for places in channels]
    small = _turned(loop, turn[:, columns], np.linalg.inv(turn)[columns])
    return LoopPart(small, [turn[np.ix_(places, [places[axis]])] for places in channels])


def _turned(loop: SampledLoop, turn: np.ndarray, back: np.ndarray) -> SampledLoop:
    """The loop of some signals: `turn` (signals, k) has them in those of the loop, `back` (k, signals) the reverse."""
    return balanced(
        SampledLoop(loop.transition, loop.drive @ turn, back @ loop.moved, back @ loop.moved_now @ turn, loop.step)
    )


def _slowness(loop: SampledLoop) -> float:
    """Of its slowest mode without delay; the loop that a delay destroys first is mostly a slow one."""
    return float(np.abs(np.linalg.eigvals(loop.transition)).max())
