"""A scenario's linear loop as the master steps it: one sparse map over a period of its schedule.

The state holds the newest and the previous outputs of all components (what the master stores) and the states of their
maps, rings of delays among them. Every operation of the schedule is carried out on these maps as the master carries it
out on the FMUs, so that algorithm, order, lines, step multiples and the ages that they add are in the map. The growth
rate is that of its eigenvalues, s = ln(z) / period.
"""

from collections.abc import Mapping

import numpy as np
from attrs import field, frozen

from cosim.analysis.sparse import Sparse, sparse
from cosim.analysis.step_fmu import StepFmu
from cosim.wiring import Wiring
from cosim.wiring.schedule import Schedule, SetInputs, Step

_NEUTRAL = 1e-6
"""Roots [1/s] nearer to zero than this are those of free motion."""
_SOUGHT = 24
"""Eigenvalues sought round z = 1."""
_RESTARTS = 200
"""Of the search for the largest eigenvalues; where it converges, it does within some tens."""
_FAST = 0.5
"""Growth [1/s] beyond that of the roots found round z = 1 that asks for a search elsewhere."""
_LARGEST = 50.0
"""Logarithm of the largest eigenvalue that is told."""
_ITERATIONS, _DOUBLED = 512, 4
"""Periods over which a state is followed, and how often the map is doubled to take many at once."""


@frozen
class StepLoop:
    """z+ = M z over a period [s] of the schedule; `outputs` (2 n,) places of the store come first in z.

    places: for each component the place of its first state, and the one behind its last.
    """

    matrix: Sparse = field(eq=False, repr=False)
    phases: tuple[Sparse, ...] = field(eq=False, repr=False)
    period: float
    outputs: int
    places: Mapping[str, tuple[int, int]]

    def roots(self) -> np.ndarray:
        """Rightmost roots s = ln(z) / period [1/s] found, those of free motion left out, right to left."""
        values = _eigenvalues(self.matrix, self.period)
        values = values[np.abs(values) > 1e-3]
        found = np.log(values.astype(complex)) / self.period
        found = found[np.abs(found) > _NEUTRAL]
        return found[np.argsort(-found.real)]

    @property
    def abscissa(self) -> float:
        """Growth rate [1/s] of the co-simulated linear loop; -inf where nothing moves."""
        found = self.roots()
        return float(found[0].real) if len(found) else -np.inf


def _eigenvalues(matrix: Sparse, period: float) -> np.ndarray:
    """Eigenvalues of the map: all of a small one; else those round 1, and the largest where iterating grows faster."""
    from scipy.sparse.linalg import ArpackNoConvergence, eigs

    size = matrix.shape[0]
    if size <= 300:
        return np.linalg.eigvals(matrix.toarray())
    start = np.random.default_rng(0).standard_normal(size)
    near = complex(np.exp((0.5 + 0.3j) * period))  # beside 1, where free motion makes the map less 1 singular
    slow, sought, inverse = np.zeros(0, complex), _SOUGHT // 2, matrix.tocsc().astype(complex)
    while not np.any(np.abs(slow - 1.0) > _NEUTRAL * period) and sought < size // 4:
        sought *= 2
        slow = np.asarray(eigs(inverse, k=sought, sigma=near, v0=start, return_eigenvectors=False))
    grown = _iterated(matrix, start)
    if grown <= float(np.log(np.abs(slow).max())) + _FAST * period:
        return slow
    try:
        fast = eigs(matrix, k=6, which="LM", v0=start, maxiter=_RESTARTS, return_eigenvectors=False)
    except ArpackNoConvergence as error:  # many of one size: of the largest only the size is known
        fast = error.eigenvalues if len(error.eigenvalues) else np.exp([min(grown, _LARGEST)])
    return np.concatenate([slow, fast])


def _iterated(matrix: Sparse, start: np.ndarray) -> float:
    """By how much the logarithm of a state grows in a period after many: what no search round 1 would see."""
    state, sizes, together = start, [], matrix
    for _ in range(_DOUBLED):
        together = together @ together  # still sparse: mostly rings that shift
    for _ in range(3):
        for _ in range(_ITERATIONS >> _DOUBLED):
            state = together @ state
        sizes.append(float(np.linalg.norm(state)))
        if not 0.0 < sizes[-1] < np.inf:
            return np.inf if sizes[-1] else -np.inf
        state = state / sizes[-1]
    return float(np.log(sizes[-1])) / _ITERATIONS


def step_loop(wiring: Wiring, fmus: Mapping[str, StepFmu]) -> StepLoop:
    """The map of a wiring whose components are given as maps; each over its own step."""
    schedule = wiring.schedule
    builder = _LinearMaster.of(schedule, [fmus[name] for name in schedule.components], wiring)
    phases = []
    for phase in schedule.phases:
        rows = sparse.eye_array(builder.size, format="csr")
        pending: dict[int, Sparse] = {}
        inputs: dict[int, tuple[Sparse, Sparse]] = {}
        for operation in phase.operations:
            if isinstance(operation, SetInputs):
                inputs[operation.component] = builder.inputs(operation, rows)
            elif isinstance(operation, Step):
                rows, pending[operation.component] = builder.stepped(operation.component, rows, inputs)
            else:
                rows = builder.shown(operation.component, rows, pending)
        phases.append(rows)
    matrix = phases[0]
    for rows in phases[1:]:
        matrix = (rows @ matrix).tocsr()
    places = dict(zip(schedule.components, zip(builder.first[:-1], builder.first[1:])))
    return StepLoop(matrix, tuple(phases), len(phases) * schedule.step_ns / 1e9, schedule.outputs, places)


@frozen
class _LinearMaster:
    """Places in z: 2 n outputs of the store, then the states of each component, then its outputs not yet fetched."""

    schedule: Schedule
    fmus: list[StepFmu]
    first: tuple[int, ...]
    late: tuple[int, ...]
    size: int
    shown_by: list[Sparse]

    @classmethod
    def of(cls, schedule: Schedule, fmus: list[StepFmu], wiring: Wiring) -> "_LinearMaster":
        first = np.cumsum([2 * schedule.outputs, *(fmu.a.shape[0] for fmu in fmus)])
        late = np.cumsum([first[-1], *schedule.count])
        places = []
        for name, fmu in zip(schedule.components, fmus):
            names = wiring.outputs(name)
            rows = [names.index(output) for output in fmu.outputs]
            shape = (len(names), len(rows))
            places.append(sparse.csr_array((np.ones(len(rows)), (rows, range(len(rows)))), shape=shape))
        return cls(schedule, fmus, tuple(first.tolist()), tuple(late.tolist()), int(late[-1]), places)

    def inputs(self, operation: SetInputs, rows: Sparse) -> tuple[Sparse, Sparse]:
        """Inputs (m, z) and slopes (k, z) as the master hands them over."""
        held, k = rows[operation.source], len(operation.line)
        if not k:
            return held, sparse.csr_array((0, self.size))
        rise = rows[operation.newer] - rows[operation.older]
        spread = sparse.csr_array((operation.weight, (operation.line, range(k))), shape=(len(operation.source), k))
        return (held + spread @ rise).tocsr(), (sparse.diags_array(1.0 / operation.span) @ rise).tocsr()

    def stepped(self, i: int, rows: Sparse, inputs: Mapping[int, tuple[Sparse, Sparse]]) -> tuple[Sparse, Sparse]:
        """The state after a step of component i, and its outputs."""
        fmu, at = self.fmus[i], slice(self.first[i], self.first[i + 1])
        u, s = inputs.get(i, (sparse.csr_array((len(fmu.inputs), self.size)), None))
        x = rows[at]
        after, shown = fmu.a @ x + fmu.b @ u, fmu.c @ x + fmu.d @ u
        if s is not None and s.shape[0]:
            after, shown = after + fmu.g @ s, shown + fmu.e @ s
        outputs = (self.shown_by[i] @ shown).tocsr()
        rows = self._replaced(rows, self.first[i], after)
        return self._replaced(rows, self.late[i], outputs), outputs

    def shown(self, i: int, rows: Sparse, pending: Mapping[int, Sparse]) -> Sparse:
        """The store after the outputs of component i were fetched."""
        n, at, count = self.schedule.outputs, self.schedule.offset[i], self.schedule.count[i]
        rows = self._replaced(rows, n + at, rows[at : at + count])
        fetched = pending[i] if i in pending else rows[self.late[i] : self.late[i] + count]
        return self._replaced(rows, at, fetched)

    @staticmethod
    def _replaced(rows: Sparse, first: int, part: Sparse) -> Sparse:
        if not part.shape[0]:
            return rows
        return sparse.vstack([rows[:first], part, rows[first + part.shape[0] :]], format="csr")
