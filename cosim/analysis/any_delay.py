"""The two-sided verdict for any delay law: proven stable up to here, destroyed by this law from there on."""

import numpy as np
from attrs import evolve, field, frozen

from cosim.analysis.adversary import DelayLaw, destroying_law
from cosim.analysis.certificate import Certificate
from cosim.analysis.delay_grid import uniform_grid
from cosim.analysis.multiplier import certify
from cosim.analysis.proof import verify
from cosim.analysis.sampled_loop import SampledLoop, TipSide, axis_loop, difference_loop

INTERVALS = 8
LIFTS = {4: 1}
"""Knots of the delay, and the earlier moment that is looked at too: what two cores solve in seconds (ANY_DELAY.md)."""


@frozen
class AnyDelay:
    """What holds for every delay law from 0 to T each way, and what some law does.

    `certificates` prove stability, one for each loop into which the system falls (empty where none was found);
    `destroying` makes the system grow, in the loop number `destroyed` (None where no law was found).
    """

    certificates: tuple[Certificate, ...] = field(converter=tuple)
    destroying: DelayLaw | None
    destroyed: int | None

    @property
    def certified(self) -> float:
        """Largest T [s] proven stable; 0 without a certificate."""
        return min((c.max_delay for c in self.certificates), default=0.0)

    @property
    def destroyed_at(self) -> float:
        """Smallest T [s] of a law known to make the system grow; infinite without one."""
        return np.inf if self.destroying is None else self.destroying.max_delay

    @property
    def gap_percent(self) -> float:
        """(destroying - certificate) / certificate [%]."""
        return 100.0 * (self.destroyed_at / self.certified - 1.0) if self.certified else np.inf


def symmetric_verdict(sides: list[TipSide], step: float, limit: float) -> AnyDelay:
    """Verdict on axes with equal sides and no coupling between axes, for T up to `limit` [s]; both classes of laws.

    The certificates are for independent laws, and so for the same law both ways as well. The destroying law is the same
    both ways, and so one of the independent laws too; it is searched in the distance of the tips, a loop of its own.
    """
    attacked = [difference_loop(side, step) for side in sides]
    law, where = _smallest(attacked, (0,), limit)
    if law is not None:
        law = evolve(law, ages=np.vstack([law.ages, law.ages]))
    loops = [axis_loop(side, side, step) for side in sides]
    return AnyDelay(certificates(loops, _below(law, loops[0], limit)), law, where)


def pair_verdict(local: TipSide, remote: TipSide, step: float, limit: float, independent: bool) -> AnyDelay:
    """Verdict on one axis with sides that differ, a hand on one or a wall at the other, for T up to `limit` [s].

    The certificate is for independent laws; the destroying law is one both ways unless `independent`.
    """
    loop = axis_loop(local, remote, step)
    law, where = _smallest([loop], (0, 1) if independent else (0, 0), limit)
    return AnyDelay(certificates([loop], _below(law, loop, limit)), law, where)


def _smallest(loops: list[SampledLoop], ways: tuple[int, ...], limit: float) -> tuple[DelayLaw | None, int | None]:
    """The destroying law with the smallest bound over the loops, and the number of its loop."""
    law, where, high = None, None, loops[0].steps(limit)
    for k, loop in enumerate(loops):
        found = destroying_law(loop, ways, high // 2, high)
        if found is not None and (law is None or found.max_delay < law.max_delay):
            law, where, high = found, k, loop.steps(found.max_delay)
    return law, where


def _below(law: DelayLaw | None, loop: SampledLoop, limit: float) -> int:
    return loop.steps(limit if law is None else law.max_delay)


def certificates(loops: list[SampledLoop], high: int, resolution: float = 0.004) -> tuple[Certificate, ...]:
    """Proven certificates of all loops for the largest common bound, at most `high` steps; empty where one has none.

    The bound is known to a part of `resolution`. Put the loop that limits first: the others are then asked once.
    """
    most, width = high, max(1, round(resolution * high))
    found: list[Certificate] = []
    for loop in loops:
        certificate = _proven(loop, most) if found else None
        certificate = certificate or _largest(loop, most, width)
        if certificate is None:
            return ()
        found.append(certificate)
        most = certificate.most
    return tuple(found)


def _largest(loop: SampledLoop, high: int, width: int) -> Certificate | None:
    """Looks down from `high` in strides that double, then halves."""
    stride, low, best = 4 * width, high, None
    while best is None:
        high, low, stride = low, low - stride, 2 * stride
        if low <= 0:
            return None
        best = _proven(loop, low)
    while high - best.most > width:
        middle = (high + best.most) // 2
        found = _proven(loop, middle)
        if found is None:
            high = middle
        else:
            best = found
    return best


def _proven(loop: SampledLoop, most: int) -> Certificate | None:
    if most < 2 * INTERVALS:
        return None
    certificate = certify(loop, uniform_grid(most, INTERVALS, LIFTS))
    return certificate if certificate is not None and verify(certificate).holds else None
