"""Steps of a torque at reversals that are wider than our own filters make them: rows are fitted that lie on them.

Coulomb friction jumps where a joint turns round, and rows that the filters smear are left out there. In a torque that
was low-passed before it was recorded, or of friction that builds up over a distance, the jump takes longer. More rows
are left out then, and both estimates are compared (Hausman, Specification tests in econometrics, Econometrica 46,
1978): they agree unless the rows between belong to another law. The standard deviation of their difference is that of a
jackknife that leaves the same block out of both.
"""

import numpy as np

from cosim.identification.fit import Fit
from cosim.identification.intervals import blocks, student
from cosim.measured.filtering import widened
from cosim.measured.notes import Doubt

FURTHER = 2  # reaches of the low-pass of both sides that are left out beyond the one that always is
SURE = 4.0  # standard deviations of a difference that is told: 6e-5


def smeared(fit: Fit) -> tuple[np.ndarray, tuple[Doubt, ...]]:
    """What leaving out more rows around reversals changes in the parameters (p,), and the doubt where that is sure.

    An interval of 95 % holds each difference that a test of 95 % finds; zero for the others, and where too few rows are
    left.
    """
    base = fit.base
    nothing = np.zeros(len(fit.params)), ()
    y, tau, joint, stamp = base.equations(base.fit)
    inner = _further_away(fit)[stamp, joint]
    if inner.all() or inner.sum() < 3 * y.shape[1]:
        return nothing
    number = blocks(base, stamp, max(round(fit.spread.block / base.step), 1))
    weights = fit.estimate.weights
    change, std = _difference(y, tau, weights, weights * inner, number)
    size = np.abs(change)
    held = np.where(size > student(int(number.max())) * std, size, 0.0)
    sure = (size > SURE * std).tolist()
    names = [str(label) for label, told in zip(base.labels, sure, strict=True) if told and label.name != "slow"]
    if not names:
        return held, ()
    text = (
        f"tau changes more slowly at reversals than Coulomb friction does: without more rows around them "
        f"{', '.join(names)} would be other: a torque that was low-passed, or friction that builds up over a distance "
        "(close-loop tells). The intervals hold what these rows change"
    )
    return held, (Doubt.of("smeared", text),)


def _further_away(fit: Fit) -> np.ndarray:
    """Rows (n, nj) of the stack further from those that are left out at reversals."""
    base, step = fit.base, max(run.step for run in fit.recording.runs)
    before, after = (int(np.ceil(FURTHER * rows * step / base.step)) for rows in fit.method.low_pass.spread(step))
    turning = base.settled[:, None] & base.whole & ~base.keep
    return ~np.stack([widened(rows, (before, after)) for rows in turning.T], axis=1)


def _difference(
    y: np.ndarray, tau: np.ndarray, weights: np.ndarray, others: np.ndarray, number: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate with the other weights less that with the weights (m,), (p,), and its standard deviation."""
    scale = np.sqrt((y**2).sum(axis=0))
    scale[scale == 0] = 1.0
    first, second = (_without_each(y / scale, tau, w, number) for w in (weights, others))
    change = (second - first) / scale
    count = len(change) - 1
    spread = change[1:] - change[1:].mean(axis=0)
    return change[0], np.sqrt((count - 1) / count * (spread**2).sum(axis=0))


def _without_each(y: np.ndarray, tau: np.ndarray, weights: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Weighted least squares of all equations, and without each block of them, (1 + blocks, p)."""
    order = np.argsort(number, kind="stable")
    edges = np.searchsorted(number[order], np.arange(number.max() + 2))
    both = np.column_stack([y, tau])
    sums = np.stack([(y[own] * weights[own, None]).T @ both[own] for own in np.split(order, edges[1:-1])])
    whole = sums.sum(axis=0)
    return np.stack([np.linalg.lstsq(n[:, :-1], n[:, -1], rcond=1e-12)[0] for n in (whole, *(whole - sums))])
