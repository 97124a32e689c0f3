"""The two-sided verdict for any delay law: proven stable up to here, destroyed by this law from there on."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from attrs import evolve, field, frozen

from cosim.analysis.adversary import DelayLaw, refined, sketched, under
from cosim.analysis.certificate import Certificate
from cosim.analysis.delay_grid import uniform_grid
from cosim.analysis.multiplier import certify
from cosim.analysis.parting import LoopPart
from cosim.analysis.proof import proven
from cosim.analysis.sampled_loop import SampledLoop
from cosim.errors import InputError

CLASS = "each way any delay between 0 and T, at any speed; the ways independent of one another"
EQUAL = "the same delay in every way, between 0 and T, at any speed"
INTERVALS = 8
LIFTS: tuple[dict[int, int], ...] = ({}, {4: 1})
"""Knots of the delay, and the earlier moment that is looked at too, cheap ones first: what two cores solve in seconds
(ANY_DELAY.md).
"""
BELOW = (0.022, 0.03, 0.038, 0.048, 0.065, 0.1, 0.15, 0.22, 0.32, 0.45, 0.65)
"""Parts by which a certificate is asked below the destroying law, one after another until one is proven."""
Say = Callable[[str], None]


@frozen
class Destroyer:
    """A delay law that makes the linear loop number `part` grow; `ages` (channels, period) [steps] as channels have
    them.
    """

    law: DelayLaw
    part: int
    owner: tuple[int, ...]

    @property
    def ages(self) -> np.ndarray:
        """Ages by channel (channels, period) in steps."""
        return self.law.ages[[self.owner.index(c) for c in range(max(self.owner) + 1)]]

    @property
    def max_delay(self) -> float:
        """Largest delay of the law [s]."""
        return self.law.max_delay


@frozen
class TwoSided:
    """What holds for every delay law from 0 to T, and what some law does, for the linear loop.

    `certificates` prove stability, one for each part of the loop (empty where none was found, `unproven` says why);
    `destroyers` make it grow: one of independent ways, one of equal ways, where the search found them.
    """

    certificates: tuple[Certificate, ...] = field(converter=tuple)
    unproven: str
    destroyers: Mapping[str, Destroyer]

    @property
    def destroyer(self) -> Destroyer | None:
        """The one of the smallest T: laws that are equal are independent ones too."""
        return min(self.destroyers.values(), key=lambda d: d.max_delay, default=None)


def two_sided(parts: Sequence[LoopPart], low: int, high: int, say: Say) -> TwoSided:
    """The verdict on a loop of these parts, destroying laws searched between low and high [steps].

    say: is told what is being done.
    """
    found = {}
    for kind in (EQUAL, CLASS):
        say(f"searching a delay law that destroys: {'equal' if kind == EQUAL else 'independent'} ways")
        destroyer = _destroyer(parts, kind, low, high)
        if destroyer is not None:
            found[kind] = destroyer
    first = min(found.values(), key=lambda d: d.max_delay, default=None)
    order = list(range(len(parts)))
    if first is not None:  # what is destroyed first is mostly what limits the certificate
        order.sort(key=lambda k: k != first.part)
    most = high if first is None else int(first.law.ages.max())
    try:
        held = _certificates([(k, parts[k]) for k in order], most, say)
    except InputError as error:  # a package of the extra is missing
        return TwoSided((), "; ".join(str(problem) for problem in error.problems), found)
    why = "" if held else "no certificate of this kind was found; nothing follows from that"
    return TwoSided([held[k] for k in sorted(held)], why, found)


def _destroyer(parts: Sequence[LoopPart], kind: str, low: int, high: int) -> Destroyer | None:
    """The law of the smallest bound over the parts: sketched for each, improved where the sketch reaches furthest."""
    best, least = None, high
    for number, part in enumerate(parts):
        ways = tuple(0 for _ in part.owner) if kind == EQUAL else part.owner
        sketch = sketched(part.loop, ways, low, least)
        if sketch is not None and (best is None or sketch.max_delay <= best[0].max_delay):
            best, least = (sketch, number, ways), min(least, int(np.ceil(sketch.max_delay / part.loop.step)))
    if best is None:
        return None
    sketch, number, ways = best
    law = refined(parts[number].loop, ways, sketch, low, high)
    return None if law is None else Destroyer(law, number, parts[number].owner)


def widened(destroyer: Destroyer, loop: SampledLoop, more: int) -> Destroyer:
    """The same law stretched by some steps of delay, so that it grows faster."""
    ages = destroyer.law.ages
    return evolve(destroyer, law=under(loop, np.rint(ages * ((ages.max() + more) / ages.max())).astype(int)))


def _certificates(parts: list[tuple[int, LoopPart]], most: int, say: Say) -> dict[int, Certificate]:
    """Proven certificates of all parts for one bound below `most` [steps]; empty where one has none."""
    found: dict[int, Certificate] = {}
    for bound in dict.fromkeys(int(most * (1.0 - part)) for part in BELOW):
        for number, part in parts:
            say(f"proving that no law up to {bound * part.loop.step:.4g} s destroys loop {number + 1} of {len(parts)}")
            certificate = _proven(part, bound)
            if certificate is None:
                break
            found[number] = certificate
        else:
            return found
    return {}


def _proven(part: LoopPart, most: int) -> Certificate | None:
    if most < 1:
        return None
    for lifts in LIFTS:
        certificate = certify(part.loop, uniform_grid(most, min(INTERVALS, most), lifts), part.owner)
        if certificate is not None and proven(certificate).holds:
            return certificate
    return None
