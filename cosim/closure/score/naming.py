"""Which names hold: laws against the families that could stand beside them or in their place.

With L the nats that the names of some joints earn, B those of names and best families together, F those of the best
families in their place:

    L >= (1 - MARGIN) F                       the names hold; what B has more than L is left without a name,
    L < (1 - MARGIN) F, F >= (1 - MARGIN) B   a family is needed and no law does as well: the names are withdrawn,
    else                             names that earn MARGIN of B beside the families stand, and something else is left.

Several names whose place one family takes as well (within SAME standard errors) are withdrawn: it needs fewer words.
One such name is not sure. A family of a law's own signals, which holds the law, takes no name away, but several names
than which it alone tells more: where the law leaves something to it, the family is sure and the law is not.
"""

from collections.abc import Mapping, Sequence

from attrs import frozen

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.families import Family
from cosim.closure.model.model import Model, with_choices
from cosim.closure.score.compare import gained, preferred
from cosim.closure.score.null import by_chance, ranked_laws, screened_families
from cosim.closure.score.refinement import refined
from cosim.closure.score.screen import Screened
from cosim.closure.score.search import EffectSearch, resettled
from cosim.effects import Effect
from cosim.effects.constants import MARGIN, SAME
from cosim.effects.motion import Joints

TRIED = 4  # families of a joint, or laws in the place of one, that are fitted with everything else
CLOSE = 0.5  # least share of the largest gain of those


@frozen(eq=False)
class Rival:
    """A law in the place of a name: by how many standard errors of blocks it is worse, what it earns in nats; `less`:
    the name earns more than it by more than one parameter does by chance.
    """

    choice: ChosenEffect
    worse: float
    nats: float
    less: bool = True

    @property
    def close(self) -> bool:
        """Whether the data do not tell it from the name."""
        return self.worse < SAME or not self.less


@frozen(eq=False)
class Leftover:
    """A family that a residual needs beyond the names, with its nats; not `sure` where only the residual's size shows
    that something is missing.

    others: families that blocks do not tell from it; laws: effects that would look like it and that this device cannot
    test.
    """

    choice: ChosenEffect
    nats: float
    share: float
    sure: bool = True
    others: tuple[Family, ...] = ()
    laws: tuple[Effect, ...] = ()

    @property
    def family(self) -> Family:
        """The function without a name."""
        assert isinstance(self.choice.effect, Family), "what is left has no name"
        return self.choice.effect

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals that the residual depends on."""
        return self.family.signals

    @property
    def joint(self) -> int:
        """The joint (0-based) whose residual it is."""
        return self.choice.joints[0]


@frozen(eq=False)
class FittedFamily:
    """The family of a joint that tells most of unseen blocks, fitted beside a model; `close`: families, fitted
    likewise, that blocks do not tell from it.
    """

    model: Model
    screened: Screened
    close: tuple[tuple[Model, Screened], ...] = ()

    @property
    def family(self) -> Family:
        """The function without a name."""
        return _family(self.screened)

    def leftover(self, beside: Model, sure: bool = True) -> Leftover:
        """What it says of the residual: of the families that blocks do not tell from it the one of fewest of its own
        signals; the best one and the others beside it, but those that only add signals to its.
        """
        best = (self.model, self.screened)
        options = (best, *self.close)
        fewer = [o for o in options if set(_family(o[1]).signals) <= set(self.family.signals)]
        model, x = min(fewer, key=lambda option: len(_family(option[1]).signals))  # the best of equally many
        mine = set(_family(x).signals)
        more = [o for _, o in options if o is self.screened or not mine <= set(_family(o).signals)]
        others = tuple(_family(o) for o in more if o is not x)
        return Leftover(x.choice, gained(model, beside, x.choice.joints), x.share, sure, others)


def _family(x: Screened) -> Family:
    assert isinstance(x.choice.effect, Family), "families are screened here"
    return x.choice.effect


@frozen(eq=False)
class Named:
    """What the comparison left: the model with the names, the doubt about each by its key, names whose own family does
    better (by key, in words), names that were withdrawn with the reason, and what is left.
    """

    model: Model
    doubts: dict[object, str]
    families: dict[object, str]
    withdrawn: tuple[tuple[ChosenEffect, str], ...]
    left: tuple[Leftover, ...]


def named(found: EffectSearch) -> Named:
    """The names of a search that hold beside and against families."""
    model, withdrawn = _without_form_errors(found.model, found.before)
    doubts: dict[object, str] = {}
    wider: dict[object, str] = {}
    left: list[Leftover] = []
    instead: list[Leftover] = []
    given = {c.key for c in found.before.choices}
    on_top = best_families(model)
    for joints in dict.fromkeys(model.acting(k) for k in range(len(model.choices))):
        mine = tuple(c for k, c in enumerate(model.choices) if model.acting(k) == joints)
        verdict = _group(model, mine, joints, on_top)
        if verdict.withdrawn:
            gone = tuple(c for c in mine if verdict.stays is None or c not in verdict.stays)
            new = tuple((c, verdict.withdrawn) for c in gone if c.key not in given)
            withdrawn += new
            instead += verdict.instead if new else ()
        if verdict.doubt:
            doubts |= {c.key: verdict.doubt for c in mine}
    gone = {c.key for c, _ in withdrawn}
    kept = tuple(c for c in model.choices if c.key not in gone)
    if kept != model.choices:
        model = resettled(with_choices(found.before, kept)) if kept else found.before
        on_top = best_families(model)
    for j, fitted in on_top.items():
        left.append(fitted.leftover(model))
        for k, c in enumerate(model.choices):
            if model.acting(k) == (j,):
                doubts.setdefault(c.key, f"what it leaves is {fitted.family.title}")
                if _holds(fitted.family, (set(c.effect.signals),)):
                    wider[c.key] = fitted.family.title
    if left:
        beside = corrected(model, left)
        left += [fitted.leftover(beside) for fitted in best_families(beside).values()]
    told = {x.joint for x in left}
    left += [x for x in instead if x.joint not in told]  # needed in the place of names, if not in that of nothing
    return Named(model, doubts, wider, withdrawn, tuple(sorted(left, key=lambda x: -x.nats)))


@frozen
class _Group:
    """Why names are withdrawn, those that stay, families in their place; or why they are in doubt."""

    withdrawn: str = ""
    stays: tuple[ChosenEffect, ...] | None = None
    doubt: str = ""
    instead: tuple[Leftover, ...] = ()


def _group(model: Model, mine: tuple[ChosenEffect, ...], joints: Joints, on_top: dict[int, FittedFamily]) -> _Group:
    """Whether the names of some joints hold."""
    rest = with_choices(model, tuple(c for c in model.choices if c not in mine))
    earned = gained(model, rest, joints)
    beside = tuple(fitted.screened.choice for j, fitted in on_top.items() if j in joints)
    whole = with_choices(model, (*model.choices, *beside)) if beside else model
    both = max(gained(whole, rest, joints), earned)
    own = tuple(set(c.effect.signals) for c in mine)
    screened = [x for x in screened_families(rest, joints) if not x.noise]
    best = best_families(rest, joints, need=False, besides=own, screened=screened)
    alone, titles = _instead(rest, best)
    instead = gained(alone, rest, joints)
    one, more = _one_for_all(model, rest, joints, screened) if len(mine) > 1 else ("", False)
    if more:
        return _Group(f"{one} explains more than all of {', '.join(c.effect.name for c in mine)}")
    if earned >= (1 - MARGIN) * max(both, instead):
        if len(joints) > 1 or preferred(model, alone, joints) > SAME:
            return _Group(doubt=one and f"{one} explains as much as all of its joint's names")
        if len(mine) > 1 and instead > (1 - MARGIN) * earned:
            return _Group(f"{titles} explains as much as all of {', '.join(c.effect.name for c in mine)}")
        return _Group(
            doubt=f"{titles} explains as much" if titles and any(own) else ""
        )  # a constant is in every family
    if earned >= (1 - MARGIN) * instead:
        return _Group()
    if instead >= (1 - MARGIN) * both:
        share = 100 * max(earned, 0.0) / max(instead, 1e-9)
        text = f"it explains {share:.0f} % of what {titles or 'nothing'} explains in its place"
        return _Group(text, instead=tuple(f.leftover(rest, sure=False) for f in best.values()))
    stays = tuple(c for c in mine if _stands(whole, rest, c, joints))
    text = f"it earns less than {100 * MARGIN:.0f} % of what can be explained beside {titles}"
    return _Group(text if len(stays) < len(mine) else "", stays)


def _instead(rest: Model, best: Mapping[int, FittedFamily]) -> tuple[Model, str]:
    """The best family of each joint in the place of its names, and what they are in words."""
    words = " and ".join(fitted.family.title for fitted in best.values())
    return with_choices(rest, (*rest.choices, *(fitted.screened.choice for fitted in best.values()))), words


def _one_for_all(model: Model, rest: Model, joints: Joints, screened: Sequence[Screened]) -> tuple[str, bool]:
    """The family of each joint that tells as much as all names there, their own signals among them, in words; whether
    it tells more.
    """
    alone, words = _instead(rest, best_families(rest, joints, need=False, screened=screened))
    more = preferred(alone, model, joints) > SAME
    return "" if preferred(model, alone, joints) > SAME else words or "nothing" * more, more


def _stands(whole: Model, rest: Model, choice: ChosenEffect, joints: Joints) -> bool:
    """Whether a name earns its margin beside families; those of its own signals, which hold it, are left out."""
    own = set(choice.effect.signals)
    beside = tuple(c for c in whole.choices if not (isinstance(c.effect, Family) and c.effect.kinds <= own))
    new = with_choices(whole, beside) if len(beside) < len(whole.choices) else whole
    return gained(new, _less(new, choice), joints) > MARGIN * gained(new, rest, joints)


def _less(model: Model, choice: ChosenEffect) -> Model:
    return with_choices(model, tuple(c for c in model.choices if c is not choice))


def _without_form_errors(model: Model, before: Model) -> tuple[Model, tuple[tuple[ChosenEffect, str], ...]]:
    """The model without names that earn less than the margin of what all names of their joint earn: they mend the form
    of the others.
    """
    out: tuple[tuple[ChosenEffect, str], ...] = ()
    given = {c.key for c in before.choices}
    while len(model.choices) > 1:
        shares = {k: _own_share(model, k) for k, c in enumerate(model.choices) if c.key not in given}
        k = min(shares, key=shares.__getitem__, default=None)
        if k is None or shares[k] >= MARGIN:
            return model, out
        gone = model.choices[k]
        out += ((gone, f"it earns {100 * shares[k]:.0f} % of what the names of its joint explain: the others' form"),)
        model = resettled(_less(model, gone))
    return model, out


def _own_share(model: Model, number: int) -> float:
    """Nats that a name earns beside the others over those of all names of its joint, the joint where it is largest."""
    choice = model.choices[number]
    rest, shares = _less(model, choice), []
    for j in choice.joints:
        bare = with_choices(model, tuple(c for c in model.choices if j not in c.joints))
        shares.append(gained(model, rest, (j,)) / max(gained(model, bare, (j,)), 1e-9))
    return max(shares)


def best_families(
    model: Model,
    joints: Joints | None = None,
    need: bool = True,
    besides: Sequence[set[str]] = (),
    screened: Sequence[Screened] | None = None,
) -> dict[int, FittedFamily]:
    """The best family of each joint beside a model, fitted with it; where it is a `need`, only one above its bar.

    besides: signals of laws, whose own families, which hold them, are left out; screened: families of these joints
    beside this model, where they were screened before.
    """
    found = screened_families(model, joints) if screened is None else screened
    out: dict[int, FittedFamily] = {}
    for j in model.active if joints is None else joints:
        mine = [
            x for x in found if x.choice.joints == (j,) and (x.clear or not need) and not _holds(_family(x), besides)
        ]
        options = [(with_choices(model, (*model.choices, x.choice), passes=0), x) for x in mine[:TRIED]]
        good = [(m, x) for m, x in options if gained(m, model) > 0 and (not need or preferred(m, model) > SAME)]
        if good:
            best, x = max(good, key=lambda option: option[0].score())
            out[j] = FittedFamily(
                best, x, tuple((m, o) for m, o in good if o is not x and preferred(best, m, (j,)) <= SAME)
            )
    return out


def _holds(family: Family, laws: Sequence[set[str]]) -> bool:
    return any(family.kinds <= signals for signals in laws)


def rivals(model: Model, number: int, effects: Sequence[Effect]) -> tuple[Rival, ...]:
    """Laws in the place of choice `number` that may do as well, most nats first."""
    choice = model.choices[number]
    rest = _less(model, choice)
    found = ranked_laws(rest, effects, model.acting(number))
    others = [x for x in found if x.choice.effect.name != choice.effect.name and not x.noise]
    out = []
    for x in others[:TRIED]:
        if x.gain[0] > CLOSE * others[0].gain[0]:
            new = with_choices(rest, (*rest.choices, refined(x)))
            if gained(new, rest) > 0 and not new.unphysical(len(new.choices) - 1):
                less = gained(model, new) > by_chance(1)  # a parameter that all blocks have seen helps each a little
                out.append(Rival(new.choices[-1], preferred(model, new), gained(new, rest), less))
    return tuple(sorted(out, key=lambda r: -r.nats))


def corrected(model: Model, left: Sequence[Leftover]) -> Model:
    """The model with the smooth corrections that its joints need."""
    choices = tuple(x.choice for x in left if x.sure)
    return with_choices(model, (*model.choices, *choices)) if choices else model
