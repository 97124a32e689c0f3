"""Active learning of a level set: a Gaussian process of the growth rate, runs where its sign is least certain.

Straddle rule (Bryan et al. 2005): the next place maximises 1.96 s(x) - |m(x)|, with m, s the posterior mean and
standard deviation; a batch is chosen by believing the mean at the places already chosen (kriging believer,
Ginsbourger et al. 2010).
"""

from collections.abc import Generator

import numpy as np
from attrs import frozen

from cosim.sweeps.boundary import Boundary
from cosim.sweeps.bracket import Places
from cosim.sweeps.quadtree import Lattice, Tree


@frozen
class Budget:
    """Runs in all, of which `start` in a jittered grid; places per round; seed."""

    count: int = 60
    start: int = 16
    batch: int = 4
    seed: int = 0


@frozen
class Process:
    """Gaussian process with a squared-exponential kernel, its two length scales chosen by the likelihood."""

    places: np.ndarray
    values: np.ndarray
    lengths: tuple[float, float]
    scale: float
    mean: float

    @classmethod
    def fitted(cls, places: np.ndarray, values: np.ndarray) -> "Process":
        """Fit to places (n, 2) in the unit square and rates (n,)."""
        mean, scale = float(values.mean()), float(values.std() or 1.0)
        grid = np.geomspace(0.1, 3.0, 12)
        standard = (values - mean) / scale
        best = max(((a, b) for a in grid for b in grid), key=lambda lengths: _likelihood(places, standard, lengths))
        return cls(places, standard, best, scale, mean)

    def predict(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Posterior mean and standard deviation (n,) at places (n, 2)."""
        factor = np.linalg.cholesky(
            _kernel(self.places, self.places, self.lengths) + _NUGGET * np.eye(len(self.places))
        )
        cross = np.linalg.solve(factor, _kernel(self.places, at, self.lengths))
        weights = np.linalg.solve(factor, self.values)
        spread = np.sqrt(np.maximum(1.0 - np.sum(cross**2, axis=0), 0.0))
        return self.mean + self.scale * (cross.T @ weights), self.scale * spread


_NUGGET = 1e-6


def _kernel(a: np.ndarray, b: np.ndarray, lengths: tuple[float, float]) -> np.ndarray:
    gaps = (a[:, None, :] - b[None, :, :]) / np.asarray(lengths)
    return np.exp(-0.5 * np.sum(gaps**2, axis=2))


def _likelihood(places: np.ndarray, values: np.ndarray, lengths: tuple[float, float]) -> float:
    factor = np.linalg.cholesky(_kernel(places, places, lengths) + _NUGGET * np.eye(len(places)))
    return float(-0.5 * np.sum(np.linalg.solve(factor, values) ** 2) - np.sum(np.log(np.diag(factor))))


def learn(budget: Budget) -> Generator[Places, list[float], Boundary]:
    """The level set of zero with at most `budget.count` places; ends earlier where no sign on a 65 x 65 grid is
    doubtful.

    Places whose rate is unknown (NaN) are left out of the fit.
    """
    side = int(np.sqrt(budget.start))
    lattice = Lattice.jittered(side, budget.seed)
    middles = [0.5 * (line[1:] + line[:-1]) for line in lattice.lines]
    places = np.array([(x, y) for x in middles[0] for y in middles[1]])
    values = np.array((yield [tuple(map(float, p)) for p in places]))
    grid = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, 65)], indexing="ij"), axis=-1).reshape(-1, 2)
    while len(places) < budget.count:
        chosen = _straddling(places, values, grid, min(budget.batch, budget.count - len(places)))
        if not chosen:
            break
        answers = yield [tuple(map(float, p)) for p in chosen]
        places, values = np.vstack([places, chosen]), np.append(values, answers)
    return _contours(places, values)


def _straddling(places: np.ndarray, values: np.ndarray, grid: np.ndarray, count: int) -> list[np.ndarray]:
    """The next places, most doubtful first; none where every sign on the grid is sure."""
    known = np.isfinite(values)
    if not known.any():
        return []
    process = Process.fitted(places[known], values[known])
    believed, standard = places[known], process.values
    chosen: list[np.ndarray] = []
    for _ in range(count):
        current = Process(believed, standard, process.lengths, process.scale, process.mean)
        mean, spread = current.predict(grid)
        doubt = 1.96 * spread - np.abs(mean)
        k = int(np.argmax(doubt))
        if doubt[k] <= 0:
            break
        chosen.append(grid[k])
        believed = np.vstack([believed, grid[k]])
        standard = np.append(standard, (mean[k] - process.mean) / process.scale)
    return chosen


def _contours(places: np.ndarray, values: np.ndarray) -> Boundary:
    """Zero lines of the posterior mean, by the tracer on the mean itself (no runs)."""
    from cosim.sweeps.boundary import Precision, trace_square

    known = np.isfinite(values)
    if not known.any():
        return Boundary(())
    process = Process.fitted(places[known], values[known])
    tracer = trace_square(Precision(0.001, 24, 0), Tree(Lattice.jittered(24, 0)))
    asked = next(tracer)
    while True:
        try:
            asked = tracer.send(list(process.predict(np.array(asked))[0]))
        except StopIteration as end:
            return end.value
