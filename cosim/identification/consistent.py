"""Least squares whose inertias a body can have: pseudo-inertias positive definite, the URDF's values as a prior.

    minimise |W (Y params - tau)|^2 + sum ((phi - phi_0) / size)^2,   params = (grouping phi, friction, ...)
    [[tr(I)/2 1 - I, h], [h^T, m]] > 0 for every link, rotors and friction >= 0    (Wensing, Kim, Slotine, RA-L 2018)

I is about the origin of the link's frame. The prior is a normal law about the URDF's values whose standard deviation is
each parameter's own size (the equations are weighted by theirs, so that no weight is left to choose): the data decide
where they can, the URDF where they cannot. The only module here that imports cvxpy.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import frozen

from cosim.errors import InputError, Problem

LEAST = 1e-6
"""Of a pseudo-inertia's smallest eigenvalue, as a part of that of the link's sizes: a hundred times the feasibility to
which the solver (Clarabel: 1e-8) keeps a condition, so that what it returns is positive definite.
"""
_NO_MASS, _NO_LENGTH = 1e-3, 1e-2
"""kg and m: sizes of links where a URDF gives no mass at all, or bodies without extent. They only are units there."""
_TRIANGLE = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


@frozen(eq=False)
class BodyPrior:
    """phi (10 n,) of the links as a URDF has them, and rotors (n,)."""

    links: np.ndarray
    rotors: np.ndarray

    @property
    def sizes(self) -> np.ndarray:
        """(n, 2) mass [kg] and length [m] of each link: the length is its radius of gyration about the frame."""
        table = self.links.reshape(-1, 10)
        mass, trace = table[:, 0], table[:, 4] + table[:, 6] + table[:, 9]
        mass = np.where(mass > 0, mass, max(float(mass.mean()), _NO_MASS))
        return np.column_stack([mass, np.sqrt(np.maximum(0.5 * trace / mass, _NO_LENGTH**2))])


def consistent_fit(
    triangle: np.ndarray, target: np.ndarray, grouping: np.ndarray, prior: BodyPrior, floors: Sequence[float | None]
) -> np.ndarray:
    """params (p,) that a body can have; the first b are base parameters, grouping (b, 11 n) @ (links, rotors).

    triangle (p, p), target (p,): the weighted equations; floors: least value of each of the others, None where it is
    free. Raises InputError where cvxpy is not there or finds nothing.
    """
    try:
        import cvxpy as cp
    except ModuleNotFoundError:
        advice = "pip install 'haptic-cosim[certify]'"
        raise InputError(Problem("--physical for device 'robot'", "the package cvxpy", "none", advice)) from None

    sizes, count = prior.sizes, len(prior.rotors)
    unit = np.concatenate([_unit(mass, length) for mass, length in sizes])
    links = cp.Variable(10 * count)  # in units of each link's size
    rotors, others = cp.Variable(count, nonneg=True), cp.Variable(len(floors))
    base = (grouping[:, : 10 * count] * unit) @ links + grouping[:, 10 * count :] @ rotors
    params = cp.hstack([base, others])
    scale = np.linalg.norm(triangle, axis=0)
    fit = cp.sum_squares((triangle / scale) @ cp.multiply(scale, params) - target)
    held = cp.sum_squares(links - prior.links / unit)
    conditions: list[Any] = [
        _pseudo_inertia(cp, links[10 * i : 10 * i + 10]) >> LEAST * np.eye(4) for i in range(count)
    ]
    conditions += [others[k] >= floor for k, floor in enumerate(floors) if floor is not None]
    problem = cp.Problem(cp.Minimize(fit + held), conditions)
    try:
        problem.solve(solver=cp.CLARABEL)
    except cp.SolverError as error:
        raise InputError(Problem("--physical", "parameters that a body can have", str(error))) from None
    if params.value is None:
        raise InputError(Problem("--physical", "parameters that a body can have", f"none ({problem.status})"))
    return np.asarray(params.value)


def _unit(mass: float, length: float) -> np.ndarray:
    return mass * np.array([1.0, *(length,) * 3, *(length**2,) * 6])


def _pseudo_inertia(cp: Any, link: Any) -> Any:
    """(4, 4) of (m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz), all in the link's own units."""
    entry = {pair: link[4 + k] for k, pair in enumerate(_TRIANGLE)}
    half = 0.5 * (link[4] + link[6] + link[9])
    rows = [
        [(half if a == b else 0.0) - entry[min(a, b), max(a, b)] for b in range(3)] + [link[1 + a]] for a in range(3)
    ]
    return cp.bmat([*rows, [link[1], link[2], link[3], link[0]]])
