"""Search for a destroying law among those whose delay changes slowly: it rises, stays, falls, stays, and again."""

import numpy as np
from attrs import frozen

from cosim.analysis.adversary import DelayLaw, coarseness, coarser, grown, period_map, under
from cosim.analysis.sampled_loop import SampledLoop

_SWING, _FREE = 2.5, 3.0
"""Longest time of a rise or fall at the steepest, and of all that is free of a period, over the largest delay."""
_TURNED = 2
"""Largest delays for which a law is followed, at least."""
_STARTS, _LOOKS, _LOOKS_FINER = 10, 60, 25
"""Laws from which the search begins, and laws looked at from each, on coarse steps and on finer ones."""
_FACTOR = 3


@frozen
class _SlowFamily:
    """Laws on a loop of some step, each a place in the unit cube: depth of the swing, how the free time is shared out
    (its length; rise, top, fall, bottom), and how far each further way is behind.
    """

    loop: SampledLoop
    ways: tuple[int, ...]
    slope: float

    @property
    def size(self) -> int:
        """Numbers that describe a law."""
        return 6 + len(set(self.ways)) - 1

    def ages(self, place: np.ndarray, most: int) -> np.ndarray:
        """(channels, period) in steps; from step to step they change by `slope` at most, rounding apart."""
        u = np.clip(place, 0.0, 1.0)
        depth = most * min(1.0, _SWING * self.slope) * u[0]
        steepest = depth / self.slope if depth > 0.0 else 0.0
        shares = u[2:6] / max(u[2:6].sum(), 1e-9) * _FREE * most * u[1]
        ends = np.cumsum([0.0, steepest + shares[0], shares[1], steepest + shares[2], shares[3]])
        period = max(int(np.ceil(ends[-1])), 2)
        ends[-1] = period
        law = np.interp(np.arange(period), ends, [most - depth, most, most, most - depth, most - depth])
        turns = -(-_TURNED * most // period)  # growth over a short period is hard to see
        behind = {way: 0.0 if k == 0 else u[5 + k] for k, way in enumerate(dict.fromkeys(self.ways))}
        steps = np.rint(law).astype(int)
        return np.array([np.tile(np.roll(steps, round(behind[way] * period)), turns) for way in self.ways])

    def rate(self, place: np.ndarray, most: int) -> float:
        """Growth [1/s] under a law."""
        ages = self.ages(place, most)
        size = grown(period_map(self.loop, ages, most))[1]
        return float(np.log(max(size, 1e-300)) / (ages.shape[1] * self.loop.step))

    def best(self, places: list[np.ndarray], most: int, looks: int) -> np.ndarray:
        """The law that grows fastest of those to which some lead, by simplices (Nelder and Mead 1965)."""
        from scipy.optimize import minimize

        found = [
            minimize(lambda u: -self.rate(u, most), place, method="Nelder-Mead", options={"maxfev": looks})
            for place in places
        ]
        return min(found, key=lambda result: float(result.fun)).x

    def least(self, place: np.ndarray, low: int, high: int) -> int:
        """The smallest bound at which the law grows, which it does at `high`; by halves."""
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.rate(place, middle) > 0.0 else (middle, high)
        return high


def slow_law(loop: SampledLoop, ways: tuple[int, ...], slope: float, low: int, high: int) -> DelayLaw | None:
    """The law with the smallest bound [steps] found between low and high that makes the loop grow and whose delay
    changes by at most `slope` steps a step; None if none. Constant delays are among them.

    `ways`: which law each channel follows. From coarse steps to finer ones, as `adversary.destroying_law`.
    """
    if slope <= 0.0:
        return None
    together = coarseness(high)
    family = _SlowFamily(coarser(loop, together), ways, slope)
    places = [np.zeros(family.size), *np.random.default_rng(1).uniform(size=(_STARTS, family.size))]
    most, looks = -(-high // together), _LOOKS
    while True:
        best = family.best(places, most, looks)
        if family.rate(best, most) > 0.0:
            most = family.least(best, max(low // together - 1, 0), most)
        if together == 1:
            law = under(loop, family.ages(best, most))
            return law if law.growth_rate > 0.0 else None
        together //= _FACTOR
        family, places, looks = _SlowFamily(coarser(loop, together), ways, slope), [best], _LOOKS_FINER
        most = min(most * _FACTOR + 1, -(-high // together))
