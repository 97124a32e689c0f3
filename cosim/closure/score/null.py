"""Which hypotheses pass: what they explain, held against what the whole library explains of replicates without effect.

A cube root makes gains near normal (Wilson, Hilferty 1931); each is standardised by its own replicates, and the bar is
the quantile (Gumbel) of the largest of the whole library in a replicate at which all that a recording is asked stay
within ALPHA. `Screened.clear` holds where a gain passes it.
"""

from collections.abc import Hashable, Sequence

import numpy as np
from attrs import evolve

from cosim.closure.model.families import families, varied
from cosim.closure.model.model import Model
from cosim.closure.score.refinement import refined
from cosim.closure.score.screen import Screened, Untestable, screens
from cosim.effects import Effect
from cosim.effects.constants import ALPHA, SIZE
from cosim.effects.motion import Joints

QUESTIONS = 4  # put to a recording, which share ALPHA (Bonferroni): laws and families, plain and robust


def screened_laws(model: Model, effects: Sequence[Effect]) -> tuple[list[Screened], list[Untestable]]:
    """All laws beside a model, most nats first, and what cannot be tested."""
    sets = _looked_for(model, effects)
    every = [[screen.of(effect, joints) for effect, joints in sets] for screen in screens(model)]
    untestable = [x for x in every[0] if isinstance(x, Untestable)]
    found = _clearer([[x for x in some if isinstance(x, Screened)] for some in every])
    if any(x.clear for x in found):
        return found, untestable
    return [_among_all(x, sets) if x is found[0] else x for x in found], untestable


def _among_all(x: Screened, sets: Sequence[tuple[Effect, Joints]]) -> Screened:
    """The law of most nats where none passes the bar: held against what the whole library explains of replicates of
    what that law leaves, as its own pieces make the bar high.
    """
    if not _counts(x):
        return x
    best = refined(x)
    screen = x.screen.without(best)
    again = [screen.of(*one, best.theta if (one[0].key, one[1]) == best.key else None) for one in sets]
    judged = _against_bar([a for a in again if isinstance(a, Screened)], last=True)
    own = next((a for a in judged if a.choice.key == x.choice.key), None)
    return x if own is None else evolve(x, z=own.z, clear=own.clear)


def ranked_laws(model: Model, effects: Sequence[Effect], near: Joints) -> list[Screened]:
    """All laws beside a model on one of the joints `near`, most nats first, not held against chance."""
    sets = _looked_for(model, effects, near)
    every = [[screen.of(effect, joints) for effect, joints in sets] for screen in screens(model, replicates=0)]
    return _best_of([[x for x in found if isinstance(x, Screened)] for found in every])


def _looked_for(model: Model, effects: Sequence[Effect], near: Joints | None = None) -> list[tuple[Effect, Joints]]:
    taken, active = {c.key for c in model.choices}, set(model.active)
    return [
        (effect, joints)
        for effect in effects
        for joints in effect.joint_sets(model.scene)
        if (effect.key, joints) not in taken and set(joints) <= active and (near is None or set(joints) & set(near))
    ]


def screened_families(model: Model, near: Joints | None = None) -> list[Screened]:
    """All families beside a model, on the joints `near`, most nats first."""
    joints = [j for j in model.active if near is None or j in near]
    kinds = [(kind, j) for j in joints for kind in families(model.scene, j)]
    for number, c in enumerate(model.choices):
        plain = c.effect.signals and not (c.effect.smooths or c.effect.nameless or c.effect.actuator)
        if plain and len(c.joints) == 1 and c.joints[0] in joints:
            kinds += [(kind, c.joints[0]) for kind in varied(c.effect, c.joints[0], c.theta, model.beta(number))]
    every = [[x for kind, j in kinds if (x := screen.family(kind, j))] for screen in screens(model)]
    return _clearer(every)


def _clearer(every: Sequence[list[Screened]]) -> list[Screened]:
    """Each hypothesis once, against the bars of a plain and a robust screening. Its size is the larger of the two: in
    the robust one, what few blocks hold is small.
    """
    share: dict[Hashable, float] = {}
    for x in (x for found in every for x in found):
        share[x.choice.key] = max(x.share, share.get(x.choice.key, 0.0))
    sized = [[evolve(x, share=share[x.choice.key]) for x in found] for found in every]
    return _best_of(list(map(_against_bar, sized)))


def _best_of(every: Sequence[list[Screened]]) -> list[Screened]:
    """Each hypothesis once, of the plain and of the robust screening the clearer one, most nats first."""
    best: dict[object, Screened] = {}
    for found in every:
        for x in found:
            key = x.choice.key
            if key not in best or (x.clear, x.gain[0]) > (best[key].clear, best[key].gain[0]):
                best[key] = x
    return sorted(best.values(), key=lambda x: -x.gain[0])


def _against_bar(found: list[Screened], last: bool = False) -> list[Screened]:
    """With z and whether each passes the bar of all of them and has a size of interest; `last`: as they are."""
    if not found:
        return []
    roots = np.cbrt(np.maximum([x.gain for x in found], 0))
    usual = float(np.median(roots[:, 1:].mean(axis=1))), float(np.median(roots[:, 1:].std(axis=1)))
    z = _standardised(roots, usual)
    largest = z[:, 1:].max(axis=0)
    scale = largest.std() * np.sqrt(6) / np.pi
    bar = largest.mean() - np.euler_gamma * scale - scale * np.log(-np.log1p(-ALPHA / QUESTIONS))
    least = by_chance(len(found))
    known = [
        evolve(x, z=float(v), clear=bool(v > bar and x.gain[0] > least) and _counts(x))
        for x, v in zip(found, z[:, 0], strict=True)
    ]
    return known if last else [_looked_at_again(x, float(bar), least, usual) for x in known]


def by_chance(hypotheses: int) -> float:
    """Nats that one free parameter explains of noise alone in one of so many hypotheses, at the level of a question
    (Wilks 1938): replicates of which a limit erases nothing have no spread to tell it.
    """
    from scipy.special import chdtri

    return float(chdtri(1, ALPHA / QUESTIONS / max(hypotheses, 1))) / 2


def _standardised(roots: np.ndarray, usual: tuple[float, float]) -> np.ndarray:
    """Roots (n, 1 + R) of gains in standard deviations of their replicates; of hardly any spread or mean, in half of
    the usual one of the library.
    """
    mean = np.maximum(roots[:, 1:].mean(axis=1), 0.5 * usual[0])
    std = np.maximum(roots[:, 1:].std(axis=1), 0.5 * usual[1])
    return (roots - mean[:, None]) / np.maximum(std, 1e-300)[:, None]


def _counts(x: Screened) -> bool:
    """Whether a gain has a size of interest and is no noise's."""
    return x.share > SIZE and not x.noise


def _looked_at_again(x: Screened, bar: float, least: float, usual: tuple[float, float]) -> Screened:
    """A law that does not pass the bar, beside replicates of what it leaves itself at its best parameters; not where it
    could not pass it beside any.
    """
    effect = x.choice.effect
    if x.clear or not _counts(x) or effect.nameless or np.cbrt(max(x.gain[0], 0.0)) <= (usual[0] + bar * usual[1]) / 2:
        return x
    best = refined(x)
    again = x.screen.without(best).of(effect, x.choice.joints, best.theta)
    if not isinstance(again, Screened):
        return x
    z = float(_standardised(np.cbrt(np.maximum(again.gain, 0))[None], usual)[0, 0])
    return evolve(x, z=z, clear=bool(z > bar and x.gain[0] > least)) if z > x.z else x
