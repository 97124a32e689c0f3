"""Two hypotheses compared by blocks that neither has seen."""

import numpy as np

from cosim.closure.model.model import Model
from cosim.effects.constants import FREEDOM


def gained(new: Model, old: Model, joints: tuple[int, ...] | None = None) -> float:
    """How many nats more of the recorded torque of joints (all that are judged) the new model tells."""
    return new.score(joints) - old.score(joints)


def preferred(new: Model, old: Model, joints: tuple[int, ...] | None = None) -> float:
    """Standard errors by which fitted blocks, each left out, prefer the new model."""
    return standard_errors(_differences(new, old, joints)[: new.setting.rows.train_blocks])


def without_best(new: Model, old: Model) -> float:
    """How many nats more of the fitted blocks, each left out, the new model tells without the one that gains most."""
    difference = _differences(new, old)[: new.setting.rows.train_blocks]
    return float(difference.sum() - difference.max(initial=0.0))


def reported(new: Model, old: Model, joints: tuple[int, ...]) -> float:
    """How many nats more of the recorded torque of the report's blocks the new model tells."""
    return float(_differences(new, old, joints)[new.setting.rows.train_blocks :].sum())


def _differences(new: Model, old: Model, joints: tuple[int, ...] | None = None) -> np.ndarray:
    """Nats (B,) that the new model tells more of each block, at one common noise level (the smaller).

    With a level each, what one block gains would be spread over all blocks, and any spike be significant.
    """
    j = list(new.active if joints is None else joints)
    variance = FREEDOM * np.minimum(new.variance, old.variance)[j]
    rows = new.gram.rows[:, j]

    def loss(m: Model) -> np.ndarray:
        squares = m.fit.sse[:, j] / m.weight[j] ** 2
        return (rows + FREEDOM) / 2 * np.log1p(squares / variance) - m.log_density(m.variance)[:, j]

    return (loss(old) - loss(new)).sum(axis=1)


def standard_errors(difference: np.ndarray) -> float:
    """How surely paired differences of blocks are positive, in standard errors: the larger of Student's t and
    Wilcoxon's z. Signed ranks show an improvement that blocks share though it lies mostly in a few, where t does not.
    """
    from scipy.stats import rankdata

    if len(difference) < 3:
        return 0.0
    t = difference.mean() / max(difference.std(ddof=1) / np.sqrt(len(difference)), 1e-300)
    ranks = rankdata(np.abs(difference))
    z = (ranks @ np.sign(difference)) / np.sqrt((ranks**2).sum())
    return float(max(min(t, 99.0), z))
