"""A delay bound for the known plant that holds for every delay law below it, fast or slow: scaled small gain."""

from collections.abc import Callable
from typing import Any

import numpy as np

from cosim.analysis.spectrum import DelayFamily, abscissa, root_bound

SAMPLES = 400
"""Frequencies at which the norm is looked at first."""


def delay_law_bound(family: DelayFamily) -> float:
    """Largest bound on the delays [s] such that the linear loop is stable for *every* delay law that stays below it.

    x(t) - x(t - T(t)) = Delta dx with an L2 gain of at most max T, whatever T(t) does (Kao and Lincoln 2004, lemma
    1). With each channel term B_j = U_j V_j and H(s) = V s (s I - F - G)^-1 U the loop is stable if T ||D H
    D^-1||_inf < 1; D scales the channels against each other and is chosen best. Assumes the plant as linearised
    (masses known, small motion about the pose), both delays below the same bound, and stability without delay (else
    0). For equal sides it is B/K, as the sum condition: the mass does not help there, but the damping counted is that
    at the pose, not the least of the workspace.
    """
    if not family.channel.matrices or abscissa(family.at(0.0)) >= 0.0:
        return 0.0
    factors = [_factor(matrix) for matrix in family.channel.matrices]
    left = np.hstack([u for u, _ in factors])
    right = np.vstack([v for _, v in factors])
    blocks = np.concatenate([np.full(u.shape[1], k) for k, (u, _) in enumerate(factors)])
    top = root_bound(family.at(0.0))
    grid = np.geomspace(1e-4 * top, top, SAMPLES)
    return 1.0 / _scaled_peak(lambda w: _response(family, left, right, w), grid, blocks)


def quick_limit(family: DelayFamily, every: int = SAMPLES) -> float:
    """A number [s] that `delay_law_bound` cannot pass, from every so many-th of its frequencies, by default from one:
    no scaling takes a norm below the spectral radius.
    """
    if not family.channel.matrices:
        return 0.0
    factors = [_factor(matrix) for matrix in family.channel.matrices]
    left, right = np.hstack([u for u, _ in factors]), np.vstack([v for _, v in factors])
    top = root_bound(family.at(0.0))
    grid = np.geomspace(1e-4 * top, top, SAMPLES)[::every]
    radius = float(np.max(np.abs(np.linalg.eigvals(_response(family, left, right, grid)))))
    return 1.0 / radius if radius > 0 else np.inf


def _factor(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A matrix as U V of full rank."""
    u, s, v = np.linalg.svd(matrix)
    rank = int(np.sum(s > 1e-12 * max(s[0], 1e-300)))
    return u[:, :rank] * s[:rank], v[:rank]


def _response(family: DelayFamily, left: np.ndarray, right: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """H(i w), shape (len(w), m, m)."""
    s = 1j * np.asarray(frequencies)[:, None, None]
    fixed = sum(a * np.exp(-s * d) for a, d in zip(family.fixed.matrices, family.fixed.delays))
    channel = sum(b * np.exp(-s * d) for b, d in zip(family.channel.matrices, family.channel.delays))
    inner = np.linalg.solve(
        s * np.eye(family.fixed.size) - fixed - channel, np.broadcast_to(left.astype(complex), (len(s), *left.shape))
    )
    return s * (right @ inner)


def _scaled_peak(response: Callable[[np.ndarray], np.ndarray], grid: np.ndarray, blocks: np.ndarray) -> float:
    """min over scalings of max over frequency of the largest singular value; the peak is refined between grid
    points.
    """
    on_grid = response(grid)
    apart = blocks[:, None] - blocks[None, :]

    def size(values: np.ndarray, log_scale: float) -> np.ndarray:
        return np.linalg.norm(values * np.exp(log_scale * apart), 2, axis=(1, 2))

    scale, _ = _least(lambda x: float(size(on_grid, x).max()), -4.0, 4.0, 1e-4)
    sizes = size(on_grid, scale)
    peak = float(sizes.max())
    for k in np.argsort(-sizes)[:3]:
        low, high = float(grid[max(k - 1, 0)]), float(grid[min(k + 1, len(grid) - 1)])
        _, finer = _least(lambda w: -float(size(response(np.array([w])), scale)[0]), low, high, 1e-5)
        peak = max(peak, -finer)
    return peak


def _least(function: Callable[[float], float], low: float, high: float, accuracy: float) -> tuple[float, float]:
    """Where a function of one variable is least between two bounds, to an accuracy, and its value there (Brent)."""
    from scipy.optimize import minimize_scalar

    found: Any = minimize_scalar(function, bounds=(low, high), method="bounded", options={"xatol": accuracy})
    return found.x, float(found.fun)
