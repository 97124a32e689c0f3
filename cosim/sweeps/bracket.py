"""Zeros of a rate along lines between two places, and searches that go on side by side."""

from collections import deque
from collections.abc import Callable, Generator, Iterable
from typing import TypeVar

import numpy as np
from attrs import frozen

from cosim.sweeps.quadtree import opposite

Places = list[tuple[float, ...]]
Key = TypeVar("Key")
Found = TypeVar("Found")


def as_place(where: np.ndarray) -> tuple[float, ...]:
    """A place (d,) as it is asked for."""
    return tuple(float(x) for x in where)


def side_by_side(
    first: Iterable[tuple[Key, Generator[Places, list[float], Found]]],
    then: Callable[[Key, Found], Iterable[tuple[Key, Generator[Places, list[float], Found]]]],
) -> Generator[Places, list[float], None]:
    """Searches that ask for places and are sent their rates: a round holds what all of them ask for.

    then: told the key and the result of each that ends, answers with further ones, which join the next round.
    """
    begun = deque(first)
    live: list[tuple[Key, Generator[Places, list[float], Found], Places]] = []
    while begun or live:
        values = iter((yield [place for _, _, asked in live for place in asked]) if live else ())
        was, live = live, []
        for key, search, asked in was:
            rates = [next(values) for _ in asked]
            try:
                live.append((key, search, search.send(rates)))
            except StopIteration as end:
                begun.extend(then(key, end.value))
        while begun:
            key, search = begun.popleft()
            try:
                live.append((key, search, next(search)))
            except StopIteration as end:
                begun.extend(then(key, end.value))


@frozen
class Bracket:
    """Two places (d,) with rates of different sign."""

    low: np.ndarray
    high: np.ndarray
    at_low: float
    at_high: float

    def along(self, share: float) -> np.ndarray:
        """The place at a share of the way from low to high."""
        return self.low + share * (self.high - self.low)


def zero(bracket: Bracket, tolerance: float, rounds: int = 60) -> Generator[Places, list[float], np.ndarray]:
    """The zero inside a bracket by Chandrupatla's method (1997), one value a round.

    A bracket is done when it is shorter than a third of the tolerance, or when the next estimate is closer than that
    to the last place and the rate there fell below a fifth of both ends' (else the rate jumps, and a small move of
    the estimate means nothing); so too from the beginning, by the rate at one end. One that is shorter than the
    tolerance from the beginning, with twice the rate at one end, needs no value more: its zero is within the tolerance
    of the estimate, and near it where the rate does not jump.
    """
    hunt = _Hunt(bracket, tolerance)
    for _ in range(rounds):
        if hunt.done:
            break
        (value,) = yield [as_place(bracket.along(hunt.next()))]
        hunt.learn(value)
    return bracket.along(hunt.estimate())


class _Hunt:
    """A zero along one bracket, in shares of its length.

    `a` is the newest end and `b` the one across the zero; `c`, once there is one, is the end that was left last.
    """

    def __init__(self, bracket: Bracket, tolerance: float) -> None:
        self.bracket = bracket
        self.length = float(np.linalg.norm(bracket.high - bracket.low))
        self.tolerance = tolerance / 3.0
        self.a, self.fa, self.b, self.fb = 1.0, bracket.at_high, 0.0, bracket.at_low
        self.c = self.fc = np.nan
        small, large = sorted((abs(self.fa), abs(self.fb)))
        near = small / (small + large) * self.length  # of the estimate to the end with the smaller rate
        self.done = self.length < (tolerance if 2.0 * small <= large else self.tolerance)
        self.done = self.done or (small <= 0.2 * large and near < self.tolerance)

    def estimate(self) -> float:
        """Where the zero is expected: the secant's at first, then that of the inverse parabola through a, b and c where
        that is sure to be monotonous, else the middle.
        """
        a, b, c, fa, fb, fc = self.a, self.b, self.c, self.fa, self.fb, self.fc
        share = 0.5 * (a + b)
        if np.isnan(c):
            share = (a * fb - b * fa) / (fb - fa)
        elif fc not in (fa, fb):
            reach, rise = (a - b) / (c - b), (fa - fb) / (fc - fb)
            if rise**2 < reach and (1.0 - rise) ** 2 < 1.0 - reach:
                share = a + (b - a) * fa / (fb - fa) * fc / (fb - fc) + (c - a) * fa / (fc - fa) * fb / (fc - fb)
        return float(np.clip(share, min(a, b), max(a, b)))

    def next(self) -> float:
        """Where a value is asked for: the estimate, kept away from the ends by a hundredth so that both close in."""
        low, high = min(self.a, self.b), max(self.a, self.b)
        margin = 0.01 * (high - low)
        return float(np.clip(self.estimate(), low + margin, high - margin))

    def learn(self, value: float) -> None:
        """Take the rate where it was asked for; an unknown one (NaN) is taken for stable, so that the hunt ends."""
        share = self.next()
        value = value if np.isfinite(value) else -max(abs(self.fa), abs(self.fb))
        smooth = abs(value) <= 0.2 * min(abs(self.fa), abs(self.fb))
        if opposite(self.fa, value):
            self.b, self.fb, self.c, self.fc = self.a, self.fa, self.b, self.fb
        else:
            self.c, self.fc = self.a, self.fa
        self.a, self.fa = share, value
        moved = abs(self.estimate() - share) * self.length
        self.done = (smooth and moved < self.tolerance) or abs(self.a - self.b) * self.length < self.tolerance
