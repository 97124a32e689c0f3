"""What a lag or delay, a saturation or a dead band of the drive would leave of a recording and of its replicates."""

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.gram import scales
from cosim.closure.model.model import with_effect
from cosim.closure.score.replicates import Replicates
from cosim.effects import Effect
from cosim.effects.actuator import Erasing
from cosim.effects.motion import Joints, Theta


@frozen(eq=False)
class Delivery:
    """The drive's hypotheses beside a model; columns: those formed so far."""

    of: Replicates
    columns: dict[Hashable, Any]

    def behind(self, effect: Effect, joints: Joints, theta: Theta, recorded: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Residuals (m, count) of each joint with a lag or delay of some joints; recorded: torques (m, count) of each
        joint, of the data and of replicates.
        """
        r, skew = self.of, self._skew_of(joints)
        x, y = list(r.x), list(recorded)
        equations = [(g, h[:, : y[0].shape[1]]) for g, h in r.unpassed]
        for j in joints:
            x[j], given = self._passed(effect, j, theta)
            y[j] = y[j] + given
            y[j][:, 0] += skew[j]
            equations[j] = r.equations(j, x[j], y[j])
        beta = r.solution(equations)
        return [own - v @ beta for v, own in zip(x, y, strict=True)]

    def explained(self, e: Sequence[np.ndarray]) -> float:
        """How much less (RMS) residuals (m,) of all joints hold than those of the data, over the torque's RMS, on the
        joint where it is most.
        """
        less = [
            float((w * (own[:, 0] ** 2 - v**2)).sum() / max((w * y**2).sum(), 1e-300))
            for own, v, w, y in zip(self.of.e, e, self.of.weight, self.of.y, strict=True)
        ]
        return float(np.sqrt(max(*less, 0.0)))

    def _skew_of(self, joints: Joints) -> np.ndarray:
        """What sampling takes from the scaled torque (J, m) of some joints: a lag of theirs holds it."""
        out = self.of.model.skew * self.of.model.setting.slope[:, self.of.fitted] * self.of.mask
        return out * np.isin(np.arange(len(out)), joints)[:, None]

    def _passed(self, effect: Effect, joint: int, theta: Theta) -> tuple[np.ndarray, np.ndarray]:
        """The scaled design (m, p) of a joint through a lag or delay, and how that changes its scaled torque (m, 1): by
        the part of the prediction that is given.
        """
        key = effect.key, joint, theta
        if key not in self.columns:
            r = self.of
            trial = with_effect(r.model, ChosenEffect(effect, (joint,), theta))
            given = (r.model.setting.given[joint] - trial.given[joint])[r.fitted, None]
            scale = r.mask[joint][:, None]
            self.columns[key] = trial.design_of(joint)[r.fitted] * scale, given * scale
        return self.columns[key]

    def delivered(self, effect: Erasing, joint: int, theta: Theta, count: int) -> tuple[np.ndarray, float]:
        """Residuals (m, count) of a joint of which a saturation or dead band erases rows, of the data and of
        replicates, and what these rows cost [nats].
        """
        model, j = self.of.model, joint
        trial = with_effect(model, ChosenEffect(effect, (j,), theta))
        change = ((trial.target[j] - model.target[j])[self.of.fitted] * self.of.mask[j])[:, None]
        if count > 1:
            change = np.concatenate((change, self._erased(effect, j, theta)[:, : count - 1]), axis=1)
        e = self.of.e[j][:, :count] + change
        e = e - self.of.x[j] @ (self.of.normal @ ((self.of.x[j].T * self.of.weight[j]) @ e))
        rows = self.of.count[:, j]
        variance, _ = scales(np.add.reduceat(e[:, :1] ** 2, self.of.starts, axis=0), rows, len(rows))
        changed = np.where(np.arange(len(self.of.x)) == j, model.variance * variance[0], model.variance)
        more = trial.log_density(changed) - model.log_density(model.variance)
        return e, more[: model.setting.rows.train_blocks, j].sum()

    def _erased(self, effect: Erasing, joint: int, theta: Theta) -> np.ndarray:
        """What saturation or dead band changes of the scaled torque (m, R) of the replicates, of which only filtered
        rows are known.
        """
        made, torque = self.of.made(joint)
        return effect.delivered(torque, theta)[0] * self.of.mask[joint][:, None] - made
