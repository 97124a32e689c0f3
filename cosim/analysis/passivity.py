"""Passivity of the plant's port: force on the tip in, velocity of the tip out."""

import numpy as np
from attrs import frozen
from numpy.typing import NDArray


@frozen
class PortPassivity:
    """Verdict on a port; `damping` is the least real part of its impedance [N s/m], found at `frequency` [rad/s]."""

    passive: bool
    damping: float
    frequency: float


def port_passivity(
    a: np.ndarray,
    b: np.ndarray,
    c: np.ndarray,
    d: np.ndarray | None = None,
    lowest: float = 1e-2,
    highest: float = 1e4,
    samples: int = 600,
) -> PortPassivity:
    """Least eigenvalue over frequency of the Hermitian part of Z(i w) = (C (i w I - A)^-1 B + D)^-1, and the verdict on
    it.

    A linear port is passive if it is stable (roots at zero allowed: a free arm) and Re Z >= 0 at every frequency
    (positive realness). State space (n, n), (n, m), (m, n), (m, m); f [N] to dx [m/s]. True for small motion about
    the pose of the linearisation, and on the grid of frequencies [rad/s] only.
    """
    grid = np.geomspace(lowest, highest, samples)
    impedance = np.linalg.inv(responses(a, b, c, d, grid))
    least = _least_real(impedance)
    k = int(np.argmin(least))
    scale = np.linalg.norm(impedance[k], 2)
    roots = np.linalg.eigvals(np.asarray(a, float)).real.max()
    passive = bool(least[k] >= -1e-7 * scale and roots <= 1e-6)
    return PortPassivity(passive, float(least[k]), float(grid[k]))


def responses(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray | None, frequencies: np.ndarray
) -> NDArray[np.complex128]:
    """C (i w I - A)^-1 B + D at frequencies [rad/s], shape (len(w), p, m)."""
    a, b, c = (np.asarray(part, float) for part in (a, b, c))
    d = np.zeros((c.shape[0], b.shape[1])) if d is None else np.asarray(d, float)
    size = len(frequencies)
    inner = np.linalg.solve(
        1j * frequencies[:, None, None] * np.eye(len(a)) - a, np.broadcast_to(b, (size, *b.shape)).astype(complex)
    )
    return np.asarray(c @ inner + d, dtype=np.complex128)


def dissipates(impedance: np.ndarray, counted: float = 0.0, accuracy: float = 1e-6) -> bool:
    """Whether an impedance (w, m, m) takes at least `counted` [N s/m] times the squared speed at every frequency.

    `accuracy`: part of the impedance's norm by which its real part may be wrong (linearised by differences).
    """
    slack = accuracy * np.linalg.norm(impedance, 2, axis=(1, 2))
    return bool(np.all(_least_real(impedance) >= counted - slack - 1e-12))


def _least_real(impedance: np.ndarray) -> np.ndarray:
    return np.linalg.eigvalsh(0.5 * (impedance + impedance.conj().transpose(0, 2, 1)))[:, 0]
