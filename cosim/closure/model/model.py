"""A hypothesis about the recorded torque: the complete model with some laws and nameless functions, fitted by blocks.

    u_i = [ A ( X beta + sum_k C_k(theta_k) beta_k ) ]_i + e_i          for the rows i in motion of each joint

X: rigid body, viscous and Coulomb friction with a fitted smooth sign, and the tangent of that sign's width, so that its
misfit is no evidence. A: what a lag or delay does to the *prediction* (u = p + T dp/dt, u(t) = p(t + d)). Saturation
and dead band have no inverse: the delivered torque T(u) is explained, and each row carries log J, its change of
variables.
"""

from collections.abc import Iterable
from functools import cached_property

import numpy as np
from attrs import define, evolve, field

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.formed import FormedColumns
from cosim.closure.model.friction import FORMS, FrictionLaw, laws
from cosim.closure.model.gram import Gram, GramFit, accumulate, fit
from cosim.closure.model.setting import Setting
from cosim.effects import EffectEstimate, Scene
from cosim.effects.actuator import Erasing, Late
from cosim.effects.constants import HALF
from cosim.effects.motion import Columns, Joints, Slopes
from cosim.measured import Label

FELT = 0.01  # of the squared torque of an effect: joints with a smaller share do not count
FEWEST_ROWS = 50  # of a joint that is judged
TANGENT = 1.03  # factor of the width between whose sides the tangent lies


@define(eq=False)
class Model:
    """Complete model and chosen effects on a setting: weighted design (J, m, p), its normal equations and the fit.

    laws: one friction law a joint; skew [s]: how late the recorded torque acts because of sampling; weight (J,): one
    over the noise scale [1/(N.m)]; seen: the scene that columns are formed from, None for a model without effects;
    formed: columns that all models of the setting share; tangents: whether the width of each sign is left free.
    """

    setting: Setting
    laws: tuple[FrictionLaw, ...]
    skew: float
    weight: np.ndarray
    formed: FormedColumns = field(repr=False)
    choices: tuple[ChosenEffect, ...] = ()
    seen: Scene | None = None
    tangents: bool = True

    def late(self, joint: int) -> ChosenEffect | None:
        """The lag or delay of a joint, of which there is one at most."""
        return next((c for c in self.choices if isinstance(c.effect, Late) and joint in c.joints), None)

    def erasing(self, joint: int) -> tuple[ChosenEffect, ...]:
        """Saturation and dead band of a joint."""
        return tuple(c for c in self.choices if isinstance(c.effect, Erasing) and joint in c.joints)

    @cached_property
    def base(self) -> np.ndarray:
        """Design (J, m, p0) of the complete model, unweighted."""
        return np.stack([self._base(j) for j in range(self.setting.joints)])

    def _base(self, joint: int) -> np.ndarray:
        key = joint, self.laws[joint], self.late(joint), self.tangents
        if key not in self.formed.base:
            self.formed.keep_base(key, self._base_of(joint))
        return self.formed.base[key]

    def _base_of(self, joint: int) -> np.ndarray:
        """(m, p0): linear columns, then viscous, Coulomb and width of each joint."""
        s, law, late = self.setting, self.laws[joint], self.late(joint)
        count, nj = len(s.labels), s.joints
        dq = s.motion.dq[:, [joint]]
        out = np.zeros((s.y.shape[1], count + (3 if self.tangents else 2) * nj))
        body = s.body.columns[:, joint]
        if late is None:
            out[:, :count] = s.linear[joint]
        elif count:
            out[:, :count] = self.passed(body, s.device.recorded_columns, joint)
        out[:, [count + joint]] = self.passed(dq, False, joint)
        out[:, [count + nj + joint]] = self.passed(law(dq), True, joint)
        if self.tangents and law.width > 0:
            wide, narrow = (evolve(law, width=law.width * f)(dq) for f in (TANGENT, 1 / TANGENT))
            out[:, [count + 2 * nj + joint]] = self.passed((wide - narrow) / (2 * np.log(TANGENT)), True, joint)
        return out

    def passed(self, full: np.ndarray, sharp: bool, joint: int) -> np.ndarray:
        """Full-rate columns (n, k) of a joint's prediction, through its lag or delay, filtered and thinned (m, k)."""
        s, late = self.setting, self.late(joint)
        if late is None:
            return s.rows.filtered(full, sharp)
        assert isinstance(late.effect, Late), "what is late has a command"
        m = s.motion
        dense = m.smooth(full, m.widths.total if sharp else m.widths.second)
        return late.effect.command(m, dense, s.rows.index, late.theta)

    @cached_property
    def given(self) -> np.ndarray:
        """What is given of the torque (J, m), through lags and delays."""
        s, out = self.setting, self.setting.given.copy()
        for j in range(s.joints):
            if self.late(j):
                out[j] = self.passed(s.body.known[:, [j]], s.device.recorded_columns, j)[:, 0]
        return out

    @cached_property
    def columns(self) -> tuple[Columns, ...]:
        """Filtered columns of each choice, joint -> (m, k); none of effects that act on the whole prediction."""
        return tuple(self.columns_of(c) for c in self.choices)

    def columns_of(self, choice: ChosenEffect, scene: Scene | None = None) -> Columns:
        """Filtered columns of a choice, formed from a scene; those that depend on neither model nor lag are kept for
        all models.
        """
        if isinstance(choice.effect, Late | Erasing):
            return {j: np.zeros((len(self.setting.rows.index), 0)) for j in choice.joints}
        scene = scene or self.seen or self.scene
        if choice.effect.dynamic:
            return self.formed_now(choice, scene)
        key = choice.effect.key, choice.joints, choice.theta, scene.laws, tuple(map(self.late, choice.joints))
        if key not in self.formed.static:
            self.formed.keep_static(key, self.formed_now(choice, scene))
        return self.formed.static[key]

    def formed_now(self, choice: ChosenEffect, scene: Scene) -> Columns:
        """As `columns_of`, for an effect with columns of its own, and kept nowhere: one of many that are tried."""
        full = choice.effect.columns(scene, choice.joints, choice.theta)
        return {j: self.passed(values, choice.effect.sharp, j) for j, values in full.items()}

    @cached_property
    def delivered(self) -> tuple[np.ndarray, np.ndarray]:
        """The torque (J, m) to explain, and the share (J, m) of each row's kernel that no effect erases."""
        s = self.setting
        y, kept = s.y.copy(), np.ones_like(s.y)
        for j in range(s.joints):
            if self.late(j) is None:
                y[j] -= self.skew * s.slope[j]
            else:
                y[j] += s.given[j] - self.given[j]
            if erasing := self.erasing(j):
                lost, left = self.formed.erased(j, erasing)
                y[j] -= lost
                kept[j] = left
        return y, kept

    @property
    def target(self) -> np.ndarray:
        """The torque (J, m) that the columns explain, without the sampling skew."""
        return self.delivered[0]

    @property
    def kept(self) -> np.ndarray:
        """Share (J, m) of each row that saturation and dead band leave."""
        return self.delivered[1]

    @cached_property
    def scale(self) -> np.ndarray:
        """(J, m, 1) weight of each row; zero where a row is not used."""
        return (self.setting.use * self.weight[:, None])[..., None]

    @cached_property
    def unweighted(self) -> np.ndarray:
        """Design (J, m, p) of all rows."""
        if not self.choices:
            return self.base
        return np.concatenate([self.base, *(spread(c, self.setting) for c in self.columns)], axis=2)

    def design_of(self, joint: int) -> np.ndarray:
        """Design (m, p) of one joint, formed anew: for one of many lags or delays that are tried."""
        none = len(self.setting.rows.index)
        parts = (c.get(joint, np.zeros((none, _width(c)))) for c in self.columns)
        return np.concatenate([self._base_of(joint), *parts], axis=1)

    @cached_property
    def gram(self) -> Gram:
        """Normal equations of every block."""
        rows = self.setting.rows
        run = np.zeros(rows.blocks, int)
        run[rows.block] = self.setting.motion.run[rows.index]
        y = self.target * self.scale[..., 0]
        normal = accumulate(self.unweighted * self.scale, y, rows.block, rows.blocks, rows.train_blocks)
        return evolve(
            normal,
            shrunk=self.setting.shrunk,
            group=run[: rows.train_blocks],
            precision=self.precision,
            smooth=self.smooth,
        )

    @cached_property
    def precision(self) -> np.ndarray:
        """Prior precision of the coefficients (p,): Effect.precision of the chosen effects."""
        known = [c.effect.precision(_width(x)) for c, x in zip(self.choices, self.columns, strict=True)]
        return np.concatenate([np.zeros(self.base.shape[2]), *known])

    @cached_property
    def smooth(self) -> np.ndarray:
        """(p,) one for columns of nameless functions."""
        known = [np.full(_width(x), float(c.effect.nameless)) for c, x in zip(self.choices, self.columns, strict=True)]
        return np.concatenate([np.zeros(self.base.shape[2]), *known])

    @cached_property
    def normal(self) -> tuple[np.ndarray, np.ndarray, float]:
        """X^T X (p, p), X^T y (p,) and y^T y of the fitted rows, blocks weighted as in the fit."""
        t, w = self.setting.rows.train_blocks, self.fit.weight
        g, h, s = self.gram.g[:t], self.gram.h[:t], self.gram.s[:t]
        return np.einsum("bjpq,bj->pq", g, w[:t]), np.einsum("bjp,bj->p", h, w[:t]), float((s * w[:t]).sum())

    @cached_property
    def fit(self) -> GramFit:
        """Coefficients with their spread, and errors of every block."""
        return fit(self.gram)

    def log_density(self, variance: np.ndarray) -> np.ndarray:
        """Of the change of variables (B, J) of each block: a row that saturation or dead band erases is charged with
        the marginal density of what it lost. Zero without such effects. variance (J,) of a row [N^2 m^2].
        """
        s, out = self.setting, np.zeros((self.setting.rows.blocks, self.setting.joints))
        for j in range(s.joints):
            if not (erasing := self.erasing(j)):
                continue
            u = s.motion.tau_raw[:, j]
            known = [c.effect.lost_density(u, c.theta) for c in erasing if isinstance(c.effect, Erasing)]
            dearest = min((d for d in known if d > 0), default=0.0)
            share = min(1.0, np.sqrt(2 * np.pi * variance[j]) * dearest)
            rows = np.log(np.maximum(self.kept[j] + (1 - self.kept[j]) * share, 1e-12)) * s.use[j]
            out[:, j] = np.bincount(s.rows.block, rows, minlength=s.rows.blocks)
        return out

    @cached_property
    def variance(self) -> np.ndarray:
        """Variance (J,) [N^2 m^2] of a row of a usual block, left out of the fit."""
        return self.fit.variance / self.weight**2

    @cached_property
    def nats(self) -> np.ndarray:
        """Log density (T, J) of the recorded torque of each fitted block, left out of the fit, without constants."""
        t = self.setting.rows.train_blocks
        return (self.log_density(self.variance) - self.fit.loss + self.gram.rows * np.log(self.weight))[:t]

    @property
    def active(self) -> Joints:
        """Joints (0-based) with enough fitted rows in motion to be judged."""
        enough = (self.setting.use & ~self.setting.rows.test).sum(axis=1) > FEWEST_ROWS
        return tuple(np.flatnonzero(enough).tolist())

    def score(self, joints: Iterable[int] | None = None) -> float:
        """Log density of the recorded torque of joints (all that are judged), fitted blocks left out in turn [nats]."""
        return float(self.nats[:, list(self.active if joints is None else joints)].sum())

    @cached_property
    def residual(self) -> np.ndarray:
        """measured - predicted (J, m) [N.m] on all thinned rows, with the coefficients of the fitted rows."""
        return self.target - self.unweighted @ self.fit.beta

    @cached_property
    def told(self) -> np.ndarray:
        """Rows (J, m) of which the model tells the command: those of which nothing is lost that the torque does not
        tell; all where all is.
        """
        out = np.ones_like(self.setting.use)
        for j in range(self.setting.joints):
            lost = (c for c in self.erasing(j) if isinstance(c.effect, Erasing) and not c.effect.tells(c.theta))
            if silent := tuple(lost):
                out[j] = self.formed.erased(j, silent)[1] > HALF
        return out | ~out.any(axis=1, keepdims=True)

    @cached_property
    def miss(self) -> np.ndarray:
        """recorded - predicted command (J, m) [N.m]: the residual, but behind a dead band the command that the model
        tells of, so that no hypothesis has a smaller error by making the record easier.
        """
        out = self.residual.copy()
        for j in range(self.setting.joints):
            if not (erasing := self.erasing(j)):
                continue
            torque = command = self.scene.prediction[:, [j]]
            for choice in erasing:
                assert isinstance(choice.effect, Erasing)
                command = choice.effect.command(command, choice.theta)
            out[j] += self.formed.erased(j, erasing)[0] - self.passed(command - torque, True, j)[:, 0]
        return out

    @property
    def labels(self) -> tuple[Label, ...]:
        """Labels of the coefficients of rigid body, viscous and Coulomb friction."""
        n = range(1, self.setting.joints + 1)
        return (*self.setting.labels, *(Label("viscous", k) for k in n), *(Label("coulomb", k) for k in n))

    @property
    def friction_levels(self) -> tuple[np.ndarray, np.ndarray]:
        """Viscous and Coulomb coefficients (J,) as fitted."""
        p, nj = len(self.setting.labels), self.setting.joints
        return self.fit.beta[p : p + nj], self.fit.beta[p + nj : p + 2 * nj]

    def coefficients(self, number: int) -> slice:
        """The range of the coefficients of choice `number`."""
        sizes = [_width(c) for c in self.columns]
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

    def unphysical(self, number: int) -> str:
        """Why the estimate of choice `number` cannot be its effect; empty where it can."""
        return self.choices[number].effect.unphysical(self.estimate(number))

    def estimate(self, number: int) -> EffectEstimate:
        """Choice `number` as fitted."""
        choice, part = self.choices[number], self.coefficients(number)
        return EffectEstimate(self.fit.beta[part], self.fit.std[part], choice.theta, choice.joints, self.scene)

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
            declared=s.body.trusted,
            gravity=s.device.gravity,
            units=s.units,
            laws=self.laws,
        )
        extra = np.zeros_like(rigid)
        for number, choice in enumerate(self.choices):
            if not choice.effect.actuator:
                for j, values in choice.effect.columns(self.seen or scene, choice.joints, choice.theta).items():
                    extra[:, j] += values @ self.beta(number)
        return evolve(scene, prediction=rigid + friction + extra)

    def _rigid_slopes(self, joint: int) -> Slopes:
        """Derivatives of the rigid torque by q, dq, ddq of a joint as fitted, each joint -> (n,)."""
        params = self.setting.body.parameters(self.fit.beta)
        q, dq, ddq = (
            {j: change @ params[used] for j, (used, change) in by.items()} for by in self.setting.slopes(joint)
        )
        return q, dq, ddq


def _width(columns: Columns) -> int:
    return next(iter(columns.values())).shape[1]


def spread(columns: Columns, setting: Setting) -> np.ndarray:
    """Columns of some joints as a design (J, m, k), zero elsewhere."""
    out = np.zeros((setting.joints, setting.y.shape[1], _width(columns)))
    for j, values in columns.items():
        out[j] = values
    return out


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
    new = evolve(model, choices=choices, seen=model.scene)
    for _ in range(passes if any(c.effect.dynamic for c in choices) else 0):
        new = evolve(new, seen=new.scene)
    return new


def with_effect(model: Model, choice: ChosenEffect) -> Model:
    """The model with one more effect, columns formed from it as it stands."""
    return evolve(model, choices=(*model.choices, choice), seen=model.scene)


def _reweighted(model: Model) -> Model:
    scale = np.sqrt(model.fit.variance) / model.weight
    return evolve(model, weight=np.where(model.setting.use.any(axis=1), 1 / np.maximum(scale, 1e-12), model.weight))


def _best_laws(model: Model) -> Model:
    """Each joint's friction law in turn, the others held: the best of the coarse choices, then its width refined."""
    model = evolve(model, tangents=False)
    for j in range(model.setting.joints):
        error = {model.laws[j]: _law_error(model, j, model.laws[j])}
        error |= {law: _law_error(model, j, law) for law in friction_laws(model, j) if law not in error}
        for factor in (1.35, 1.16, 1.08, 1.04):
            close = [min((w for w in error if w.form == form and w.width > 0), key=error.__getitem__) for form in FORMS]
            for law in (evolve(law, width=law.width * f) for law in close for f in (factor, 1 / factor)):
                error[law] = _law_error(model, j, law)
        best = min(error, key=error.__getitem__)
        if best != model.laws[j]:
            model = with_friction(model, j, best)
    return evolve(model, tangents=True)


def friction_laws(model: Model, joint: int) -> tuple[FrictionLaw, ...]:
    """The friction laws that a joint's speeds let choose from."""
    return laws(float(np.percentile(np.abs(model.setting.motion.dq[:, joint]), 99)))


def with_friction(model: Model, joint: int, law: FrictionLaw) -> Model:
    """The model with another friction law of a joint."""
    return evolve(model, laws=(*model.laws[:joint], law, *model.laws[joint + 1 :]))


def _law_error(model: Model, joint: int, law: FrictionLaw) -> float:
    """In-sample error of the fitted rows with the Coulomb column of a joint replaced."""
    place = len(model.setting.labels) + model.setting.joints + joint
    rows = model.setting.rows
    key = joint, law, model.late(joint)
    if key not in model.formed.signs:
        model.formed.signs[key] = model.passed(law(model.setting.motion.dq[:, [joint]]), True, joint)[:, 0]
    block = np.sqrt(model.fit.weight[rows.block, joint])
    scale = model.scale[joint, :, 0] * block * ~rows.test
    own = model.formed.signs[key] * scale
    x, y = model.unweighted[joint], model.target[joint] * scale
    g, h, left = (np.array(v) for v in model.normal)
    g[place] = own @ (x * scale[:, None])
    g[place, place] = own @ own
    g[:, place], h[place] = g[place], own @ y
    held, beta = np.ones(len(h), bool), np.zeros(len(h))
    for _ in range(2):  # friction that drives is none: a level below zero is held at zero
        size = 1 / np.sqrt(np.maximum(np.diag(g)[held], 1e-300))
        within = g[np.ix_(held, held)] * size[:, None] * size + np.diag(model.fit.penalty[held])
        beta = np.zeros(len(h))
        beta[held] = np.linalg.solve(within, h[held] * size) * size
        if beta[place] >= 0:
            break
        held[place] = False
    return float(left - 2 * h @ beta + beta @ g @ beta)


def _best_skew(model: Model) -> Model:
    step = model.setting.motion.sample
    options = [evolve(model, skew=k * step) for k in (0.0, 0.5, 1.0)]
    return min(options, key=lambda m: m.fit.loss[: m.setting.rows.train_blocks].sum())
