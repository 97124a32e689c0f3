"""The model as it stands: the complete model with the effects chosen so far, fitted by blocks."""

from functools import cached_property

import numpy as np
from attrs import define, evolve, field, frozen

from cosim.closure.data.friction import FORMS, FrictionLaw, laws
from cosim.closure.data.setting import Setting
from cosim.closure.model.gram import Gram, GramFit, accumulate, fit
from cosim.effects import Effect, EffectEstimate, Scene
from cosim.effects.effect import Theta

FELT = 0.01  # of the squared torque of an effect: joints that have less of it do not count


@frozen
class ChosenEffect:
    """An effect on a set of joints (0-based) at values of its nonlinear parameters."""

    effect: Effect
    joints: tuple[int, ...]
    theta: Theta = ()

    @property
    def key(self) -> tuple[str, tuple[int, ...]]:
        return self.effect.key, self.joints


@define(eq=False)
class Model:
    """Complete model and chosen effects on a setting: weighted design (J, m, p), its normal equations and the fit.

    laws: one friction law a joint; skew [s]: how late the recorded torque acts because of sampling; weight (J,) one
    over the noise
    scale [1/(N.m)]; columns: those of each choice, joint -> (m, k).
    """

    setting: Setting
    laws: tuple[FrictionLaw, ...]
    skew: float
    weight: np.ndarray
    choices: tuple[ChosenEffect, ...] = ()
    columns: tuple[dict[int, np.ndarray], ...] = ()
    seen: Scene | None = None
    _cache: dict = field(factory=dict, repr=False)

    @cached_property
    def base(self) -> np.ndarray:
        """Design (J, m, p0) of the complete model, unweighted: linear columns, viscous and Coulomb friction of each
        joint.
        """
        s = self.setting
        count = len(s.names)
        out = np.zeros((s.joints, s.y.shape[1], count + 2 * s.joints))
        out[:, :, :count] = s.linear
        for j in range(s.joints):
            out[j, :, count + j] = s.viscous[j]
            out[j, :, count + s.joints + j] = self.sign(j)
        return out

    def sign(self, joint: int) -> np.ndarray:
        key = (joint, self.laws[joint])
        if key not in self._cache:
            self._cache[key] = self.setting.sign(*key)
        return self._cache[key]

    @cached_property
    def target(self) -> np.ndarray:
        """(J, m) what the columns have to make: the torque as chosen lags and delays deliver it, with the sampling skew
        taken out.
        """
        return _target(self, self.choices)

    @cached_property
    def scale(self) -> np.ndarray:
        """(J, m, 1) weight of each row; zero where a row is not used."""
        return (self.setting.use * self.weight[:, None])[..., None]

    @cached_property
    def design(self) -> np.ndarray:
        """Weighted design (J, m, p)."""
        blocks = [self.base, *(spread(c, self.setting) for c in self.columns)]
        return np.concatenate(blocks, axis=2) * self.scale

    @cached_property
    def y(self) -> np.ndarray:
        """Weighted target (J, m)."""
        return self.target * self.scale[..., 0]

    @cached_property
    def gram(self) -> Gram:
        rows = self.setting.rows
        run = np.zeros(rows.blocks, int)
        run[rows.block] = self.setting.motion.run[rows.index]
        normal = accumulate(self.design, self.y, rows.block, rows.blocks, rows.train_blocks)
        return evolve(normal, shrunk=self.setting.shrunk, group=run[: rows.train_blocks], precision=self.precision)

    @cached_property
    def precision(self) -> np.ndarray:
        """What is known of the coefficients (p,) before the data: Effect.precision of the chosen effects."""
        known = [
            c.effect.precision(next(iter(columns.values())).shape[1])
            for c, columns in zip(self.choices, self.columns, strict=True)
        ]
        return np.concatenate([np.zeros(self.base.shape[2]), *known])

    @property
    def normal(self) -> tuple[np.ndarray, np.ndarray, float]:
        """X^T X (p, p), X^T y (p,) and y^T y of the fitted rows."""
        t = self.setting.rows.train_blocks
        return tuple(x[:t].sum(axis=(0, 1)) for x in (self.gram.g, self.gram.h, self.gram.s))

    @cached_property
    def fit(self) -> GramFit:
        return fit(self.gram)

    @cached_property
    def residual(self) -> np.ndarray:
        """measured - predicted (J, m) [N.m] on all thinned rows, with the coefficients of the fitted rows."""
        blocks = [self.base, *(spread(c, self.setting) for c in self.columns)]
        return self.target - np.concatenate(blocks, axis=2) @ self.fit.beta

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients of the complete model."""
        n = range(1, self.setting.joints + 1)
        return (*self.setting.names, *(f"viscous[{k}]" for k in n), *(f"coulomb[{k}]" for k in n))

    def coefficients(self, number: int) -> slice:
        """Where the coefficients of choice `number` are."""
        sizes = [next(iter(c.values())).shape[1] for c in self.columns]
        start = self.base.shape[2] + sum(sizes[:number])
        return slice(start, start + sizes[number])

    def beta(self, number: int) -> np.ndarray:
        """Coefficients (k,) of choice `number` as fitted."""
        return self.fit.beta[self.coefficients(number)]

    def acting(self, number: int) -> tuple[int, ...]:
        """Joints (0-based) on which choice `number` acts: those with more than a share `FELT` of its squared torque. A
        wall that only one
        joint feels is a function of that joint's motion like others.
        """
        squares = {j: float(((x @ self.beta(number)) ** 2).sum()) for j, x in self.columns[number].items()}
        return tuple(sorted(j for j, square in squares.items() if square >= FELT * sum(squares.values())))

    def unphysical(self, number: int, scene: Scene | None = None) -> str:
        """Why the estimate of choice `number` cannot be its effect, beside the model or another scene; empty where it
        can.
        """
        return self.choices[number].effect.unphysical(self.estimate(number, scene))

    def estimate(self, number: int, scene: Scene | None = None) -> EffectEstimate:
        """Choice `number` as fitted, beside the model or another scene."""
        choice, part = self.choices[number], self.coefficients(number)
        return EffectEstimate(self.fit.beta[part], self.fit.std[part], choice.theta, choice.joints, scene or self.scene)

    @cached_property
    def scene(self) -> Scene:
        """What effects may look at, at the full rate, with the coefficients as fitted."""
        s, m, beta = self.setting, self.setting.motion, self.fit.beta
        p, nj = len(s.names), s.joints
        viscous, coulomb = beta[p : p + nj], beta[p + nj : p + 2 * nj]
        sign = np.stack([law(m.dq[:, j]) for j, law in enumerate(self.laws)], axis=1)
        rigid = s.full @ beta[:p] + s.known
        friction = viscous * m.dq + coulomb * sign
        pi = None
        if s.device == "phantom":
            pi = s.declared_pi if s.declared_pi is not None else beta[:8]
        scene = Scene(
            motion=m,
            device=s.device,
            sign=sign,
            rigid=rigid,
            friction=friction,
            prediction=rigid + friction,
            viscous=viscous,
            coulomb=coulomb,
            rigid_slopes=None if s.equations is None else self._slopes,
            pi=pi,
            declared=s.declared_pi is not None,
            gravity=s.gravity,
            skew=self.skew,
            units=s.units,
        )
        extra = np.zeros_like(rigid)
        for number, choice in enumerate(self.choices):
            if not choice.effect.actuator:
                for j, values in choice.effect.columns(self.seen or scene, choice.joints, choice.theta).items():
                    extra[:, j] += values @ self.beta(number)
        return evolve(scene, prediction=rigid + friction + extra)

    @cached_property
    def searched(self) -> Scene:
        """The scene as `Motion.searched` has it: where a search forms columns."""
        whole, (rows, motion) = self.scene, self.setting.motion.searched
        cut = {name: getattr(whole, name)[rows] for name in ("sign", "rigid", "friction", "prediction")}
        slopes = (
            None
            if whole.rigid_slopes is None
            else lambda joint: tuple({j: x[rows] for j, x in by.items()} for by in whole.rigid_slopes(joint))
        )
        return evolve(whole, motion=motion, rigid_slopes=slopes, **cut)

    def _slopes(self, joint: int) -> tuple[dict[int, np.ndarray], ...]:
        """Derivatives of the rigid torque by q_j, dq_j, ddq_j with the parameters as fitted, each joint -> (n,)."""
        s = self.setting
        params = self.fit.beta[: len(s.names)] if s.declared_pi is None else s.declared_pi
        return tuple({j: change @ params[used] for j, (used, change) in by.items()} for by in s.slopes(joint))

    def unseen(self, joint: int) -> np.ndarray:
        """Squared error (T,) of a joint's fitted blocks, each left out in turn [N^2 m^2]."""
        return self.fit.sse[: self.setting.rows.train_blocks, joint] / self.weight[joint] ** 2

    def joint_error(self) -> tuple[np.ndarray, np.ndarray]:
        """Squared error (T, J) of fitted blocks left out in turn and (H, J) of held-out blocks, weighted."""
        t = self.setting.rows.train_blocks
        return self.fit.sse[:t], self.fit.sse[t:]


def delivered_target(model: Model, choice: ChosenEffect) -> np.ndarray:
    """The model's target (J, m) with one more effect that acts on the recorded torque."""
    return _target(model, (*model.choices, choice))


def _target(model: Model, choices: tuple[ChosenEffect, ...]) -> np.ndarray:
    y, slope = model.setting.y.copy(), model.setting.slope.copy()
    for j in range(model.setting.joints):
        passed = tuple(c for c in choices if c.effect.late and j in c.joints)
        if passed:
            y[j], slope[j] = _delivered(model, j, passed)
    return y - model.skew * slope


def _delivered(model: Model, joint: int, choices: tuple[ChosenEffect, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Target and slope (m,) of a joint's recorded torque after these lags and delays."""
    key = ("delivered", joint, *((c.effect.key, c.theta) for c in choices))
    if key not in model._cache:
        tau = model.setting.motion.tau[:, [joint]]
        for c in choices:
            tau = c.effect.delivered(model.setting.motion, tau, c.theta)
        model._cache[key] = model.setting.target(joint, tau)
    return model._cache[key]


def spread(columns: dict[int, np.ndarray], setting: Setting) -> np.ndarray:
    """Columns of some joints as a design (J, m, k), zero elsewhere."""
    k = next(iter(columns.values())).shape[1]
    out = np.zeros((setting.joints, setting.y.shape[1], k))
    for j, values in columns.items():
        out[j] = values
    return out


def filtered(setting: Setting, effect: Effect, full: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Full-rate columns of an effect, filtered and thinned."""
    return {j: setting.rows.filtered(values, effect.sharp) for j, values in full.items()}


def complete(setting: Setting) -> Model:
    """The complete model: friction laws, sampling skew and weights fitted."""
    top = np.percentile(np.abs(setting.motion.dq), 99, axis=0)
    start = tuple(FrictionLaw("algebraic", 0.01 * float(v)) for v in top)
    scale = np.sqrt([np.mean(y[u] ** 2) if u.any() else 1.0 for y, u in zip(setting.y, setting.use, strict=True)])
    model = Model(setting, start, 0.0, 1 / np.maximum(scale, 1e-12))
    return settled(model)


def settled(model: Model) -> Model:
    """Friction laws and skew chosen by the fitted rows, weights from the residual; a second pass of the laws settles
    both.
    """
    model = _reweighted(model)
    model = _best_laws(model)
    return _reweighted(_best_skew(model))


def with_choices(model: Model, choices: tuple[ChosenEffect, ...], passes: int = 1) -> Model:
    """The model with these effects; dynamic columns are formed again from each new prediction."""
    scene = model.scene
    columns = tuple(columns_of(model, c, scene) for c in choices)
    new = Model(model.setting, model.laws, model.skew, model.weight, choices, columns, scene, model._cache)
    dynamic = any(c.effect.dynamic for c in choices)
    for _ in range(passes if dynamic else 0):
        scene = new.scene
        columns = tuple(
            columns_of(new, c, scene) if c.effect.dynamic else old for c, old in zip(choices, new.columns, strict=True)
        )
        new = evolve_model(new, columns=columns, seen=scene)
    return new


def columns_of(model: Model, choice: ChosenEffect, scene: Scene) -> dict[int, np.ndarray]:
    """Filtered columns of a choice, joint -> (m, k); those that do not hang on the model's prediction are kept."""
    laws_used = tuple(model.laws[j] for j in range(model.setting.joints))
    key = (choice.effect.key, choice.joints, choice.theta, laws_used)
    if choice.effect.dynamic:
        return filtered(model.setting, choice.effect, choice.effect.columns(scene, choice.joints, choice.theta))
    if key not in model._cache:
        model._cache[key] = filtered(
            model.setting, choice.effect, choice.effect.columns(scene, choice.joints, choice.theta)
        )
    return model._cache[key]


def evolve_model(model: Model, **changes) -> Model:
    """A new model with some fields changed (the fit is made anew)."""
    fields = {
        name: getattr(model, name) for name in ("setting", "laws", "skew", "weight", "choices", "columns", "seen")
    }
    return Model(**(fields | changes), cache=model._cache)


def train_error(model: Model) -> float:
    """Weighted squared error of the fitted rows, in sample."""
    return float(model.fit.in_sample[: model.setting.rows.train_blocks].sum())


def _reweighted(model: Model) -> Model:
    used = model.setting.use & ~model.setting.rows.test
    left = [np.sqrt(np.mean(r[u] ** 2)) if u.any() else 1.0 for r, u in zip(model.residual, used, strict=True)]
    return evolve_model(model, weight=1 / np.maximum(left, 1e-12))


def _best_laws(model: Model) -> Model:
    """Each joint's friction law in turn, the others held: the best of the coarse choices, then its width refined."""
    top = np.percentile(np.abs(model.setting.motion.dq), 99, axis=0)
    for j in range(model.setting.joints):
        error = {model.laws[j]: _law_error(model, j, model.laws[j])}
        error |= {law: _law_error(model, j, law) for law in laws(float(top[j])) if law not in error}
        for factor in (1.35, 1.16, 1.08, 1.04):
            close = [min((w for w in error if w.form == form and w.width > 0), key=error.get) for form in FORMS]
            for law in (evolve(law, width=law.width * f) for law in close for f in (factor, 1 / factor)):
                error[law] = _law_error(model, j, law)
        best = min(error, key=error.get)
        if best != model.laws[j]:
            model = evolve_model(model, laws=tuple(best if i == j else law for i, law in enumerate(model.laws)))
    return model


def _law_error(model: Model, joint: int, law: FrictionLaw) -> float:
    if (joint, law) not in model._cache:
        model._cache[joint, law] = model.setting.sign(joint, law)
    place = len(model.setting.names) + model.setting.joints + joint
    return _swap_error(model, place, joint, model._cache[joint, law])


def _swap_error(model: Model, place: int, joint: int, column: np.ndarray) -> float:
    """In-sample error of the fitted rows with one column that belongs to one joint replaced."""
    train = ~model.setting.rows.test
    g, h, left = (np.array(x) for x in model.normal)
    own = column[train] * model.scale[joint, train, 0]
    g[place] = own @ model.design[joint, train]
    g[place, place] = own @ own
    g[:, place], h[place] = g[place], own @ model.y[joint, train]
    scale = 1 / np.sqrt(np.maximum(np.diag(g), 1e-300))
    beta = np.linalg.solve(g * scale[:, None] * scale + np.diag(model.fit.penalty), h * scale) * scale
    return float(left - 2 * h @ beta + beta @ g @ beta)


def _best_skew(model: Model) -> Model:
    step = model.setting.motion.sample
    options = [evolve_model(model, skew=k * step) for k in (0.0, 0.5, 1.0)]
    return min(options, key=train_error)
