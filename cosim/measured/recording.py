"""A recorded experiment: runs on an even time grid, in SI units, with the rows that are held out marked."""

from collections.abc import Mapping

import numpy as np
from attrs import evolve, field, fields, frozen

from cosim.measured.description import RecordingDescription
from cosim.measured.device import Device
from cosim.measured.notes import Doubt, Rescaled


@frozen(eq=False)
class Run:
    """One uninterrupted stretch of recording with n rows, nj joints and an even step.

    time (n,) [s]; q, tau, dq, ddq, q_ref (n, nj) [SI of the description]; force (n, 3) [N], tip, base frame;
    regressor (n, p) and rigid (n,): recorded columns and torque of the rigid body; test (n,) marks the held-out rows.
    clipped (n, nj): torques at the end of their range, which no model can be fitted to; load (n, 3): known
    inertia [kg m^2] and m l cos, m l sin [kg m] of what was mounted; servo (n, nj): what a radian of its dead band
    takes from tau. None: not recorded, or none. pace: seconds for one of `time`, if the clock was set because it runs
    fast or slow.
    """

    name: str
    time: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    test: np.ndarray
    dq: np.ndarray | None = None
    ddq: np.ndarray | None = None
    q_ref: np.ndarray | None = None
    force: np.ndarray | None = None
    regressor: np.ndarray | None = None
    rigid: np.ndarray | None = None
    other: Mapping[str, np.ndarray] = field(factory=dict)
    clipped: np.ndarray | None = None
    load: np.ndarray | None = None
    servo: np.ndarray | None = None
    pace: float = 1.0

    @property
    def step(self) -> float:
        """Sampling period [s]."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def train(self) -> np.ndarray:
        """Rows to fit on, (n,) bool."""
        return ~self.test

    def __len__(self) -> int:
        return len(self.time)

    def part(self, rows: slice) -> "Run":
        """Some rows in succession, without copies."""
        signals = {
            one.name: getattr(self, one.name) for one in fields(Run) if one.name not in ("name", "other", "pace")
        }
        cut = {name: x[rows] for name, x in signals.items() if x is not None}
        return evolve(self, other={name: x[rows] for name, x in self.other.items()}, **cut)


@frozen(eq=False)
class Recording:
    """Runs of one device, where they came from, and every repair and doubt: in words, and as entries with rows."""

    description: RecordingDescription
    runs: tuple[Run, ...]
    warnings: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()

    @property
    def device(self) -> Device:
        """What was recorded."""
        return self.description.device

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints in words."""
        return self.description.joints

    def paced(self) -> "Recording":
        """The recording on the time that its clocks tell if they run as fast or slow as they were set."""
        return evolve(self, runs=tuple(evolve(run, time=run.time * run.pace) for run in self.runs))

    def rescaled(self, by: Rescaled) -> "Recording":
        """The recording with one signal of a joint in another unit."""

        def scaled(x: np.ndarray) -> np.ndarray:
            x = x.copy()
            x[:, by.joint] *= by.factor
            return x

        return evolve(self, runs=tuple(evolve(run, **{by.role: scaled(getattr(run, by.role))}) for run in self.runs))
