"""Candidates: every effect of the library on every set of joints, at the best values of its nonlinear parameters."""

from collections.abc import Collection, Iterable, Sequence

import numpy as np
from attrs import evolve, frozen

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.formed import Grid
from cosim.closure.model.model import Model, delivered_target
from cosim.effects import Effect, EffectEstimate
from cosim.effects.motion import Columns, Joints, Theta

Option = tuple[float, Theta, np.ndarray]
"""Gain, theta and coefficients of one regression."""

CHUNK = 24  # values of nonlinear parameters whose columns are formed at once, to limit memory
COLLINEAR = 2e-3  # a column of which the model leaves a smaller share unexplained counts as part of it
REFINED = 0.1  # gain above which nonlinear parameters are refined before the evidence is weighed
FIRST_STEP, BETWEEN = 0.1, 0.5  # first and largest change of that refinement
MOVES = 9  # trials of that refinement, times one more than the number of parameters
CLEARLY = 0.03  # share of the error left that an unphysical trial has to remove beyond the best physical one
KNOWN = 0.1  # share of a coefficient that it may be off by where a screening asks whether it is physical
PARSIMONY = 1.03  # factor by which an option with one more column has to leave a smaller error


@frozen(eq=False)
class Candidate:
    """One effect on one set of joints at its best theta, screened on the fitted rows.

    gain: share of the squared error of its joints that it removes in sample; beta (k,); tried: number of regressions
    that were searched; reason: why it cannot be the effect (not testable, not physical), empty where it can.
    """

    choice: ChosenEffect
    gain: float
    beta: np.ndarray
    tried: int
    reason: str = ""
    untestable: bool = False


def screen(model: Model, effects: Sequence[Effect], near: Collection[int] | None = None) -> list[Candidate]:
    """All candidates that may be added to the model (those on one of the joints `near`), best gain first; untestable
    ones last.
    """
    normal = Normal(model)
    taken = {c.key for c in model.choices}
    found = []
    for effect in effects:
        for joints in effect.joint_sets(model.scene):
            if (effect.name, joints) not in taken and (near is None or set(joints) & set(near)):
                found.append(screened(model, normal, effect, joints))
    return sorted(found, key=lambda c: (c.untestable, -c.gain))


def screened(model: Model, normal: "Normal", effect: Effect, joints: Joints) -> Candidate:
    """One effect on one set of joints, at the best of its grid."""
    nothing = Candidate(ChosenEffect(effect, joints), 0.0, np.zeros(0), 0)
    if reason := effect.untestable(model.scene, joints):
        return Candidate(nothing.choice, 0.0, nothing.beta, 0, reason, True)
    options: list[Option] = []
    for theta, columns in _all_columns(model, effect, joints):
        result = normal.gain_of(ChosenEffect(effect, joints, theta), columns)
        if result is not None:
            options.append((result[0], theta, result[1]))
    if not options:
        return Candidate(nothing.choice, 0.0, nothing.beta, 0, "its columns lie within the model already", True)
    return _best(model, normal, effect, joints, options)


def _best(model: Model, normal: "Normal", effect: Effect, joints: Joints, options: list[Option]) -> Candidate:
    """The physical option with the largest gain, refined; the best unphysical one where that explains more than twice
    as much.
    """
    base, tried, first = normal.error(joints), len(options), None
    options.sort(
        key=lambda option: (base - option[0]) * PARSIMONY ** len(option[2]) * effect.handicap(model.scene, option[1])
    )
    for gain, theta, beta in options:
        reason = _why_not(model, ChosenEffect(effect, joints, theta), beta, KNOWN)
        candidate = Candidate(ChosenEffect(effect, joints, theta), gain / base, beta, tried, reason)
        first = first or candidate
        if not reason:
            found = _refined(model, normal, candidate, base) if candidate.gain > REFINED else candidate
            return found if found.gain > 0.5 * first.gain else first
    assert first is not None, "there is at least one option"
    return first


def _why_not(model: Model, choice: ChosenEffect, beta: np.ndarray, known: float) -> str:
    """Why coefficients of a screening cannot be the effect; `known`: assumed standard deviation, as a share of each."""
    return choice.effect.unphysical(
        EffectEstimate(beta, np.abs(beta) * known, choice.theta, choice.joints, model.scene)
    )


def _refined(model: Model, normal: "Normal", candidate: Candidate, base: float) -> Candidate:
    """A promising candidate with its continuous nonlinear parameters moved to the largest gain that is physical
    (Nelder, Mead 1965); every trial is counted. An unphysical one that does clearly better is what the data say, and is
    returned.
    """
    from scipy.optimize import minimize

    choice = candidate.choice
    free = choice.effect.continuous(choice.theta)
    if not free:
        return candidate
    found: dict[Theta, tuple[float, np.ndarray]] = {choice.theta: (candidate.gain * base, candidate.beta)}
    refused: dict[Theta, tuple[float, np.ndarray]] = {}

    def loss(x: np.ndarray) -> float:
        trial = evolve(choice, theta=shifted(choice, free, np.clip(x, -BETWEEN, BETWEEN)))
        gain, beta = normal.gain_of(trial) or (0.0, candidate.beta)
        if _why_not(model, trial, beta, 0.0):
            refused[trial.theta] = (gain, beta)
            return 0.0
        found[trial.theta] = (gain, beta)
        return -gain

    simplex = np.vstack([np.zeros(len(free)), FIRST_STEP * np.eye(len(free))])
    result = minimize(
        loss,
        simplex[0],
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": MOVES * (1 + len(free)), "xatol": 3e-3, "fatol": 1e-4 * base},
    )
    best = max(found, key=lambda theta: found[theta][0])
    allowed = found[best][0] + CLEARLY * (base - found[best][0])
    found |= {theta: trial for theta, trial in refused.items() if trial[0] > allowed}
    best = max(found, key=lambda theta: found[theta][0])
    gain, beta = found[best]
    return evolve(
        candidate, choice=evolve(choice, theta=best), gain=gain / base, beta=beta, tried=candidate.tried + result.nfev
    )


def shifted(choice: ChosenEffect, free: tuple[int, ...], steps: np.ndarray) -> Theta:
    """theta of the choice with its free parameters moved by steps, factors of 1 + step for positive ones."""
    theta = choice.theta
    for index, step in zip(free, steps, strict=False):
        theta = choice.effect.moved(theta, index, float(np.clip(step, -0.6, 2.0)))
    return theta


def _all_columns(model: Model, effect: Effect, joints: Joints) -> Grid:
    """The whole grid with filtered columns on the fitted rows; columns that are not dynamic are formed once."""
    if effect.late:
        return [(theta, {}) for theta in effect.grid(model.scene, joints)]

    def form() -> Grid:
        thetas = effect.grid(model.scene, joints)
        chunks = [thetas[start : start + CHUNK] for start in range(0, len(thetas), CHUNK)]
        return [pair for chunk in chunks for pair in _chunk(model, effect, joints, chunk)]

    return form() if effect.dynamic else model.formed.grid(effect, joints, model.laws, form)


def _chunk(model: Model, effect: Effect, joints: Joints, thetas: Sequence[Theta]) -> Grid:
    full = effect.columns_of_all(model.searched, joints, thetas)
    touched = {j for columns in full for j in columns}
    result: list[dict[int, np.ndarray]] = [{} for _ in thetas]
    for j in touched:
        parts = [columns[j] for columns in full]
        stacked = model.setting.rows.fitted(np.concatenate(parts, axis=1), effect.sharp)
        edges = np.cumsum([0] + [part.shape[1] for part in parts])
        for k in range(len(thetas)):
            result[k][j] = stacked[:, edges[k] : edges[k + 1]]
    return list(zip(thetas, result, strict=True))


class Normal:
    """Normal equations of the fitted rows, ready for the gain of added columns."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.train: np.ndarray = ~model.setting.rows.test
        self.x: list[np.ndarray] = [model.design[j, self.train] for j in range(model.setting.joints)]
        self.residual: list[np.ndarray] = [
            model.residual[j, self.train] * model.scale[j, self.train, 0] for j in range(model.setting.joints)
        ]
        g = sum((x.T @ x for x in self.x), np.zeros((self.x[0].shape[1],) * 2))
        size = np.diag(g)
        empty = size <= 1e-24 * size.max()  # columns without rows: joints that do not move
        scale = np.where(empty, 0.0, 1 / np.sqrt(np.where(empty, 1.0, size)))
        self.inverse: np.ndarray = (
            np.linalg.inv(g * scale[:, None] * scale + np.diag(model.fit.penalty + empty)) * scale[:, None] * scale
        )

    def error(self, joints: Iterable[int]) -> float:
        """Squared error of the joints' fitted rows."""
        return max(sum(float(self.residual[j] @ self.residual[j]) for j in joints), 1e-300)

    def gain_of(self, choice: ChosenEffect, columns: Columns | None = None) -> tuple[float, np.ndarray] | None:
        """Decrease of the squared error by a choice and its coefficients: by the torque that it delivers, or by its
        filtered columns on the fitted rows, which are formed here unless given.
        """
        if choice.effect.late:
            return self.gain_of_late(choice)
        effect = choice.effect
        if columns is None:
            full = effect.columns(self.model.searched, choice.joints, choice.theta)
            columns = {j: self.model.setting.rows.fitted(values, effect.sharp) for j, values in full.items()}
        return self.gain(columns, effect)

    def gain_of_late(self, choice: ChosenEffect) -> tuple[float, np.ndarray]:
        """As `gain`, for an effect that acts on the recorded torque; the error is relative to what is left of that."""
        model, cross, left = self.model, 0.0, 0.0
        target = delivered_target(model, choice)
        for j in range(model.setting.joints):
            old = model.target[j, self.train] * model.scale[j, self.train, 0]
            new = target[j, self.train] * model.scale[j, self.train, 0]
            if j in choice.joints:
                new *= np.sqrt(max(old @ old, 1e-300) / max(new @ new, 1e-300))
            cross, left = cross + self.x[j].T @ new, left + new @ new
        before = self.error(range(model.setting.joints))
        return float(before - (left - cross @ self.inverse @ cross)), np.zeros(1)

    def gain(self, columns: Columns, effect: Effect) -> tuple[float, np.ndarray] | None:
        """Decrease of the squared error by an effect's columns (on the fitted rows) and their coefficients; None where
        they lie within the model.
        """
        if not columns:
            return None
        k = next(iter(columns.values())).shape[1]
        cross, own, toward = np.zeros((len(self.inverse), k)), np.zeros((k, k)), np.zeros(k)
        for j, values in columns.items():
            c = values * self.model.scale[j, self.train]
            cross, own, toward = cross + self.x[j].T @ c, own + c.T @ c, toward + c.T @ self.residual[j]
        free = own + np.diag(effect.precision(len(own))) - cross.T @ self.inverse @ cross
        size = np.sqrt(np.maximum(np.diag(own), 1e-300))
        unit = free / size[:, None] / size
        if not np.isfinite(unit).all():
            return None
        values, vectors = np.linalg.eigh(unit)
        if values[-1] < COLLINEAR:
            return None
        keep = values > 1e-6
        beta = (vectors[:, keep] / values[keep]) @ (vectors[:, keep].T @ (toward / size)) / size
        return float(toward @ beta), beta
