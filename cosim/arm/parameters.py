"""The parameter sets of the arm, each with its source, and how it is mounted."""

from collections.abc import Callable
from enum import Enum
from typing import Any

import numpy as np
from attrs import NOTHING, cmp_using, evolve, field, frozen
from numpy.typing import ArrayLike

from cosim.arm.kinematics import L1, L2
from cosim.arm.segments import G, point_mass_pi, segment_pi
from cosim.errors import InputError, Problem, did_you_mean


class Mounting(Enum):
    """How the device stands; upside down turns the sign of gravity."""

    UPRIGHT = "upright"
    UPSIDE_DOWN = "upside_down"

    @property
    def gravity(self) -> float:
        """Gravity [m/s^2] along the base frame's -y."""
        return G if self is Mounting.UPRIGHT else -G


def _vector(length: int) -> Callable[[ArrayLike], np.ndarray]:
    def convert(values: ArrayLike) -> np.ndarray:
        array = np.array(values, dtype=float)
        if array.shape != (length,) or not np.all(np.isfinite(array)):
            raise InputError(Problem("parameter set", f"{length} finite numbers", np.array2string(array)))
        array.flags.writeable = False
        return array

    return convert


def _array(length: int, default: ArrayLike | None = None) -> Any:
    """A field for a vector of that length, required where there is no default."""
    fallback = NOTHING if default is None else default
    return field(converter=_vector(length), eq=cmp_using(np.array_equal), default=fallback)


@frozen
class ParameterSet:
    """The fourteen parameters of one arm.

    pi (8,) = d1..d6 [kg m^2], g7, g8 [N m]; viscous (3,) [N m s/rad]; coulomb (3,) [N m]; `source` says where they
    come from; `mounting` is how the arm was mounted for these gravity terms, and `fixed` whether they hold for that
    mounting only.
    """

    name: str
    pi: np.ndarray = _array(8)
    viscous: np.ndarray = _array(3, default=(0.0, 0.0, 0.0))
    coulomb: np.ndarray = _array(3, default=(0.0, 0.0, 0.0))
    source: str = ""
    mounting: Mounting = Mounting.UPRIGHT
    fixed: bool = False

    @property
    def vector(self) -> np.ndarray:
        """All fourteen (14,), in the order of Taati Table 1: pi, viscous, Coulomb."""
        return np.concatenate([self.pi, self.viscous, self.coulomb])


_TABLE1 = "Taati et al. 2008, Table 1, column {}, identified on a device mounted {}"


def _identified(name: str, mounting: Mounting, column: tuple[float, ...]) -> ParameterSet:
    values = np.array(column) * 1e-3
    source = _TABLE1.format(name, mounting.value.replace("_", " "))
    return ParameterSet(name, values[:8], values[8:11], values[11:], source, mounting, fixed=True)


_UP, _DOWN = Mounting.UPRIGHT, Mounting.UPSIDE_DOWN
_SETS = {
    parameters.name: parameters
    for parameters in (
        ParameterSet("segment", segment_pi(), source="Sallam et al. Table II put right (MISPRINTS.md), g = 9.81 m/s^2"),
        ParameterSet(
            "piecewise",
            np.array((2.78, 1.09, -0.40, 0.91, 2.41, 0.91, -16.30, -73.80)) * 1e-3,
            source="Taati et al. 2008, Table 1, column Piecewise (Cavusoglu, Feygin, Tendick 2002)",
        ),
        _identified(
            "UR", _UP, (1.42, 1.35, -0.40, 0.69, 2.08, 0.95, -19.23, -109.96, -2.08, -1.28, -0.18, 25.89, 9.19, 9.08)
        ),
        _identified(
            "GCW", _UP, (3.40, 4.43, -1.17, 9.23, 7.54, 3.55, 26.92, 46.52, -2.71, 0.10, 1.13, 26.22, 8.35, 9.04)
        ),
        _identified(
            "FS", _UP, (1.02, 2.16, -0.76, 3.00, 3.47, 1.13, 46.84, -69.08, -0.91, -0.32, 0.43, 27.06, 9.34, 10.00)
        ),
        _identified(
            "USD", _DOWN, (1.20, 1.61, -0.51, 0.65, 2.85, 1.28, 21.24, 108.75, -1.35, -0.14, 0.91, 26.08, 8.24, 8.09)
        ),
        _identified(
            "USD+GCW",
            _DOWN,
            (3.04, 3.29, -0.73, 9.19, 6.37, 3.15, -16.59, -112.45, -0.10, 0.54, 0.73, 24.35, 7.28, 8.71),
        ),
    )
}
SET_NAMES = tuple(_SETS)
"""Names that `parameter_set` knows."""


def parameter_set(name: str) -> ParameterSet:
    """The parameter set of that name.

    Raises InputError for a name that is not in `SET_NAMES`.
    """
    if name not in _SETS:
        raise InputError(
            Problem("parameter set", f"one of {', '.join(SET_NAMES)}", repr(name), did_you_mean(name, SET_NAMES))
        )
    return _SETS[name]


def mounted(params: ParameterSet, mounting: Mounting) -> ParameterSet:
    """The same arm mounted another way: g7 and g8 change sign.

    Raises InputError for an identified set: its gravity terms were measured in its own mounting and are used as
    printed.
    """
    if mounting is params.mounting:
        return params
    if params.fixed:
        problem = Problem(
            f"parameter set {params.name}",
            f"mounting {params.mounting.value}, in which it was identified",
            mounting.value,
            "use segment or piecewise, or the set that was identified so (UR and USD)",
        )
        raise InputError(problem)
    pi = params.pi * np.array([1, 1, 1, 1, 1, 1, -1, -1])
    return evolve(params, pi=pi, mounting=mounting)


def with_payload(params: ParameterSet, mass: float, distance: float = L2) -> ParameterSet:
    """The arm that carries `mass` [kg] on the line of the forearm, `distance` [m] from the elbow (default: at the
    tip).
    """
    pi = params.pi + point_mass_pi(mass, L1, distance, params.mounting.gravity)
    return evolve(params, name=f"{params.name} + {mass:g} kg", pi=pi)
