"""Reasons not to judge a recording at all: no motion, too short, a torque that is a function of the state or of the
model.
"""

import numpy as np
from attrs import frozen

from cosim.closure.model.model import Model
from cosim.closure.model.motion import FitRows, SmoothedMotion

SHORTEST = 4.0  # s of fitted rows
FEWEST_BLOCKS = 8
STATIC = 0.05  # share of the torque that a function of angle and speed leaves, below which inertia has to be seen
INERTIA = 0.01  # least share of the torque that is due to inertia there
MOST_CLIPPED = 0.5  # share of rows, above which the rest is no sample of the motion
MOVING = 0.05  # share of the rows in which a joint has to move
EXACT = 1e-4  # residual as a share of the torque that is too small for a measurement


@frozen
class Refusal:
    """Why nothing may be concluded; joint is 1-based or 0 for all."""

    joint: int
    reason: str


def motion_refusals(motion: SmoothedMotion, rows: FitRows) -> list[Refusal]:
    """Reasons in the data: too short, no motion, a joint that rests on all fitted rows, a constant torque."""
    out = []
    seconds = round(
        float((~motion.test).sum() * motion.step), 1
    )  # as it is told: halves of several runs are some samples short
    if seconds < SHORTEST or rows.train_blocks < FEWEST_BLOCKS:
        out.append(
            Refusal(
                0,
                f"too short: {seconds:g} s of fitted rows make {rows.train_blocks} blocks, at least {FEWEST_BLOCKS} "
                f"blocks and {SHORTEST:g} s are needed",
            )
        )
    clipped = np.zeros(motion.joints) if motion.clipped is None else motion.clipped.mean(axis=0)
    cut = [j for j in range(motion.joints) if clipped[j] > MOST_CLIPPED]
    out += [Refusal(j + 1, f"the torque is clipped in {100 * clipped[j]:.3g} % of the rows") for j in cut]
    still = [j for j in range(motion.joints) if j not in cut and not _moves(motion, rows, j)]
    if len(still) == motion.joints:
        out.append(Refusal(0, "no joint moves: a residual at rest cannot be traced to an effect of motion"))
    unseen = [j for j in range(motion.joints) if j not in still and not rows.moving[~rows.test, j].any()]
    out += [
        Refusal(j + 1, "it rests on all fitted rows and moves on held-out ones: hold out other rows") for j in unseen
    ]
    flat = [
        j
        for j in range(motion.joints)
        if np.ptp(motion.tau_raw[:, j]) <= 1e-9 * max(np.abs(motion.tau_raw[:, j]).max(), 1e-30)
    ]
    out += [Refusal(j + 1, "the torque is constant") for j in flat if j not in still]
    return out


def hidden(motion: SmoothedMotion, rows: FitRows) -> list[Refusal]:
    """Joints that move and of which no rows are left to judge: within the filter's reach of every reversal."""
    out = []
    for j in range(motion.joints):
        moves = float((np.abs(motion.dq[rows.index, j]) > rows.standstill_speed[j]).mean())
        used = float(rows.moving[:, j].mean())
        if used <= MOVING < moves:
            text = (
                f"it moves in {100 * moves:.0f} % of the rows, all but {100 * used:.1f} % of them within the filter's "
            )
            out.append(Refusal(j + 1, f"{text}reach of a reversal: record it faster, or with longer strokes"))
    return out


def _moves(motion: SmoothedMotion, rows: FitRows, joint: int) -> bool:
    return bool(rows.moving[:, joint].mean() > MOVING and np.ptp(motion.q[:, joint]) > 0)


def circular(model: Model) -> list[Refusal]:
    """Joints whose torque column was computed, not measured."""
    out = []
    for j in range(model.setting.joints):
        if not _moves(model.setting.motion, model.setting.rows, j):
            continue
        for reason in (_static(model, j), _exact(model, j)):
            if reason:
                out.append(Refusal(j + 1, reason))
                break
    return out


def _static(model: Model, j: int) -> str:
    """Why the torque was computed from the state: a function of angle and speed reproduces it without inertia. Empty
    where it was not.
    """
    s = model.setting
    rows, m = s.rows, s.motion
    use = s.use[j] if s.use[j].sum() >= 200 else np.ones(len(rows.index), bool)
    if use.sum() < 100 or s.device.recorded_columns:
        return ""
    q, dq, ddq, tau = (rows.filtered(x[:, [j]], False)[use, 0] for x in (m.q, m.dq, m.ddq, m.tau))
    static = np.stack((np.ones_like(q), q, np.sin(q), np.cos(q), dq), axis=1)
    scale = np.sqrt(np.mean(tau**2))
    left = tau - static @ np.linalg.lstsq(static, tau, rcond=None)[0]
    share = float(np.sqrt(np.mean(left**2)) / max(scale, 1e-300))
    if share > STATIC:
        return ""
    both = np.column_stack((static, ddq))
    full = np.linalg.lstsq(both, tau, rcond=None)[0][-1]
    parts = [np.isin(rows.block[use], p) for p in np.array_split(np.unique(rows.block[use]), 8)]
    rest = [np.linalg.lstsq(both[~p], tau[~p], rcond=None)[0][-1] for p in parts if p.any()]
    upper = full + 2 * float(np.std(rest)) * np.sqrt(len(rest))  # jackknife by parts
    made = upper * float(np.std(ddq)) / scale
    if made > INERTIA:
        return ""
    return (
        f"the torque is a function of the angle and the speed to {100 * share:.2g} % and inertia makes less than "
        f"{100 * max(made, 0):.2g} % of it: it was computed from the state (circular), it did not move the joint"
    )


def _exact(model: Model, j: int) -> str:
    use = model.setting.use[j]
    if use.sum() < 200:
        return ""
    share = float(np.sqrt(np.mean(model.residual[j][use] ** 2) / max(np.mean(model.target[j][use] ** 2), 1e-300)))
    if share > EXACT:
        return ""
    return (
        f"the model fits the torque to {100 * share:.1g} %: no measurement is that "
        f"good, the torque was computed from the model (circular)"
    )
