"""The answer: which effects are named, with what they cannot be told from; what is left without a name; or why nothing may be said."""

from collections.abc import Sequence
from enum import Enum

import numpy as np
from attrs import field, frozen

from cosim.closure.aliases import LISTED, Rival, indistinguishable, rivals
from cosim.closure.dependence import Leftover, corrected, leftovers
from cosim.closure.evidence import Evidence
from cosim.closure.model import Model, with_choices
from cosim.closure.selection import Progress, Rule, Selection, polished
from cosim.effects import Effect, Estimate

NAMED_SHARE = 0.9  # of what can be explained at all has to be explained by the named effects of a joint
SETTLED = 0.97  # of what can be explained: from here on a nameless function that does better only refines the form
BETTER = 3.0  # standard errors by which a nameless function has to beat all named effects of a joint to withdraw them
LOWER = 0.85  # and the share of their squared error that it may have at most


class Answer(Enum):
    """The four answers of the contract."""

    FOUND = "effect_found"
    COMPLETE = "model_complete"
    UNEXPLAINED = "unexplained"
    REFUSED = "refused"


@frozen(eq=False)
class Finding:
    """A named effect: its evidence beside the others, parameters with 95 % intervals, rivals."""

    evidence: Evidence
    parameters: dict[str, float]
    interval: dict[str, tuple[float, float]]
    rivals: tuple[Rival, ...]

    @property
    def effect(self) -> Effect:
        return self.evidence.candidate.choice.effect

    @property
    def name(self) -> str:
        return self.evidence.name

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints, 1-based."""
        return tuple(j + 1 for j in self.evidence.joints)

    @property
    def indistinguishable(self) -> tuple[Rival, ...]:
        return indistinguishable(self.effect, self.rivals)

    @property
    def aliases(self) -> tuple[str, ...]:
        """Names within one standard error, closest first, at most `LISTED`."""
        return tuple(rival.evidence.name for rival in self.indistinguishable)[:LISTED]

    @property
    def separated_by(self) -> str:
        known = {alias.name: alias.separated_by for alias in self.effect.aliases}
        for rival in self.indistinguishable:
            known |= {self.name: a.separated_by for a in rival.evidence.candidate.choice.effect.aliases if a.name == self.name}
        texts = [f"{name}: {known.get(name) or known.get(self.name) or 'another excitation'}" for name in self.aliases]
        return "; ".join(texts)


@frozen(eq=False)
class Verdict:
    """The answer with its findings; `model` holds the named effects, `best` also the smooth correction where there is one."""

    answer: Answer
    findings: tuple[Finding, ...] = ()
    withdrawn: tuple[tuple[Finding, str], ...] = ()
    leftovers: tuple[Leftover, ...] = ()
    model: Model | None = None
    best: Model | None = None
    warnings: tuple[str, ...] = field(default=(), converter=tuple)


def judge(selection: Selection, effects: Sequence[Effect], rule: Rule, progress: Progress = lambda text: None) -> Verdict:
    """Findings with aliases; the residual's leftovers; names withdrawn where a nameless function does clearly better."""
    model = selection.model
    progress("looking for what is left in the residual")
    left = leftovers(model, rule)
    reasons = _withdrawals(selection.before, model, left, rule)
    progress("comparing each effect with its rivals")
    findings = [finding(model, k, effects, rule, selection.trials) for k in range(len(model.choices))]
    kept = tuple(f for k, f in enumerate(findings) if k not in reasons)
    withdrawn = tuple((f, reasons[k]) for k, f in enumerate(findings) if k in reasons)
    if withdrawn:
        model = polished(with_choices(selection.before, tuple(c for k, c in enumerate(model.choices) if k not in reasons)))
        left = leftovers(model, rule) or left
    return _answer(kept, withdrawn, left, model)


def _answer(kept, withdrawn, left, model: Model) -> Verdict:
    best = corrected(model, left) if left else model
    ordered = tuple(sorted(kept, key=lambda f: -f.evidence.gain_fit * f.evidence.size))
    if ordered:
        answer = Answer.FOUND
    else:
        answer = Answer.UNEXPLAINED if left or withdrawn else Answer.COMPLETE
    return Verdict(answer, ordered, withdrawn, left, model, best)


def _withdrawals(before: Model, model: Model, left: tuple[Leftover, ...], rule: Rule) -> dict[int, str]:
    """Choices (by number) whose name does not hold, and why."""
    out = {}
    for joint in {j for c in model.choices for j in c.joints}:
        numbers = [k for k, c in enumerate(model.choices) if c.joints == (joint,)]
        if not numbers:
            continue
        if reason := _unnamed_better(before, model, joint, numbers, left, rule):
            out |= dict.fromkeys(numbers, reason)
    return out


def _unnamed_better(before: Model, model: Model, joint: int, numbers: list[int], left, rule: Rule) -> str:
    """Why the named effects of a joint do not explain it: too much is left, or one nameless function does clearly better."""
    here = [leftover for leftover in left if leftover.joint == joint]
    if not here:
        return ""
    base = with_choices(model, tuple(c for k, c in enumerate(model.choices) if k not in numbers))
    error = [_joint_error(m, joint) for m in (base, model, here[0].evidence.model)]
    named, possible = (error[0] - error[1]).sum(), max((error[0] - error[2]).sum(), 1e-300)
    if named < NAMED_SHARE * possible:
        return (f"it explains {100 * named / possible:.0f} % of what can be explained on joint {joint + 1}; "
                f"{' and '.join(here[0].signals)} explains the rest without a name")  # fmt: skip
    if named > SETTLED * possible:
        return ""
    rival = min((with_choices(base, (*base.choices, x.evidence.candidate.choice)) for x in here),
                key=lambda m: _joint_error(m, joint).sum())  # fmt: skip
    difference = error[1] - _joint_error(rival, joint)
    t = difference.mean() / max(difference.std(ddof=1) / np.sqrt(len(difference)), 1e-300)
    if t > BETTER and _joint_error(rival, joint).sum() < LOWER * error[1].sum():
        return f"a smooth function of {' and '.join(rival.choices[-1].effect.signals)} does clearly better (t = {t:.1f})"
    return ""


def _joint_error(model: Model, joint: int) -> np.ndarray:
    """Squared error of a joint's fitted blocks, each left out in turn [N^2 m^2]."""
    t = model.setting.rows.train_blocks
    return model.fit.sse[:t, joint] / model.weight[joint] ** 2


def finding(model: Model, number: int, effects: Sequence[Effect], rule: Rule, trials: int) -> Finding:
    """Evidence, parameters, intervals and rivals of one chosen effect."""
    evidence, found = rivals(model, number, effects, rule, trials)
    values, interval = intervals(model, number)
    return Finding(evidence, values, interval, found)


def intervals(model: Model, number: int) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """FMU parameters of an effect and their 95 % intervals: jackknife by blocks, nonlinear parameters linearised beside the others."""
    choice, part = model.choices[number], model.coefficients(number)
    beta, cov, theta_std = model.fit.beta[part], model.fit.cov[part, part], np.zeros(len(choice.theta))
    free = choice.effect.continuous(choice.theta)
    if free:
        beta_cov = _with_tangents(model, number, free)
        k = len(beta)
        cov = beta_cov[:k, :k]
        for place, index in enumerate(free):
            theta_std[index] = np.sqrt(max(beta_cov[k + place, k + place], 0.0))
    std = np.sqrt(np.maximum(np.diag(cov), 0.0))
    t = _quantile(model)

    def read(b, th) -> dict[str, float]:
        return choice.effect.parameters(Estimate(b, std, tuple(th), choice.joints, model.scene))

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
    return values, {name: (low[name], high[name]) for name in values}


def _quantile(model: Model) -> float:
    from scipy.stats import t

    return float(t.ppf(0.975, max(model.setting.rows.train_blocks - 1, 1)))


def _with_tangents(model: Model, number: int, free: tuple[int, ...]) -> np.ndarray:
    """Jackknife covariance of (coefficients, free nonlinear parameters) from the model linearised in the latter."""
    from cosim.closure.gram import accumulate, fit
    from cosim.closure.model import filtered, spread

    choice, part, rows = model.choices[number], model.coefficients(number), model.setting.rows
    scene, extra = model.seen or model.scene, []
    for index in free:
        ahead, behind = (choice.effect.moved(choice.theta, index, s) for s in (0.02, -0.02))
        width = ahead[index] - behind[index]
        a, b = (filtered(model.setting, choice.effect, choice.effect.columns(scene, choice.joints, th)) for th in (ahead, behind))
        slope = {j: (a[j] - b[j]) @ model.fit.beta[part] / width for j in a}
        extra.append(spread({j: v[:, None] for j, v in slope.items()}, model.setting) * model.scale)
    design = np.concatenate((model.design, *extra), axis=2)
    cov = fit(accumulate(design, model.y, rows.block, rows.blocks, rows.train_blocks)).cov
    places = [*range(part.start, part.stop), *range(model.design.shape[2], design.shape[2])]
    return cov[np.ix_(places, places)]


