"""The two-sided verdict for any delay law: proven stable up to here, destroyed by this law from there on."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from attrs import evolve, field, frozen

from cosim.analysis.adversary import DelayLaw, fitted, refined, sketched, sooner, under
from cosim.analysis.certificate import Certificate
from cosim.analysis.delay_grid import uniform_grid
from cosim.analysis.multiplier import certify
from cosim.analysis.parting import LoopPart, together
from cosim.analysis.proof import proven
from cosim.analysis.sampled_loop import SampledLoop
from cosim.analysis.slow_laws import slow_law
from cosim.errors import InputError

CLASS = "each way any delay between 0 and T, at any speed; the ways independent of one another"
EQUAL = "the same delay in every way, between 0 and T, at any speed"


def laws(slope: float | None, equal: bool = False) -> str:
    """The class of delay laws, in words; slope: seconds a second by which a delay changes at most."""
    said = EQUAL if equal else CLASS
    return said if slope is None else said.replace("at any speed", f"changing by at most {slope:g} s a second")


INTERVALS = 8
LIFTS: tuple[dict[int, int], ...] = ({}, {4: 1})
"""Knots of the delay, and the earlier moment that is looked at too, cheap ones first: what two cores solve in seconds
(ANY_DELAY.md).
"""
SLOW_LIFTS: tuple[dict[int, int], ...] = ({4: 1}, {2: 1})
"""The same where the slope of the delay is bounded: the earlier moment says most where the law has hardly changed."""
BELOW = (0.022, 0.03, 0.038, 0.043, 0.048, 0.055, 0.065, 0.1, 0.15, 0.22, 0.32, 0.45, 0.65)
"""Parts by which a certificate is asked below the destroying law, one after another until one is proven."""
FAR_BELOW = (0.05, 0.15, 0.32, 0.65)
"""The same below the bound of the search where no law destroys: there is no gap to make small."""
SIGNALS = 6
"""Signals of a loop in one piece up to which proofs are sought: each encloses a matrix of them thousands of times."""
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
        """Ages by channel (channels, period) in steps, of as many turns as last for three of the largest delay."""
        ages = self.law.ages[[self.owner.index(c) for c in range(max(self.owner) + 1)]]
        return np.tile(ages, (1, -(-3 * int(ages.max()) // ages.shape[1])))

    @property
    def max_delay(self) -> float:
        """Largest delay of the law [s]."""
        return self.law.max_delay


@frozen
class TwoSided:
    """What holds for every delay law from 0 to T, and what some law does, for the linear loop.

    slope: seconds a second by which the laws change at most; None: at any speed.
    `certificates` prove stability, one for each part of the loop (empty where none was found, `unproven` says why);
    `destroyers` make it grow: one of independent ways, one of equal ways, where the search found them.
    """

    certificates: tuple[Certificate, ...] = field(converter=tuple)
    unproven: str
    destroyers: Mapping[str, Destroyer]
    slope: float | None = None

    @property
    def destroyer(self) -> Destroyer | None:
        """The one of the smallest T: laws that are equal are independent ones too."""
        return min(self.destroyers.values(), key=lambda d: d.max_delay, default=None)


def two_sided(parts: Sequence[LoopPart], low: int, high: int, say: Say, slope: float | None = None) -> TwoSided:
    """The verdict on a loop of these parts, destroying laws searched between low and high [steps].

    say: is told what is being done; slope: seconds a second by which the laws change at most; None: at any speed.
    """
    say("searching a delay law that destroys")
    found = _destroyers(parts, low, high) if slope is None else _slow_destroyers(parts, low, high, slope)
    first = min(found.values(), key=lambda d: d.max_delay, default=None)
    most = high if first is None else int(first.law.ages.max())
    try:
        below = FAR_BELOW if first is None else BELOW
        bounds = list(dict.fromkeys(int(most * (1.0 - part)) for part in below))
        held = (
            []
            if any(part.loop.channels > SIGNALS for part in parts)
            else _certificates(parts, bounds, 0 if first is None else first.part, say, slope)
        )
    except InputError as error:  # a package of the extra is missing
        return TwoSided((), "; ".join(str(problem) for problem in error.problems), found, slope)
    return TwoSided(held, "" if held else _unproven(parts), found, slope)


def _unproven(parts: Sequence[LoopPart]) -> str:
    most = max(part.loop.channels for part in parts)
    if most > SIGNALS:
        return f"{most} signals that do not come apart are more than the {SIGNALS} up to which proofs are sought"
    return "no certificate of this kind was found; nothing follows from that"


def certified(parts: Sequence[LoopPart], most: int) -> bool:
    """Whether a cheap certificate proves that no delay law up to `most` [steps] destroys a loop of these parts.

    Raises InputError where a package of the extra is missing.
    """
    return all(_proven([part], most, LIFTS[:1]) for part in parts)


def _destroyers(parts: Sequence[LoopPart], low: int, high: int) -> dict[str, Destroyer]:
    """A law of equal ways and one of independent ways, by their class; equal laws are independent ones too."""
    found = {}
    equal = _sketch(parts, low, high, equal=True)
    if equal is not None:
        found[EQUAL] = _refined(parts, equal, low, high)
    free = _sketch(parts, low, high, equal=False) if equal is None else _sooner(parts, equal, low)
    if free is not None:
        found[CLASS] = _refined(parts, free, low, high)
    law = min((d for d in found.values() if d is not None), key=lambda d: d.max_delay, default=None)
    found[CLASS] = law
    return {kind: destroyer for kind, destroyer in found.items() if destroyer is not None}


def _slow_destroyers(parts: Sequence[LoopPart], low: int, high: int, slope: float) -> dict[str, Destroyer]:
    """Of the laws that change by so much a step at most; those of the part that is destroyed first."""
    found: dict[str, Destroyer] = {}
    for kind in (EQUAL, CLASS):
        least = high
        for number, part in enumerate(parts):
            ways = tuple(0 for _ in part.owner) if kind == EQUAL else part.owner
            law = slow_law(part.loop, ways, slope, low, least)
            if law is not None and (kind not in found or law.max_delay < found[kind].max_delay):
                found[kind], least = Destroyer(law, number, part.owner), int(law.ages.max())
    if EQUAL in found and (CLASS not in found or found[EQUAL].max_delay < found[CLASS].max_delay):
        found[CLASS] = found[EQUAL]  # equal laws are independent ones too
    return found


@frozen
class _Sketch:
    """A destroying law of coarse steps, the loop that it makes grow, which law each of its signals follows, and the
    part that this loop is, or is of.
    """

    law: DelayLaw
    loop: SampledLoop
    ways: tuple[int, ...]
    part: int


def _sketch(parts: Sequence[LoopPart], low: int, high: int, equal: bool) -> _Sketch | None:
    """That of the smallest bound over the parts; what destroys one is where the search on the next begins."""
    best, least = None, high
    for number, part in enumerate(parts):
        for loop in together(part) if equal else (part.loop,):
            ways = (0,) * loop.channels if equal else part.owner
            begun = best.law if best and len(best.ways) == len(ways) else None
            law = sketched(loop, ways, low, least, begun)
            if law is not None and (best is None or _reach(law) < _reach(best.law)):
                best = _Sketch(law, loop, ways, number)
                least = min(least, int(np.ceil(law.max_delay / loop.step)))
    return best


def _reach(law: DelayLaw) -> tuple[float, float]:
    """Laws of the smallest bound first, among them those that grow fastest."""
    return law.max_delay, -law.growth_rate


def _sooner(parts: Sequence[LoopPart], equal: _Sketch, low: int) -> _Sketch | None:
    part = parts[equal.part]
    law = sooner(part.loop, part.owner, low, equal.law) if len(set(part.owner)) > 1 else None
    return None if law is None else _Sketch(law, part.loop, part.owner, equal.part)


def _refined(parts: Sequence[LoopPart], sketch: _Sketch, low: int, high: int) -> Destroyer | None:
    law = refined(sketch.loop, sketch.ways, sketch.law, low, high)
    if law is None:
        return None
    owner = parts[sketch.part].owner
    if len(owner) > len(law.ages):  # found for one age of all signals
        law = evolve(law, ages=np.repeat(law.ages[:1], len(owner), axis=0))
    return Destroyer(law, sketch.part, owner)


def widened(destroyer: Destroyer, loop: SampledLoop, more: int, slope: float | None = None) -> Destroyer:
    """The same law stretched by some steps of delay, so that it grows faster; in time too where its slope is bound."""
    ages = destroyer.law.ages
    most, period = int(ages.max()) + more, ages.shape[1]
    longer = period if slope is None else -(-period * most // int(ages.max()))
    return evolve(destroyer, law=under(loop, fitted(ages, longer, most)))


def _certificates(
    parts: Sequence[LoopPart], bounds: Sequence[int], first: int, say: Say, slope: float | None
) -> list[Certificate]:
    """Proven certificates of all parts for the first of the bounds [steps] that has them; empty where none has.

    first: the part that is destroyed first, which mostly limits the certificate.
    """
    order = sorted(range(len(parts)), key=lambda k: k != first)
    alike = len({part.owner for part in parts}) == 1
    groups = [[parts[k] for k in order]] if alike else [[parts[k]] for k in order]
    for bound in bounds:
        say(f"proving that no law up to {bound * parts[0].loop.step:.4g} s destroys")
        found: list[Certificate] = []
        for group in groups:
            held = _proven(group, bound, LIFTS if slope is None else SLOW_LIFTS, slope)
            if not held:
                break
            found += held
        else:
            return [found[order.index(k)] for k in range(len(parts))]
    return []


def _proven(
    group: list[LoopPart], most: int, moments: Sequence[dict[int, int]] = LIFTS, slope: float | None = None
) -> list[Certificate]:
    """Certificates of loops that share their multipliers; empty where there are none, or none is sought."""
    sought = most >= 1 and group[0].loop.channels <= SIGNALS
    for lifts in moments if sought else ():
        grid = uniform_grid(most, min(INTERVALS, most), lifts, slope)
        found = certify([part.loop for part in group], grid, group[0].owner)
        if found is not None and all(proven(certificate).holds for certificate in found):
            return found
    return []
