"""How an identification treats its data: cutoffs, the common low-pass filter, reversals, and the fit, each named."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from attrs import evolve, field, frozen

from cosim.errors import InputError, Problem
from cosim.measured.filtering import FilteredMotion, FirstOrder, LowPass, Window, ZeroPhase, bandwidth, near_reversal
from cosim.measured.recording import Recording

LADDER = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Shares of the usual cutoffs, half an octave apart: the variance that noise of q has in the acceleration goes with the
fifth power of the cutoff, so each is a factor of six. The last lies at three times the motion's band; a window of that
cutoff still passes the band itself, and all of the equation goes through it alike.
"""


class Reversals(ABC):
    """What is done where a joint turns round, where the sign of the measured velocity is wrong (PHYSICS.md 4)."""

    smoothing: float = 0.0  # rad/s over which the sign is smoothed
    heed_clipping: ClassVar[bool] = True  # whether rows with clipped torques are left out

    def slowest(self, usual_speed: np.ndarray) -> np.ndarray | None:
        """Smallest speed (nj,) of the rows in use, None where the sign's law is given or all rows are used."""
        return None

    @abstractmethod
    def keep(self, motion: FilteredMotion, spread: tuple[int, int], usual_speed: np.ndarray) -> np.ndarray:
        """Rows to use, (n, nj) bool; the filters smear over `spread` rows; usual_speed (nj,) is the rms of dq over
        all runs.
        """

    @abstractmethod
    def text(self) -> str:
        """For the report."""


@frozen
class LeaveOut(Reversals):
    """Rows near a reversal are left out: |dq| below `share` of its rms, widened by what the filters smear.

    A sine is below a tenth of its rms for a twentieth of the time: so many rows are the price of sure signs.

    On the rows that are left the sign may still be smoothed, over `smoothing` [rad/s], where the friction's law is
    known.
    """

    share: float = 0.1
    smoothing: float = 0.0

    def slowest(self, usual_speed: np.ndarray) -> np.ndarray | None:
        return None if self.smoothing else self.share * usual_speed

    def keep(self, motion: FilteredMotion, spread: tuple[int, int], usual_speed: np.ndarray) -> np.ndarray:
        columns = zip(motion.dq.T, self.share * usual_speed, strict=True)
        return ~np.stack([near_reversal(dq, motion.step, spread, limit) for dq, limit in columns], axis=1)

    def text(self) -> str:
        law = f", sign of dq smoothed over {self.smoothing:g} (known law)" if self.smoothing else ""
        return (
            f"rows near velocity reversals left out (|dq| < {self.share:g} rms(dq), widened by the filters' reach){law}"
        )


@frozen
class SmoothLaw(Reversals):
    """All rows, with the sign of dq replaced by the known law dq / sqrt(dq^2 + v^2)."""

    smoothing: float = 0.01

    def keep(self, motion: FilteredMotion, spread: tuple[int, int], usual_speed: np.ndarray) -> np.ndarray:
        return np.ones(motion.dq.shape, bool)

    def text(self) -> str:
        return f"all rows, sign of dq smoothed over {self.smoothing:g} (known law)"


@frozen
class KeepAll(Reversals):
    """All rows with sgn(dq), as the paper does."""

    heed_clipping: ClassVar[bool] = False

    def keep(self, motion: FilteredMotion, spread: tuple[int, int], usual_speed: np.ndarray) -> np.ndarray:
        return np.ones(motion.dq.shape, bool)

    def text(self) -> str:
        return "all rows with sgn(dq), as the paper does"


@frozen
class Method:
    """One way from a recording to parameters.

    before: low-pass of q (and of tau where `both_sides`) before differentiation; low_pass: over both sides of the
    equation; weighted: joints weighted by their residual; robust: Huber's weights; physical: constrained to M > 0 over
    the workspace and to friction that dissipates; shares: of both cutoffs that are tried, the narrowest intervals win;
    dead_band: errors of a servo [rad] up to which rows are left out.
    """

    name: str
    before: LowPass
    low_pass: LowPass
    reversals: Reversals = field(factory=LeaveOut)
    both_sides: bool = True
    weighted: bool = True
    robust: bool = False
    physical: bool = False
    shares: tuple[float, ...] = (1.0,)
    dead_band: float = 0.0

    def tried(self) -> tuple["Method", ...]:
        """The methods to choose from."""
        return tuple(
            evolve(self, before=self.before.at(share), low_pass=self.low_pass.at(share), shares=(1.0,))
            for share in self.shares
        )

    def text(self) -> str:
        """The processing in one sentence."""
        sides = "q and tau" if self.both_sides else "q"
        fit = (
            ", ".join(
                word
                for word, on in (
                    ("weighted by joint", self.weighted),
                    ("Huber weights", self.robust),
                    ("constrained to a physical arm", self.physical),
                )
                if on
            )
            or "ordinary"
        )
        return (
            f"{sides} through {self.before}, central differences, both sides through "
            f"{self.low_pass}, {self.reversals.text()}; least squares: {fit}"
        )


def suggested(recording: Recording) -> Method:
    """The default: cutoffs from the band of the motion, rows near reversals left out, joints weighted.

    The common low-pass lies at twelve times the motion's band, the one before differentiation at six times that. Where
    torques were clipped, a row is lost with each clipped one that its filters see, which speaks for short filters, and
    the rows that are left are the slow ones, in which the encoder's noise in the acceleration weighs more, which speaks
    for long ones. Both enter the intervals (`doubted`), so those of LADDER are tried.
    """
    rate = 1 / max(run.step for run in recording.runs)
    low = float(np.clip(12 * bandwidth(recording), 2.0, 0.1 * rate))
    law = LeaveOut(smoothing=recording.description.coulomb_velocity)
    shares = LADDER if any(run.clipped is not None for run in recording.runs) else (1.0,)
    return Method("default", Window(min(6 * low, 0.2 * rate)), Window(low), law, shares=shares)


def taati(recording: Recording, velocity_cutoff: float = 30.0) -> Method:
    """The paper's estimator: 30 Hz velocity filter, L(s) with 10 rad/s, sgn(dq), all rows, ordinary least squares."""
    rate = 1 / max(run.step for run in recording.runs)
    cutoff = min(velocity_cutoff, 0.2 * rate)
    return Method("Taati", ZeroPhase(cutoff), FirstOrder(10.0), KeepAll(), both_sides=False, weighted=False)


def adjusted(
    method: Method,
    cutoff: float | None,
    velocity_cutoff: float | None,
    smooth_sign: float | None,
    robust: bool,
    physical: bool,
) -> Method:
    """The method with what a user asked for. Raises InputError for a cutoff or a speed that is not positive."""
    given = {"--cutoff": cutoff, "--velocity-cutoff": velocity_cutoff, "--smooth-sign": smooth_sign}
    problems = [
        Problem(name, "a positive number", f"{value:g}")
        for name, value in given.items()
        if value is not None and not value > 0
    ]
    if problems:
        raise InputError(problems)
    low_pass = method.low_pass if cutoff is None else Window(cutoff)
    before = method.before if velocity_cutoff is None else Window(velocity_cutoff)
    reversals = method.reversals if smooth_sign is None else SmoothLaw(smooth_sign)
    shares = method.shares if cutoff is None and velocity_cutoff is None else (1.0,)
    return evolve(
        method,
        low_pass=low_pass,
        before=before,
        reversals=reversals,
        robust=robust,
        physical=physical,
        shares=shares,
    )
