"""How much each hypothesis explains of the residual, on the recording and on replicates of it that hold no effect.

Gains are in sample, in the log density of `gram.losses` (every block with a noise level of its own), maximised over the
grid of nonlinear parameters on data and replicates alike.
"""

from collections.abc import Callable, Hashable, Iterator, Sequence
from functools import cache, cached_property
from typing import Any

import numpy as np
from attrs import define, evolve, field, frozen

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.families import Family
from cosim.closure.model.model import Model
from cosim.closure.score.delivery import Delivery
from cosim.closure.score.floor import from_encoders
from cosim.closure.score.replicates import NOTHING, REPLICATES, Replicates
from cosim.effects import Effect, EffectEstimate
from cosim.effects.actuator import Erasing, Late
from cosim.effects.constants import FED_BACK
from cosim.effects.motion import Columns, Joints, Theta

CHUNK, FEWEST = 24, 4  # values of nonlinear parameters whose columns are formed at once, and at least
ROWS = 100_000  # of a recording up to which it is so many; fewer of a longer one, to limit memory
WITHIN = 1e-5  # a column of which the model leaves a smaller share lies within the model
NEGLIGIBLE = 1e-5  # directions of columns with a smaller share of the largest carry rounding only
SMOOTHING = 1e-3  # of the scaled diagonal, of families
KNOWN = 0.1  # share of a coefficient that it may be off by where a screening asks whether it is physical


@frozen(eq=False)
class Screened:
    """A hypothesis beside a model: its gain [nats] on the data and on each replicate (1 + R,), the share of the torque
    that only it explains; z and whether it passes the bar of its library.
    """

    choice: ChosenEffect
    gain: np.ndarray
    share: float
    screen: "Screen"
    noise: bool = False  # it explains no more than the noise of an encoder may let it
    z: float = 0.0
    clear: bool = False

    @property
    def kept(self) -> "Tried":
        """The same without its screen, which holds the replicates of all rows."""
        return Tried(self.choice, float(self.gain[0]), self.share, self.z, self.clear)


@frozen
class Tried:
    """What is kept of a hypothesis that was screened, without the screen: nats on the data, and the rest as there."""

    choice: ChosenEffect
    nats: float
    share: float
    z: float
    clear: bool


@frozen(eq=False)
class Untestable:
    """A law that this data cannot show, and why; `ruled_out`: because the model holds it already, or its coefficients
    are not physical.
    """

    choice: ChosenEffect
    reason: str
    ruled_out: bool = False


@define(eq=False)
class Screen(Replicates):
    """Hypotheses beside a model. columns: formed once for the plain and the robust one; best: laws at their best
    nonlinear parameters, by their key and where they were looked for from.
    """

    columns: dict[Hashable, Any] = field(factory=dict, repr=False)
    best: dict[Hashable, ChosenEffect] = field(factory=dict, init=False, repr=False)

    @cached_property
    def drive(self) -> Delivery:
        """Those of the drive."""
        return Delivery(self, self.columns)

    def of(self, effect: Effect, joints: Joints, found: Theta | None = None) -> Screened | Untestable:
        """The best physical value of a law's nonlinear parameters. found: one that was sought beyond its grid, which
        data and replicates may take as well; the data pay one nat for each parameter that was moved (Akaike 1974).
        """
        nothing = ChosenEffect(effect, joints)
        if reason := effect.untestable(self.model.scene, joints):
            return Untestable(nothing, reason)
        thetas = effect.grid(self.model.scene, joints)
        if not thetas:
            return Untestable(nothing, "this motion has no values of its parameters to try")
        if isinstance(effect, Late):
            best = self._late(effect, joints, thetas, found)
        elif isinstance(effect, Erasing):
            best = self._erasing(effect, joints, thetas, found)
        else:
            best = self._law(effect, joints, thetas, found)
        return best or Untestable(nothing, "its columns lie within the model already", True)

    def added(self, columns: Columns, prior: Effect) -> "Added | None":
        """Columns (m, k) of some joints beside the model; None where they lie within it."""
        (found,) = self.each_added([columns], prior)
        return found

    def each_added(self, columns: Sequence[Columns], prior: Effect) -> Iterator["Added | None"]:
        """`added` of several hypotheses on the same joints, which are multiplied with the residuals together."""
        scaled = {j: np.concatenate([c[j] for c in columns], axis=1) * self.mask[j][:, None] for j in columns[0]}
        weighted = {j: c.T * self.weight[j] for j, c in scaled.items()}
        cross = sum((weighted[j] @ self.x[j] for j in scaled), NOTHING)  # (K, p)
        within = self.normal @ cross.T  # (p, K): the columns as the model fits them
        toward = sum((weighted[j] @ self.e[j] for j in scaled), NOTHING)  # (K, 1 + R)
        stop = 0
        for one in columns:
            part = slice(stop, stop := stop + next(iter(one.values())).shape[1])
            own = sum((weighted[j][part] @ c[:, part] for j, c in scaled.items()), NOTHING)
            size = np.sqrt(np.maximum(np.diag(own), 1e-300))
            free = (own - cross[part] @ within[:, part]) / size[:, None] / size
            if not np.isfinite(free).all():
                yield None
                continue
            free += np.diag(np.full(len(size), SMOOTHING) if prior.nameless else prior.precision(len(size)) / size**2)
            values, vectors = np.linalg.eigh(free)
            if values[-1] < WITHIN + SMOOTHING * prior.nameless:
                yield None
                continue
            keep = values > NEGLIGIBLE
            half = (vectors[:, keep] / np.sqrt(values[keep])).T @ (toward[part] / size[:, None])
            beta = (vectors[:, keep] / np.sqrt(values[keep])) @ half / size[:, None]
            mine = {j: c[:, part] for j, c in scaled.items()}
            yield Added(self, mine, within[:, part], (half**2).sum(axis=0), beta)

    def _law(
        self, effect: Effect, joints: Joints, thetas: Sequence[Theta], sought: Theta | None
    ) -> Screened | Untestable | None:
        """Of every replicate the value of most gain, of the data that of the physical ones."""
        best, null = None, np.zeros(self.replicates)
        top, where = np.full(self.replicates, -np.inf), np.zeros(self.replicates, int)
        every: list[tuple[Theta, Added]] = []
        beyond = [] if sought is None else [(sought, self.columns_now(ChosenEffect(effect, joints, sought)))]
        for theta, found in self._beside(effect, (*self._grid(effect, joints, thetas), *beyond)):
            if found is None:
                continue
            better = found.gain[1:] > top
            top[better], where[better] = found.gain[1:][better], len(every)
            every.append((theta, found))
            if (best is None or found.gain[0] > best[1].gain[0]) and not self.why_not(
                ChosenEffect(effect, joints, theta), found.beta[:, 0]
            ):
                best = theta, found
        if best is None:
            nothing, reason = ChosenEffect(effect, joints), "no value of its parameters that was tried is physical"
            return Untestable(nothing, reason, True) if every else None
        for number in np.unique(where):
            chosen = np.flatnonzero(where == number)
            null[chosen] = every[number][1].nats(chosen + 1)
        gain = best[1].nats(np.array([0])) - (best[0] == sought) * len(effect.continuous(best[0]))
        choice = ChosenEffect(effect, joints, best[0])
        return Screened(
            choice, np.r_[gain, np.maximum(null, 0)], best[1].share, self, self.of_noise(choice, float(gain[0]))
        )

    def _beside(
        self, effect: Effect, columns: Sequence[tuple[Theta, Columns]]
    ) -> Iterator[tuple[Theta, "Added | None"]]:
        """Each value of nonlinear parameters with its columns beside the model, a few at once to limit memory."""
        some = max(1, CHUNK * ROWS // max(len(self.fitted), 1))
        for start in range(0, len(columns), some):
            thetas, parts = zip(*columns[start : start + some], strict=True)
            yield from zip(thetas, self.each_added(parts, effect), strict=True)

    def columns_now(self, choice: ChosenEffect) -> Columns:
        """Filtered columns of a choice on the fitted rows, formed from the model as it stands and kept nowhere."""
        formed = self.model.formed_now(choice, self.model.scene)
        return {j: x[self.fitted] for j, x in formed.items()}

    def without(self, choice: ChosenEffect) -> "Screen":
        """The screen whose replicates are made of what a law leaves, in the place of what the model leaves: where an
        effect is there, its pieces are no noise.
        """
        return evolve(self, beside=self._left_by(choice))

    def _left_by(self, choice: ChosenEffect) -> np.ndarray:
        """Scaled residuals (J, m) with a law beside the model."""
        effect, joints, theta = choice.effect, choice.joints, choice.theta
        if isinstance(effect, Late):
            return np.stack([e[:, 0] for e in self.drive.behind(effect, joints, theta, self.recorded(1))])
        left = self.e[..., 0].copy()
        if isinstance(effect, Erasing):
            left[joints[0]] = self.drive.delivered(effect, joints[0], theta, 1)[0][:, 0]
            return left
        found = self.added(self.columns_now(choice), effect)
        assert found is not None, "it was screened"
        for j in range(len(left)):
            left[j] -= found.own(np.array([0]), j)[:, 0]
        return left

    def _late(self, effect: Effect, joints: Joints, thetas: Sequence[Theta], sought: Theta | None) -> Screened | None:
        """A lag or delay of the prediction: the whole design of its joints passes through it."""
        if any(self.model.late(j) for j in joints):
            return None
        before, recorded = self.loss.sum(axis=0), cache(self.recorded)

        def told(theta: Theta, count: int) -> np.ndarray:
            e = self.drive.behind(effect, joints, theta, recorded(count))
            return before[:count] - sum(self.losses(own, j) for j, own in enumerate(e))

        theta, gain = self._against_chance(effect, thetas, sought, told)
        choice = ChosenEffect(effect, joints, theta)
        share = self.drive.explained([own[:, 0] for own in self.drive.behind(effect, joints, theta, recorded(1))])
        return Screened(choice, gain, share, self, self.of_noise(choice, float(gain[0])))

    def _erasing(
        self, effect: Erasing, joints: Joints, thetas: Sequence[Theta], sought: Theta | None
    ) -> Screened | None:
        """Saturation or dead band: the delivered torque is explained, rows that it erases are charged."""
        (j,) = joints
        if any(c.effect.key == effect.key for c in self.model.erasing(j)):
            return None
        before = self.loss[j]

        def told(theta: Theta, count: int) -> np.ndarray:
            e, charge = self.drive.delivered(effect, j, theta, count)
            return before[:count] - self.losses(e, j) + charge

        theta, gain = self._against_chance(effect, thetas, sought, told)
        return Screened(ChosenEffect(effect, joints, theta), np.maximum(gain, 0), 1.0, self)

    def _against_chance(
        self,
        effect: Effect,
        thetas: Sequence[Theta],
        sought: Theta | None,
        told: Callable[[Theta, int], np.ndarray],
    ) -> tuple[Theta, np.ndarray]:
        """The value of most gain on the data, and what data and replicates (1 + R,) gain, at least 0 of these; `told`
        says it of so many of them. Data that gain nothing are not held against chance.
        """
        every = [(theta, 0) for theta in thetas] + [(t, len(effect.continuous(t))) for t in (sought,) if t is not None]
        nats, best = max((float(told(theta, 1)[0]) - moved, theta) for theta, moved in every)
        null = np.zeros(self.replicates)
        for theta, _ in every if nats > 0 else ():
            null = np.maximum(null, told(theta, 1 + self.replicates)[1:])
        return best, np.r_[nats, null]

    def family(self, kind: Family, joint: int) -> Screened | None:
        """A nameless function on a joint."""
        choice, model = ChosenEffect(kind, (joint,)), self.model
        origin = model.laws, model.late(joint)
        columns = self._formed_once(choice.key, kind.dynamic, origin, lambda: self.columns_now(choice))
        found = self.added(columns, kind)
        if found is None:
            return None
        gain = found.nats(np.arange(1 + self.replicates))
        return Screened(choice, np.maximum(gain, 0), found.share, self, self.of_noise(choice, float(gain[0])))

    def _grid(self, effect: Effect, joints: Joints, thetas: Sequence[Theta]) -> list[tuple[Theta, Columns]]:
        """Filtered columns of all values of a grid on the fitted rows; kept for other models where they do not depend
        on the fit.
        """
        model = self.model
        links = effect.smooths  # simulated links hardly change from one fit to the next: their torque is the arm's
        origin = () if links else model.laws, tuple(map(model.late, joints))
        chunk = int(np.clip(CHUNK * ROWS // len(model.setting.motion.time), FEWEST, CHUNK))

        def formed() -> list[tuple[Theta, Columns]]:
            out = []
            for start in range(0, len(thetas), chunk):
                part = thetas[start : start + chunk]
                full = effect.columns_of_all(model.scene, joints, part)
                stacked = {j: np.concatenate([c[j] for c in full], axis=1) for j in full[0]}
                edges = np.cumsum([0, *(next(iter(c.values())).shape[1] for c in full)])
                del full
                thin = {j: model.passed(x, effect.sharp, j)[self.fitted] for j, x in stacked.items()}
                out += [
                    (t, {j: x[:, a:b] for j, x in thin.items()})
                    for t, a, b in zip(part, edges, edges[1:], strict=False)
                ]
            return out

        return self._formed_once((effect.key, joints), effect.dynamic and not links, origin, formed)

    def _formed_once(self, key: Hashable, own: bool, origin: Hashable, formed: Callable[[], Any]) -> Any:
        """Columns formed the first time: for this model alone, or for all until they are formed of another origin."""
        known: dict[Any, Any] = self.columns if own else self.model.formed.grids
        if key not in known or known[key][0] != origin:
            known.pop(key, None)  # it goes before another takes its place
            known[key] = origin, formed()
        return known[key][1]

    def of_noise(self, choice: ChosenEffect, gain: float) -> bool:
        """Whether an effect that smooths the prediction explains no more than the noise of an encoder may let it."""
        if not choice.effect.smooths:
            return False
        if choice.effect.nameless:  # with so many ways to smooth it always does
            return True
        joints, noise = list(choice.joints), from_encoders(self.model)
        rows = max(int(self.used[joints].sum()), 1)
        own = 1.0  # the noise's share of the residual
        if noise is not None:
            own = min(float((noise[joints] ** 2).mean() / self.model.variance[joints].mean()), 1.0)
        share = 1 - np.exp(-2 * gain / rows)
        whole = 0.0 if isinstance(choice.effect, Late) else 1.0  # a spring smooths all of it
        return bool(share < (whole + FED_BACK) * own)

    def why_not(self, choice: ChosenEffect, beta: np.ndarray) -> str:
        """Why coefficients of a screening cannot be the effect; empty where they can."""
        known = KNOWN * np.abs(beta)
        return choice.effect.unphysical(EffectEstimate(beta, known, choice.theta, choice.joints, self.model.scene))


@frozen(eq=False)
class Added:
    """Columns beside a model: scaled (m, k) of each joint, as the model fits them (p, k), the decrease of the squared
    error (1 + R,) and coefficients (k, 1 + R) on data and replicates.
    """

    screen: Screen
    scaled: Columns
    within: np.ndarray
    gain: np.ndarray
    beta: np.ndarray

    def nats(self, which: np.ndarray) -> np.ndarray:
        """Gain (R',) in log density of data (0) or replicates."""
        s, out = self.screen, np.zeros(len(which))
        for j in self.scaled if len(self.scaled) == 1 else range(len(s.x)):
            out = out + s.loss[j, which] - s.losses(s.e[j][:, which] - self.own(which, j), j)
        return out

    def own(self, which: np.ndarray, joint: int) -> np.ndarray:
        """What they explain of a joint (m, R') on data (0) or replicates, scaled, the model fitted again."""
        beta = self.beta[:, which]
        moved = -self.screen.x[joint] @ (self.within @ beta)
        return moved + self.scaled[joint] @ beta if joint in self.scaled else moved

    @property
    def share(self) -> float:
        """RMS of what only these columns explain over that of the torque, on the joint where it is largest."""
        s, beta = self.screen, self.beta[:, 0]
        parts = []
        for j, c in self.scaled.items():
            own = c @ beta - s.x[j] @ (self.within @ beta)
            parts.append((s.weight[j] * own**2).sum() / max((s.weight[j] * s.y[j] ** 2).sum(), 1e-300))
        return float(np.sqrt(max(parts)))


def screens(model: Model, replicates: int = REPLICATES) -> tuple[Screen, Screen]:
    """The plain and the robust screen of a model."""
    plain = Screen(model, robust=False, replicates=replicates)
    return plain, Screen(model, robust=True, columns=plain.columns, replicates=replicates)
