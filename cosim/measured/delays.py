"""Recorded round-trip times as one-way delays over time.

A trace of round trips (request k leaves when answer k-1 has come) holds no one-way delays and no clock. Both are made:
exchange k begins at t_k = sum of the round trips before it; a `share` of its round trip is the way there, the rest the
way back. A channel reads its delay when it receives, so the value share * rtt_k stands at t_k + share * rtt_k, and the
value (1 - share) * rtt_k at t_k + rtt_k. share = 0.5 is the symmetric split; a network with a slow uplink has more. The
sum of both delays, which alone counts for stability with constant delays, does not depend on the share.
"""

import numpy as np

from cosim.errors import InputError, Problem


def one_way(round_trips: np.ndarray, share: float, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (n,) and delays (n,) there and back [s], on an even grid of `step` [s], linear between the exchanges.

    round_trips: (k,) [s]. Raises InputError for a share outside 0 to 1 or round trips that are not positive.
    """
    trips = np.asarray(round_trips, dtype=float)
    if not 0.0 <= share <= 1.0:
        raise InputError(Problem("share", "a number from 0 to 1", str(share)))
    if trips.size < 2 or not np.all(trips > 0.0):
        raise InputError(Problem("round trips", "two or more positive times", "others"))
    begin = np.concatenate([[0.0], np.cumsum(trips)[:-1]])
    time = np.arange(int((begin[-1] + trips[-1]) / step + 1e-9) + 1) * step
    there = np.interp(time, begin + share * trips, share * trips)
    back = np.interp(time, begin + trips, (1.0 - share) * trips)
    return time, there, back
