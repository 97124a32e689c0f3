"""The answer: which effects are named and what they cannot be distinguished from, what is left without a name, or why
nothing can be concluded.
"""

from collections.abc import Callable, Hashable, Sequence
from enum import Enum

import numpy as np
from attrs import evolve, frozen

from cosim.closure.aliases import LISTED, Rival, indistinguishable, nameless_rival, rivals
from cosim.closure.model.candidates import Candidate
from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.gram import accumulate, fit
from cosim.closure.model.model import Model, spread, with_choices
from cosim.closure.model.unnamed import dependences, faults
from cosim.closure.score.dependence import Leftover, corrected, in_place, leftovers, strongest
from cosim.closure.score.evidence import EffectEvidence, standard_errors, weigh
from cosim.closure.score.selection import Rule, Selection, polished, tangents
from cosim.effects import Alias, Effect, EffectEstimate
from cosim.effects.motion import Joints
from cosim.measured import Label

NAMED_SHARE = 0.75  # of what can be explained on a joint its named effects have to explain
MOST = 2 / 3  # of it suffices where every name keeps its evidence and coefficients beside the nameless function
STEADY = 1.5  # factor by which a coefficient may change beside it
SETTLED = 0.97  # of what can be explained: above it a nameless function that does better only refines the form
BETTER = 3.0  # standard errors by which a nameless function has to beat all named effects of a joint to withdraw them
SKEW = 0.3
"""Samples: RMS error of the sampling skew, 0, 1/2 or 1, on rigs. A wall of stiffness k [N/m] shows d [s] of it as a
damping k d."""
LOWER = 0.85  # and the largest share of their squared error that it may have


class Answer(Enum):
    """The four answers of the contract."""

    FOUND = "effect_found"
    COMPLETE = "model_complete"
    UNEXPLAINED = "unexplained"
    REFUSED = "refused"


@frozen(eq=False)
class NamedEffect:
    """A named effect as the model has it: its evidence beside the others, parameters with 95 % intervals, rivals."""

    choice: ChosenEffect
    evidence: EffectEvidence
    parameters: dict[Label, float]
    interval: dict[Label, tuple[float, float]]
    rivals: tuple[Rival, ...]
    inherent: tuple[Alias, ...] = ()  # effects that this motion cannot distinguish from it
    acting: Joints = ()  # joints (0-based) on which it acts
    rest: tuple[Leftover, ...] = ()  # what is left on them without a name
    doubt: Leftover | None = None  # where nothing is left for sure, what may be
    vague: str = ""  # what is not measured that would distinguish it from effects without a name
    earlier: bool = False  # of an earlier pass: the model was started from it

    @property
    def effect(self) -> Effect:
        """The effect."""
        return self.choice.effect

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.evidence.name

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints, 1-based."""
        return tuple(j + 1 for j in self.evidence.joints)

    @property
    def indistinguishable(self) -> tuple[Rival, ...]:
        """Rivals that explain the data as well."""
        return indistinguishable(self.effect, self.rivals)

    @property
    def alike(self) -> tuple[str, ...]:
        """All names that the data cannot distinguish from this one, closest first.

        They are effects that this motion does not distinguish, those within one standard error, and the relatives of
        an effect between motor and link that leaves a nameless rest on its joint: the details that decide between them
        are in that rest.
        """
        inherent = [alias.name for alias in self.inherent]
        close = [rival.evidence.name for rival in self.indistinguishable]
        relatives = self.effect.relatives if self.rest else ()
        return tuple(dict.fromkeys((*inherent, *close, *relatives)))

    @property
    def aliases(self) -> tuple[str, ...]:
        """The first `LISTED` of them; `unknown` is the last where an effect without a name may be behind this one."""
        return (*self.alike[: LISTED - 1], "unknown") if self.nameless else self.alike[:LISTED]

    @property
    def nameless(self) -> str:
        """What would distinguish this one from an effect without a name that may be behind it; empty where nothing
        suggests one.

        What is left on one of the joints of an effect on several says nothing about it.
        """
        leftover = next(iter(self.rest), self.doubt)
        if self.vague or leftover is None or len(self.acting) > 1:
            return self.vague
        if not leftover.sure:
            return "it leaves more than its sensors' noise (other excitation)"
        return f"what it leaves is {leftover.form} ({leftover.separated_by})"

    @property
    def separated_by(self) -> str:
        """The experiments that would distinguish it from its aliases."""
        theirs = [
            (r.evidence.name, alias)
            for r in self.indistinguishable
            for alias in r.evidence.candidate.choice.effect.aliases
        ]
        known = {name: alias.separated_by for name, alias in theirs if alias.name == self.name}
        known |= {alias.name: alias.separated_by for alias in (*self.effect.aliases, *self.inherent)}
        if self.nameless:
            known["unknown"] = self.nameless
        texts = [f"{name}: {known.get(name) or 'another excitation'}" for name in self.aliases]
        return "; ".join(texts)


@frozen(eq=False)
class ClosureVerdict:
    """The answer with its findings.

    model: with the named effects; best: also with the smooth correction where there is one. Both None where refused.
    """

    answer: Answer
    findings: tuple[NamedEffect, ...] = ()
    withdrawn: tuple[tuple[NamedEffect, str], ...] = ()
    leftovers: tuple[Leftover, ...] = ()
    model: Model | None = None
    best: Model | None = None
    warnings: tuple[str, ...] = ()

    def models(self) -> tuple[Model, Model]:
        """`model` and `best` of a verdict that is no refusal."""
        assert self.model is not None and self.best is not None, "only a refusal has no models"
        return self.model, self.best


def judge(
    selection: Selection,
    effects: Sequence[Effect],
    rule: Rule,
    progress: Callable[[str], None] = lambda text: None,
) -> ClosureVerdict:
    """The findings with their aliases, what the residual still depends on, and names that are withdrawn because a
    nameless function does clearly better.
    """
    model = selection.model
    withdrawn: tuple[tuple[NamedEffect, str], ...] = ()
    former: tuple[tuple[ChosenEffect, np.ndarray], ...] = ()
    given = {
        c.key for k, c in enumerate(selection.before.choices) if selection.before.unphysical(k)
    }  # by an earlier pass, on data that showed it
    earlier = {choice.key for choice in selection.before.choices}

    def found(number: int) -> NamedEffect:
        return evolve(
            finding(model, number, effects, rule, selection.trials), earlier=model.choices[number].key in earlier
        )

    progress("looking for what is left in the residual")
    left, doubts = leftovers(model, rule)
    reasons = _unphysical(model, given) | _withdrawals(model, left, rule)
    progress("comparing each effect with its rivals")
    while reasons:
        withdrawn += tuple((found(k), reasons[k]) for k in sorted(reasons))
        former += tuple((c, model.beta(k)) for k, c in enumerate(model.choices) if k in reasons)
        choices = tuple(c for k, c in enumerate(model.choices) if k not in reasons)
        model = (
            polished(with_choices(selection.before, choices))
            if choices != selection.before.choices
            else selection.before
        )
        reasons = _unphysical(model, given)
    if withdrawn:
        again, doubts = leftovers(model, rule, former)
        left = again or left
    kept = tuple(map(found, range(len(model.choices))))
    kept = tuple(
        evolve(f, rest=tuple(x for x in left if x.joint in f.acting), doubt=doubts.get(f.acting[0])) for f in kept
    )
    return _answer(kept, withdrawn, left, model)


def _unphysical(model: Model, given: set[tuple[Hashable, Joints]]) -> dict[int, str]:
    """Choices (by number) whose estimate is not physical beside the others, since refits move estimates; those that
    were `given` are excepted.
    """
    reasons = {k: model.unphysical(k) for k, c in enumerate(model.choices) if c.key not in given}
    return {k: reason for k, reason in reasons.items() if reason}


def _answer(
    kept: tuple[NamedEffect, ...],
    withdrawn: tuple[tuple[NamedEffect, str], ...],
    left: tuple[Leftover, ...],
    model: Model,
) -> ClosureVerdict:
    best = corrected(model, left) if left else model
    ordered = tuple(sorted(kept, key=lambda f: -f.evidence.gain_fit * f.evidence.size))
    if any(not f.earlier for f in ordered):
        answer = Answer.FOUND
    else:
        answer = Answer.UNEXPLAINED if left or withdrawn else Answer.COMPLETE
    return ClosureVerdict(answer, ordered, withdrawn, left, model, best)


def _withdrawals(model: Model, left: tuple[Leftover, ...], rule: Rule) -> dict[int, str]:
    """Choices (by number) whose name does not hold, and why."""
    out = {}
    acting = [model.acting(k) for k in range(len(model.choices))]
    for joints in dict.fromkeys(acting):
        numbers = [k for k, on in enumerate(acting) if on == joints]
        base = with_choices(model, tuple(c for k, c in enumerate(model.choices) if k not in numbers))
        here = strongest(leftover for leftover in left if leftover.joint in joints)
        reason = _too_much_left(base, model, list(joints), tuple(here.values()), numbers, rule)
        reason = reason or (_unnamed_better(base, model, joints[0]) if len(joints) == 1 else "")
        if reason:
            out |= dict.fromkeys(numbers, reason)
    return out


def _too_much_left(
    base: Model, model: Model, joints: list[int], here: tuple[Leftover, ...], numbers: list[int], rule: Rule
) -> str:
    """Why the names do not hold where nameless functions, one a joint, explain a good part of what they leave; empty
    where they hold. An effect on several joints, on which these may have nothing to do with it, only has to keep its
    evidence beside them.
    """
    if not here:
        return ""
    nameless = tuple(leftover.choice for leftover in here)
    without, names, both = (
        float(m.joint_error()[0][:, joints].sum())
        for m in (base, model, with_choices(model, (*model.choices, *nameless)))
    )
    named, possible = without - names, max(without - both, 1e-300)
    if named >= NAMED_SHARE * possible:
        return ""
    if (len(joints) > 1 or named >= MOST * possible) and all(_stands_beside(model, k, nameless, rule) for k in numbers):
        return ""
    return (
        f"it explains {100 * named / possible:.0f} % of what can be explained "
        f"on joint {', '.join(str(j + 1) for j in joints)}; "
        f"{' and '.join(leftover.form for leftover in here)} explains the rest without a name"
    )


def _stands_beside(model: Model, number: int, nameless: tuple[ChosenEffect, ...], rule: Rule) -> bool:
    """Whether a name keeps its evidence and its coefficients beside the nameless functions."""
    choice = model.choices[number]
    others = tuple(c for k, c in enumerate(model.choices) if k != number)
    rest = with_choices(model, (*others, *nameless))
    beside = weigh(rest, Candidate(choice, 0.0, np.zeros(0), 1), 1)
    alone, now = (choice.effect.amount(beta, choice.theta) for beta in (model.beta(number), beside.beta))
    strong = np.abs(alone) > 0.3 * np.abs(alone).max()
    ratio = now[strong] / alone[strong]
    return not rule.refusal(beside) and bool((ratio > 1 / STEADY).all() and (ratio < STEADY).all())


def _unnamed_better(base: Model, model: Model, joint: int) -> str:
    """Why one nameless function replaces all names of the joint, being clearly better; empty where none is."""
    error, without = model.unseen(joint), base.unseen(joint).sum()
    nameless = in_place(base, joint, (*dependences(base.scene), *faults(base.scene, joint)))
    rival = min((e.model for e in nameless), key=lambda m: m.unseen(joint).sum(), default=None)
    if rival is None:
        return ""
    other = rival.unseen(joint)
    if without - error.sum() > SETTLED * (without - other.sum()) or other.sum() > LOWER * error.sum():
        return ""
    t = standard_errors(error - other)
    return f"{rival.choices[-1].effect.title} does clearly better (t = {t:.1f})" if t > BETTER else ""


def finding(model: Model, number: int, effects: Sequence[Effect], rule: Rule, trials: int) -> NamedEffect:
    """Evidence, parameters, intervals and rivals of one chosen effect."""
    evidence, found = rivals(model, number, effects, rule, trials)
    values, interval = intervals(model, number)
    choice, other = model.choices[number], nameless_rival(model, number)
    vague = [choice.effect.vague(model.scene, choice.joints, choice.theta)]
    if other:
        vague.insert(0, f"{other.words} explains as much ({other.separated_by})")
    inherent = choice.effect.inherent(model.estimate(number))
    return NamedEffect(
        choice, evidence, values, interval, found, inherent, model.acting(number), vague=", ".join(filter(None, vague))
    )


def intervals(model: Model, number: int) -> tuple[dict[Label, float], dict[Label, tuple[float, float]]]:
    """FMU parameters of an effect with 95 % intervals: jackknife by blocks, the model linearised in nonlinear ones."""
    choice, part = model.choices[number], model.coefficients(number)
    beta, cov, theta_std = model.fit.beta[part], model.fit.cov[part, part], np.zeros(len(choice.theta))
    free = () if choice.effect.late else choice.effect.continuous(choice.theta)  # a late one's coefficient has the rest
    if free or choice.effect.sharp:
        beta_cov = _with_tangents(model, number, free)
        k = len(beta)
        cov = beta_cov[:k, :k]
        for place, index in enumerate(free):
            theta_std[index] = np.sqrt(max(beta_cov[k + place, k + place], 0.0))
    std = np.sqrt(np.maximum(np.diag(cov), 0.0))
    t = _quantile(model)
    std = np.hypot(std, choice.effect.form * (np.linalg.norm(beta) if choice.effect.amplitude else np.abs(beta)))
    if not choice.effect.late:
        std = np.hypot(std, _by_skew(model)[part])
    for index in free:
        change = choice.effect.moved(choice.theta, index, choice.effect.form)[index] - choice.theta[index]
        theta_std[index] = np.hypot(theta_std[index], change)

    def read(b: np.ndarray, th: Sequence[float]) -> dict[Label, float]:
        return choice.effect.parameters(EffectEstimate(b, std, tuple(th), choice.joints, model.scene))

    values = read(beta, choice.theta)
    low, high = dict(values), dict(values)
    for k in range(len(beta) + len(choice.theta)):
        for sign in (-1, 1):
            b, th = beta.copy(), list(choice.theta)
            if k < len(beta):
                b[k] += sign * t * std[k]
            else:
                th[k - len(beta)] += sign * t * theta_std[k - len(beta)]
            for name, value in read(b, th).items():
                low[name], high[name] = min(low[name], value), max(high[name], value)
    slack = choice.effect.slack * model.setting.motion.sample
    return values, {name: (low[name] - slack, high[name]) for name in values}


def _by_skew(model: Model) -> np.ndarray:
    """Standard deviation (p,) of the coefficients because of that of the sampling skew, which is one of three values;
    lag and delay contain it.
    """
    step = SKEW * model.setting.motion.sample
    return np.abs(evolve(model, skew=model.skew + step).fit.beta - model.fit.beta)


def _quantile(model: Model) -> float:
    from scipy.stats import t

    return float(t.ppf(0.975, max(model.setting.rows.train_blocks - 1, 1)))


def _with_tangents(model: Model, number: int, free: tuple[int, ...]) -> np.ndarray:
    """Jackknife covariance of (coefficients, free nonlinear parameters), the model linearised in the latter and in the
    width of the friction law of the effect's joint.
    """
    choice, part, rows = model.choices[number], model.coefficients(number), model.setting.rows
    extra = [column / (change or 1e12) for column, change in tangents(model, number, free)]  # fixed: zero
    count = len(extra)
    extra += [_width_tangent(model, j) for j in choice.joints if choice.effect.sharp and model.laws[j].width > 0]
    design = np.concatenate((model.design, *extra), axis=2)
    normal = accumulate(design, model.y, rows.block, rows.blocks, rows.train_blocks)
    cov = fit(evolve(normal, precision=np.pad(model.precision, (0, len(extra))))).cov
    places = [*range(part.start, part.stop), *range(model.design.shape[2], model.design.shape[2] + count)]
    return cov[np.ix_(places, places)]


def _width_tangent(model: Model, joint: int) -> np.ndarray:
    """Column (J, m, 1) of a relative change of the width of a joint's friction law."""
    law = model.laws[joint]
    ahead, behind = (model.setting.sign(joint, evolve(law, width=law.width * f)) for f in (1.03, 1 / 1.03))
    level = model.friction_levels[1][joint]
    return spread({joint: (level * (ahead - behind) / (2 * np.log(1.03)))[:, None]}, model.setting) * model.scale
