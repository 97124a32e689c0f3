"""What the data cannot distinguish from a chosen effect: other candidates in its place whose unseen error lies within
one standard error.
"""

from collections.abc import Sequence

import numpy as np
from attrs import evolve, frozen

from cosim.closure.model.candidates import Candidate, screen
from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.model import Model, with_choices
from cosim.closure.model.unnamed import Dependence, faults, other_laws
from cosim.closure.score.dependence import in_place
from cosim.closure.score.evidence import EffectEvidence, relative_error, student, weigh
from cosim.closure.score.selection import Rule, polished
from cosim.effects import Effect

LISTED = 2  # alternatives named beside an effect; more stand in its evidence
NEAR = 1.0  # standard errors
# share of the chosen effect's gain from which on a rival counts as indistinguishable: the rest is form, not evidence
REACHED = 0.92


@frozen(eq=False)
class Rival:
    """Another effect in the place of a chosen one: the fit with it, how much worse (in standard errors of the blocks),
    and the share of the chosen effect's gain that it reaches.
    """

    evidence: EffectEvidence
    worse: float
    reached: float


def rivals(
    model: Model, number: int, effects: Sequence[Effect], rule: Rule, trials: int
) -> tuple[EffectEvidence, tuple[Rival, ...]]:
    """Evidence for choice `number` beside the others, and its rivals, closest first (also distinguishable ones)."""
    choice = model.choices[number]
    rest = with_choices(model, tuple(c for k, c in enumerate(model.choices) if k != number), passes=1)
    touched = set(model.columns[number])
    candidates = [c for c in screen(rest, effects, touched) if not c.untestable and not c.reason]
    own = next((c for c in candidates if c.choice.key == choice.key), None)
    chosen = _replaced(choice, rest, trials, own)
    least = 0.4 * max(own.gain if own else 0.0, rule.gain)
    out = []
    for candidate in candidates:
        key = candidate.choice.key
        if (
            key[0] == choice.effect.name
            or not touched & set(key[1])
            or candidate.gain < least * _share(rest, choice, key[1])
        ):
            continue
        other = _replaced(candidate.choice, rest, trials, candidate)
        if not rule.refusal(other):
            if choice.effect.related(candidate.choice.effect):
                other = evolve(
                    other, model=polished(other.model, chosen.model.weight)
                )  # the chosen one has a friction law of its own as well
            out.append(Rival(other, _worse(chosen, other), _reached(rest, chosen, other)))
    return chosen, tuple(sorted(out, key=lambda rival: rival.worse))


def nameless_rival(model: Model, number: int) -> Dependence | None:
    """The best nameless function that does as well as choice `number` in its place; None if none does.

    It is another law of the effect's signal, or a fault of drive or encoder, which may also take the place of all
    choices of its joint.
    """
    (joint, *further), own = model.acting(number), model.choices[number]
    if further:
        return None
    alone = with_choices(model, tuple(c for c in model.choices if c is not own))
    bare = with_choices(model, tuple(c for c in alone.choices if c.joints != own.joints))
    places = (alone, bare) if len(bare.choices) < len(alone.choices) else (alone,)
    found = [e.model for rest in places for e in in_place(rest, joint, faults(rest.scene, joint))]
    laws = in_place(alone, joint, other_laws(alone.scene, own.effect, joint))
    found += [polished(e.model, model.weight) for e in laws]  # as the named one has a friction law of its own
    error = _errors(model, joint)
    best, least = min(((m, _errors(m, joint)) for m in found), key=lambda pair: pair[1].sum(), default=(None, error))
    if best is None or student(least - error) > NEAR:
        return None
    effect = best.choices[-1].effect
    assert isinstance(effect, Dependence), "faults and other laws have no name"
    return effect


def _errors(model: Model, joint: int) -> np.ndarray:
    """Squared error (B,) of every block of a joint, each with a fit that has not seen it."""
    return np.concatenate([part[:, joint] for part in relative_error(model)])


def _share(model: Model, choice: ChosenEffect, joints: tuple[int, ...]) -> float:
    """How much of the squared error of `joints` lies on the joints of the choice: gains are shares of different
    errors.
    """
    error = model.joint_error()[0].sum(axis=0)
    own, other = error[list(choice.joints)].sum(), error[list(joints)].sum()
    return float(min(own / max(other, 1e-300), 1.0))


def _replaced(choice: ChosenEffect, rest: Model, trials: int, candidate: Candidate | None) -> EffectEvidence:
    return weigh(rest, candidate or Candidate(choice, 0.0, np.zeros(0), 1), trials, passes=2)


def _worse(chosen: EffectEvidence, other: EffectEvidence) -> float:
    """Mean difference of squared error per block over its standard error, all blocks, each with a fit that has not seen
    it.
    """
    return student(other.model.fit.sse.sum(axis=1) - chosen.model.fit.sse.sum(axis=1))


def _reached(rest: Model, chosen: EffectEvidence, other: EffectEvidence) -> float:
    """Gain of the other over gain of the chosen, all fitted blocks left out in turn."""
    without, own, rival = (float(m.joint_error()[0].sum()) for m in (rest, chosen.model, other.model))
    return (without - rival) / max(without - own, 1e-300)


def indistinguishable(chosen: Effect, found: Sequence[Rival]) -> tuple[Rival, ...]:
    """The rivals within one standard error or of nearly the same gain, one of a name."""
    reach = {alias.name: alias.reach for alias in chosen.aliases}
    close = [r for r in found if r.worse <= NEAR or r.reached >= reach.get(r.evidence.name, REACHED)]
    first: dict[str, Rival] = {}
    for rival in close:
        first.setdefault(rival.evidence.name, rival)
    return tuple(first.values())
