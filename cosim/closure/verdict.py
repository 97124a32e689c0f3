"""The answer: which effects are named and what they cannot be told from, what is left without a name, or why nothing
can be concluded.
"""

from collections.abc import Callable, Sequence
from enum import Enum

import numpy as np
from attrs import evolve, frozen

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.gram import accumulate, fit
from cosim.closure.model.model import Model, with_choices
from cosim.closure.score.checks import ClosureEvent, doubt_of, events, incomplete
from cosim.closure.score.compare import gained, preferred
from cosim.closure.score.naming import Leftover, Rival, best_families, corrected, named, rivals
from cosim.closure.score.search import EffectSearch, tangent
from cosim.effects import Alias, Effect, EffectEstimate
from cosim.effects.constants import SAME
from cosim.effects.motion import Joints
from cosim.measured import Label

KINDS = {"rad": "q", "m": "q", "rad/s": "dq", "m/s": "dq", "N.m": "tau", "N": "tau"}  # further signals, by unit
SKEW = 0.3
"""Samples: RMS error of the sampling skew, 0, 1/2 or 1, on rigs. A wall of stiffness k [N/m] shows d [s] of it as a
damping k d."""


class Answer(Enum):
    """The four answers of the contract."""

    FOUND = "effect_found"
    COMPLETE = "model_complete"
    UNEXPLAINED = "unexplained"
    REFUSED = "refused"


@frozen(eq=False)
class NamedEffect:
    """A named effect as the model has it: nats that it earns and by how many standard errors blocks prefer it,
    parameters with 95 % intervals, rivals.

    untestable: aliases that this data could not have shown, and those of rivals that blocks do not tell from it, that
    the device cannot test or no motion shows; doubts: why another cause may stand behind it; acting: joints (0-based)
    on which it acts; earlier: of an earlier pass; wider: the family that does better than the law.
    """

    choice: ChosenEffect
    nats: float
    sure_by: float
    parameters: dict[Label, float]
    interval: dict[Label, tuple[float, float]]
    rivals: tuple[Rival, ...] = ()
    inherent: tuple[Alias, ...] = ()
    untestable: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    separated: tuple[tuple[str, str], ...] = ()
    acting: Joints = ()
    earlier: bool = False
    wider: str = ""

    @property
    def level(self) -> str:
        """Of the answer: "law", or "family" where a nameless function of its signals does better than this law."""
        return "family" if self.wider else "law"

    @property
    def family(self) -> str:
        """On what the torque depends, in words."""
        return self.wider or self.effect.family_of(self.choice.joints)

    @property
    def effect(self) -> Effect:
        """The effect."""
        return self.choice.effect

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints, 1-based."""
        return tuple(j + 1 for j in self.choice.joints)

    @property
    def alike(self) -> tuple[str, ...]:
        """All names that the data cannot tell from this one: those that no motion tells, those that blocks do not tell
        from it, those that could not be tested.
        """
        inherent = [alias.name for alias in self.inherent]
        close = [r.choice.effect.name for r in self.rivals if r.close]
        names = dict.fromkeys((*inherent, *close, *self.untestable))
        return tuple(name for name in names if name != self.name)

    @property
    def aliases(self) -> tuple[str, ...]:
        """`alike`, and `unknown` as the last where something without a name may stand behind this one."""
        return (*self.alike, *(("unknown",) if self.doubts else ()))

    @property
    def separated_by(self) -> str:
        """The experiments that would tell it from its aliases."""
        close = [alias for r in self.rivals if r.close for alias in r.choice.effect.aliases]
        known = {alias.name: alias.separated_by for alias in (*close, *self.effect.aliases, *self.inherent)}
        known |= dict(self.separated)
        if self.doubts:
            known["unknown"] = self.doubts[0]
        return "; ".join(f"{name}: {known.get(name) or 'another excitation'}" for name in self.aliases)


@frozen(eq=False)
class ClosureVerdict:
    """The answer with its findings.

    model: with the named effects; best: also with the smooth correction where there is one. Both None where refused.
    """

    answer: Answer
    findings: tuple[NamedEffect, ...] = ()
    withdrawn: tuple[tuple[ChosenEffect, str], ...] = ()
    leftovers: tuple[Leftover, ...] = ()
    events: tuple[ClosureEvent, ...] = ()
    model: Model | None = None
    best: Model | None = None
    warnings: tuple[str, ...] = ()

    def models(self) -> tuple[Model, Model]:
        """`model` and `best` of a verdict that is no refusal."""
        assert self.model is not None and self.best is not None, "only a refusal has no models"
        return self.model, self.best


def judge(
    search: EffectSearch, effects: Sequence[Effect], tell: Callable[[str], None] = lambda text: None
) -> ClosureVerdict:
    """Names that hold with their rivals, what is left, moments that no law explains."""
    tell("comparing names with what has no name")
    found = named(search)
    model, left = found.model, found.left
    tell("comparing each effect with its rivals")
    earlier = {c.key for c in search.before.choices}
    findings = tuple(
        evolve(
            _finding(search, model, k, effects, found.doubts),
            earlier=c.key in earlier,
            wider=found.families.get(c.key, ""),
        )
        for k, c in enumerate(model.choices)
    )
    moments = events(model)
    bare = {j: why for j, why in incomplete(model).items() if j not in {x.joint for x in left}}
    left = (*(_with_unseen(model, x, effects) for x in left), *closest(model, tuple(bare), effects))
    doubts = bare | {e.joint: e.kind for e in moments}
    findings = tuple(
        evolve(f, doubts=(*f.doubts, *(why for j, why in doubts.items() if f.acting == (j,)))) for f in findings
    )
    findings = tuple(sorted(findings, key=lambda f: -f.nats))
    new = any(not f.earlier for f in findings)
    answer = Answer.FOUND if new else Answer.UNEXPLAINED if left or bare or found.withdrawn else Answer.COMPLETE
    plain = evolve(model, tangents=False)
    best = evolve(corrected(model, left), tangents=False)
    return ClosureVerdict(answer, findings, found.withdrawn, left, moments, plain, best)


def _with_unseen(model: Model, left: Leftover, effects: Sequence[Effect]) -> Leftover:
    """With the effects that the device cannot test and whose torque depends on nothing else than what is left may
    depend on, those that depend on fewest signals first.
    """
    units = model.scene.units
    every = [
        {KINDS.get(units[s], s) if s in units else s.rstrip("0123456789") for s in family.signals}
        for family in (left.family, *left.others)
    ]
    found = [e for e in effects if any(kinds <= set(e.unseen(model.scene)) for kinds in every)]
    return evolve(left, laws=tuple(sorted(found, key=lambda e: len(e.unseen(model.scene)))))


def closest(model: Model, joints: Joints, effects: Sequence[Effect]) -> tuple[Leftover, ...]:
    """Where something is missing that has no name: the family of each joint that comes closest, with the effects that
    the device cannot test.
    """
    place = best_families(model, joints, need=False) if joints else {}
    left = (fitted.leftover(model, sure=False) for fitted in place.values())
    return tuple(_with_unseen(model, x, effects) for x in left)


def _finding(
    search: EffectSearch, model: Model, number: int, effects: Sequence[Effect], doubts: dict[object, str]
) -> NamedEffect:
    choice, acting = model.choices[number], model.acting(number)
    rest = with_choices(model, tuple(c for c in model.choices if c is not choice))
    values, interval = intervals(model, number)
    known = rivals(model, number, effects)
    sure_by = preferred(model, rest)
    why = (
        doubts.get(choice.key, ""),
        doubt_of(model, choice, acting),
        model.unphysical(number),
        f"blocks that it has not seen prefer it by {sure_by:.1f} standard errors only" if sure_by <= SAME else "",
        search.few_blocks(choice),
    )
    tried = (*(search.steps[0].found if search.steps else ()), *(u for u in search.untestable if u.ruled_out))
    held = (x.choice for x in tried)
    tested = {c.effect.name for c in (*held, *model.choices) if set(c.joints) & set(acting)}
    unseen = {e.name for e in effects if e.unseen(model.scene)} - tested
    own = [a.name for a in choice.effect.aliases if a.name not in tested]
    through = [a for r in known if r.close for a in r.choice.effect.aliases if a.always or a.name in unseen]
    return NamedEffect(
        choice,
        gained(model, rest),
        sure_by,
        values,
        interval,
        rivals=known,
        inherent=choice.effect.inherent(model.estimate(number)),
        untestable=(*own, *(a.name for a in through)),
        doubts=tuple(filter(None, why)),
        separated=tuple((r.choice.effect.name, where_apart(model, rest, r)) for r in known if r.close),
        acting=acting,
    )


def where_apart(model: Model, rest: Model, rival: Rival) -> str:
    """Where in this motion a rival differs most from the model: more of it would tell the two."""
    other = with_choices(rest, (*rest.choices, rival.choice))
    scene, rows, use = model.scene, model.setting.rows, model.setting.use
    between = (other.unweighted @ other.fit.beta - other.target) - (model.unweighted @ model.fit.beta - model.target)
    joint = max(model.active, key=lambda j: float((between[j, use[j]] ** 2).sum()))
    apart, at = between[joint, use[joint]] ** 2, rows.index[use[joint]]
    signals = {"q": scene.motion.q, "dq": scene.motion.dq, "tau": scene.rigid}
    best = ("", 0.0)
    for name, values in signals.items():
        x = values[at, joint]
        for words, edge, beyond in (("above", 90, 1), ("below", 10, -1)):
            limit = float(np.percentile(x, edge))
            share = float(apart[beyond * (x - limit) > 0].sum() / max(apart.sum(), 1e-300))
            best = max(best, (f"more motion with {name}{joint + 1} {words} {limit:.3g}", share), key=lambda b: b[1])
    return f"{best[0]}, where {100 * best[1]:.0f} % of their difference lies"


def intervals(model: Model, number: int) -> tuple[dict[Label, float], dict[Label, tuple[float, float]]]:
    """FMU parameters of an effect with 95 % intervals: jackknife by blocks, the model linearised in nonlinear ones."""
    plain, choice, part = evolve(model, tangents=False), model.choices[number], model.coefficients(number)
    beta, theta = plain.beta(number), choice.theta
    free = choice.effect.continuous(theta)
    cov = _with_tangents(model, number, free)
    k, t = len(beta), _quantile(model)
    std, theta_std = np.sqrt(np.maximum(np.diag(cov)[:k], 0.0)), np.zeros(len(theta))
    std = np.hypot(std, choice.effect.form * (np.linalg.norm(beta) if choice.effect.amplitude else np.abs(beta)))
    std = np.hypot(std, _by_skew(model)[part])
    for place, index in enumerate(free):
        change = choice.effect.moved(theta, index, choice.effect.form)[index] - theta[index]
        theta_std[index] = np.hypot(np.sqrt(max(cov[k + place, k + place], 0.0)), change)

    def read(b: np.ndarray, th: Sequence[float]) -> dict[Label, float]:
        return choice.effect.parameters(EffectEstimate(b, std, tuple(th), choice.joints, plain.scene))

    values = {name: float(value) for name, value in read(beta, theta).items()}
    low, high = dict(values), dict(values)
    for place, spread in enumerate((*std, *theta_std)):
        for sign in (-1, 1):
            b, th = beta.copy(), list(theta)
            if place < k:
                b[place] += sign * t * spread
            else:
                th[place - k] += sign * t * spread
            for name, value in ((n, float(v)) for n, v in read(b, th).items()):
                low[name], high[name] = min(low[name], value), max(high[name], value)
    slack = choice.effect.slack * model.setting.motion.sample
    return values, {name: (low[name] - slack, high[name]) for name in values}


def _by_skew(model: Model) -> np.ndarray:
    """Standard deviation (p,) of the coefficients because of that of the sampling skew, which is one of three
    values.
    """
    step = SKEW * model.setting.motion.sample
    return np.abs(evolve(model, skew=model.skew + step).fit.beta - model.fit.beta)


def _quantile(model: Model) -> float:
    from scipy.stats import t

    return float(t.ppf(0.975, max(model.setting.rows.train_blocks - 1, 1)))


def _with_tangents(model: Model, number: int, free: tuple[int, ...]) -> np.ndarray:
    """Jackknife covariance of (coefficients, free nonlinear parameters), the model linearised in the latter."""
    rows, part = model.setting.rows, model.coefficients(number)
    extra = [tangent(model, number, index) for index in free]
    design = np.concatenate((model.unweighted, *extra), axis=2) * model.scale
    normal = accumulate(design, model.target * model.scale[..., 0], rows.block, rows.blocks, rows.train_blocks)
    cov = fit(evolve(normal, precision=np.pad(model.precision, (0, len(extra))))).cov
    size = model.unweighted.shape[2]
    places = [*range(part.start, part.stop), *range(size, size + len(extra))]
    return cov[np.ix_(places, places)]
