"""The damping that a criterion may count on: the controller's plus the least viscosity of the plant in its
workspace.
"""

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from cosim.arm.kinematics import jacobian, radius
from cosim.arm.workspace import Workspace

LEAST_RADIUS = 0.05
"""Poses nearer to the vertical axis than this [m] are left out: there a negative joint viscosity has no bound in task
space.
"""


@frozen
class LeastViscosity:
    """Least eigenvalue of the plant's viscosity [N s/m, or N m s/rad in joint space] and the pose where it stands."""

    value: float
    pose: tuple[float, ...]


def task_viscosity(viscous: ArrayLike, poses: np.ndarray) -> np.ndarray:
    """Least eigenvalue of J^-T diag(viscous) J^-1 at `poses` (..., 3) [N s/m]: power lost at the tip per squared speed.

    `viscous` (3,) [N m s/rad]; identified terms may be negative and then subtract.
    """
    inverse = np.linalg.inv(jacobian(poses))
    task = np.einsum("...ki,k,...kj->...ij", inverse, np.asarray(viscous, float), inverse)
    return np.linalg.eigvalsh(task)[..., 0]


def least_task_viscosity(
    viscous: ArrayLike, workspace: Workspace | None = None, least_radius: float = LEAST_RADIUS, per_axis: int = 161
) -> LeastViscosity:
    """Minimum of `task_viscosity` over the workspace, by a grid in (q2, q3) refined three times round its best point.

    q1 turns the tip frame and leaves the eigenvalues alone. Poses with |r| < `least_radius` [m] are left out.
    """
    workspace = workspace or Workspace()
    if not np.any(viscous):
        return LeastViscosity(0.0, (0.0, 0.0, 0.0))
    low, high = np.array(workspace.low[1:]), np.array(workspace.high[1:])
    best: LeastViscosity | None = None
    for _ in range(4):
        axes = [np.linspace(low[k], high[k], per_axis) for k in (0, 1)]
        q2, q3 = (grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))
        poses = np.column_stack([np.zeros_like(q2), q2, q3])
        poses = poses[workspace.contains(poses) & (np.abs(radius(poses)) >= least_radius)]
        values = task_viscosity(viscous, poses)
        k = int(np.argmin(values))
        if best is None or values[k] < best.value:
            best = LeastViscosity(float(values[k]), tuple(float(angle) for angle in poses[k]))
        reach = 2.0 * (high - low) / (per_axis - 1)
        low, high = np.array(best.pose[1:]) - reach, np.array(best.pose[1:]) + reach
    assert best is not None  # four grids have been searched
    return best


def least_tip_viscosity(viscous: ArrayLike, reach: ArrayLike) -> LeastViscosity:
    """A bound from below for the viscosity [N s/m] that a tip of any serial arm feels, at every pose.

    The power lost is dq^T D dq >= |dx|^2 / lambda_max(J D^-1 J^T), however the joints share the tip's motion, and
    lambda_max <= sum_i reach_i^2 / D_i with reach (n,) [m] >= |J_i| (1 for a slide). Zero where a joint has no
    friction; minus infinity where one has a negative term, for which a motion of the joints without the tip has no
    bound.
    """
    d, levers = np.asarray(viscous, float), np.asarray(reach, float)
    if np.any(d < 0.0):
        return LeastViscosity(-np.inf, ())
    if np.any(d == 0.0):
        return LeastViscosity(0.0, ())
    return LeastViscosity(float(1.0 / np.sum(levers**2 / d)), ())


def least_joint_viscosity(viscous: ArrayLike) -> LeastViscosity:
    """Least joint viscosity [N m s/rad]: what adds to the damping of a joint-space controller, at every pose."""
    return LeastViscosity(float(np.min(viscous)), ())
