"""Where the tip of the PHANToM is and how it moves: Taati Fig. 1, Sallam Eqs. 2-4, absolute q2 and q3 (the
parallelogram).

Joint angles `q` (..., 3) [rad]; tip `x` (..., 3) [m] in the base frame: y is up, x = 0 at q = 0. In the plane of the
arm the upper arm points along (cos q2, sin q2) and the forearm along (sin q3, -cos q3), as (radial, height).
"""

from collections.abc import Sequence

import numpy as np

L1 = 0.215
"""Upper arm [m], Sallam Table I."""
L2 = 0.170
"""Forearm [m], Sallam Table I."""


def matrix(*rows: Sequence[np.ndarray | float]) -> np.ndarray:
    """Stack entries (scalars or arrays that broadcast) to (..., rows, columns)."""
    width = len(rows[0])
    entries = np.broadcast_arrays(*(entry for row in rows for entry in row))
    flat = np.stack(entries, axis=-1)
    return flat.reshape(*flat.shape[:-1], len(rows), width)


def radius(q: np.ndarray) -> np.ndarray:
    """Signed distance of the tip from the vertical axis, r = l1 cos q2 + l2 sin q3 [m], (...)."""
    q = np.asarray(q)
    return L1 * np.cos(q[..., 1]) + L2 * np.sin(q[..., 2])


def forward(q: np.ndarray) -> np.ndarray:
    """Tip position (..., 3) [m]: (sin q1 r, l2 - l2 cos q3 + l1 sin q2, cos q1 r - l1), Sallam Eqs. 2-4."""
    q = np.asarray(q)
    r = radius(q)
    height = L2 - L2 * np.cos(q[..., 2]) + L1 * np.sin(q[..., 1])
    return np.stack([np.sin(q[..., 0]) * r, height, np.cos(q[..., 0]) * r - L1], axis=-1)


def inverse(x: np.ndarray) -> np.ndarray:
    """Joint angles (..., 3) [rad] that put the tip in front of the vertical axis (r >= 0) at `x` (..., 3) [m].

    The elbow is the one that the linkage allows, |q3 - q2| < 90 deg. NaN where `x` is out of reach; on the axis (r =
    0), where every q1 will do, q1 = 0. Stops being true for postures with r < 0: see `inverse_behind`.
    """
    x = np.asarray(x, dtype=float)
    return _posture(x, np.arctan2(x[..., 0], x[..., 2] + L1), np.hypot(x[..., 0], x[..., 2] + L1))


def inverse_behind(x: np.ndarray) -> np.ndarray:
    """Joint angles (..., 3) [rad] that reach over the vertical axis (r < 0) to the same tip `x` (..., 3) [m]; NaN
    out of reach.
    """
    x = np.asarray(x, dtype=float)
    return _posture(x, np.arctan2(-x[..., 0], -(x[..., 2] + L1)), -np.hypot(x[..., 0], x[..., 2] + L1))


def _posture(x: np.ndarray, q1: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Planar two-link inverse: the forearm turned by delta = q3 - 90 deg - q2 in (-180 deg, 0) against the upper
    arm.
    """
    h = x[..., 1] - L2
    cosine = (r**2 + h**2 - L1**2 - L2**2) / (2 * L1 * L2)
    reached = np.abs(cosine) <= 1 + 1e-12
    delta = -np.arccos(np.clip(np.where(reached, cosine, np.nan), -1, 1))
    q2 = np.arctan2(h, r) - np.arctan2(L2 * np.sin(delta), L1 + L2 * np.cos(delta))
    q2 = np.arctan2(np.sin(q2), np.cos(q2))
    return np.stack([np.where(reached, q1, np.nan), q2, q2 + delta + np.pi / 2], axis=-1)


def jacobian(q: np.ndarray) -> np.ndarray:
    """Translational Jacobian dx/dq (..., 3, 3) [m/rad] in the base frame; det J = l1 l2 r cos(q2 - q3).

    Sallam prints l2 sin q1 for the entry (2, 3); it is l2 sin q3 (MISPRINTS.md).
    """
    q = np.asarray(q)
    (s1, s2, s3), (c1, c2, c3) = np.moveaxis(np.sin(q), -1, 0), np.moveaxis(np.cos(q), -1, 0)
    r = L1 * c2 + L2 * s3
    return matrix(
        [c1 * r, -L1 * s1 * s2, L2 * s1 * c3],
        [0.0, L1 * c2, L2 * s3],
        [-s1 * r, -L1 * c1 * s2, L2 * c1 * c3],
    )


def jacobian_rate(q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """dJ/dt (..., 3, 3) [m/(rad s)], so that the tip accelerates with J ddq + dJ/dt dq."""
    q, dq = np.asarray(q), np.asarray(dq)
    (s1, s2, s3), (c1, c2, c3) = np.moveaxis(np.sin(q), -1, 0), np.moveaxis(np.cos(q), -1, 0)
    w1, w2, w3 = np.moveaxis(dq, -1, 0)
    r, dr = L1 * c2 + L2 * s3, -L1 * s2 * w2 + L2 * c3 * w3
    return matrix(
        [-s1 * w1 * r + c1 * dr, -L1 * (c1 * s2 * w1 + s1 * c2 * w2), L2 * (c1 * c3 * w1 - s1 * s3 * w3)],
        [0.0, -L1 * s2 * w2, L2 * c3 * w3],
        [-c1 * w1 * r - s1 * dr, L1 * (s1 * s2 * w1 - c1 * c2 * w2), -L2 * (s1 * c3 * w1 + c1 * s3 * w3)],
    )


def angular_jacobian(q: np.ndarray) -> np.ndarray:
    """Angular velocity of the forearm per joint rate (..., 3, 3) [1], base frame.

    The second column is zero because q3 is absolute; Sallam prints (-c1, 0, s1) there (MISPRINTS.md).
    """
    q = np.asarray(q)
    s1, c1 = np.sin(q[..., 0]), np.cos(q[..., 0])
    return matrix([0.0, 0.0, -c1], [1.0, 0.0, 0.0], [0.0, 0.0, s1])


def orientation(q: np.ndarray) -> np.ndarray:
    """Rotation (..., 3, 3) of the tool frame: columns are its axes in the base frame (Sallam's T, upper left block)."""
    q = np.asarray(q)
    s1, c1, s3, c3 = np.sin(q[..., 0]), np.cos(q[..., 0]), np.sin(q[..., 2]), np.cos(q[..., 2])
    return matrix([c1, -s1 * s3, s1 * c3], [0.0, c3, s3], [-s1, -c1 * s3, c1 * c3])


def tool_jacobian(q: np.ndarray) -> np.ndarray:
    """Translational Jacobian in the tool frame, R^T J (..., 3, 3) [m/rad]: Taati Eq. 21.

    A force that this Jacobian turns into torque is one in the *tool* frame; a base-frame force needs `jacobian`
    (MISPRINTS.md).
    """
    q = np.asarray(q)
    difference = q[..., 1] - q[..., 2]
    return matrix(
        [radius(q), 0.0, 0.0],
        [0.0, L1 * np.cos(difference), 0.0],
        [0.0, -L1 * np.sin(difference), L2],
    )
