"""A tube around a reference curve, and what of another curve lies outside of it.

The tube is that of csv-compare (Modelica Association) and Funnel (LBNL): the area that a rectangle of half width
`time` [s] and half height `height` covers when its centre moves along the reference, whose samples are joined by
lines. A sample of the other curve agrees where it lies inside; its border counts as inside.
"""

import numpy as np
from attrs import frozen


@frozen
class Tube:
    """Half width [s] and half height [unit of the signal] of the rectangle."""

    time: float
    height: float

    def bounds(self, at: np.ndarray, time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper border (n,) at the times `at` (n,) of the tube around values (m,) over time (m,), which may
        repeat a time at a jump.
        """
        early, late = at - self.time, at + self.time
        ends = np.stack([np.interp(early, time, values), np.interp(late, time, values)])
        low, high = ends.min(axis=0), ends.max(axis=0)
        first, last = np.searchsorted(time, early, "left"), np.searchsorted(time, late, "right")
        held = last > first
        pairs = np.stack([first[held], last[held]], axis=1).ravel()
        if len(pairs):
            padded = np.append(values, values[-1])  # so that a stretch may end at the end
            low[held] = np.minimum(low[held], np.minimum.reduceat(padded, pairs)[::2])
            high[held] = np.maximum(high[held], np.maximum.reduceat(padded, pairs)[::2])
        return low - self.height, high + self.height


@frozen
class Departure:
    """How far a curve is from a reference: over the samples of the curve within the time that both have.

    greatest: of the difference at the same time, first reached `at` [s]; rms: its root mean square; outside: share of
    samples outside the tube (None: no tube was asked for), `first_outside` [s]; height: of the tube.
    """

    greatest: float
    at: float
    rms: float
    height: float | None = None
    outside: float | None = None
    first_outside: float | None = None

    @property
    def within(self) -> bool:
        """Whether no sample is outside the tube."""
        return not self.outside


def departure(
    time: np.ndarray, values: np.ndarray, reference_time: np.ndarray, reference: np.ndarray, tube: Tube | None
) -> Departure:
    """Compare values (n,) over time (n,) with a reference (m,) over its own time (m,), each in rising order."""
    shared = (time >= reference_time[0]) & (time <= reference_time[-1])
    t, y = time[shared], values[shared]
    wanted = np.interp(t, reference_time, reference)
    difference = np.abs(y - wanted)
    none = np.isnan(y) & np.isnan(wanted)
    difference[none] = 0.0
    difference[np.isnan(difference)] = np.inf  # a value that is none agrees with no number
    worst = int(np.argmax(difference))
    found = float(difference[worst]), float(t[worst]), float(np.sqrt(np.mean(difference**2)))
    if tube is None:
        return Departure(*found)
    low, high = tube.bounds(t, reference_time, reference)
    outside = ~(((y >= low) & (y <= high)) | none)
    first = float(t[int(np.argmax(outside))]) if outside.any() else None
    return Departure(*found, tube.height, float(outside.mean()), first)
