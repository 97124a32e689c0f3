"""Exact spectrum of a linear loop with delays: Chebyshev collocation of its generator, then Newton on the true
matrix.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike, NDArray

_ORDERS = (10, 16, 24, 36, 54, 80, 120)
_POLISH = 40


def _one_delay_each(system: "DelaySystem", _: object, delays: tuple[float, ...]) -> None:
    if len(delays) != len(system.matrices) or min(delays) < 0.0:
        raise ValueError(f"one delay >= 0 for each of the {len(system.matrices)} matrices, not {delays}")


def _matrices(terms: Iterable[ArrayLike]) -> tuple[np.ndarray, ...]:
    return tuple(np.asarray(term, float) for term in terms)


def _floats(delays: Iterable[float]) -> tuple[float, ...]:
    return tuple(float(delay) for delay in delays)


@frozen
class DelaySystem:
    """The retarded linear system x'(t) = A0 x(t) + sum_i A_i x(t - tau_i).

    `matrices` is (A_0, A_1, ...) with `delays` (0, tau_1, ...) [s]; every matrix has the shape (n, n). A delay of zero
    may stand anywhere. Not for neutral systems: no delayed derivative.
    """

    matrices: tuple[np.ndarray, ...] = field(converter=_matrices)
    delays: tuple[float, ...] = field(converter=_floats, validator=_one_delay_each)

    @property
    def size(self) -> int:
        """Number n of states."""
        return self.matrices[0].shape[0]

    @property
    def longest(self) -> float:
        """Longest delay [s]."""
        return max(self.delays)

    def characteristic(self, s: complex | NDArray[np.complex128]) -> np.ndarray:
        """Delta(s) = s I - sum_i A_i exp(-s tau_i), shape (n, n); (k, n, n) for several s (k,)."""
        s = np.asarray(s, complex)[..., None, None]
        delta = s * np.eye(self.size, dtype=complex)
        for matrix, delay in zip(self.matrices, self.delays):
            delta -= matrix * np.exp(-s * delay)
        return delta

    def slope(self, s: complex | NDArray[np.complex128]) -> np.ndarray:
        """Delta'(s) = I + sum_i tau_i A_i exp(-s tau_i), shape (n, n); (k, n, n) for several s (k,)."""
        s = np.asarray(s, complex)[..., None, None]
        slope = np.eye(self.size, dtype=complex)
        for matrix, delay in zip(self.matrices, self.delays):
            slope = slope + delay * matrix * np.exp(-s * delay)
        return slope


@cache
def chebyshev(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes cos(i pi / N) on [-1, 1], shape (N + 1,), and their differentiation matrix (Trefethen 2000, program
    `cheb`).
    """
    nodes = np.cos(np.pi * np.arange(order + 1) / order)
    weights = np.ones(order + 1)
    weights[[0, -1]] = 2.0
    weights *= (-1.0) ** np.arange(order + 1)
    gaps = nodes[:, None] - nodes[None, :] + np.eye(order + 1)
    matrix = np.outer(weights, 1.0 / weights) / gaps
    return nodes, matrix - np.diag(matrix.sum(axis=1))


def _interpolation(nodes: np.ndarray, point: float) -> np.ndarray:
    """Barycentric Lagrange weights of the Chebyshev nodes at a point, shape (N + 1,)."""
    gaps = point - nodes
    if np.any(np.abs(gaps) < 1e-14):
        return (np.abs(gaps) < 1e-14).astype(float)
    weights = (-1.0) ** np.arange(nodes.size)
    weights[[0, -1]] *= 0.5
    return weights / gaps / np.sum(weights / gaps)


def generator(system: DelaySystem, order: int) -> np.ndarray:
    """Infinitesimal generator collocated on N + 1 Chebyshev nodes of [-tau, 0], shape (n + N m, n + N m).

    First n rows: x'(0) = sum_i A_i p(-tau_i); other rows: p'(theta_j), with p the interpolating polynomial
    (Breda, Maset, Vermiglio 2005, eq. 4) of the m states whose past acts: that of the others would only follow them.
    """
    nodes, derivative = chebyshev(order)
    delayed = [np.any(term, axis=0) for term, delay in zip(system.matrices, system.delays) if delay > 0.0]
    n, past = system.size, np.flatnonzero(np.any(delayed, axis=0))
    slopes = np.kron(2.0 / system.longest * derivative[1:], np.eye(len(past)))
    matrix = np.zeros((n + len(slopes), n + len(slopes)))
    matrix[n:, past], matrix[n:, n:] = np.split(slopes, [len(past)], axis=1)
    for term, delay in zip(system.matrices, system.delays):
        weights = _interpolation(nodes, 1.0 - 2.0 * delay / system.longest)
        matrix[:n, :n] += weights[0] * term
        matrix[:n, n:] += np.kron(weights[1:], term[:, past])
    return matrix


def balanced(system: DelaySystem) -> DelaySystem:
    """The same spectrum with states scaled by powers of two, so that norms mean something (Parlett and Reinsch
    1969).
    """
    off = np.asarray(sum(np.abs(matrix) for matrix in system.matrices))
    np.fill_diagonal(off, 0.0)
    scale, usable = np.ones(system.size), (off.sum(axis=0) > 0.0) & (off.sum(axis=1) > 0.0)
    last = scale
    for _ in range(20):
        columns, rows = off.sum(axis=0)[usable], off.sum(axis=1)[usable]
        step = np.ones(system.size)
        step[usable] = np.exp2(np.clip(np.round(0.5 * np.log2(rows / columns)), -1.0, 1.0))
        if np.all(step * last == 1.0):  # nothing moves, or all of it back to where it was
            break
        last = step
        scale *= step
        off *= step[None, :] / step[:, None]
    return DelaySystem([matrix * scale[None, :] / scale[:, None] for matrix in system.matrices], system.delays)


def polished(system: DelaySystem, guesses: NDArray[np.complex128]) -> list[complex | None]:
    """Newton correction of roots (k,) on the exact characteristic matrix; None for those that do not converge.

    Successive linear problems (Ruhe 1973): Delta(s) v = lambda Delta'(s) v and s <- s - lambda with the lambda of least
    modulus, found as the largest 1 / lambda of Delta(s)^-1 Delta'(s). Convergence stays quadratic at semisimple
    multiple roots, which equal axes produce.
    """
    s: NDArray[np.complex128] = np.array(guesses, complex)
    found: dict[int, complex] = {}
    size, todo = np.full(len(s), np.inf), np.arange(len(s))
    for _ in range(_POLISH):
        # exp(-s tau) would overflow: far left, not sought
        todo = todo[np.isfinite(s[todo]) & (-s.real[todo] * system.longest <= 600.0)]
        if not len(todo):
            break
        try:
            ratio = np.linalg.solve(system.characteristic(s[todo]), system.slope(s[todo]))
        except np.linalg.LinAlgError:  # Delta(s) is singular: a root
            if len(s) > 1:
                return [root for guess in guesses for root in polished(system, guess[None])]
            return [complex(s[0])]
        fine = np.isfinite(ratio).all(axis=(1, 2))
        todo, ratio = todo[fine], ratio[fine]
        inverse = np.linalg.eigvals(ratio)
        largest = np.take_along_axis(inverse, np.argmax(np.abs(inverse), axis=1)[:, None], axis=1)[:, 0]
        todo, largest = todo[largest != 0.0], largest[largest != 0.0]
        s[todo] -= 1.0 / largest
        size[todo] = np.abs(1.0 / largest) / np.maximum(1.0, np.abs(s[todo]))
        found |= {int(k): complex(s[k]) for k in todo if size[k] <= 4e-15}
        todo = todo[size[todo] > 4e-15]
    found |= {int(k): complex(s[k]) for k in todo if size[k] <= 1e-11}
    return [found.get(k) for k in range(len(s))]


def roots(system: DelaySystem, above: float = -np.inf, at_most: int = 12, sure: int = 4) -> NDArray[np.complex128]:
    """Rightmost characteristic roots with real part >= `above` [1/s], polished, right to left; each conjugate pair
    once.

    Upper half plane only (imaginary part >= 0), shape (k,). Multiple roots appear once. The collocation order grows
    until its `sure` rightmost eigenvalues are roots to 1e-6 before polishing; roots far to the left are only as
    complete as that.
    """
    return _roots_of_balanced(balanced(system), above, at_most, sure)


def _roots_of_balanced(scaled: DelaySystem, above: float, at_most: int, sure: int) -> NDArray[np.complex128]:
    if scaled.longest == 0.0:
        found: NDArray[np.complex128] = np.linalg.eigvals(_added(scaled.matrices)).astype(complex)
        return _distinct(found[(found.imag >= 0) & (found.real >= above)])[:at_most]
    corrected: list[complex | None] = []
    for order in _ORDERS:
        guesses = _rightmost(scaled, order, above, at_most)
        corrected = polished(scaled, guesses)
        if _resolved(guesses[:sure], corrected[:sure]):
            break
    kept = [complex(s.real, abs(s.imag)) for s in corrected if s is not None and s.real >= above]
    return _distinct(np.array(kept, complex))


def _rightmost(system: DelaySystem, order: int, above: float, at_most: int) -> NDArray[np.complex128]:
    guesses: NDArray[np.complex128] = np.linalg.eigvals(generator(system, order)).astype(complex)
    guesses = guesses[(guesses.imag >= 0) & (guesses.real >= above - 1.0 / system.longest)]
    return guesses[np.argsort(-guesses.real)][:at_most]


def _resolved(guesses: NDArray[np.complex128], corrected: list[complex | None]) -> bool:
    """True where Newton moved the collocation eigenvalues by less than 1e-6 relative."""
    return all(s is not None and abs(s - g) <= 1e-6 * max(abs(s), 1e-2) for g, s in zip(guesses, corrected))


def _distinct(found: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Right to left, without repetitions (roots closer than 1e-7 relative)."""
    kept: list[complex] = []
    for s in found[np.argsort(-found.real)]:
        if all(abs(s - other) > 1e-7 * max(1.0, abs(s)) for other in kept):
            kept.append(s)
    return np.array(kept, complex)


def abscissa(system: DelaySystem) -> float:
    """Largest real part of the roots [1/s], the structural roots at s = 0 left out.

    A free, gravity-compensated loop rests anywhere, so that s = 0 is a root for every gain and delay (one for each
    axis: both arms displaced together). It is not a matter of stability and is left out when Delta(0) is singular (to
    1e-7: a linearisation by differences moves it a little); so are roots below 1e-5 of the loop's frequency then.
    -inf where no other root was found.
    """
    system = balanced(system)
    neutral = _neutral(system)
    found = _roots_of_balanced(system, -np.inf, neutral + 4, neutral + 2)
    if neutral:
        found = found[np.abs(found) > 1e-5 * _frequency_scale(system)]
    return float(found[0].real) if found.size else -np.inf


def _neutral(scaled: DelaySystem) -> int:
    """Number of structural roots at s = 0 of a balanced system: singular values of Delta(0) below 1e-7 of the
    largest.
    """
    values = np.linalg.svd(scaled.characteristic(0.0), compute_uv=False)
    return int(np.sum(values <= 1e-7 * values[0]))


def _frequency_scale(system: DelaySystem) -> float:
    """A frequency [rad/s] that is typical of the loop: the largest modulus of the roots without delay."""
    return float(np.max(np.abs(np.linalg.eigvals(_added(system.matrices)))))


def root_bound(system: DelaySystem) -> float:
    """No root with Re s >= 0 has a modulus above this [1/s]: the norm of the sum of absolute terms, balanced."""
    scaled = balanced(system)
    return float(np.linalg.norm(_added(np.abs(matrix) for matrix in scaled.matrices), 2))


def count_right(system: DelaySystem, real: float, samples: int = 4000) -> int:
    """Number of roots with real part above `real` [1/s] by the argument principle: the check on `roots`.

    Winding of det Delta(real + i w) / (real + i w + c)^n over w in [0, bound], doubled by symmetry; intervals are
    halved until the angle turns by less than 0.5 rad. Wrong if a root lies on the line.
    """
    bound = 50.0 * (
        sum(
            np.linalg.norm(matrix, 2) * np.exp(max(-real, 0.0) * delay)
            for matrix, delay in zip(balanced(system).matrices, system.delays)
        )
        + abs(real)
    )
    scaled, shift = balanced(system), abs(real) + 1.0

    def value(w: float) -> complex:
        s = complex(real, w)
        return np.linalg.det(scaled.characteristic(s) / (s + shift - real))

    grid = np.concatenate([[0.0], np.geomspace(1e-6 * bound, bound, samples)])
    values = [value(w) for w in grid]
    turned = sum(_turn(value, grid[i], grid[i + 1], values[i], values[i + 1], 40) for i in range(samples))
    return round(-turned / np.pi)


def _turn(
    value: Callable[[float], complex], low: float, high: float, at_low: complex, at_high: complex, depth: int
) -> float:
    angle = float(np.angle(at_high / at_low))
    if abs(angle) < 0.5 or depth == 0:
        return angle
    middle = 0.5 * (low + high)
    at_middle = value(middle)
    return _turn(value, low, middle, at_low, at_middle, depth - 1) + _turn(
        value, middle, high, at_middle, at_high, depth - 1
    )


@frozen
class DelayFamily:
    """A loop whose channel delay T is free: x' = sum_i A_i x(t - d_i) + sum_j B_j x(t - d_j - T).

    `fixed` holds the A_i with their delays d_i (the co-simulation's own ages among them), `channel` the B_j. The same T
    stands in both directions: by similarity only the sum of the two directions counts.
    """

    fixed: DelaySystem
    channel: DelaySystem

    def at(self, delay: float) -> DelaySystem:
        """The loop with the channel delay T [s] each way."""
        return DelaySystem(
            self.fixed.matrices + self.channel.matrices,
            self.fixed.delays + tuple(d + delay for d in self.channel.delays),
        )


def crossings(family: DelayFamily, samples: int = 3000) -> np.ndarray:
    """All pairs (w [rad/s], T [s] >= 0 least) where a root sits on the imaginary axis, shape (k, 2), T ascending.

    Frequency sweep (Chen and Latchman 1995): at every w the values z with det(i w I - F(w) - z G(w)) = 0, F and G the
    fixed and channel terms; a root crosses where |z| = 1, at the delay T = -arg(z) / w. Solved on a logarithmic grid,
    each change of sign of |z| - 1 by Brent's method. Tangencies between grid points are missed.
    """
    top = 1.05 * root_bound(family.at(0.0))
    grid = np.geomspace(1e-5 * top, top, samples)
    sizes = np.sort(np.abs(_gains(family, grid)), axis=1)
    found = []
    for k, branch in np.argwhere((sizes[:-1] - 1.0) * (sizes[1:] - 1.0) < 0.0):
        w = _zero(
            lambda w, b=branch: float(np.sort(np.abs(_gains(family, [w])[0]))[b] - 1.0), *map(float, grid[k : k + 2])
        )
        values = _gains(family, [w])[0]
        found += [(w, float(np.angle(v) % (2.0 * np.pi)) / w) for v in values[np.abs(np.abs(values) - 1.0) < 1e-8]]
    return np.array(sorted(found, key=lambda pair: pair[1])).reshape(-1, 2)


def _zero(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function changes sign between two places, to the last digit (Brent's method)."""
    from scipy.optimize import brentq

    found: Any = brentq(function, low, high, xtol=1e-300, rtol=np.float64(8.9e-16))
    return float(found)


def _gains(family: DelayFamily, frequencies: ArrayLike) -> np.ndarray:
    """Values 1/z of det(i w I - F - z G) = 0, shape (len(w), n): eigenvalues of (i w I - F)^-1 G.

    A root crosses at |1/z| = 1 with exp(-i w T) = z, so T = arg(1/z) / w.
    """
    s = 1j * np.asarray(frequencies)[:, None, None]
    fixed = s * np.eye(family.fixed.size) - _sum(family.fixed, s)
    return np.linalg.eigvals(np.linalg.solve(fixed, _sum(family.channel, s)))


def _sum(system: DelaySystem, s: np.ndarray) -> np.ndarray:
    return _added(matrix * np.exp(-s * delay) for matrix, delay in zip(system.matrices, system.delays))


def _added(terms: Iterable[np.ndarray]) -> np.ndarray:
    """The sum of terms; zero where there are none."""
    return np.asarray(sum(terms))


def max_delay(family: DelayFamily) -> float:
    """Least channel delay T [s] each way at which the loop loses stability; inf if none does, 0 if unstable without
    delay.

    The crossing comes from the frequency sweep and is then polished by Newton on (w, T) at the exact characteristic
    matrix.
    """
    if abscissa(family.at(0.0)) >= 0.0:
        return 0.0
    pairs = crossings(family)
    if pairs.size == 0:
        return np.inf
    w, delay = pairs[0]
    return _polished_crossing(family, w, delay)


def _polished_crossing(family: DelayFamily, w: float, delay: float) -> float:
    """Newton on T so that the root near i w has no real part: dT = -Re s / Re(ds/dT)."""
    for _ in range(6):
        system = family.at(delay)
        s = polished(system, np.array([1j * w]))[0]
        if s is None:
            return delay
        rate = root_rate(family, delay, s)
        step = -s.real / rate.real
        w, delay = s.imag + step * rate.imag, delay + step
        if abs(step) <= 1e-14 * max(delay, 1e-6):
            break
    return float(delay)


def root_rate(family: DelayFamily, delay: float, s: complex) -> complex:
    """ds/dT of a simple root [1/s^2] = -(u^H dDelta/dT v) / (u^H Delta' v) with the null vectors u, v of Delta(s)."""
    from scipy.linalg import eig

    system = family.at(delay)
    solved: Any = eig(system.characteristic(s), left=True)  # what it returns depends on its options
    values, left, right = solved
    k = int(np.argmin(np.abs(values)))
    u, v = left[:, k].conj(), right[:, k]
    by_delay = sum(s * b * np.exp(-s * (d + delay)) for b, d in zip(family.channel.matrices, family.channel.delays))
    return complex(-(u @ by_delay @ v) / (u @ system.slope(s) @ v))


def position_loop(
    mass: Sequence[np.ndarray],
    stiffness: Sequence[np.ndarray],
    damping: Sequence[np.ndarray],
    added: Sequence[float] = (0.0, 0.0),
) -> DelayFamily:
    """P-like teleoperation near a pose: M_i x_i'' = K_i (x_j(t - T - a_i) - x_i) - B_i x_i' for the two sides.

    `mass`, `stiffness`, `damping`: (local, remote), each scalar or (n, n) in task space [kg, N/m, N s/m]; `added` [s]
    is the age that the co-simulation adds to the sample each side receives. States (x_l, v_l, x_r, v_r), shape (4 n,
    4 n).
    """
    size = np.atleast_2d(mass[0]).shape[0]
    eye, zero = np.eye(size), np.zeros((size, size))
    inverse = [np.linalg.inv(np.atleast_2d(m)) for m in mass]
    spring = [inverse[i] @ (np.atleast_2d(stiffness[i]) * 1.0) for i in (0, 1)]
    damper = [inverse[i] @ (np.atleast_2d(damping[i]) * 1.0) for i in (0, 1)]
    fixed = np.block(
        [
            [zero, eye, zero, zero],
            [-spring[0], -damper[0], zero, zero],
            [zero, zero, zero, eye],
            [zero, zero, -spring[1], -damper[1]],
        ]
    )
    to_local, to_remote = np.zeros((4 * size, 4 * size)), np.zeros((4 * size, 4 * size))
    to_local[size : 2 * size, 2 * size : 3 * size] = spring[0]
    to_remote[3 * size :, :size] = spring[1]
    return DelayFamily(DelaySystem([fixed], [0.0]), DelaySystem([to_local, to_remote], added))
