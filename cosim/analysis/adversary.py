"""Search for the delay law within a bound that makes a sampled loop grow fastest: policy iteration over a period."""

from typing import Any

import numpy as np
from attrs import cmp_using, evolve, field, frozen

from cosim.analysis.sampled_loop import SampledLoop
from cosim.errors import InputError, Problem

_IMPROVEMENTS, _FIRST = 12, 4
"""Improvements of a law at most, and of each of many to see which are worth it."""
_CLIMBS = 25
"""Changes of a period at most: far below a bound that destroys it may grow without end, for next to nothing."""
_FACTOR = 3
"""Steps taken together: powers of this."""
_MOST_WORK = 1e9
"""Products in a map over a period up to which a law is improved."""
_STRETCHES = (1.0, 1.01, 1.03)
"""How a law that is not improved any more is stretched until it grows."""
_FEW = 30
"""Coarse steps in the largest delay, at most."""
_ALONE = 1e-6
"""Part of M^2 v that may lie outside of M v and v for v to hold one pair of eigenvectors only."""
_CLEARLY = 1e-3
"""Part by which a rate has to exceed another to be counted as greater: what a sketch is not sure of."""


def _whole(values) -> np.ndarray:
    ages = np.atleast_2d(np.array(values, dtype=int))
    ages.flags.writeable = False
    return ages


@frozen
class DelayLaw:
    """A periodic delay law on a loop: `ages` (channels, period) in steps, repeated for ever.

    `multiplier` is the Floquet multiplier of largest modulus of the loop under this law, `step` [s].
    """

    ages: np.ndarray = field(converter=_whole, eq=cmp_using(np.array_equal))
    step: float
    multiplier: complex

    @property
    def growth_rate(self) -> float:
        """ln |multiplier| over the period [1/s]; above zero the loop is destroyed."""
        return float(np.log(max(abs(self.multiplier), 1e-300)) / (self.ages.shape[1] * self.step))

    @property
    def max_delay(self) -> float:
        """Largest delay of the law [s]."""
        return float(self.ages.max() * self.step)

    def trace(self, duration: float) -> np.ndarray:
        """Rows (time, delay of each channel) [s] at every step up to a duration, shape (n, 1 + channels)."""
        k = np.arange(round(duration / self.step) + 1)
        return np.column_stack([k * self.step, self.ages[:, k % self.ages.shape[1]].T * self.step])


def under(loop: SampledLoop, ages: np.ndarray) -> DelayLaw:
    """A given periodic law with its Floquet multiplier, by the eigenvalues of the map over one period."""
    ages = _whole(ages)
    if ages.shape[0] != loop.channels or ages.min() < 0:
        raise InputError(Problem("delay law", f"ages >= 0 for {loop.channels} channels", f"{ages.shape[0]} rows"))
    values = np.linalg.eigvals(period_map(loop, ages, int(ages.max())))
    return DelayLaw(ages, loop.step, complex(values[np.argmax(np.abs(values))]))


def destroying_law(loop: SampledLoop, ways: tuple[int, ...], low: int, high: int) -> DelayLaw | None:
    """The law with the smallest bound [steps], searched between low and high, that makes the loop grow; None if none.

    `ways`: which law each channel follows, (0, 0) for the same law both ways, (0, 1) for independent ones. Periods and
    bounds are searched on a loop of coarser steps, and improved on finer ones down to the loop's own. A law found is a
    proof that it exists; that no smaller bound has one is for a certificate to say.
    """
    sketch = sketched(loop, ways, low, high)
    return None if sketch is None else refined(loop, ways, sketch, low, high)


def sketched(
    loop: SampledLoop, ways: tuple[int, ...], low: int, high: int, start: DelayLaw | None = None
) -> DelayLaw | None:
    """A destroying law of coarse steps, near the smallest bound; None where the search finds none.

    start: a sketch of a loop like this one, as fine, from which the search begins; else it begins from many laws.
    """
    together = coarseness(high)
    coarse, bounds = coarser(loop, together), _bounds(low, high, together)
    begun = start is not None and round(start.step / loop.step) == together
    best = _tuned(coarse, bounds[1], ways, start, 4) if start and begun else _searched(coarse, bounds[1], ways)
    return _descended(coarse, best, ways, bounds, 4, 8) if best.growth_rate > 0.0 else None


def sooner(loop: SampledLoop, ways: tuple[int, ...], low: int, sketch: DelayLaw) -> DelayLaw | None:
    """A sketch of independent ways that makes the loop grow more than a given one of the same bound; None if none."""
    together, most = round(sketch.step / loop.step), int(sketch.ages.max())
    coarse = coarser(loop, together)
    best = _searched(coarse, most, ways)
    if best.growth_rate <= sketch.growth_rate + _CLEARLY * abs(sketch.growth_rate):
        return None
    return _descended(coarse, best, ways, (_bounds(low, most * together, together)[0], most), 4, 8)


def refined(loop: SampledLoop, ways: tuple[int, ...], sketch: DelayLaw, low: int, high: int) -> DelayLaw | None:
    """The destroying law with the smallest bound of the loop's own step that improving a sketch leads to.

    On the first finer steps the many laws are tried again, just below the bound that is known then: far above it a
    constant delay grows faster than the laws that destroy first. Of a loop of many signals the law is improved on
    coarser steps only, and then stretched until it grows.
    """
    together, law = round(sketch.step / loop.step), sketch
    again = together > 1
    while together > 1:
        together //= _FACTOR
        law = evolve(law, ages=np.repeat(law.ages, _FACTOR, axis=1) * _FACTOR, step=law.step / _FACTOR)
        finer = coarser(loop, together)
        if _costly(finer, law):
            continue
        law = _descended(finer, law, ways, _bounds(low, high, together), 1, 5)
        if again:
            other = _searched(finer, max(int(law.ages.max()) - 1, 1), ways)
            other, again = _descended(finer, other, ways, _bounds(low, high, together), 1, 5), False
            law = other if other.growth_rate > 0.0 and other.max_delay <= law.max_delay else law
    most, period = int(law.ages.max()), law.ages.shape[1]
    for stretch in _STRETCHES if _costly(loop, law) else (1.0,):
        exact = under(loop, fitted(law.ages, period, min(round(most * stretch), max(high, most))))
        if exact.growth_rate > 0.0:
            return exact
    return None


def _costly(loop: SampledLoop, law: DelayLaw) -> bool:
    """Whether a map over the law's period, of which improving it takes hundreds, is seconds of work."""
    states, size = len(loop.transition), len(loop.transition) + loop.channels * int(law.ages.max())
    return states**2 * size * law.ages.shape[1] > _MOST_WORK


def _bounds(low: int, high: int, together: int) -> tuple[int, int]:
    """Bounds [coarse steps] that hold those of the loop's own steps."""
    return max(low // together - 1, 1), -(-high // together) + 1


def coarseness(high: int) -> int:
    """Steps taken together in the first search, a power of _FACTOR."""
    together = 1
    while high > _FEW * together:
        together *= _FACTOR
    return together


def _descended(
    loop: SampledLoop, law: DelayLaw, ways: tuple[int, ...], bounds: tuple[int, int], change: int, rounds: int
) -> DelayLaw:
    """The law of the smallest growing bound, along the line through the growth rates; the best one if none grows.

    Each bound begins with the law of the nearest one that grows: far below it a law loses its shape.
    """
    most, slope, laws = int(law.ages.max()), 0.5 / law.max_delay, dict[int, DelayLaw]()
    for _ in range(rounds):
        near = min(laws, key=lambda k: (laws[k].growth_rate <= 0.0, abs(k - most)), default=None)
        law = laws[most] = _tuned(loop, most, ways, law if near is None else laws[near], change)
        least, largest = min(laws), max(laws)
        if least < largest:
            slope = (laws[largest].growth_rate - laws[least].growth_rate) / ((largest - least) * loop.step)
        step = law.growth_rate / max(slope, 1e-2) / loop.step
        most -= max(int(step), 1) if law.growth_rate > 0.0 else min(int(np.floor(step)), -1)
        if most in laws or not bounds[0] <= most <= bounds[1]:
            break
    growing = [law for _, law in sorted(laws.items()) if law.growth_rate > 0.0]
    return growing[0] if growing else max(laws.values(), key=_rate)


def _searched(loop: SampledLoop, most: int, ways: tuple[int, ...], known: tuple[DelayLaw, ...] = ()) -> DelayLaw:
    """The best of many starts, tuned: a value held in sight and then the full delay, or a full delay with a pause.

    Periods of 1.5 to 6 times the bound; independent ways start a third of a period apart.
    """
    found = []
    for period in sorted({round(most * factor) for factor in np.geomspace(1.5, 6.0, 16)}):
        k = np.arange(period)
        for start in (np.minimum(k, most), np.where(k < 0.2 * period, 0, most)):
            ages = np.array([np.roll(start, way * period // 3) for way in ways])
            found.append(_improved(loop, most, ways, ages, _FIRST))
    found.sort(key=_rate, reverse=True)
    steady = [law for law in found if np.ptp(law.ages) == 0][:1]  # a constant delay is the same in every period
    moving = [law for law in found if np.ptp(law.ages) > 0][:3]
    return max([*steady, *(_tuned(loop, most, ways, law, 4) for law in moving)], key=_rate)


def _rate(law: DelayLaw) -> float:
    return law.growth_rate


def _tuned(loop: SampledLoop, most: int, ways: tuple[int, ...], start: DelayLaw, change: int) -> DelayLaw:
    """The law for a bound, from one for another bound; the period climbs by smaller and smaller changes [steps]."""
    best = _improved(loop, most, ways, fitted(start.ages, start.ages.shape[1], most))
    for _ in range(_CLIMBS):
        if change < 1:
            break
        period = best.ages.shape[1]
        others = [_improved(loop, most, ways, fitted(best.ages, period + sign * change, most)) for sign in (-1, 1)]
        other = max(others, key=_rate)
        if other.growth_rate > best.growth_rate:
            best = other
        else:
            change //= 2
    return best


def coarser(loop: SampledLoop, together: int) -> SampledLoop:
    """The loop over several steps at once, the difference w that the delay makes held meanwhile."""
    if together == 1:
        return loop
    n = len(loop.transition)
    power, summed = np.eye(n), np.zeros((n, n))
    moved, moved_now = np.zeros_like(loop.moved), np.zeros_like(loop.moved_now)
    for _ in range(together):
        moved, moved_now = moved + loop.moved @ power, moved_now + loop.moved @ summed @ loop.drive + loop.moved_now
        power, summed = loop.transition @ power, loop.transition @ summed + np.eye(n)
    return SampledLoop(power, summed @ loop.drive, moved, moved_now, loop.step * together)


def fitted(ages: np.ndarray, period: int, most: int) -> np.ndarray:
    """A law stretched to another period and bound; one without any delay stays so."""
    at = np.arange(period) * ages.shape[1] // period
    return np.rint(ages[:, at] * (most / max(ages.max(), 1))).astype(int)


def _improved(
    loop: SampledLoop, most: int, ways: tuple[int, ...], ages: np.ndarray, turns: int = _IMPROVEMENTS
) -> DelayLaw:
    """Policy iteration: at each step the age that most helps the growing motion, by the adjoint of the period map."""
    best, size, idle = ages, 0.0, 0
    for _ in range(turns):
        mapped = period_map(loop, ages, most)
        motion, gain = grown(mapped)
        if gain > size * (1.0 + 1e-6):
            best, size, idle = ages, gain, 0
        else:
            idle += 1
        if idle > 1:
            break
        goal = grown(mapped.T)[0]  # d lambda = goal dM motion / (goal motion)
        ages = _better(loop, most, ways, ages, motion, goal * np.sign(goal @ mapped @ motion))
    return DelayLaw(best, loop.step, complex(size))


def grown(matrix: np.ndarray, turns: int = 60) -> tuple[np.ndarray, float]:
    """The direction that a matrix makes grow most, and the modulus of its eigenvalue, by powers of it.

    The eigenvalue, or the complex pair, is read off three successive vectors: M^2 v = a M v + b v. Where powers have
    not yet left one pair alone (an arm of many joints has many that are nearly as large), by Arnoldi's method.
    """
    v = np.ones(len(matrix))
    for _ in range(turns):
        v = matrix @ v
        v /= max(np.linalg.norm(v), 1e-300)
    once = matrix @ v
    twice, pair = matrix @ once, np.column_stack([once, v])
    a, b = np.linalg.lstsq(pair, twice, rcond=1e-9)[0]
    if np.linalg.norm(twice - pair @ (a, b)) > _ALONE * np.linalg.norm(twice):
        return _largest(matrix, v)
    return v, float(np.abs(np.roots([1.0, -a, -b])).max())


def _largest(matrix: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, float]:
    from scipy.sparse import linalg

    solver: Any = linalg.eigs
    try:
        values, vectors = solver(matrix, k=1, v0=start, tol=_ALONE)
    except linalg.ArpackError:  # of matrices too small for it, or where it does not converge
        values, vectors = np.linalg.eig(matrix)
    most = int(np.argmax(np.abs(values)))
    v = np.real(vectors[:, most])
    return v / max(np.linalg.norm(v), 1e-300), float(abs(values[most]))


def period_map(loop: SampledLoop, ages: np.ndarray, most: int) -> np.ndarray:
    """The linear map of (s, x[k-1] - x[k], .., x[k-most] - x[k] of each channel) over the law's period."""
    n, p, period = len(loop.transition), loop.channels, ages.shape[1]
    size = n + p * most
    state = np.eye(n, size)
    past = np.zeros((p, most + 1 + period, size))  # x of each channel from k = -most on, over the starting values
    for c in range(p):
        past[c, most - 1 :: -1] = 0.0
        past[c, :most, n + c * most : n + (c + 1) * most] = np.eye(most)[::-1]
    channels = np.arange(p)
    for k in range(period):
        now = past[:, most + k]
        late = past[channels, most + k - ages[:, k]] - now
        past[:, most + k + 1] = now + loop.moved @ state + loop.moved_now @ late
        state = loop.transition @ state + loop.drive @ late
    ends = [past[c, period + most - 1 : period - 1 if period else None : -1] - past[c, most + period] for c in range(p)]
    return np.vstack([state, *ends])


def _better(loop: SampledLoop, most: int, ways, ages: np.ndarray, motion: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """For each step the age that moves the end of the period furthest along `goal`, on the given motion."""
    n, p, period = len(loop.transition), loop.channels, ages.shape[1]
    x = _positions(loop, most, ages, motion)
    pull = np.zeros((p, most + 1 + period))  # derivative of the goal by x
    for c in range(p):
        part = goal[n + c * most : n + (c + 1) * most]
        pull[c, period : period + most] += part[::-1]
        pull[c, most + period] -= part.sum()
    force, channels = goal[:n].copy(), np.arange(p)
    chosen = np.empty_like(ages)
    laws = [[c for c in range(p) if ways[c] == way] for way in ways]
    for k in range(period - 1, -1, -1):
        ahead = pull[:, most + k + 1]
        help_ = loop.drive.T @ force + loop.moved_now.T @ ahead
        worth = help_[:, None] * x[:, k : k + most + 1]
        chosen[:, k] = [most - int(np.argmax(worth[law].sum(axis=0))) for law in laws]
        pull[:, most + k] += ahead - help_
        np.add.at(pull, (channels, most + k - ages[:, k]), help_)
        force = loop.transition.T @ force + loop.moved.T @ ahead
    return chosen


def _positions(loop: SampledLoop, most: int, ages: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """x of each channel from k = -most to the end of the period, from a starting value of `_period_map`."""
    n, p, period = len(loop.transition), loop.channels, ages.shape[1]
    x = np.zeros((p, most + 1 + period))
    x[:, :most] = motion[n:].reshape(p, most)[:, ::-1]
    state, channels = motion[:n], np.arange(p)
    for k in range(period):
        late = x[channels, most + k - ages[:, k]] - x[:, most + k]
        x[:, most + k + 1] = x[:, most + k] + loop.moved @ state + loop.moved_now @ late
        state = loop.transition @ state + loop.drive @ late
    return x
