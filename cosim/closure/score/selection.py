"""Forward selection of effects with joint refit, under a rule whose rate of false claims is measured
(tests/support/rig/study.py nulls).
"""

from collections.abc import Callable, Hashable, Sequence

import numpy as np
from attrs import evolve, frozen

from cosim.closure.model.candidates import BETWEEN, Candidate, screen, shifted
from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.model import (
    Model,
    filtered,
    settled,
    spread,
    train_error,
    with_choices,
)
from cosim.closure.score.evidence import EffectEvidence, relative_error, weigh
from cosim.effects import Effect
from cosim.effects.motion import Joints, Theta

FORM_ERROR = 0.03  # of a strong effect's share of the torque: the error of its idealised form
NEAR = 0.4  # share of the best candidate's gain above which another is compared with a friction law of its own
PLAIN = 0.97  # of the error: a step to unphysical values has to leave less, so that the data clearly ask for it
WORTH = 0.7  # of the squared error of unseen fitted blocks that a form with one parameter more may leave
DESCENTS, DESCENDED = 8, 1e-4  # Gauss-Newton steps at most; share of the error that the last one removes
TANGENT = 0.005  # step of the central differences in nonlinear parameters: a fraction of the narrowest resonance
CLEARLY = 1.1  # times the gain of an effect on the whole arm, for effects of single joints to be preferred


@frozen
class Rule:
    """What a claim needs.

    p: jackknife F on fitted blocks, times everything tried; gain: share of its joints' squared error removed on blocks
    not seen; t_fit, t_held: of paired differences per block; size: share of the torque's RMS that only this effect
    explains; sure: t of fitted and held-out blocks that replaces p where few blocks show an effect; most: effects to
    add; shortlist: candidates to weigh in a round.
    """

    p: float = 1e-3
    gain: float = 0.04
    t_fit: float = 2.0
    t_held: float = 2.0
    size: float = 0.004
    sure: float = 5.0
    most: int = 6
    shortlist: int = 40

    def refusal(self, evidence: EffectEvidence) -> str:
        """Why the evidence does not support a claim; empty where it does."""
        if evidence.reason:
            return evidence.reason
        if evidence.candidate.choice.effect.of_time and evidence.gain_held > 0:
            evidence = evolve(evidence, gain_held=evidence.gain_fit, t_held=evidence.t_fit)
        gain = max(self.gain, evidence.candidate.choice.effect.least)
        checks = (
            (
                evidence.p > self.p and not self.confirmed(evidence),
                f"p = {evidence.p:.1g} after counting all that was tried",
            ),
            (
                evidence.gain_fit < gain,
                f"removes {100 * evidence.gain_fit:.1f} % of the squared error of unseen fitted blocks",
            ),
            (evidence.t_fit < self.t_fit, f"fitted blocks disagree (t = {evidence.t_fit:.1f})"),
            (evidence.gain_held < gain, f"removes {100 * evidence.gain_held:.1f} % of the held-out squared error"),
            (evidence.t_held < self.t_held, f"held-out blocks disagree (t = {evidence.t_held:.1f})"),
            (
                evidence.size < self.size,
                f"explains {100 * evidence.size:.2f} % of the torque: below what processing alone can make",
            ),
        )
        return next((text for failed, text in checks if failed), "")

    def confirmed(self, evidence: EffectEvidence) -> bool:
        """Whether held-out blocks, which took no part in the search, support the claim where an effect shows in few
        fitted blocks.

        A short recording has too few of them for five standard errors (all of 20 blocks better: Wilcoxon's z is 3.9);
        three are enough where the effect explains most of what there is.
        """
        gain = min(evidence.gain_held, evidence.gain_fit)
        return evidence.t_held >= self.sure and (
            (evidence.t_fit >= self.sure and gain >= 0.2) or (evidence.t_fit >= 3 and gain >= 0.5)
        )


@frozen(eq=False)
class SelectionRound:
    """One round of the search: the candidates that were weighed, best first, and the one taken (None: none)."""

    weighed: tuple[EffectEvidence, ...]
    refusals: tuple[str, ...]
    taken: EffectEvidence | None

    @property
    def decisions(self) -> tuple[tuple[EffectEvidence, str], ...]:
        """Each candidate and what was decided."""
        pairs = zip(self.weighed, self.refusals, strict=True)
        return tuple(
            (e, "accepted" if e is self.taken else why or "another candidate explains more") for e, why in pairs
        )


@frozen(eq=False)
class Selection:
    """The rounds, the complete model, the model with all chosen effects, what could not be tested and why."""

    before: Model
    model: Model
    steps: tuple[SelectionRound, ...]
    untestable: tuple[Candidate, ...]
    trials: int


def select(
    before: Model,
    effects: Sequence[Effect],
    rule: Rule,
    progress: Callable[[str], None] = lambda text: None,
) -> Selection:
    """Add the best effect that the rule accepts, refit everything, drop what is no longer needed, until nothing is
    accepted.
    """
    model, trials = before, 0
    steps: list[SelectionRound] = []
    untestable: tuple[Candidate, ...] = ()
    seen: set[frozenset[tuple[Hashable, Joints]]] = set()
    shares: dict[int, float] = {}
    given = {choice.key for choice in before.choices}
    while len(model.choices) - len(given) < rule.most:
        candidates = screen(model, effects)
        trials = max(trials, sum(c.tried for c in candidates))
        untestable = untestable or tuple(c for c in candidates if c.untestable)
        step = _round(model, candidates, rule, trials, shares)
        steps.append(step)
        if step.taken is None:
            break
        for j in step.taken.joints:
            shares[j] = max(shares.get(j, 0.0), step.taken.size)
        progress(f"accepted {step.taken.name} on joint(s) {', '.join(str(j + 1) for j in step.taken.joints)}")
        model = _pruned(polished(step.taken.model), rule, trials, given)
        state = frozenset(c.key for c in model.choices)
        if state in seen:
            break
        seen.add(state)
    return Selection(before, model, tuple(steps), untestable, trials)


def _round(
    model: Model, candidates: Sequence[Candidate], rule: Rule, trials: int, shares: dict[int, float]
) -> SelectionRound:
    likely = [c for c in candidates if not c.untestable and c.gain > 0.5 * rule.gain][: rule.shortlist]
    weighed = sorted((weigh(model, c, trials) for c in likely), key=EffectEvidence.error)
    refusals = tuple(rule.refusal(e) or _beside(model, e, shares) for e in weighed)
    accepted = [e for e, why in zip(weighed, refusals, strict=True) if not why]
    taken = next((e for e in accepted if not _made_of_single_ones(model, e, accepted)), None)
    return SelectionRound(tuple(weighed), refusals, taken and _settled_best(taken, weighed, rule, trials))


def _settled_best(best: EffectEvidence, weighed: Sequence[EffectEvidence], rule: Rule, trials: int) -> EffectEvidence:
    """The best candidate, or an alias of it that does better once each has a friction law of its own."""
    effect = best.candidate.choice.effect
    near = [
        e
        for e in weighed
        if e is best
        or (
            e.joints == best.joints
            and not e.reason
            and e.gain_fit > NEAR * best.gain_fit
            and effect.related(e.candidate.choice.effect)
        )
    ]
    if len(near) < 2:
        return best
    settled = {id(e): polished(e.model, best.model.weight) for e in near}
    winner = min(near, key=lambda e: float(relative_error(settled[id(e)])[0].sum()))
    if winner is best or rule.refusal(alone(settled[id(winner)], len(winner.model.choices) - 1, trials)):
        return best
    return winner


def _beside(model: Model, evidence: EffectEvidence, shares: dict[int, float]) -> str:
    """Why the evidence does not support a claim beside the effects accepted before: it is smaller than their error of
    form, or an alias of one.
    """
    strongest = max((shares.get(j, 0.0) for j in evidence.joints), default=0.0)
    if evidence.size < FORM_ERROR * strongest:
        return (
            f"explains {100 * evidence.size:.2f} % of the torque: the form "
            f"of the stronger effect before it can make that"
        )
    own = {alias.name for alias in evidence.candidate.choice.effect.aliases if alias.reach < 0.5}
    for choice in model.choices:
        theirs = {alias.name for alias in choice.effect.aliases if alias.reach < 0.5}
        if set(choice.joints) & set(evidence.joints) and (choice.effect.name in own or evidence.name in theirs):
            return f"is hardly told from {choice.effect.name}, which explains more"
    return ""


def _made_of_single_ones(model: Model, evidence: EffectEvidence, accepted: Sequence[EffectEvidence]) -> bool:
    """Whether an effect on the whole arm does clearly worse than the best effect of each joint by itself."""
    if len(evidence.joints) == 1:
        return False
    t = model.setting.rows.train_blocks
    best: dict[int, float] = {}
    for other in accepted:
        if len(other.joints) == 1:
            best.setdefault(other.joints[0], float((model.fit.sse[:t] - other.model.fit.sse[:t]).sum()))
    gain = float((model.fit.sse[:t] - evidence.model.fit.sse[:t]).sum())
    return sum(best.values()) > CLEARLY * gain


def polished(model: Model, weight: np.ndarray | None = None) -> Model:
    """The model with friction laws, weights and nonlinear parameters fitted again around its effects, in richer forms
    where these are worth it; at last with a weight (J,) if given.
    """
    model = _polished(model)
    for number, choice in enumerate(model.choices):
        theta, (joint, *_) = choice.effect.richer(choice.theta), choice.joints
        if theta is not None:
            richer = (*model.choices[:number], evolve(choice, theta=theta), *model.choices[number + 1 :])
            trial = _polished(with_choices(model, richer))
            if trial.unseen(joint).sum() < WORTH * model.unseen(joint).sum():
                model = trial
    if weight is not None:
        model = evolve(model, weight=weight)
    return with_choices(model, model.choices, passes=2)


def _polished(model: Model) -> Model:
    choices = model.choices
    for _ in range(2):
        model = with_choices(settled(with_choices(model, choices)), choices, passes=2)
        better = tuple(_refined(model, k) for k in range(len(choices)))
        if better == choices:
            break
        choices = better
    model = with_choices(model, choices, passes=2)
    for number, choice in enumerate(choices):
        free = choice.effect.continuous(choice.theta)
        if free and len(choice.joints) == 1 and choice.effect.sharp:
            model = _together(model, number)
        elif len(free) > 1:
            model = _descended(model, number)
    return model


def _descended(model: Model, number: int) -> Model:
    """The model with an effect's nonlinear parameters moved all at once (Gauss-Newton): those of a wall turn and shift
    it together, those of a link (resonance, damping, share) its phase.
    """
    choice = model.choices[number]
    free, error = choice.effect.continuous(choice.theta), train_error(model)
    for _ in range(DESCENTS):
        steps = np.clip(_newton_steps(model, number, free), -BETWEEN, BETWEEN)
        for share in (1.0, 0.5, 0.25):
            moved = evolve(choice, theta=shifted(choice, free, share * steps))
            trial = with_choices(
                model, tuple(moved if k == number else c for k, c in enumerate(model.choices)), passes=0
            )
            if train_error(trial) < error:
                break
        else:
            return model
        done = train_error(trial) > (1 - DESCENDED) * error
        model, choice, error = trial, moved, train_error(trial)
        if done:
            return model
    return model


def _newton_steps(model: Model, number: int, free: tuple[int, ...]) -> np.ndarray:
    """Best steps of the free nonlinear parameters for the model linearised in them."""
    columns = np.concatenate([column for column, _ in tangents(model, number, free)], axis=2)
    train = ~model.setting.rows.test
    x = np.concatenate((model.design, columns), axis=2)[:, train].reshape(-1, model.design.shape[2] + len(free))
    size = np.linalg.norm(x, axis=0)
    scale = np.where(size > 1e-9 * size.max(), 1 / np.maximum(size, 1e-300), 0.0)
    return (np.linalg.lstsq(x * scale, model.y[:, train].ravel(), rcond=1e-8)[0] * scale)[-len(free) :]


def tangents(model: Model, number: int, free: tuple[int, ...]) -> list[tuple[np.ndarray, float]]:
    """For each free nonlinear parameter of an effect the weighted column (J, m, 1) of a step of it, and the change of
    its value by a step.
    """
    choice, scene, beta, out = model.choices[number], model.seen or model.scene, model.beta(number), []
    for index in free:
        ahead, behind = (choice.effect.moved(choice.theta, index, s) for s in (TANGENT, -TANGENT))
        a, b = (
            filtered(model.setting, choice.effect, choice.effect.columns(scene, choice.joints, th))
            for th in (ahead, behind)
        )
        slope = {j: ((a[j] - b[j]) @ beta / (2 * TANGENT))[:, None] for j in a}
        out.append((spread(slope, model.setting) * model.scale, (ahead[index] - behind[index]) / (2 * TANGENT)))
    return out


def _together(model: Model, number: int) -> Model:
    """The model with an effect's nonlinear parameters and the width of its joint's friction law moved together (Nelder,
    Mead 1965).

    Both shape friction at low speed; one after the other they get stuck in the valley between them.
    """
    from scipy.optimize import minimize

    choice, joint = model.choices[number], model.choices[number].joints[0]
    free = choice.effect.continuous(choice.theta)

    def moved(x: np.ndarray) -> Model:
        theta = shifted(choice, free, x)
        law = evolve(model.laws[joint], width=model.laws[joint].width * float(np.exp(np.clip(x[-1], -2, 2))))
        changed = evolve(model, laws=tuple(law if j == joint else old for j, old in enumerate(model.laws)))
        return with_choices(
            changed, tuple(evolve(c, theta=theta) if k == number else c for k, c in enumerate(model.choices)), passes=0
        )

    start = np.zeros(len(free) + 1)
    simplex = np.vstack([start, *(0.15 * row for row in np.eye(len(start)))])
    found = minimize(
        lambda x: train_error(moved(x)),
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": 45, "xatol": 3e-3, "fatol": 1e-6 * train_error(model)},
    )
    return moved(found.x)


def _refined(model: Model, number: int) -> ChosenEffect:
    """The choice with its continuous nonlinear parameters moved to the least error of the fitted rows, within what is
    physical unless the error is clearly larger there.
    """
    choice = model.choices[number]
    free = choice.effect.continuous(choice.theta)
    for index in free:
        choice = _line_search(model, number, choice, index)
    return choice


def _line_search(model: Model, number: int, choice: ChosenEffect, index: int) -> ChosenEffect:
    def tried(theta: Theta) -> Model:
        return with_choices(
            model, tuple(evolve(c, theta=theta) if k == number else c for k, c in enumerate(model.choices)), passes=0
        )

    def error(trial: Model) -> float:
        return float(relative_error(trial)[0].sum())

    start = tried(choice.theta)
    best, value, held = choice.theta, error(start), not start.unphysical(number, model.scene)
    for step in (0.25, 0.12, 0.06, 0.03, 0.015):
        for sign in (1, -1):
            for _ in range(4):
                theta = choice.effect.moved(best, index, sign * step)
                trial = tried(theta)
                if (new := error(trial)) >= value or (
                    held and new > PLAIN * value and trial.unphysical(number, model.scene)
                ):
                    break
                best, value = theta, new
    return evolve(choice, theta=best)


def _pruned(model: Model, rule: Rule, trials: int, given: set[tuple[Hashable, Joints]]) -> Model:
    """The model without effects that the others have made superfluous, except those that were `given`."""
    while len(model.choices) > 1:
        weak = [
            k for k, c in enumerate(model.choices[:-1]) if c.key not in given and rule.refusal(alone(model, k, trials))
        ]
        if not weak:
            return model
        left = tuple(c for k, c in enumerate(model.choices) if k != weak[0])
        model = polished(with_choices(model, left))
    return model


def alone(model: Model, number: int, trials: int) -> EffectEvidence:
    """Evidence for one of the model's effects beside all others."""
    choice = model.choices[number]
    rest = with_choices(model, tuple(c for k, c in enumerate(model.choices) if k != number))
    return weigh(rest, Candidate(choice, 0.0, np.zeros(0), 1), trials)
