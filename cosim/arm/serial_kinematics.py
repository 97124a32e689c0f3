"""Where the links of a serial arm are: frames in the base frame, points, Jacobians.

`q` (..., n) [rad, m at prismatic joints]; leading axes broadcast. True for rigid links and joints without play.
"""

import numpy as np
from attrs import frozen

from cosim.arm.serial import SerialModel


@frozen(eq=False)
class LinkFrames:
    """Frames of the joints (which move with their links) in the base frame.

    rotation (..., n, 3, 3), origin (..., n, 3) [m], axis (..., n, 3) unit vectors.
    """

    rotation: np.ndarray
    origin: np.ndarray
    axis: np.ndarray


def about(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotation (..., 3, 3) by `angle` (...) about a unit vector (3,): 1 + sin K + (1 - cos) K^2 (Rodrigues)."""
    k = skew(axis)
    sine, cosine = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + sine * k + (1 - cosine) * (k @ k)


def skew(vector: np.ndarray) -> np.ndarray:
    """[v] (..., 3, 3) with [v] a = v x a."""
    x, y, z = np.moveaxis(np.asarray(vector, dtype=float), -1, 0)
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=-1).reshape(*x.shape, 3, 3)


def apply(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """matrix (..., m, k) times vector (..., k)."""
    return (matrix @ vector[..., None])[..., 0]


def frames(model: SerialModel, q: np.ndarray) -> LinkFrames:
    """The frames of all joints at `q`, from the base outwards."""
    q = np.asarray(q, dtype=float)
    rotation, origin = np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3)), np.zeros((*q.shape[:-1], 3))
    rotations, origins, axes = [], [], []
    for i, slides in enumerate(model.sliding):
        origin = origin + rotation @ model.origin[i]
        rotation = rotation @ model.rotation[i]
        axis = rotation @ model.axis[i]
        if slides:
            origin = origin + axis * q[..., i, None]
        else:
            rotation = rotation @ about(model.axis[i], q[..., i])
        rotations.append(rotation)
        origins.append(origin)
        axes.append(axis)
    return LinkFrames(np.stack(rotations, axis=-3), np.stack(origins, axis=-2), np.stack(axes, axis=-2))


def in_base(at: LinkFrames, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) of the links' frames in the base frame (..., n, 3) [m]."""
    return at.origin + apply(at.rotation, points)


def point_jacobians(model: SerialModel, at: LinkFrames, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and turning of link i by joint k, (..., n, 3, n) each, for one point (..., n, 3) [m, base frame] a link.

    Column k <= i: axis_k x (point_i - origin_k) and axis_k; for a prismatic joint axis_k and 0.
    """
    arms = points[..., :, None, :] - at.origin[..., None, :, :]
    axes = np.broadcast_to(at.axis[..., None, :, :], arms.shape)
    slides = model.sliding[:, None]
    carried = np.tri(model.count)[:, :, None]
    linear = np.where(slides, axes, np.cross(axes, arms)) * carried
    angular = np.where(slides, 0.0, axes) * carried
    return np.swapaxes(linear, -1, -2), np.swapaxes(angular, -1, -2)


def tip_position(model: SerialModel, q: np.ndarray) -> np.ndarray:
    """x (..., 3) [m], base frame."""
    at = frames(model, q)
    return at.origin[..., -1, :] + at.rotation[..., -1, :, :] @ model.tip


def tip_jacobian(model: SerialModel, q: np.ndarray) -> np.ndarray:
    """J (..., 3, n) with dx = J dq."""
    at = frames(model, q)
    tip = at.origin[..., -1, :] + at.rotation[..., -1, :, :] @ model.tip
    arms = tip[..., None, :] - at.origin
    columns = np.where(model.sliding[:, None], at.axis, np.cross(at.axis, arms))
    return np.swapaxes(columns, -1, -2)
