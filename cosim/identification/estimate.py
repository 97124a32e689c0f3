"""Least squares for stacked equations: ordinary, weighted by joint, Huber-weighted, and constrained to a physical
arm.
"""

import numpy as np
from attrs import frozen

from cosim.identification.linear_model import LinearModel, PhysicalLimits
from cosim.identification.method import Method
from cosim.identification.stack import Stack

HUBER = 1.345  # residuals beyond this many robust standard deviations count less (95 % efficient for a normal law)
RANK = 1e-8  # singular values of the scaled regressor below this share of the largest are zero


@frozen(eq=False)
class ParameterEstimate:
    """params (p,), weights (m,) of the equations that were used, sigma (nj,): rms residual of each joint."""

    params: np.ndarray
    weights: np.ndarray
    sigma: np.ndarray


def solve(y: np.ndarray, tau: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """argmin sum w (tau - y params)^2; where columns are dependent, the shortest scaled solution."""
    root = np.sqrt(weights)
    scale = np.sqrt(((y * root[:, None]) ** 2).sum(axis=0))
    scale[scale == 0] = 1.0
    triangle = np.asarray(np.linalg.qr(np.column_stack([y / scale, tau]) * root[:, None], mode="r"))
    return np.linalg.lstsq(triangle[:, :-1], triangle[:, -1], rcond=RANK)[0] / scale


def estimate(stack: Stack, method: Method, model: LinearModel) -> ParameterEstimate:
    """Fit the training equations by the method's least squares."""
    y, tau, joint, _ = stack.equations(stack.fit)
    weights, sigma = np.ones(len(tau)), np.ones(stack.tau.shape[1])
    params = solve(y, tau, weights)
    for _ in range(8 if method.robust else 2 if method.weighted else 0):
        residual = tau - y @ params
        sigma = joint_sigma(residual, joint, len(sigma), method.robust)
        weights = (1 / sigma[joint] ** 2) if method.weighted else np.ones(len(tau))
        weights = weights * (_huber(residual / sigma[joint]) if method.robust else 1.0)
        params = solve(y, tau, weights)
    if method.physical:
        _, triangle = np.linalg.qr(np.column_stack([y, tau]) * np.sqrt(weights)[:, None])
        size = len(params)
        found = model.consistent(stack.labels, triangle[:size, :size], triangle[:size, -1])
        params = _physical(y, tau, weights, params, model.limits(stack.labels)) if found is None else found
    sigma = joint_sigma(tau - y @ params, joint, len(sigma), False)
    return ParameterEstimate(params, weights, sigma)


def joint_sigma(residual: np.ndarray, joint: np.ndarray, joints: int, robust: bool) -> np.ndarray:
    """Root mean square residual of each joint (nj,), or 1.4826 median |r|; never zero."""
    spread = []
    for j in range(joints):
        mine = residual[joint == j]
        value = 1.4826 * np.median(np.abs(mine)) if robust else np.sqrt(np.mean(mine**2))
        spread.append(value)
    sigma = np.array(spread)
    return np.maximum(sigma, 1e-9 * max(sigma.max(), 1e-12))


def _huber(scaled: np.ndarray) -> np.ndarray:
    return np.minimum(1.0, HUBER / np.maximum(np.abs(scaled), 1e-12))


def _physical(
    y: np.ndarray, tau: np.ndarray, weights: np.ndarray, start: np.ndarray, limits: PhysicalLimits
) -> np.ndarray:
    """The same least squares under rows @ params >= bounds and margin(params) >= 0."""
    from scipy.optimize import minimize

    root = np.sqrt(weights)
    scale = np.abs(start) + 1e-3 * np.abs(start).max()
    _, triangle = np.linalg.qr(np.column_stack([y * scale, tau]) * root[:, None])
    top, target = triangle[: len(start), :-1], triangle[: len(start), -1]
    size = max(float(target @ target), 1e-300)
    rows, bounds, margin = limits.rows, limits.bounds, limits.margin
    conditions: list[dict[str, object]] = [
        {"type": "ineq", "fun": lambda u: (rows @ (u * scale) - bounds) / 1e-3, "jac": lambda u: rows * scale / 1e-3}
    ]
    if margin is not None:
        conditions.append({"type": "ineq", "fun": lambda u: margin(u * scale)})
    found = minimize(
        lambda u: float(np.sum((top @ u - target) ** 2)) / size,
        start / scale,
        jac=lambda u: 2 * top.T @ (top @ u - target) / size,
        constraints=conditions,
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-14},
    )
    return found.x * scale
