"""How an identification treats its data: cutoffs, the common low-pass filter, reversals, and the fit, each named."""

from abc import ABC, abstractmethod

import numpy as np
from attrs import evolve, field, frozen

from cosim.errors import InputError, Problem
from cosim.measured.filtering import FirstOrder, LowPass, Motion, ZeroPhase, bandwidth, near_reversal
from cosim.measured.recording import Recording


class Reversals(ABC):
    """What is done where a joint turns round, where the sign of the measured velocity is wrong (PHYSICS.md 4)."""

    smoothing: float = 0.0  # rad/s over which the sign is smoothed

    @abstractmethod
    def keep(self, motion: Motion, low_pass: LowPass, usual_speed: np.ndarray) -> np.ndarray:
        """Rows to use, (n, nj) bool; usual_speed (nj,) is the root mean square of dq over the recording."""

    @abstractmethod
    def text(self) -> str:
        """For the report."""


@frozen
class LeaveOut(Reversals):
    """Rows near a reversal are left out: |dq| below `share` of its rms, widened by what the low-pass smears."""

    share: float = 0.1

    def keep(self, motion: Motion, low_pass: LowPass, usual_speed: np.ndarray) -> np.ndarray:
        spread = low_pass.spread(motion.step)
        columns = zip(motion.dq.T, self.share * usual_speed, strict=True)
        return ~np.stack([near_reversal(dq, motion.step, spread, limit) for dq, limit in columns], axis=1)

    def text(self) -> str:
        return f"rows near velocity reversals left out (|dq| < {self.share:g} rms(dq), widened by the filter's reach)"


@frozen
class SmoothLaw(Reversals):
    """All rows, with the sign of dq replaced by the known law dq / sqrt(dq^2 + v^2)."""

    smoothing: float = 0.01

    def keep(self, motion: Motion, low_pass: LowPass, usual_speed: np.ndarray) -> np.ndarray:
        return np.ones(motion.dq.shape, bool)

    def text(self) -> str:
        return f"all rows, sign of dq smoothed over {self.smoothing:g} (known law)"


@frozen
class KeepAll(Reversals):
    """All rows with sgn(dq), as the paper does."""

    def keep(self, motion: Motion, low_pass: LowPass, usual_speed: np.ndarray) -> np.ndarray:
        return np.ones(motion.dq.shape, bool)

    def text(self) -> str:
        return "all rows with sgn(dq), as the paper does"


@frozen
class Method:
    """One way from a recording to parameters.

    velocity_cutoff [Hz]: zero-phase low-pass of q (and of tau where `both_sides`) before differentiation;
    low_pass: over both sides of the equation; weighted: joints weighted by their residual; robust: Huber's weights;
    physical: constrained to M > 0 over the workspace and to friction that dissipates.
    """

    name: str
    velocity_cutoff: float
    low_pass: LowPass
    reversals: Reversals = field(factory=LeaveOut)
    both_sides: bool = True
    weighted: bool = True
    robust: bool = False
    physical: bool = False

    def text(self) -> str:
        """The processing in one sentence."""
        sides = "q and tau" if self.both_sides else "q"
        fit = ", ".join(
            word for word, on in (("weighted by joint", self.weighted), ("Huber weights", self.robust),
                                  ("constrained to a physical arm", self.physical)) if on
        ) or "ordinary"  # fmt: skip
        return (f"{sides} low-passed at {self.velocity_cutoff:.3g} Hz (zero phase), central differences, both sides through "
                f"{self.low_pass}, {self.reversals.text()}; least squares: {fit}")  # fmt: skip


def suggested(recording: Recording) -> Method:
    """The default: cutoffs from the band of the motion, rows near reversals left out, joints weighted.

    The common low-pass lies at twelve times the motion's band, the one before differentiation at six times that.
    """
    rate = 1 / max(run.step for run in recording.runs)
    low = float(np.clip(12 * bandwidth(recording), 2.0, 0.1 * rate))
    return Method("default", min(6 * low, 0.2 * rate), ZeroPhase(low))


def taati(recording: Recording, velocity_cutoff: float = 30.0) -> Method:
    """The paper's estimator: 30 Hz velocity filter, L(s) with 10 rad/s, sgn(dq), all rows, ordinary least squares."""
    rate = 1 / max(run.step for run in recording.runs)
    cutoff = min(velocity_cutoff, 0.2 * rate)
    return Method("Taati", cutoff, FirstOrder(10.0), KeepAll(), both_sides=False, weighted=False)


def adjusted(method: Method, cutoff: float | None, velocity_cutoff: float | None, smooth_sign: float | None, robust: bool,
             physical: bool) -> Method:
    """The method with what a user asked for. Raises InputError for a cutoff or a speed that is not positive."""
    given = {"--cutoff": cutoff, "--velocity-cutoff": velocity_cutoff, "--smooth-sign": smooth_sign}
    problems = [Problem(name, "a positive number", f"{value:g}") for name, value in given.items() if value is not None and not value > 0]
    if problems:
        raise InputError(problems)
    low_pass = method.low_pass if cutoff is None else ZeroPhase(cutoff)
    reversals = method.reversals if smooth_sign is None else SmoothLaw(smooth_sign)
    return evolve(method, low_pass=low_pass, velocity_cutoff=velocity_cutoff or method.velocity_cutoff, reversals=reversals,
                  robust=robust, physical=physical)  # fmt: skip
