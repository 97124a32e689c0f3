"""The motion that effects look at, as they need it."""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

Theta = tuple[float, ...]
"""Values of an effect's nonlinear parameters."""
Joints = tuple[int, ...]
"""Joints, counted from 0."""
Columns = Mapping[int, np.ndarray]
"""Columns of a regression: joint -> (n, k)."""
Slopes = tuple[Mapping[int, np.ndarray], Mapping[int, np.ndarray], Mapping[int, np.ndarray]]
"""Derivatives of the rigid torque by position, velocity and acceleration of a joint: each joint -> (n,)."""


class FilterWidths(Protocol):
    """Standard deviations [s] of the smoothing filters: of the first one, and of all together."""

    @property
    def first(self) -> float: ...

    @property
    def total(self) -> float: ...


class Motion(Protocol):
    """Smoothed signals of all runs of a recording below each other: n rows, nj joints, SI units.

    step, sample [s] between rows and between recorded samples; bounds: first and last row of each run; time (n,),
    run (n,) number of the run, test (n,) rows that are held out; q, dq, ddq, tau (n, nj) smoothed, tau_raw (n, nj) as
    recorded; other: further recorded signals (n,) by name. `cosim.closure.model.motion` has the one that is used.
    """

    @property
    def step(self) -> float: ...
    @property
    def sample(self) -> float: ...
    @property
    def widths(self) -> FilterWidths: ...
    @property
    def bounds(self) -> Sequence[tuple[int, int]]: ...
    @property
    def time(self) -> np.ndarray: ...
    @property
    def run(self) -> np.ndarray: ...
    @property
    def test(self) -> np.ndarray: ...
    @property
    def q(self) -> np.ndarray: ...
    @property
    def dq(self) -> np.ndarray: ...
    @property
    def ddq(self) -> np.ndarray: ...
    @property
    def tau(self) -> np.ndarray: ...
    @property
    def tau_raw(self) -> np.ndarray: ...
    @property
    def other(self) -> Mapping[str, np.ndarray]: ...
    @property
    def joints(self) -> int: ...

    def per_run(self, function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
        """A function applied to the rows of each run of x (n, ...)."""
        ...

    def smooth(self, x: np.ndarray, width: float | None = None) -> np.ndarray:
        """x (n, ...) smoothed by the first filter, or by one of another width [s]."""
        ...

    def of_torque(self, joint: int, function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """A function (n,) of the recorded torque of a joint, formed sample by sample and then smoothed."""
        ...

    def rate(self, x: np.ndarray) -> np.ndarray:
        """The time derivative of a smooth signal x (n, ...)."""
        ...
