"""Base parameters of a serial arm: the combinations of its links' parameters that torques can show (Gautier 1991)."""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from attrs import frozen

from cosim.arm.serial import SerialModel
from cosim.arm.serial_dynamics import LINK_PARAMETERS, link_parameters, regressor

DEPENDENT = 1e-9
"""A column whose part beside the columns before it is smaller than this share of it is dependent: rounding is 1e-14."""
NOTHING = float(np.finfo(float).eps) / DEPENDENT
"""A share of a combination, as a part of the largest, that is rounding: columns that are kept may be dependent to
DEPENDENT, which enlarges rounding by its inverse.
"""
_CHUNK = 4096  # rows of a regressor formed at once


@frozen(eq=False)
class BaseParameters:
    """`kept` (b,) numbers of independent columns of `whole_regressor`; grouping (b, p) with base = grouping @ all."""

    kept: np.ndarray
    grouping: np.ndarray

    def of(self, everything: np.ndarray) -> np.ndarray:
        """Base parameters (b,) of all parameters (p,)."""
        return self.grouping @ everything


def parameter_names(model: SerialModel) -> list[tuple[str, int]]:
    """(name, joint from 0) of the p = 11 n parameters: LINK_PARAMETERS of each link, then the rotors."""
    links = [(name, i) for i in range(model.count) for name in LINK_PARAMETERS]
    return links + [("rotor", i) for i in range(model.count)]


def all_parameters(model: SerialModel) -> np.ndarray:
    """(11 n,) of an arm: `link_parameters`, then its armature."""
    return np.concatenate([link_parameters(model), model.armature])


def whole_regressor(model: SerialModel, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Y (m, n, 11 n) with Y all_parameters = M ddq + C dq + N at m states, rotors included."""
    rotors = np.asarray(ddq)[..., None] * np.eye(model.count)
    return np.concatenate([regressor(model, q, dq, ddq), rotors], axis=-1)


@lru_cache(maxsize=8)
def base_parameters(model: SerialModel, seed: int = 1) -> BaseParameters:
    """By QR of the regressor at random states: a column stays that those before it do not make up.

    So of each link stay those that Gautier's rules keep, and a rotor that turns as its link does goes with the link.
    """
    random, p = np.random.default_rng(seed), 11 * model.count
    q = model.poses(4 * p, seed)
    dq, ddq = random.uniform(-2.0, 2.0, q.shape), random.uniform(-5.0, 5.0, q.shape)
    y = whole_regressor(model, q, dq, ddq).reshape(-1, p)
    norms = np.linalg.norm(y, axis=0)
    seen = norms > DEPENDENT * norms.max()
    scaled = y / np.where(seen, norms, 1.0)
    kept: list[int] = []
    basis = np.zeros((len(y), 0))
    for k in np.flatnonzero(seen):
        rest = scaled[:, k]
        for _ in range(2):  # a second time for the digits that the first one loses
            rest = rest - basis @ (basis.T @ rest)
        if (size := float(np.linalg.norm(rest))) > DEPENDENT:
            kept.append(int(k))
            basis = np.column_stack([basis, rest / size])
    grouping = np.linalg.lstsq(scaled[:, kept], scaled, rcond=None)[0] * norms / norms[kept, None]
    return BaseParameters(np.array(kept), np.where(np.abs(grouping) > NOTHING * np.abs(grouping).max(), grouping, 0.0))


def base_columns(
    model: SerialModel, base: BaseParameters, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray
) -> np.ndarray:
    """The base columns (m, n, b) at m states, formed piece by piece."""
    out, links = np.zeros((*q.shape, len(base.kept))), 10 * model.count
    first = int(np.searchsorted(base.kept, links))  # rotors come last
    for s in _pieces(len(q)):
        out[s, :, :first] = regressor(model, q[s], dq[s], ddq[s])[..., base.kept[:first]]
    for column, joint in enumerate(base.kept[first:] - links, start=first):
        out[:, joint, column] = ddq[:, joint]
    return out


def _pieces(rows: int) -> Iterator[slice]:
    for first in range(0, rows, _CHUNK):
        yield slice(first, first + _CHUNK)


def base_mass_matrix(model: SerialModel, base: BaseParameters, params: np.ndarray, q: np.ndarray) -> np.ndarray:
    """M(q) (m, n, n) [kg m^2] of base parameters (b,) at poses (m, n)."""
    still, n = np.zeros_like(q), model.count
    gravity = base_columns(model, base, q, still, still) @ params
    unit = [base_columns(model, base, q, still, still + np.eye(n)[k]) @ params - gravity for k in range(n)]
    return np.stack(unit, axis=-1)
