"""Forward search: of the laws above the bar, the one that tells most of blocks left out, until none is left."""

from collections.abc import Callable, Sequence

import numpy as np
from attrs import evolve, frozen

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.gram import accumulate, fit
from cosim.closure.model.model import Model, settled, with_choices
from cosim.closure.score.compare import gained, preferred, without_best
from cosim.closure.score.null import by_chance, ranked_laws, screened_laws
from cosim.closure.score.refinement import REACH, refined
from cosim.closure.score.screen import Screened, Tried, Untestable
from cosim.effects import Effect
from cosim.effects.constants import SAME

MOST = 6  # laws of a pass
SHORT, WORTH = 8, 0.3  # laws above the bar that are fitted with everything else; least share of the largest gain
DESCENTS, PARTS, LEAST_GAIN = 3, (1.0, 0.3), 0.2  # Gauss-Newton steps; parts of one; nats that one has to gain
TANGENT = 0.005  # step of the central differences in nonlinear parameters: a fraction of the narrowest resonance


@frozen(eq=False)
class SearchStep:
    """One round: every law that was screened, most nats first, and the model with the one that was taken."""

    found: tuple[Tried, ...]
    taken: Model | None


@frozen(eq=False)
class EffectSearch:
    """The models before and after, the rounds, and what could not be tested; `firm`: the search before the first law
    that was taken though it lives in few blocks, None where there is none.
    """

    before: Model
    model: Model
    steps: tuple[SearchStep, ...] = ()
    untestable: tuple[Untestable, ...] = ()
    firm: "EffectSearch | None" = None

    @property
    def few(self) -> ChosenEffect | None:
        """The first law that was taken though it lives in few blocks."""
        taken = self.steps[len(self.firm.steps) - 1].taken if self.firm else None
        return taken.choices[-1] if taken else None

    def few_blocks(self, choice: ChosenEffect) -> str:
        """Why a law is not sure that was found as, or on a joint of, one that lives in few blocks; empty where not."""
        if self.few is None or self.firm is None or choice.key in {c.key for c in self.firm.model.choices}:
            return ""
        if choice.key == self.few.key:
            return "few blocks showed it when it was found"
        shared = set(choice.joints) & set(self.few.joints)
        return "it was found beside a law that few blocks showed" if shared else ""

    @property
    def trials(self) -> int:
        """How many hypotheses were screened."""
        return sum(len(step.found) for step in self.steps)


def search(
    before: Model, effects: Sequence[Effect], most: int = MOST, tell: Callable[[str], None] = lambda text: None
) -> EffectSearch:
    """Laws added one at a time. Everything is fitted again beside each: rigid body, friction and its form, skew."""
    model, steps, untestable = before, [], ()
    firm: EffectSearch | None = None
    for number in range(most):
        found, unknown = screened_laws(model, effects)
        untestable = untestable or tuple(unknown)
        best = _best(model, [x for x in found if x.clear], by_chance(len(found)))
        tried = tuple(x.kept for x in found)
        if firm is None and best is not None and preferred(best, model) <= SAME:
            firm = EffectSearch(before, simplified(model), (*steps, SearchStep(tried, None)), untestable)
        steps.append(SearchStep(tried, best))
        if best is None:
            break
        model = resettled(best)
        tell(f"found {model.choices[-1].effect.name} ({number + 1})")
        model = exchanged(model, before, effects)
    return EffectSearch(before, simplified(model), tuple(steps), untestable, firm)


def exchanged(model: Model, before: Model, effects: Sequence[Effect]) -> Model:
    """The model in which laws that were taken while others were still missing have found their place again: with other
    values of their nonlinear parameters, or given way to those that unseen blocks prefer (stepwise search with
    replacement: Miller 2002, Subset Selection in Regression), or gone where beside the others they only smooth noise.
    """
    given = {c.key for c in before.choices}
    for choice in model.choices[:-1]:  # the last one has been compared with all others
        if choice.key in given or choice not in model.choices:
            continue
        rest = with_choices(model, tuple(c for c in model.choices if c is not choice))
        found = ranked_laws(rest, effects, model.acting(model.choices.index(choice)))
        own = next((x for x in found if x.choice.key == choice.key), None)
        if own is not None and own.screen.of_noise(choice, max(float(own.gain[0]), gained(model, rest))):
            model = resettled(rest)
            continue
        new = _best(rest, [x for x in found if not x.noise], by_chance(len(found)))
        new = new and resettled(new)
        if new is None or gained(new, model) <= LEAST_GAIN:
            continue
        if new.choices[-1].key == choice.key or preferred(new, model) > SAME:
            model = new
    return model


def simplified(model: Model) -> Model:
    """The model with the simplest form of each law that unseen blocks do not tell from the one that was found."""
    for number, choice in enumerate(model.choices):
        for theta in choice.effect.simpler(choice.theta):
            fewer = (*model.choices[:number], evolve(choice, theta=theta), *model.choices[number + 1 :])
            trial = resettled(with_choices(model, fewer))
            if preferred(model, trial) <= SAME and not trial.unphysical(number):
                model = trial
                break
    return model


def _best(model: Model, found: Sequence[Screened], least: float) -> Model | None:
    """The model with the law of most nats of those that blocks left out prefer by SAME; where there is none, of those
    that tell more than the least nats of them also without the one that gains most: an effect may live in few blocks. A
    nonlinear parameter, which all blocks have seen, costs one (Akaike 1974).
    """
    best, most = None, (False, -np.inf)  # of long recordings a model is large: no list of them
    for x in found[:SHORT]:
        if x.gain[0] <= WORTH * found[0].gain[0]:
            continue
        new = with_choices(model, (*model.choices, refined(x)))
        if new.unphysical(len(model.choices)) and gained(new, model) > 0:
            new = resettled(new)  # what is fitted beside it may have to move first
        nats = new.score() - len(new.choices[-1].effect.continuous(new.choices[-1].theta))
        if gained(new, model) <= 0 or new.unphysical(len(model.choices)):
            continue
        rank = preferred(new, model) > SAME, nats
        if rank > most and (rank[0] or without_best(new, model) > least):
            best, most = new, rank
    return best


def resettled(model: Model) -> Model:
    """The same hypothesis with the friction laws and the skew fitted again beside it, and the nonlinear parameters of
    its laws beside these: Gauss-Newton steps with rigid body and friction, while unseen blocks are told better.
    """
    for _ in range(DESCENTS):
        model = with_choices(settled(model), model.choices)
        thetas = (c.effect.agreed(c.theta, model.beta(k)) for k, c in enumerate(model.choices))
        agreed = tuple(evolve(c, theta=theta) for c, theta in zip(model.choices, thetas, strict=True))
        if agreed != model.choices and gained(new := with_choices(model, agreed), model) > 0:
            model = new
        new = _descended(model)
        if new is None:
            break
        model = new
    return model


def _descended(model: Model) -> Model | None:
    """The model one step further in all continuous nonlinear parameters, the whole step or a part; None where none is
    better.
    """
    places = [(n, k) for n, c in enumerate(model.choices) for k in c.effect.continuous(c.theta)]
    if not places:
        return None
    rows, extra = model.setting.rows, [tangent(model, n, k) for n, k in places]
    design = np.concatenate((model.unweighted, *extra), axis=2) * model.scale
    normal = accumulate(design, model.target * model.scale[..., 0], rows.block, rows.blocks, rows.train_blocks)
    moves = fit(evolve(normal, precision=np.pad(model.precision, (0, len(extra))))).beta[-len(extra) :]
    for part in PARTS:
        thetas = [list(c.theta) for c in model.choices]
        for (n, k), move in zip(places, moves, strict=True):
            thetas[n][k] += part * move
        choices = tuple(evolve(c, theta=tuple(map(float, t))) for c, t in zip(model.choices, thetas, strict=True))
        if all(_within(old, new) for old, new in zip(model.choices, choices, strict=True)):
            new = with_choices(model, choices)
            if gained(new, model) > LEAST_GAIN and not any(new.unphysical(n) for n, _ in places):
                return new
    return None


def _within(old: ChosenEffect, new: ChosenEffect) -> bool:
    """Whether a step keeps the bounds of the parameters and is small enough for a linearisation."""
    free = new.effect.continuous(new.theta)
    near = all(abs(new.theta[k] - old.theta[k]) <= REACH * max(abs(old.theta[k]), REACH) for k in free)
    return near and all(np.allclose(new.effect.moved(new.theta, k, 0.0), new.theta, rtol=1e-6, atol=1e-6) for k in free)


def tangent(model: Model, number: int, index: int) -> np.ndarray:
    """Column (J, m, 1): what a nonlinear parameter changes of prediction less torque, per unit."""
    choice = model.choices[number]

    def moved(step: float) -> tuple[np.ndarray, float]:
        theta = choice.effect.moved(choice.theta, index, step)
        choices = tuple(evolve(c, theta=theta) if k == number else c for k, c in enumerate(model.choices))
        trial = evolve(model, choices=choices)
        return trial.unweighted @ model.fit.beta - trial.target, theta[index]

    (high, above), (low, below) = moved(TANGENT), moved(-TANGENT)
    return ((high - low) / ((above - below) or 1e12))[..., None]  # a fixed one: zero
