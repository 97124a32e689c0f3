"""The model as it stands: the complete model with the effects chosen so far, fitted by blocks."""

from functools import cached_property

import numpy as np
from attrs import define, evolve, field

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.formed import FormedColumns
from cosim.closure.model.friction import FORMS, FrictionLaw, laws
from cosim.closure.model.gram import Gram, GramFit, accumulate, fit
from cosim.closure.model.setting import Setting
from cosim.effects import Effect, EffectEstimate, Scene
from cosim.effects.motion import Columns, Joints, Slopes
from cosim.measured import Label

FELT = 0.01  # of the squared torque of an effect: joints with a smaller share do not count


@define(eq=False)
class Model:
    """Complete model and chosen effects on a setting: weighted design (J, m, p), its normal equations and the fit.

    laws: one friction law a joint; skew [s]: how late the recorded torque acts because of sampling; weight (J,): one
    over the noise scale [1/(N.m)]; columns: those of each choice, joint -> (m, k); seen: the scene that they were
    formed from; formed: columns that all models of the setting share.
    """

    setting: Setting
    laws: tuple[FrictionLaw, ...]
    skew: float
    weight: np.ndarray
    formed: FormedColumns = field(repr=False)
    choices: tuple[ChosenEffect, ...] = ()
    columns: tuple[Columns, ...] = ()
    seen: Scene | None = None

    @cached_property
    def base(self) -> np.ndarray:
        """Design (J, m, p0) of the complete model, unweighted: linear columns, viscous and Coulomb friction of each
        joint.
        """
        s = self.setting
        count = len(s.labels)
        out = np.zeros((s.joints, s.y.shape[1], count + 2 * s.joints))
        out[:, :, :count] = s.linear
        for j in range(s.joints):
            out[j, :, count + j] = s.viscous[j]
            out[j, :, count + s.joints + j] = self.sign(j)
        return out

    def sign(self, joint: int) -> np.ndarray:
        """The smooth sign (m,) of a joint by its friction law."""
        return self.formed.sign(joint, self.laws[joint])

    @cached_property
    def target(self) -> np.ndarray:
        """The torque (J, m) that the columns explain: behind the chosen lags and delays, without the sampling skew."""
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
        """Normal equations of every block."""
        rows = self.setting.rows
        run = np.zeros(rows.blocks, int)
        run[rows.block] = self.setting.motion.run[rows.index]
        normal = accumulate(self.design, self.y, rows.block, rows.blocks, rows.train_blocks)
        return evolve(normal, shrunk=self.setting.shrunk, group=run[: rows.train_blocks], precision=self.precision)

    @cached_property
    def precision(self) -> np.ndarray:
        """Prior precision of the coefficients (p,): Effect.precision of the chosen effects."""
        known = [
            c.effect.precision(next(iter(columns.values())).shape[1])
            for c, columns in zip(self.choices, self.columns, strict=True)
        ]
        return np.concatenate([np.zeros(self.base.shape[2]), *known])

    @property
    def normal(self) -> tuple[np.ndarray, np.ndarray, float]:
        """X^T X (p, p), X^T y (p,) and y^T y of the fitted rows."""
        t = self.setting.rows.train_blocks
        g, h, s = (x[:t].sum(axis=(0, 1)) for x in (self.gram.g, self.gram.h, self.gram.s))
        return g, h, s

    @cached_property
    def fit(self) -> GramFit:
        """Coefficients with their spread, and errors of every block."""
        return fit(self.gram)

    @cached_property
    def residual(self) -> np.ndarray:
        """measured - predicted (J, m) [N.m] on all thinned rows, with the coefficients of the fitted rows."""
        blocks = [self.base, *(spread(c, self.setting) for c in self.columns)]
        return self.target - np.concatenate(blocks, axis=2) @ self.fit.beta

    @property
    def labels(self) -> tuple[Label, ...]:
        """Labels of the coefficients of the complete model."""
        n = range(1, self.setting.joints + 1)
        return (*self.setting.labels, *(Label("viscous", k) for k in n), *(Label("coulomb", k) for k in n))

    @property
    def friction_levels(self) -> tuple[np.ndarray, np.ndarray]:
        """Viscous and Coulomb coefficients (J,) as fitted."""
        p, nj = len(self.setting.labels), self.setting.joints
        return self.fit.beta[p : p + nj], self.fit.beta[p + nj : p + 2 * nj]

    def coefficients(self, number: int) -> slice:
        """The range of the coefficients of choice `number`."""
        sizes = [next(iter(c.values())).shape[1] for c in self.columns]
        start = self.base.shape[2] + sum(sizes[:number])
        return slice(start, start + sizes[number])

    def beta(self, number: int) -> np.ndarray:
        """Coefficients (k,) of choice `number` as fitted."""
        return self.fit.beta[self.coefficients(number)]

    def acting(self, number: int) -> Joints:
        """Joints (0-based) on which choice `number` acts: those with more than a share `FELT` of its squared torque.

        A wall that pushes on one joint alone is a function of that joint's motion, like other effects of one joint.
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
        """The motion and the model as fitted, at the full rate, for effects to look at."""
        s, m = self.setting, self.setting.motion
        viscous, coulomb = self.friction_levels
        sign = np.stack([law(m.dq[:, j]) for j, law in enumerate(self.laws)], axis=1)
        rigid = s.body.columns @ self.fit.beta[: len(s.labels)] + s.body.known
        friction = viscous * m.dq + coulomb * sign
        scene = Scene(
            motion=m,
            device=s.device,
            sign=sign,
            rigid=rigid,
            friction=friction,
            prediction=rigid + friction,
            viscous=viscous,
            coulomb=coulomb,
            rigid_slopes=None if s.body.equations is None else self._rigid_slopes,
            arm=s.arm,
            pi=None if s.arm is None else s.body.parameters(self.fit.beta),
            declared=s.body.declared is not None,
            gravity=s.device.gravity,
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
        """The scene on the rows of `SmoothedMotion.searched`, where a search forms columns."""
        whole, (rows, motion) = self.scene, self.setting.motion.searched
        cut = {name: getattr(whole, name)[rows] for name in ("sign", "rigid", "friction", "prediction")}

        def slopes(joint: int) -> Slopes:
            q, dq, ddq = ({j: x[rows] for j, x in by.items()} for by in self._rigid_slopes(joint))
            return q, dq, ddq

        known = None if whole.rigid_slopes is None else slopes
        return evolve(whole, motion=motion, arm=self.setting.searched_arm, rigid_slopes=known, **cut)

    def _rigid_slopes(self, joint: int) -> Slopes:
        """Derivatives of the rigid torque by q, dq, ddq of a joint as fitted, each joint -> (n,)."""
        params = self.setting.body.parameters(self.fit.beta)
        q, dq, ddq = (
            {j: change @ params[used] for j, (used, change) in by.items()} for by in self.setting.slopes(joint)
        )
        return q, dq, ddq

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
            y[j], slope[j] = model.formed.delivered(j, passed)
    return y - model.skew * slope


def spread(columns: Columns, setting: Setting) -> np.ndarray:
    """Columns of some joints as a design (J, m, k), zero elsewhere."""
    k = next(iter(columns.values())).shape[1]
    out = np.zeros((setting.joints, setting.y.shape[1], k))
    for j, values in columns.items():
        out[j] = values
    return out


def filtered(setting: Setting, effect: Effect, full: Columns) -> Columns:
    """Full-rate columns of an effect, filtered and thinned."""
    return {j: setting.rows.filtered(values, effect.sharp) for j, values in full.items()}


def complete(setting: Setting) -> Model:
    """The complete model: friction laws, sampling skew and weights fitted."""
    top = np.percentile(np.abs(setting.motion.dq), 99, axis=0)
    start = tuple(FrictionLaw("algebraic", 0.01 * float(v)) for v in top)
    scale = np.sqrt([np.mean(y[u] ** 2) if u.any() else 1.0 for y, u in zip(setting.y, setting.use, strict=True)])
    model = Model(setting, start, 0.0, 1 / np.maximum(scale, 1e-12), FormedColumns(setting))
    return settled(model)


def settled(model: Model) -> Model:
    """The model with friction laws and skew chosen by the fitted rows, and weights from the residual."""
    model = _reweighted(model)
    model = _best_laws(model)
    return _reweighted(_best_skew(model))


def with_choices(model: Model, choices: tuple[ChosenEffect, ...], passes: int = 1) -> Model:
    """The model with these effects; dynamic columns are formed again from each new prediction."""
    scene = model.scene
    columns = tuple(columns_of(model, c, scene) for c in choices)
    new = Model(model.setting, model.laws, model.skew, model.weight, model.formed, choices, columns, scene)
    dynamic = any(c.effect.dynamic for c in choices)
    for _ in range(passes if dynamic else 0):
        scene = new.scene
        columns = tuple(
            columns_of(new, c, scene) if c.effect.dynamic else old for c, old in zip(choices, new.columns, strict=True)
        )
        new = evolve(new, columns=columns, seen=scene)
    return new


def columns_of(model: Model, choice: ChosenEffect, scene: Scene) -> Columns:
    """Filtered columns of a choice, joint -> (m, k). Those that do not depend on the model's prediction are kept."""

    def form() -> Columns:
        return filtered(model.setting, choice.effect, choice.effect.columns(scene, choice.joints, choice.theta))

    return form() if choice.effect.dynamic else model.formed.static(choice, model.laws, form)


def train_error(model: Model) -> float:
    """Weighted squared error of the fitted rows, in sample."""
    return float(model.fit.in_sample[: model.setting.rows.train_blocks].sum())


def _reweighted(model: Model) -> Model:
    used = model.setting.use & ~model.setting.rows.test
    left = [np.sqrt(np.mean(r[u] ** 2)) if u.any() else 1.0 for r, u in zip(model.residual, used, strict=True)]
    return evolve(model, weight=1 / np.maximum(left, 1e-12))


def _best_laws(model: Model) -> Model:
    """Each joint's friction law in turn, the others held: the best of the coarse choices, then its width refined."""
    top = np.percentile(np.abs(model.setting.motion.dq), 99, axis=0)
    for j in range(model.setting.joints):
        error = {model.laws[j]: _law_error(model, j, model.laws[j])}
        error |= {law: _law_error(model, j, law) for law in laws(float(top[j])) if law not in error}
        for factor in (1.35, 1.16, 1.08, 1.04):
            close = [min((w for w in error if w.form == form and w.width > 0), key=error.__getitem__) for form in FORMS]
            for law in (evolve(law, width=law.width * f) for law in close for f in (factor, 1 / factor)):
                error[law] = _law_error(model, j, law)
        best = min(error, key=error.__getitem__)
        if best != model.laws[j]:
            model = evolve(model, laws=tuple(best if i == j else law for i, law in enumerate(model.laws)))
    return model


def _law_error(model: Model, joint: int, law: FrictionLaw) -> float:
    place = len(model.setting.labels) + model.setting.joints + joint
    return _swap_error(model, place, joint, model.formed.sign(joint, law))


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
    options = [evolve(model, skew=k * step) for k in (0.0, 0.5, 1.0)]
    return min(options, key=train_error)
