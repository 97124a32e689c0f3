"""What the data cannot tell from a chosen effect: other candidates in its place whose unseen error lies within one standard error."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from cosim.closure.candidates import screen
from cosim.closure.evidence import Evidence, weigh
from cosim.closure.model import Model, with_choices
from cosim.closure.selection import Rule
from cosim.effects import Effect

LISTED = 2  # alternatives named beside an effect; more are told in its evidence
NEAR = 1.0  # standard errors


@frozen(eq=False)
class Rival:
    """Another effect in the place of a chosen one: how much worse (in standard errors of the blocks), and the fit with it."""

    evidence: Evidence
    worse: float


def rivals(model: Model, number: int, effects: Sequence[Effect], rule: Rule, trials: int) -> tuple[Evidence, tuple[Rival, ...]]:
    """Evidence for choice `number` beside the others, and its rivals, closest first (also those that the data do tell apart)."""
    choice = model.choices[number]
    rest = with_choices(model, tuple(c for k, c in enumerate(model.choices) if k != number), passes=1)
    candidates = [c for c in screen(rest, effects) if not c.untestable and not c.reason]
    own = next((c for c in candidates if c.choice.key == choice.key), None)
    chosen = _replaced(model, number, choice, rest, trials, own)
    touched = set(model.columns[number])
    least = 0.4 * max(own.gain if own else 0.0, rule.gain)
    out = []
    for candidate in candidates:
        key = candidate.choice.key
        if key[0] == choice.effect.name or not touched & set(key[1]) or candidate.gain < least * _share(rest, choice, key[1]):
            continue
        other = _replaced(model, number, candidate.choice, rest, trials, candidate)
        if not rule.refusal(other):
            out.append(Rival(other, _worse(chosen, other)))
    return chosen, tuple(sorted(out, key=lambda rival: rival.worse))


def _share(model: Model, choice, joints: tuple[int, ...]) -> float:
    """How much of the squared error of `joints` lies on the joints of the choice: gains are shares of different errors."""
    error = model.joint_error()[0].sum(axis=0)
    own, other = error[list(choice.joints)].sum(), error[list(joints)].sum()
    return float(min(own / max(other, 1e-300), 1.0))


def _replaced(model: Model, number: int, choice, rest: Model, trials: int, candidate) -> Evidence:
    from cosim.closure.candidates import Candidate

    return weigh(rest, candidate or Candidate(choice, 0.0, np.zeros(0), 1), trials, passes=2)


def _worse(chosen: Evidence, other: Evidence) -> float:
    """Mean difference of squared error per block over its standard error, all blocks, each with a fit that has not seen it."""
    difference = other.model.fit.sse.sum(axis=1) - chosen.model.fit.sse.sum(axis=1)
    error = difference.std(ddof=1) / np.sqrt(len(difference))
    return float(difference.mean() / max(error, 1e-300))


def indistinguishable(found: Sequence[Rival]) -> tuple[Rival, ...]:
    """The rivals within one standard error, one of each name."""
    names, out = set(), []
    for rival in found:
        if rival.worse <= NEAR and rival.evidence.name not in names:
            names.add(rival.evidence.name)
            out.append(rival)
    return tuple(out)
