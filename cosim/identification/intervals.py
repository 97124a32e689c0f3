"""Intervals of estimated parameters that count the correlation of the residual in time.

The white-noise standard deviation of least squares is 3 to 10 times too small here (PHYSICS.md 4). The rows are cut
into contiguous blocks longer than the residual's memory, and each block is left out once (delete-one jackknife).
"""

import numpy as np
from attrs import frozen

from cosim.identification.estimate import ParameterEstimate
from cosim.identification.stack import Stack

LEVEL = 0.95
LOST = 0.05  # correlation that counts as none: 400 rows that have none show it with their own scatter, 1 / sqrt(400)
LONGER = 10  # times the memory: what neighbouring blocks share is then a tenth of them
BLOCKS = 12  # of fewer a jackknife's own standard deviation is known to less than 20 %, 1 / sqrt(2 * 12)
PAIRED = 0.02  # of the rows: lags with fewer pairs, over holes, say nothing of the correlation


@frozen(eq=False)
class Spread:
    """std and std_white (p,), half_width (p,) of the 95 % interval, block [s], blocks, effective (nj,) sample size."""

    std: np.ndarray
    std_white: np.ndarray
    half_width: np.ndarray
    block: float
    blocks: int
    effective: np.ndarray


def spread(stack: Stack, estimate: ParameterEstimate) -> Spread:
    """Standard deviations and 95 % half-widths of the estimate's parameters."""
    y, tau, joint, stamp = stack.equations(stack.fit)
    residual = tau - y @ estimate.params
    memory = np.array([_memory(stack, residual, joint, stamp, j) for j in range(stack.tau.shape[1])])
    length = max(int(np.ceil(LONGER * memory.max())), 4)
    number = blocks(stack, stamp, length)
    scale = np.sqrt((estimate.weights[:, None] * y**2).sum(axis=0))
    scale[scale == 0] = 1.0
    scaled = y / scale
    normal = (scaled * estimate.weights[:, None]).T @ scaled
    shifts, count = _jackknife(scaled, residual, estimate.weights, number, normal)
    std = np.sqrt((count - 1) / count * (shifts**2).sum(axis=0)) / scale
    white = (
        np.sqrt(np.diag(np.linalg.pinv(normal, rcond=1e-14)) * _variance(residual, estimate.weights, y.shape[1]))
        / scale
    )
    effective = np.array([(joint == j).sum() for j in range(len(memory))]) / memory
    return Spread(std, white, student(count - 1) * std, length * stack.step, count, effective)


def student(freedom: float) -> float:
    """Two-sided 95 % point of Student's t."""
    from scipy.stats import t

    return float(t.ppf(0.5 + LEVEL / 2, max(freedom, 1)))


def _variance(residual: np.ndarray, weights: np.ndarray, parameters: int) -> float:
    return float((weights * residual**2).sum() / max(len(residual) - parameters, 1))


def _memory(stack: Stack, residual: np.ndarray, joint: np.ndarray, stamp: np.ndarray, j: int) -> float:
    """Integrated autocorrelation 1 + 2 sum rho_k of a joint's residual in rows, up to where rho first falls below
    LOST.
    """
    series = np.zeros(len(stack.time))
    present = np.zeros(len(stack.time))
    mine = joint == j
    series[stamp[mine]], present[stamp[mine]] = residual[mine], 1.0
    return memory(series, present)


def memory(series: np.ndarray, present: np.ndarray) -> float:
    """Integrated autocorrelation [rows] of a series (n,) with holes, present (n,) in {0, 1}; at least 1."""
    size = 1 << int(2 * len(series) - 1).bit_length()
    power = np.abs(np.fft.rfft(series * present, size)) ** 2
    pairs = np.fft.irfft(np.abs(np.fft.rfft(present, size)) ** 2, size)[: len(series)]
    products = np.fft.irfft(power, size)[: len(series)]
    if products[0] <= 0:
        return 1.0
    usable = pairs > PAIRED * pairs[0]
    rho = np.where(usable, products / np.maximum(pairs, 1), 0.0) / (products[0] / pairs[0])
    below = np.flatnonzero(rho < LOST)
    last = below[0] if len(below) else len(rho)
    return max(1.0 + 2.0 * float(rho[1:last].sum()), 1.0)


def blocks(stack: Stack, stamp: np.ndarray, length: int) -> np.ndarray:
    """Number of the contiguous block of each equation; blocks do not cross runs and there are at least about BLOCKS."""
    used = np.unique(stamp)
    length = max(min(length, len(used) // BLOCKS), 1)
    edges = np.flatnonzero(np.diff(stack.run[used]) != 0) + 1
    numbers, first = np.empty(len(used), int), 0
    for part in np.split(np.arange(len(used)), edges):
        count = max(round(len(part) / length), 1)
        numbers[part] = first + np.arange(len(part)) * count // len(part)
        first += count
    return numbers[np.searchsorted(used, stamp)]


def _jackknife(
    y: np.ndarray, residual: np.ndarray, weights: np.ndarray, number: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, int]:
    """Change of the scaled parameters when each block is left out, (blocks, p)."""
    blocks = int(number.max()) + 1
    order = np.argsort(number, kind="stable")
    edges = np.searchsorted(number[order], np.arange(blocks + 1))
    shifts = np.zeros((blocks, y.shape[1]))
    for b in range(blocks):
        rows = order[edges[b] : edges[b + 1]]
        own = y[rows] * weights[rows, None]
        shifts[b] = -np.linalg.lstsq(normal - own.T @ y[rows], own.T @ residual[rows], rcond=1e-12)[0]
    return shifts - shifts.mean(axis=0), blocks
