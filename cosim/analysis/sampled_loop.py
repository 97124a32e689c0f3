"""A linear loop as it is co-simulated: a step map, and channels that show what was sent some steps ago."""

import numpy as np
from attrs import cmp_using, field, frozen
from numpy.typing import ArrayLike

from cosim.errors import InputError, Problem


def _matrix(values: ArrayLike) -> np.ndarray:
    matrix = np.atleast_2d(np.array(values, dtype=float))
    matrix.flags.writeable = False
    return matrix


@frozen
class SampledLoop:
    """A loop of p channels at a fixed step, in the coordinates in which the delays are the only unknown.

    s[k+1] = A s[k] + B w[k],  x_c[k+1] - x_c[k] = (C s[k] + D w[k])_c,  w_c[k] = x_c[k - d_c[k]] - x_c[k].

    x_c is what channel c carries and d_c[k] >= 0 the age of what it shows, in steps. So w = 0 is the loop without
    delay. Positions enter by their increments only: a free pair of arms may stand anywhere. `transition` A (n, n),
    `drive` B (n, p), `moved` C (p, n), `moved_now` D (p, p), `step` [s].
    """

    transition: np.ndarray = field(converter=_matrix, eq=cmp_using(np.array_equal))
    drive: np.ndarray = field(converter=_matrix, eq=cmp_using(np.array_equal))
    moved: np.ndarray = field(converter=_matrix, eq=cmp_using(np.array_equal))
    moved_now: np.ndarray = field(converter=_matrix, eq=cmp_using(np.array_equal))
    step: float

    def __attrs_post_init__(self) -> None:
        n, p = self.drive.shape
        found = (self.transition.shape, self.moved.shape, self.moved_now.shape)
        if found != ((n, n), (p, n), (p, p)):
            raise InputError(Problem("sampled loop", f"A {(n, n)}, C {(p, n)}, D {(p, p)} for B {(n, p)}", str(found)))
        matrices = (self.transition, self.drive, self.moved, self.moved_now)
        if not (np.isfinite(self.step) and self.step > 0.0 and all(np.all(np.isfinite(m)) for m in matrices)):
            raise InputError(Problem("sampled loop", "finite matrices and a step > 0 s", f"step {self.step}"))

    @property
    def channels(self) -> int:
        """Number p of channels."""
        return self.drive.shape[1]

    def increments(self, frequencies: np.ndarray) -> np.ndarray:
        """Response from w to x[k+1] - x[k] at frequencies [rad/step], shape (frequencies, p, p)."""
        z = np.exp(1j * np.asarray(frequencies))[:, None, None]
        n = len(self.transition)
        inner = np.linalg.solve(
            z * np.eye(n) - self.transition, np.broadcast_to(self.drive + 0j, (len(z), n, self.channels))
        )
        return self.moved @ inner + self.moved_now
