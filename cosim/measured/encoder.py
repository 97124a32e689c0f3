"""What an encoder's step tells of the unit of its angle: it divides a turn into a whole number of counts.

A step that divides 360 and does not divide 2 pi is one of degrees, and the other way round. A gear between encoder and
joint may leave no whole number, and a step of 1, 2 or 5 of some decimal place may be the rounding of a file: then
nothing is told.
"""

import numpy as np

TURNS = {"deg": 360.0, "rad": 2 * np.pi}
FEWEST = 64  # levels: of fewer, a step between all of them need not be the encoder's own
SURE = 4.0  # standard deviations of the step: 6e-5
ONE = 1.5  # smallest gaps: larger ones are nearer to two counts than to one
LOOSE = 0.1  # of a step: digits of a file are far finer; levels that lie anywhere between two counts are no counts
ROUNDING = 1e-9  # of a step
CHANCE = 0.005  # counts to either side of a whole number: any other step is there in one of a hundred cases


def unit_of(angle: np.ndarray) -> str | None:
    """The unit of an angle (n,), one of TURNS; None where its steps do not tell."""
    found = _step(angle)
    if found is None:
        return None
    step, error = found
    if _decimal(step, SURE * error):
        return None
    whole = []
    for unit, turn in TURNS.items():
        counts, slack = turn / step, SURE * error / step * turn / step
        if slack > CHANCE:
            return None
        if abs(counts - round(counts)) <= max(slack, 1e-12 * counts):
            whole.append(unit)
    return whole[0] if len(whole) == 1 else None


def _step(angle: np.ndarray) -> tuple[float, float] | None:
    """The step of which all levels are multiples, and its standard deviation; None where there is none."""
    levels = np.unique(angle)
    if len(levels) < FEWEST:
        return None
    gaps = np.diff(levels)
    smallest = float(np.median(gaps[gaps < ONE * gaps.min()]))
    counts = np.r_[0.0, np.cumsum(np.rint(gaps / smallest))]
    (step, start), covariance = np.polyfit(counts, levels, 1, cov=True)
    rest = np.abs(levels - start - step * counts).max()
    return None if rest > LOOSE * step else (float(step), float(np.sqrt(covariance[0, 0])))


def _decimal(step: float, error: float) -> bool:
    """Whether a step is 1, 2 or 5 of a decimal place."""
    place = 10.0 ** np.floor(np.log10(step))
    return any(abs(step - k * place) <= max(error, ROUNDING * step) for k in (1, 2, 5, 10))
