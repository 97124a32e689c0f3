"""Least squares for stacked equations: ordinary, weighted by joint, Huber-weighted, and constrained to a physical
arm.
"""

import numpy as np
from attrs import frozen

from cosim.arm.workspace import LINKED
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
    triangle = np.linalg.qr(np.column_stack([y / scale, tau]) * root[:, None], mode="r")
    return np.linalg.lstsq(triangle[:, :-1], triangle[:, -1], rcond=RANK)[0] / scale


def estimate(stack: Stack, method: Method, device: str) -> ParameterEstimate:
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
        params = _physical(y, tau, weights, params, device, stack.names)
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


def _physical(y, tau, weights, start, device: str, names: tuple[str, ...]) -> np.ndarray:
    """The same least squares under A params >= b and, for the arm, p5 p6 >= (p4/2 s)^2 (M > 0 over the workspace)."""
    from scipy.optimize import minimize

    root = np.sqrt(weights)
    scale = np.abs(start) + 1e-3 * np.abs(start).max()
    _, triangle = np.linalg.qr(np.column_stack([y * scale, tau]) * root[:, None])
    top, target = triangle[: len(names), :-1], triangle[: len(names), -1]
    size = max(float(target @ target), 1e-300)
    rows, bounds = _linear_limits(device, names)
    limits = [
        {"type": "ineq", "fun": lambda u: (rows @ (u * scale) - bounds) / 1e-3, "jac": lambda u: rows * scale / 1e-3}
    ]
    if device == "phantom":
        sine = max(abs(np.sin(LINKED.linkage_low)), abs(np.sin(LINKED.linkage_high)))
        limits.append({"type": "ineq", "fun": lambda u: _block(u * scale, sine)})
    found = minimize(
        lambda u: float(np.sum((top @ u - target) ** 2)) / size,
        start / scale,
        jac=lambda u: 2 * top.T @ (top @ u - target) / size,
        constraints=limits,
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-14},
    )
    return found.x * scale


def _block(params: np.ndarray, sine: float) -> float:
    """sqrt(p5 p6) - |p4| s / 2 in units of 1e-3, with the signs of p5 and p6 seen to by the linear limits."""
    return 1e3 * (np.sqrt(max(params[4] * params[5], 0.0)) - 0.5 * np.abs(params[3]) * sine - 1e-6)


def _linear_limits(device: str, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and bounds of A params >= b: friction dissipates, inertia is positive, M11 > 0 on a grid of the
    workspace.
    """
    floor = {name: 0.0 for name in names if name.startswith(("viscous", "coulomb"))}
    floor |= {name: 1e-6 for name in names if name in ("inertia", "d5", "d6")}
    rows = [np.eye(len(names))[names.index(name)] for name in floor]
    bounds = list(floor.values())
    if device == "phantom":
        poses = LINKED.clip(
            np.stack(np.meshgrid(0.0, np.linspace(-1.01, 2.01, 22), np.linspace(-0.45, 2.93, 22)), -1).reshape(-1, 3)
        )
        _, q2, q3 = np.unique(poses.round(6), axis=0).T
        grid = np.zeros((len(q2), len(names)))
        grid[:, :4] = np.stack([np.ones_like(q2), np.cos(2 * q2), np.cos(2 * q3), np.cos(q2) * np.sin(q3)], axis=1)
        rows, bounds = [*rows, *grid], [*bounds, *np.full(len(grid), 2e-5)]
    return np.array(rows), np.array(bounds)
