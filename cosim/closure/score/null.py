"""How much each hypothesis explains of the residual, on the recording and on replicates of it that hold no effect.

The replicates: the residuals of the model so far, with a random sign for each of about a hundred pieces of this very
recording (wild cluster bootstrap: Cameron, Gelbach, Miller 2008, Rev. Econ. Stat. 90(3)). They keep what goes on within
a piece, uneven noise and periodic motion, and break every function of the state or of time.

Gains are in sample, in the log density of `gram.losses` (every block with a noise level of its own), maximised over the
grid of nonlinear parameters on data and replicates alike. A cube root makes them
near normal (Wilson, Hilferty 1931); each is standardised by its own replicates, and the bar is the 1 - ALPHA quantile
(Gumbel) of the largest of the whole library in a replicate. `Screened.clear` holds where a gain passes it.
"""

from collections.abc import Callable, Hashable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from attrs import define, evolve, field, frozen

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.families import Family, families, varied
from cosim.closure.model.gram import losses, scales
from cosim.closure.model.model import Model
from cosim.closure.score.floor import from_encoders
from cosim.effects import Effect, EffectEstimate
from cosim.effects.actuator import Erasing, Late
from cosim.effects.constants import ALPHA, FED_BACK, SIZE
from cosim.effects.motion import Columns, Joints, Theta

REPLICATES = 79
PIECES = 100  # of a recording, whose residuals get a sign of their own
SHORTEST = 8  # rows (filter widths) of a piece
CHUNK = (
    24  # values of nonlinear parameters whose columns are formed at once; of a long recording fewer, to limit memory
)
FEWEST, ROWS = 4, 100_000  # of them at least; rows up to which it is so many
WITHIN = 1e-5  # a column of which the model leaves a smaller share lies within the model
NEGLIGIBLE = 1e-5  # directions of columns with a smaller share of the largest carry rounding only
RIDGE = 1e-8  # of the scaled diagonal
SMOOTHING = 1e-3  # of the scaled diagonal, of families
NOTHING = np.zeros(())
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
    """A law that this data cannot show, and why; `within`: because the model holds it already."""

    choice: ChosenEffect
    reason: str
    within: bool = False


@define(eq=False)
class Screen:
    """Weighted residuals of a model with their replicates, on the m fitted rows. robust: coefficients are those of
    blocks weighted by their own noise level; an effect in a third of the blocks shows only without, one beside a
    spike only with it. Both are scored alike. columns: formed once for both. beside: residuals (J, m) that the
    replicates are made of, by default those of the model.
    """

    model: Model
    robust: bool
    columns: dict[Hashable, Any] = field(factory=dict, repr=False)
    seed: int = 0
    replicates: int = REPLICATES
    beside: np.ndarray | None = field(default=None, repr=False)

    @cached_property
    def fitted(self) -> np.ndarray:
        """Numbers (m,) of the fitted rows, blocks below each other."""
        return np.flatnonzero(~self.model.setting.rows.test)

    @cached_property
    def starts(self) -> np.ndarray:
        """First row (T,) of each block."""
        block = self.model.setting.rows.block[self.fitted]
        return np.flatnonzero(np.diff(block, prepend=-1))

    @cached_property
    def used(self) -> np.ndarray:
        """Rows (J, m) in use."""
        return self.model.setting.use[:, self.fitted]

    @cached_property
    def count(self) -> np.ndarray:
        """Rows (T, J, 1) in use of each block."""
        return np.add.reduceat(self.used.astype(float), self.starts, axis=1).T[..., None]

    @cached_property
    def mask(self) -> np.ndarray:
        """One over the noise [1/(N m)] of each row (J, m) in use, else zero."""
        return self.used / np.sqrt(self.model.variance)[:, None]

    @cached_property
    def weight(self) -> np.ndarray:
        """Weight (J, m) of each row in the coefficients."""
        weight = self.model.fit.weight[self.model.setting.rows.block[self.fitted]].T
        return weight if self.robust else np.ones_like(weight)

    @cached_property
    def x(self) -> np.ndarray:
        """Scaled design (J, m, p)."""
        return self.model.unweighted[:, self.fitted] * self.mask[..., None]

    def solved(self, x: Sequence[np.ndarray] | np.ndarray, y: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
        """Coefficients (p, R) of designs (m, p) and torques (m, R) of each joint."""
        return self._solved([self._equations(j, *both) for j, both in enumerate(zip(x, y, strict=True))])

    def _equations(self, joint: int, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal equations (p, p), (p, R) of a design (m, p) and torques (m, R) of a joint."""
        weighted = x.T * self.weight[joint]
        return weighted @ x, weighted @ y

    def _solved(self, equations: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Coefficients (p, R) of the normal equations of all joints."""
        g, h = (sum(parts) for parts in zip(*equations, strict=True))
        scale = 1 / np.sqrt(np.maximum(np.diag(g), 1e-300))
        extra = RIDGE + self.model.precision * scale**2 + self.model.fit.penalty
        return np.linalg.solve(g * scale[:, None] * scale + np.diag(extra), h * scale[:, None]) * scale[:, None]

    @cached_property
    def y(self) -> np.ndarray:
        """Scaled torque (J, m)."""
        return self.model.target[:, self.fitted] * self.mask

    @cached_property
    def left(self) -> np.ndarray:
        """Residual (J, m) of the fit with these weights."""
        return self.y - (self.x @ self.solved(self.x, self.y[..., None]))[..., 0]

    @cached_property
    def flipped(self) -> np.ndarray:
        """Residuals (J, m, R) of the replicates, before they are fitted again."""
        random, out = np.random.default_rng(self.seed), np.zeros((*self.left.shape, self.replicates))
        for j, used in enumerate(self.used):
            rows = np.flatnonzero(used)
            if len(rows):
                piece = np.arange(len(rows)) // max(SHORTEST, len(rows) // PIECES)
                signs = np.where(random.random((piece[-1] + 1, self.replicates)) < 0.5, 1.0, -1.0)
                left = self.left if self.beside is None else self.beside
                out[j, rows] = left[j, rows, None] * signs[piece]
        return out

    @cached_property
    def e(self) -> np.ndarray:
        """Residuals (J, m, 1 + R) of data and replicates, fitted again."""
        e = np.concatenate([self.left[..., None], self.flipped], axis=2)
        return e - self.x @ self.solved(self.x, e)

    @cached_property
    def replicated(self) -> np.ndarray:
        """Scaled torque (J, m, 1 + R) of data and replicates: prediction and residuals."""
        prediction = (self.y - self.left)[..., None] + self.flipped
        return np.concatenate([self.y[..., None], prediction], axis=2)

    @cached_property
    def unpassed(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Normal equations of every joint, through no lag or delay, of data and replicates."""
        return [self._equations(j, x, y) for j, (x, y) in enumerate(zip(self.x, self.replicated, strict=True))]

    @cached_property
    def loss(self) -> np.ndarray:
        """Minus the log density (J, 1 + R) of data and replicates [nats]."""
        return np.stack([self.losses(e, j) for j, e in enumerate(self.e)])

    def losses(self, e: np.ndarray, joint: int) -> np.ndarray:
        """Minus the log density (R,) of residuals (m, R) of a joint, each block with a noise level of its own
        [nats].
        """
        squares = np.add.reduceat(e * e, self.starts, axis=0)
        rows = self.count[:, joint]
        variance, _ = scales(squares, rows, len(squares))
        return losses(squares, rows, variance).sum(axis=0)

    def of(self, effect: Effect, joints: Joints) -> Screened | Untestable:
        """The best physical value of a law's nonlinear parameters."""
        nothing = ChosenEffect(effect, joints)
        if reason := effect.untestable(self.model.scene, joints):
            return Untestable(nothing, reason)
        thetas = effect.grid(self.model.scene, joints)
        if not thetas:
            return Untestable(nothing, "this motion has no values of its parameters to try")
        if isinstance(effect, Late):
            found = self._late(effect, joints, thetas)
        elif isinstance(effect, Erasing):
            found = self._erasing(effect, joints, thetas)
        else:
            found = self._law(effect, joints, thetas)
        reason = "its columns lie within the model already, or no value of them is physical"
        return found or Untestable(nothing, reason, True)

    def added(self, columns: Columns, prior: Effect) -> "Added | None":
        """Columns (m, k) of some joints beside the model; None where they lie within it."""
        scaled = {j: c * self.mask[j][:, None] for j, c in columns.items()}
        weighted = {j: c.T * self.weight[j] for j, c in scaled.items()}
        cross = sum((weighted[j] @ self.x[j] for j in scaled), NOTHING)  # (k, p)
        within = self.normal @ cross.T  # (p, k): the columns as the model fits them
        own = sum((weighted[j] @ c for j, c in scaled.items()), NOTHING)
        size = np.sqrt(np.maximum(np.diag(own), 1e-300))
        free = (own - cross @ within) / size[:, None] / size
        if not np.isfinite(free).all():
            return None
        free += np.diag(np.full(len(size), SMOOTHING) if prior.nameless else prior.precision(len(size)) / size**2)
        values, vectors = np.linalg.eigh(free)
        if values[-1] < WITHIN + SMOOTHING * prior.nameless:
            return None
        keep = values > NEGLIGIBLE
        toward = sum((weighted[j] @ self.e[j] for j in scaled), NOTHING) / size[:, None]
        half = (vectors[:, keep] / np.sqrt(values[keep])).T @ toward
        beta = (vectors[:, keep] / np.sqrt(values[keep])) @ half / size[:, None]
        return Added(self, scaled, within, (half**2).sum(axis=0), beta)

    @cached_property
    def normal(self) -> np.ndarray:
        """(X^T W X)^-1 (p, p) with prior precisions and penalties."""
        g = sum((v.T * w) @ v for v, w in zip(self.x, self.weight, strict=True))
        scale = 1 / np.sqrt(np.maximum(np.diag(g), 1e-300))
        extra = RIDGE + self.model.precision * scale**2 + self.model.fit.penalty
        return np.linalg.inv(g * scale[:, None] * scale + np.diag(extra)) * scale[:, None] * scale

    def _law(self, effect: Effect, joints: Joints, thetas: Sequence[Theta]) -> Screened | None:
        """Of every replicate the value of most gain, of the data that of the physical ones."""
        best, null = None, np.zeros(self.replicates)
        top, where = np.full(self.replicates, -np.inf), np.zeros(self.replicates, int)
        every: list[tuple[Theta, Added]] = []
        for theta, columns in self._grid(effect, joints, thetas):
            found = self.added(columns, effect)
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
            return None
        for number in np.unique(where):
            chosen = np.flatnonzero(where == number)
            null[chosen] = every[number][1].nats(chosen + 1)
        gain = best[1].nats(np.array([0]))
        choice = ChosenEffect(effect, joints, best[0])
        return Screened(
            choice, np.r_[gain, np.maximum(null, 0)], best[1].share, self, self.of_noise(choice, float(gain[0]))
        )

    def without(self, x: Screened) -> "Screen":
        """The screen whose replicates are made of what a law leaves, in the place of what the model leaves: where an
        effect is there, its pieces are no noise.
        """
        thetas = x.choice.effect.grid(self.model.scene, x.choice.joints)
        columns = dict(self._grid(x.choice.effect, x.choice.joints, thetas))[x.choice.theta]
        found, left = self.added(columns, x.choice.effect), self.e[..., 0].copy()
        assert found is not None, "it was screened"
        for j in range(len(left)):
            left[j] -= found.own(np.array([0]), j)[:, 0]
        return evolve(self, beside=left)

    def _late(self, effect: Effect, joints: Joints, thetas: Sequence[Theta]) -> Screened | None:
        """A lag or delay of the prediction: the whole design of its joints passes through it."""
        if any(self.model.late(j) for j in joints):
            return None
        skew = self.skew_of(joints)
        best, null = (-np.inf, thetas[0], 0.0), np.zeros(self.replicates)
        before = self.loss.sum(axis=0)
        for theta in thetas:
            x, y, equations = list(self.x), list(self.replicated), list(self.unpassed)
            for j in joints:
                x[j], given = self._passed(effect, j, theta)
                y[j] = y[j] + given
                y[j][:, 0] += skew[j]
                equations[j] = self._equations(j, x[j], y[j])
            beta = self._solved(equations)
            e = [v - u @ beta for u, v in zip(x, y, strict=True)]
            nats = before - sum(self.losses(v, j) for j, v in enumerate(e))
            null = np.maximum(null, nats[1:])
            best = max(best, (float(nats[0]), theta, self.explained([x[:, 0] for x in e])))
        choice = ChosenEffect(effect, joints, best[1])
        return Screened(choice, np.r_[best[0], null], best[2], self, self.of_noise(choice, best[0]))

    def explained(self, e: Sequence[np.ndarray]) -> float:
        """How much less (RMS) residuals (m,) of all joints hold than those of the data, over the torque's RMS, on the
        joint where it is most.
        """
        less = [
            float((w * (own[:, 0] ** 2 - v**2)).sum() / max((w * y**2).sum(), 1e-300))
            for own, v, w, y in zip(self.e, e, self.weight, self.y, strict=True)
        ]
        return float(np.sqrt(max(*less, 0.0)))

    def skew_of(self, joints: Joints) -> np.ndarray:
        """What sampling takes from the scaled torque (J, m) of some joints: a lag of theirs holds it."""
        out = self.model.skew * self.model.setting.slope[:, self.fitted] * self.mask
        return out * np.isin(np.arange(len(out)), joints)[:, None]

    def _passed(self, effect: Effect, joint: int, theta: Theta) -> tuple[np.ndarray, np.ndarray]:
        """The scaled design (m, p) of a joint through a lag or delay, and how that changes its scaled torque (m, 1): by
        the part of the prediction that is given.
        """
        key = effect.key, joint, theta
        if key not in self.columns:
            trial, setting = with_effect(self.model, ChosenEffect(effect, (joint,), theta)), self.model.setting
            given = setting.given[joint] - trial.given[joint]
            x, given = (v[self.fitted] * self.mask[joint][:, None] for v in (trial.design_of(joint), given[:, None]))
            self.columns[key] = x, given
        return self.columns[key]

    def _erasing(self, effect: Effect, joints: Joints, thetas: Sequence[Theta]) -> Screened | None:
        """Saturation or dead band: the delivered torque is explained, rows that it erases are charged."""
        (j,), model = joints, self.model
        if any(c.effect.key == effect.key for c in model.erasing(j)):
            return None
        best, null = (0.0, thetas[0]), np.zeros(self.replicates)
        blocks = slice(0, model.setting.rows.train_blocks)
        projection = self.normal @ (self.x[j].T * self.weight[j])
        for theta in thetas:
            trial = with_effect(model, ChosenEffect(effect, joints, theta))
            change = (trial.target[j] - model.target[j])[self.fitted] * self.mask[j]
            kept = trial.kept[j, self.fitted]
            e = self.e[j] * kept[:, None] + (change + self.e[j][:, 0] * (1 - kept))[:, None]
            e = e - self.x[j] @ (projection @ e)
            rows = self.count[:, j]
            variance, _ = scales(np.add.reduceat(e[:, :1] ** 2, self.starts, axis=0), rows, len(rows))
            changed = np.where(np.arange(len(self.x)) == j, model.variance * variance[0], model.variance)
            charge = (trial.log_density(changed) - model.log_density(model.variance))[blocks, j].sum()
            nats = self.loss[j] - self.losses(e, j) + charge
            null = np.maximum(null, nats[1:])
            best = max(best, (float(nats[0]), theta))
        return Screened(ChosenEffect(effect, joints, best[1]), np.r_[best[0], null], 1.0, self)

    def family(self, kind: Family, joint: int) -> Screened | None:
        """A nameless function on a joint."""
        choice = ChosenEffect(kind, (joint,))
        model = self.model

        def formed() -> Columns:
            return {joint: model.formed_now(choice, model.scene)[joint][self.fitted]}

        columns = self._formed_once(choice.key, kind.dynamic, (model.laws, model.late(joint)), formed)
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


def with_effect(model: Model, choice: ChosenEffect) -> Model:
    """The model with one more effect, columns formed from it as it stands."""
    return evolve(model, choices=(*model.choices, choice), seen=model.scene)


def screens(model: Model, replicates: int = REPLICATES) -> tuple[Screen, Screen]:
    """The plain and the robust screen of a model."""
    plain = Screen(model, robust=False, replicates=replicates)
    return plain, Screen(model, robust=True, columns=plain.columns, replicates=replicates)


def screened_laws(
    model: Model, effects: Sequence[Effect], near: Joints | None = None
) -> tuple[list[Screened], list[Untestable]]:
    """All laws beside a model (those on one of the joints `near`), most nats first, and what cannot be tested."""
    every = [
        [screen.of(effect, joints) for effect, joints in _looked_for(model, effects, near)] for screen in screens(model)
    ]
    untestable = [x for x in every[0] if isinstance(x, Untestable)]
    return _best_of([_against_bar([x for x in found if isinstance(x, Screened)]) for found in every]), untestable


def ranked_laws(model: Model, effects: Sequence[Effect], near: Joints) -> list[Screened]:
    """All laws beside a model on one of the joints `near`, most nats first, not held against chance."""
    sets = _looked_for(model, effects, near)
    every = [[screen.of(effect, joints) for effect, joints in sets] for screen in screens(model, replicates=0)]
    return _best_of([[x for x in found if isinstance(x, Screened)] for found in every])


def _looked_for(model: Model, effects: Sequence[Effect], near: Joints | None) -> list[tuple[Effect, Joints]]:
    taken, active = {c.key for c in model.choices}, set(model.active)
    return [
        (effect, joints)
        for effect in effects
        for joints in effect.joint_sets(model.scene)
        if (effect.key, joints) not in taken and set(joints) <= active and (near is None or set(joints) & set(near))
    ]


def screened_families(model: Model, near: Joints | None = None) -> list[Screened]:
    """All families beside a model, on the joints `near`, most nats first."""
    joints = [j for j in model.active if near is None or j in near]
    kinds = [(kind, j) for j in joints for kind in families(model.scene, j)]
    for number, c in enumerate(model.choices):
        plain = c.effect.signals and not (c.effect.smooths or c.effect.nameless or c.effect.actuator)
        if plain and len(c.joints) == 1 and c.joints[0] in joints:
            kinds += [(kind, c.joints[0]) for kind in varied(c.effect, c.joints[0], c.theta, model.beta(number))]
    every = [[x for kind, j in kinds if (x := screen.family(kind, j))] for screen in screens(model)]
    return _best_of(list(map(_against_bar, every)))


def _best_of(every: Sequence[list[Screened]]) -> list[Screened]:
    """Each hypothesis once, of the plain and of the robust screening the clearer one, most nats first."""
    best: dict[object, Screened] = {}
    for found in every:
        for x in found:
            key = x.choice.key
            if key not in best or (x.clear, x.gain[0]) > (best[key].clear, best[key].gain[0]):
                best[key] = x
    return sorted(best.values(), key=lambda x: -x.gain[0])


def _against_bar(found: list[Screened]) -> list[Screened]:
    """With z and whether each passes the bar of all of them and has a size of interest."""
    if not found:
        return []
    roots = np.cbrt(np.maximum([x.gain for x in found], 0))
    usual = float(np.median(roots[:, 1:].mean(axis=1))), float(np.median(roots[:, 1:].std(axis=1)))
    z = _standardised(roots, usual)
    largest = z[:, 1:].max(axis=0)
    scale = largest.std() * np.sqrt(6) / np.pi
    bar = largest.mean() - np.euler_gamma * scale - scale * np.log(-np.log(1 - ALPHA))
    known = [evolve(x, z=float(v), clear=bool(v > bar) and _counts(x)) for x, v in zip(found, z[:, 0], strict=True)]
    return [_looked_at_again(x, float(bar), usual) for x in known]


def _standardised(roots: np.ndarray, usual: tuple[float, float]) -> np.ndarray:
    """Roots (n, 1 + R) of gains in standard deviations of their replicates; of hardly any spread or mean, in half of
    the usual one of the library.
    """
    mean = np.maximum(roots[:, 1:].mean(axis=1), 0.5 * usual[0])
    std = np.maximum(roots[:, 1:].std(axis=1), 0.5 * usual[1])
    return (roots - mean[:, None]) / np.maximum(std, 1e-300)[:, None]


def _counts(x: Screened) -> bool:
    """Whether a gain has a size of interest and is no noise's."""
    return x.share > SIZE and not x.noise


def _looked_at_again(x: Screened, bar: float, usual: tuple[float, float]) -> Screened:
    """A law that does not pass the bar, beside replicates of what it leaves itself."""
    effect = x.choice.effect
    if x.clear or x.z < 1 or not _counts(x) or effect.nameless or isinstance(effect, Late | Erasing):
        return x
    again = x.screen.without(x).of(effect, x.choice.joints)
    if not isinstance(again, Screened):
        return x
    z = float(_standardised(np.cbrt(np.maximum(again.gain, 0))[None], usual)[0, 0])
    return evolve(x, z=z, clear=bool(z > bar)) if z > x.z else x
