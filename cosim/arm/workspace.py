"""Where the arm can be, where its Jacobian is singular, and whether its mass matrix is positive definite there.

Box of joint angles from Sallam Table I; the linkage limits q2 - q3 (a public PHANToM model: q2 - q3 <= 65 deg,
q3 - q2 <= 55 deg). M depends on q2 and q3 only, so its definiteness is a question about a convex polygon in that plane.
"""

from enum import Enum

import numpy as np
from attrs import field, frozen

from cosim.arm.dynamics import yaw_inertia, yaw_inertia_slopes
from cosim.arm.kinematics import L1, L2, jacobian, radius
from cosim.errors import InputError, Problem


@frozen
class Workspace:
    """Limits of the joint angles [rad]: `low` and `high` of q1..q3 and of the linkage's q2 - q3."""

    low: tuple[float, float, float] = tuple(np.deg2rad((-90.0, -57.7, -25.7)).tolist())
    high: tuple[float, float, float] = tuple(np.deg2rad((90.0, 115.0, 167.5)).tolist())
    linkage_low: float = field(default=float(np.deg2rad(-55.0)))
    linkage_high: float = field(default=float(np.deg2rad(65.0)))

    def contains(self, q: np.ndarray) -> np.ndarray:
        """True (...) where `q` (..., 3) lies inside the box and the linkage's limits."""
        q = np.asarray(q, dtype=float)
        difference = q[..., 1] - q[..., 2]
        inside = np.all((q >= self.low) & (q <= self.high), axis=-1)
        return inside & (difference >= self.linkage_low) & (difference <= self.linkage_high)

    def clip(self, q: np.ndarray) -> np.ndarray:
        """A pose (..., 3) inside the workspace near `q`: box first, then q3 moved to what the linkage allows for
        that q2.
        """
        q = np.clip(np.asarray(q, dtype=float), self.low, self.high)
        lowest = np.maximum(self.low[2], q[..., 1] - self.linkage_high)
        highest = np.minimum(self.high[2], q[..., 1] - self.linkage_low)
        return np.stack([q[..., 0], q[..., 1], np.clip(q[..., 2], lowest, highest)], axis=-1)

    def sample(self, count: int, seed: int) -> np.ndarray:
        """Poses (count, 3) spread evenly over the box with linkage; reproducible by `seed`."""
        rng, found = np.random.default_rng(seed), np.empty((0, 3))
        while len(found) < count:
            poses = rng.uniform(self.low, self.high, (4 * count, 3))
            found = np.concatenate([found, poses[self.contains(poses)]])
        return found[:count]


LINKED = Workspace()
"""Box and linkage: where the device can really go."""
BOX = Workspace(linkage_low=-np.inf, linkage_high=np.inf)
"""Sallam's box alone, as his Table I gives it."""


class SingularityKind(Enum):
    """What is lost at a singular pose."""

    NONE = "regular"
    AXIS = "the tip is on the vertical axis (r = 0): joint 1 does not move it"
    STRETCHED = "upper arm and forearm are in line (|q3 - q2| = 90 deg): no motion along the arm"
    BOTH = "tip on the vertical axis and arm in line"


@frozen
class Singularity:
    """How near one pose is to a singularity of J: determinant l1 l2 r cos(q2 - q3) [m^3], smallest singular value
    [m/rad].
    """

    kind: SingularityKind
    radius: float
    linkage_cosine: float
    determinant: float
    smallest: float


def singularity(q: np.ndarray, tolerance: float = 1e-3) -> Singularity:
    """Report on the pose `q` (3,): singular when r / (l1 + l2) or |cos(q2 - q3)| is below `tolerance`."""
    q = np.asarray(q, dtype=float)
    r, cosine = float(radius(q)), float(np.cos(q[1] - q[2]))
    axis, line = abs(r) < tolerance * (L1 + L2), abs(cosine) < tolerance
    kind = {
        (False, False): SingularityKind.NONE,
        (True, False): SingularityKind.AXIS,
        (False, True): SingularityKind.STRETCHED,
        (True, True): SingularityKind.BOTH,
    }[axis, line]
    smallest = float(np.linalg.svd(jacobian(q), compute_uv=False)[-1])
    return Singularity(kind, r, cosine, L1 * L2 * r * cosine, smallest)


@frozen
class Definiteness:
    """Is M > 0 over a workspace? Global minima of M11 and of the smaller eigenvalue of the (q2, q3) block [kg m^2].

    `pose` (q2, q3) [rad] is where M11 is smallest, `difference` the q2 - q3 where the block is; `bound` is a proven
    lower bound of M11, so `least_yaw` is the minimum to within least_yaw - bound; `negative_share` is the part of
    the polygon where M is not positive definite.
    """

    least_yaw: float
    bound: float
    pose: tuple[float, float]
    least_block: float
    difference: float
    negative_share: float

    @property
    def positive(self) -> bool:
        """M is positive definite in every pose of the workspace."""
        return self.bound > 0 and self.least_block > 0

    @property
    def smallest_eigenvalue(self) -> float:
        """The smallest eigenvalue of M over the workspace [kg m^2]."""
        return min(self.least_yaw, self.least_block)


def definiteness(pi: np.ndarray, workspace: Workspace = LINKED) -> Definiteness:
    """Definiteness of M(q) for `pi` (8,) over a workspace: M11 by branch and bound, the block in closed form.

    Raises InputError if `pi` is not eight finite numbers.
    """
    pi = np.asarray(pi, dtype=float)
    if pi.shape != (8,) or not np.all(np.isfinite(pi)):
        raise InputError(Problem("pi", "8 finite numbers", np.array2string(pi)))
    value, bound, pose = _least_yaw(pi, workspace)
    block, difference = _least_block(pi, workspace)
    return Definiteness(value, bound, pose, block, difference, _negative_share(pi, workspace))


def block_eigenvalue(pi: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """Smaller eigenvalue (...) of [[p5, M23], [M23, p6]], M23 = -p4/2 sin(q2 - q3) [kg m^2]."""
    p4, p5, p6 = pi[3:6]
    m23 = 0.5 * p4 * np.sin(np.asarray(difference))
    return (p5 + p6) / 2 - np.hypot((p5 - p6) / 2, m23)


def _least_block(pi: np.ndarray, workspace: Workspace) -> tuple[float, float]:
    """The eigenvalue falls with |sin(q2 - q3)|, which is largest at the ends of the interval or at +-90 deg inside
    it.
    """
    low = max(workspace.linkage_low, workspace.low[1] - workspace.high[2])
    high = min(workspace.linkage_high, workspace.high[1] - workspace.low[2])
    candidates = np.array([low, high, *(k * np.pi / 2 for k in (-3, -1, 1, 3) if low < k * np.pi / 2 < high)])
    values = block_eigenvalue(pi, candidates)
    return float(values.min()), float(candidates[values.argmin()])


def _least_yaw(pi: np.ndarray, workspace: Workspace, rounds: int = 40) -> tuple[float, float, tuple[float, float]]:
    """Global minimum of M11 over the polygon: value, proven lower bound, pose.

    A cell of half widths h2, h3 about c holds no value below M11(c) - |D2| h2 - |D3| h3 - (K22 h2^2 + 2 K23 h2 h3 +
    K33 h3^2)/2, with K the bounds of the second derivatives; cells that cannot hold the minimum are dropped, the
    others are cut in four.
    """
    low, high = np.array(workspace.low[1:]), np.array(workspace.high[1:])
    curvature = abs(pi[3]) + 4 * np.abs(pi[1:3])
    half = (high - low) / 64
    ticks = [low[i] + half[i] * (2 * np.arange(32) + 1) for i in (0, 1)]
    cells = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    best, pose, bound = np.inf, cells[0], -np.inf
    for _ in range(rounds):
        cells = cells[_touches(cells, half, workspace)]
        q = np.insert(cells, 0, 0.0, axis=1)
        slopes = np.abs(np.stack(yaw_inertia_slopes(pi, q), axis=-1))
        floor = yaw_inertia(pi, q) - slopes @ half - 0.5 * (curvature @ half**2) - abs(pi[3]) * half.prod()
        feasible = workspace.clip(q)
        values = yaw_inertia(pi, feasible)
        if values.min() < best:
            best, pose = float(values.min()), feasible[values.argmin(), 1:]
        bound = float(floor.min())
        cells = cells[floor <= best]
        half = half / 2
        cells = (cells[:, None, :] + half * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])).reshape(-1, 2)
        if best - bound <= 1e-9 * np.abs(pi[:4]).sum():
            break
    return best, min(bound, best), (float(pose[0]), float(pose[1]))


def _touches(cells: np.ndarray, half: np.ndarray, workspace: Workspace) -> np.ndarray:
    """True for cells that share a point with the linkage's strip."""
    difference, reach = cells[:, 0] - cells[:, 1], half.sum()
    return (difference + reach >= workspace.linkage_low) & (difference - reach <= workspace.linkage_high)


def definite_map(
    pi: np.ndarray, workspace: Workspace = LINKED, count: int = 181
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smallest eigenvalue of M over the (q2, q3) plane: ticks q2 (n,), q3 (n,) [rad], values (n, n) with NaN
    outside.
    """
    pi = np.asarray(pi, dtype=float)
    q2 = np.linspace(workspace.low[1], workspace.high[1], count)
    q3 = np.linspace(workspace.low[2], workspace.high[2], count)
    grid2, grid3 = np.meshgrid(q2, q3, indexing="ij")
    q = np.stack([np.zeros_like(grid2), grid2, grid3], axis=-1)
    least = np.minimum(yaw_inertia(pi, q), block_eigenvalue(pi, grid2 - grid3))
    return q2, q3, np.where(workspace.contains(q), least, np.nan)


def mesh(workspace: Workspace = LINKED, count: int = 81) -> np.ndarray:
    """Poses (count, count, 3) with q1 = 0 that cover the (q2, q3) polygon to its edges: q2 along axis 0, q3 across
    the strip.
    """
    q2 = np.linspace(workspace.low[1], workspace.high[1], count)[:, None]
    lower = np.maximum(workspace.low[2], q2 - workspace.linkage_high)
    upper = np.minimum(workspace.high[2], q2 - workspace.linkage_low)
    q3 = lower + (upper - lower) * np.linspace(0, 1, count)
    return np.stack([np.zeros_like(q3), np.broadcast_to(q2, q3.shape), q3], axis=-1)


def _negative_share(pi: np.ndarray, workspace: Workspace) -> float:
    values = definite_map(pi, workspace)[2]
    return float(np.mean(values[np.isfinite(values)] <= 0))


def outline(workspace: Workspace = LINKED, count: int = 60) -> np.ndarray:
    """Poses (n, 3) with q1 = 0 along the edge of the (q2, q3) polygon, in order: their tips outline the reachable
    section.
    """
    q2 = np.linspace(workspace.low[1], workspace.high[1], count)
    lower = np.maximum(workspace.low[2], q2 - workspace.linkage_high)
    upper = np.minimum(workspace.high[2], q2 - workspace.linkage_low)
    edge = [
        np.stack([q2, lower], axis=-1),
        np.stack([np.full(count, q2[-1]), np.linspace(lower[-1], upper[-1], count)], axis=-1),
        np.stack([q2, upper], axis=-1)[::-1],
        np.stack([np.full(count, q2[0]), np.linspace(upper[0], lower[0], count)], axis=-1),
    ]
    return np.insert(np.concatenate(edge), 0, 0.0, axis=1)
