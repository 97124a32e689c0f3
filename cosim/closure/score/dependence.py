"""Whether anything is left in the residual: smooth functions of single signals, of pairs and of history compete under
the rule for claims.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from attrs import evolve, frozen

from cosim.closure.model.candidates import Candidate, Normal
from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.model import Model, columns_of, with_choices
from cosim.closure.model.unnamed import Dependence, dependences, faults, persistence, varied
from cosim.closure.score.evidence import EffectEvidence, weigh
from cosim.closure.score.floor import from_sensors
from cosim.closure.score.selection import Rule

PERSISTENT = 0.35  # share of the residual's square that its neighbours beyond the filter's memory have to predict
LARGE = 0.01  # of the torque
BEYOND, MUCH = 4.0, 0.03
"""Times the noise of the sensors, and share of the torque, above which a residual cannot be called noise."""
NEW = 2.0  # times the residual of fitted rows, and the noise, above which held-out rows show something new
DOUBT = 0.25  # share of what a name leaves that a nameless function has to remove to make the name doubtful
FLEXIBLE = 2.5  # times the share of the error that one column has to remove, for a basis of eight functions


@frozen(eq=False)
class Leftover:
    """A signal that the residual of some joints depends on, without a name; not `sure` where only the residual's size
    shows that something is missing.
    """

    evidence: EffectEvidence
    sure: bool = True

    @property
    def choice(self) -> ChosenEffect:
        """The dependence, chosen on its joint."""
        return self.evidence.candidate.choice

    @property
    def dependence(self) -> Dependence:
        """The function without a name."""
        effect = self.choice.effect
        assert isinstance(effect, Dependence), "what is left has no name"
        return effect

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals that the residual depends on."""
        return self.dependence.signals

    @property
    def form(self) -> str:
        """What was fitted, in words."""
        return self.dependence.title

    @property
    def separated_by(self) -> str:
        """What would distinguish it from a named effect."""
        if given := self.dependence.separated_by:
            return given
        if "time" in self.signals:
            return "the same motion, later"
        names = " and ".join(dict.fromkeys(name.removeprefix("history of ") for name in self.signals))
        return f"a motion that changes {names} one at a time" if " and " in names else f"other ranges of {names}"

    @property
    def joint(self) -> int:
        """The joint (0-based) whose residual it is."""
        return self.evidence.joints[0]


def leftovers(
    model: Model, rule: Rule, former: tuple[tuple[ChosenEffect, np.ndarray], ...] = ()
) -> tuple[tuple[Leftover, ...], dict[int, Leftover]]:
    """Dependences of the residual that the rule accepts, strongest first; for joints without any the best one that
    makes a name doubtful. A doubt needs less than a claim: it may be small and one of many that were tried.

    Whether the size of a named effect varies with another signal is one of them. former: effects that were named and
    withdrawn, with their coefficients.
    """
    joints = tuple(range(model.setting.joints))
    kinds = [(kind, joints) for kind in dependences(model.scene)] + [
        (kind, (j,)) for j in joints for kind in faults(model.scene, j)
    ]
    parts = [(c, model.beta(k), False) for k, c in enumerate(model.choices)] + [(*part, True) for part in former]
    for choice, beta, whole in parts:
        if len(choice.joints) == 1 and choice.effect.signals:
            kinds += [
                (kind, choice.joints)
                for kind in varied(model.scene, choice.effect, choice.joints[0], choice.theta, beta, whole)
            ]
    trials = sum(len(on) for _, on in kinds)
    strict = evolve(rule, gain=FLEXIBLE * rule.gain, size=1.25 * rule.size)
    doubt = evolve(rule, p=1.0, gain=DOUBT, size=0.0)
    found: list[Leftover] = []
    best: dict[int, EffectEvidence] = {}
    doubts: dict[int, EffectEvidence] = {}
    normal = Normal(model)
    for kind, on in kinds:
        basis = model.setting.rows.filtered(kind.columns(model.scene, on, ())[on[0]], kind.sharp)
        for joint in on:
            model.formed.keep(ChosenEffect(kind, (joint,)), model.laws, {joint: basis})
            evidence = weighed(model, kind, joint, trials, normal)
            if evidence is None:
                continue
            if not strict.refusal(evidence):
                found.append(Leftover(evidence))
            _keep_better(best, joint, evidence)
            if not doubt.refusal(evidence):
                _keep_better(doubts, joint, evidence)
    found.sort(key=lambda leftover: leftover.evidence.error())
    bare = set(joints) - {leftover.joint for leftover in found}
    found += _persistent(model, rule, bare, normal)
    bare -= {leftover.joint for leftover in found}
    large = sorted(bare & beyond_noise(model))
    for joint in set(large) - set(best):
        every = [weighed(model, kind, joint, trials, normal, least=0.0) for kind, on in kinds if joint in on]
        if known := [evidence for evidence in every if evidence is not None]:
            best[joint] = min(known, key=EffectEvidence.error)
    found += [Leftover(best[joint], sure=False) for joint in large if joint in best]
    sure = strongest(found)
    return tuple(found), {joint: Leftover(evidence) for joint, evidence in doubts.items() if joint not in sure}


def _keep_better(known: dict[int, EffectEvidence], joint: int, evidence: EffectEvidence) -> None:
    if joint not in known or evidence.error() < known[joint].error():
        known[joint] = evidence


def beyond_noise(model: Model) -> set[int]:
    """Joints (0-based) whose model is incomplete whatever signals explain: the residual, fitted or held out, is far
    larger than the noise of the sensors, or the held-out residual is larger than that noise and far larger than the
    fitted one, as where only held-out rows cross a gap.
    """
    if (noise := from_sensors(model)) is None:
        return set()
    test, use = model.setting.rows.test, model.setting.use
    (fitted, _), (held, torque) = halves = [
        (_rms(model.residual, use & rows), _rms(model.target, use & rows)) for rows in (~test, test)
    ]
    far = [(left > BEYOND * noise) & (left > MUCH * whole) for left, whole in halves]
    new = (held > NEW * np.maximum(fitted, noise)) & (held > LARGE * torque)
    return set(np.flatnonzero(far[0] | far[1] | new).tolist())


def _rms(x: np.ndarray, use: np.ndarray) -> np.ndarray:
    return np.sqrt(np.where(use, x**2, 0).sum(axis=1) / np.maximum(use.sum(axis=1), 1))


def _persistent(model: Model, rule: Rule, joints: set[int], normal: Normal) -> tuple[Leftover, ...]:
    """Joints whose residual is large and correlated beyond the filter's memory though it depends on no signal."""
    kind = persistence(model.setting.rows, model.setting.motion, model.residual, model.setting.use)
    strict = evolve(rule, gain=PERSISTENT, size=LARGE)
    found = []
    for joint in sorted(joints):
        evidence = weighed(model, kind, joint, 1, normal)
        if evidence is not None and not strict.refusal(evidence):
            found.append(Leftover(evidence))
    return tuple(found)


def in_place(base: Model, joint: int, kinds: Sequence[Dependence]) -> tuple[EffectEvidence, ...]:
    """Evidence for each of these dependences of one joint added to a model by itself."""
    normal = Normal(base)
    found = (weighed(base, kind, joint, len(kinds), normal) for kind in kinds)
    return tuple(e for e in found if e is not None)


def weighed(
    model: Model, kind: Dependence, joint: int, trials: int, normal: Normal | None = None, least: float = 0.02
) -> EffectEvidence | None:
    """The evidence for one dependence; None where its basis lies within the model or removes less than a share `least`
    of the fitted rows' error.
    """
    normal, choice = normal or Normal(model), ChosenEffect(kind, (joint,))
    screened = normal.gain_of(choice, {j: x[normal.train] for j, x in columns_of(model, choice, model.scene).items()})
    if screened is None or (gain := screened[0] / normal.error((joint,))) < least:
        return None
    return weigh(model, Candidate(choice, gain, screened[1], 1), trials)


def strongest(found: Iterable[Leftover]) -> dict[int, Leftover]:
    """The first of each joint."""
    out: dict[int, Leftover] = {}
    for leftover in found:
        out.setdefault(leftover.joint, leftover)
    return out


def corrected(model: Model, found: Iterable[Leftover]) -> Model:
    """The model with the best smooth correction of each joint that needs one."""
    best = strongest(x for x in found if x.sure and not x.dependence.witness).values()
    return with_choices(model, (*model.choices, *(x.choice for x in best)))
