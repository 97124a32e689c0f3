"""Evidence for a candidate: the error that it removes on blocks that the fit has not seen, and how sure its
coefficients are.
"""

import numpy as np
from attrs import evolve, frozen

from cosim.closure.model.candidates import Candidate
from cosim.closure.model.model import Model, with_choices
from cosim.closure.score.floor import from_encoders
from cosim.effects import EffectEstimate, Scene
from cosim.effects.motion import Joints

BEYOND_NOISE = 1.5  # times the variance of encoder noise in the torque, that an effect which smooths it has to remove


@frozen(eq=False)
class EffectEvidence:
    """A candidate added to a model and fitted with it.

    p: of the block jackknife's F on the fitted rows, times the number of regressions tried; gain_fit, gain_held: share
    of the squared error of its joints that it removes on fitted blocks left out in turn and on held-out blocks; t_fit,
    t_held: of the paired differences per block; size: RMS of what only this effect explains, as a share of the torque's
    RMS, on fitted or held-out rows.
    """

    candidate: Candidate
    model: Model
    beta: np.ndarray
    std: np.ndarray
    p: float
    gain_fit: float
    gain_held: float
    t_fit: float
    t_held: float
    size: float
    reason: str

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.candidate.choice.effect.name

    @property
    def joints(self) -> Joints:
        """Joints of the effect, 0-based."""
        return self.candidate.choice.joints

    def error(self) -> float:
        """Squared error of all fitted blocks, each left out in turn (weighted, all joints)."""
        return float(relative_error(self.model)[0].sum())


def weigh(model: Model, candidate: Candidate, trials: int, passes: int = 1) -> EffectEvidence:
    """Add the candidate, refit everything, compare block by block. `trials`: regressions tried in the whole search."""
    new = with_choices(model, (*model.choices, candidate.choice), passes)
    part = new.coefficients(len(new.choices) - 1)
    beta, cov = new.fit.beta[part], new.fit.cov[part, part]
    joints = list(_felt(new))
    before, after = relative_error(model), relative_error(new)
    fitted = (before[0] - after[0])[:, joints].sum(axis=1)
    held = (before[1] - after[1])[:, joints].sum(axis=1)
    std = np.sqrt(np.maximum(np.diag(cov), 0))
    amount = candidate.choice.effect.amount(beta, candidate.choice.theta)
    estimate = EffectEstimate(beta, std, candidate.choice.theta, candidate.choice.joints, _beside(model, new))
    return EffectEvidence(
        candidate,
        new,
        beta,
        estimate.std,
        min(_p_value(amount, cov[: len(amount), : len(amount)], len(fitted)) * trials, 1.0),
        fitted.sum() / max(before[0][:, joints].sum(), 1e-300),
        held.sum() / max(before[1][:, joints].sum(), 1e-300),
        standard_errors(fitted),
        standard_errors(held),
        _size(model, new, joints),
        candidate.reason or candidate.choice.effect.unphysical(estimate) or _of_noise(model, new),
    )


def _of_noise(model: Model, new: Model) -> str:
    """Why an effect that smooths the acceleration removes no more than the encoder's noise in it; empty where it does
    more.
    """
    choice = new.choices[-1]
    if not choice.effect.smooths or (noise := from_encoders(model)) is None:
        return ""
    joint = choice.joints[0]
    rows = model.setting.use[joint] & ~model.setting.rows.test
    removed = float((model.residual[joint, rows] ** 2 - new.residual[joint, rows] ** 2).mean()) if rows.any() else 0.0
    if removed > BEYOND_NOISE * noise[joint] ** 2:
        return ""
    return "takes away no more than the noise of the encoder in the acceleration, which any lag smooths"


def relative_error(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Squared errors of blocks as `Model.joint_error`, scaled up where an effect acts on the measured torque.

    Such an effect (saturation, dead band, lag) removes a part of what is to be explained, whether or not the model
    explains it. The error is therefore scaled by what is left to explain: times sum y^2 / sum (what is left of y)^2 of
    each joint's fitted rows.
    """
    fitted, held = model.joint_error()
    taken = np.zeros_like(model.target)
    for number, (choice, columns) in enumerate(zip(model.choices, model.columns, strict=True)):
        if choice.effect.measured:
            for j, values in columns.items():
                taken[j] += values @ model.beta(number)
    use = model.setting.use & ~model.setting.rows.test
    whole, left = (np.where(use, y**2, 0).sum(axis=1) for y in (model.setting.y, model.target - taken))
    share = np.maximum(whole, 1e-300) / np.maximum(left, 1e-3 * np.maximum(whole, 1e-300))
    return fitted * share, held * share


def _beside(old: Model, new: Model) -> Scene:
    """The scene of the old model with the friction of the new one, by which an estimate is judged physical."""
    viscous, coulomb = new.friction_levels
    return evolve(old.scene, viscous=viscous, coulomb=coulomb)


def _felt(model: Model) -> Joints:
    """Joints (0-based) on whose rows the last choice acts; those of the candidate for effects that name one joint."""
    choice, columns = model.choices[-1], model.columns[-1]
    if len(choice.joints) > 1:
        return tuple(columns)
    return choice.joints


def _p_value(beta: np.ndarray, cov: np.ndarray, blocks: int) -> float:
    """P of F(k, blocks - k - 1) for the jackknife's Wald statistic."""
    from scipy.stats import f

    k = len(beta)
    scale = 1 / np.sqrt(np.maximum(np.diag(cov), 1e-300))
    wald = beta * scale @ np.linalg.pinv(cov * scale[:, None] * scale, rcond=1e-9) @ (beta * scale)
    dof = max(blocks - k - 1, 1)
    return float(f.sf(wald / k * dof / max(blocks - 1, 1), k, dof))


def standard_errors(difference: np.ndarray) -> float:
    """How surely the paired differences per block are positive, in standard errors: the larger of Student's t and
    Wilcoxon's z. Signed ranks show an improvement that lies mostly in a few blocks, where t does not.
    """
    from scipy.stats import rankdata

    if len(difference) < 3:
        return 0.0
    t = student(difference)
    ranks = rankdata(np.abs(difference))
    z = (ranks @ np.sign(difference)) / np.sqrt((ranks**2).sum())
    return float(max(min(t, 99.0), z))


def student(difference: np.ndarray) -> float:
    """Student's t of paired differences: their mean over its standard error."""
    return float(difference.mean() / max(difference.std(ddof=1) / np.sqrt(len(difference)), 1e-300))


def _size(old: Model, new: Model, joints: list[int]) -> float:
    """RMS of the change of the prediction as a share of the RMS of the torque of these joints: on fitted or held-out
    rows, whichever show more.
    """
    change, use, torque = ((new.residual - old.residual)[joints], old.setting.use[joints], old.target[joints])
    halves = [use & rows for rows in (~old.setting.rows.test, old.setting.rows.test)]
    return max(float(np.sqrt((change[u] ** 2).sum() / max((torque[u] ** 2).sum(), 1e-300))) for u in halves)
