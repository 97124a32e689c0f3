"""An arm with base parameters of its own: the table nearest to that of its URDF that has them."""

import numpy as np
from attrs import evolve

from cosim.arm.base_parameters import all_parameters, base_parameters
from cosim.arm.serial import SerialModel
from cosim.arm.serial_dynamics import LINK_PARAMETERS

_DIGITS = 1e-9
"""Share of the largest base parameter to which they have to come back: where masses as they are forbid it, masses
change too."""


def identified_arm(model: SerialModel, base: np.ndarray) -> SerialModel:
    """The arm whose torques are those of base parameters (b,).

    What torques do not show is the URDF's: of all parameters p with `base` the nearest to it, each change measured by
    the URDF's usual size, masses held where that is possible. Single links need not be bodies; their sum moves as
    identified.
    """
    return _of_parameters(model, _nearest(model, np.asarray(base, dtype=float)))


def _nearest(model: SerialModel, base: np.ndarray) -> np.ndarray:
    """(11 n,) parameters in the order of `parameter_names`."""
    grouping, first = base_parameters(model).grouping, all_parameters(_weighing(model))
    kind = np.array([*LINK_PARAMETERS] * model.count + ["rotor"] * model.count)
    size = np.ones(len(kind))
    for name in set(kind):
        size[kind == name] = max(np.sqrt(np.mean(first[kind == name] ** 2)), 1e-3 * np.abs(base).max(), 1e-12)
    held = np.where(kind == "m", 0.0, size)
    for free in (held, size):
        change = free * np.linalg.lstsq(grouping * free, base - grouping @ first, rcond=1e-12)[0]
        if np.abs(grouping @ (first + change) - base).max() <= _DIGITS * max(np.abs(base).max(), 1e-12):
            break
    return first + change


def _weighing(model: SerialModel) -> SerialModel:
    """The arm with a mass on every link, as a table of centres needs it."""
    usual = model.mass[model.mass > 0].mean() if (model.mass > 0).any() else 1.0
    return evolve(model, mass=np.where(model.mass > 0, model.mass, usual))


def _of_parameters(model: SerialModel, params: np.ndarray) -> SerialModel:
    """The arm with these parameters of its links, inertias about the centres of mass, and rotors."""
    n = model.count
    links, rotors = params[: 10 * n].reshape(n, 10), params[10 * n :]
    mass, centre = links[:, 0], links[:, 1:4] / links[:, :1]
    xx, xy, yy, xz, yz, zz = links[:, 4:].T
    about = np.stack([np.stack(row, axis=1) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))], axis=1)
    square = np.einsum("ia,ia->i", centre, centre)[:, None, None] * np.eye(3)
    inertia = about - mass[:, None, None] * (square - np.einsum("ia,ib->iab", centre, centre))
    return evolve(model, mass=mass, centre=centre, inertia=inertia, armature=rotors)
