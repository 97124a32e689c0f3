"""How large a value may become before a run counts as diverged, and what is told to an FMU of the run."""

import numpy as np

from cosim.signals import Variable
from cosim.wiring.wiring import Wiring

_OTHERWISE = 1e6
"""Usual size, in SI, allowed for where an FMU declares none and the unit is none of motion or force: pressures and
powers of large plants reach 1e9, a million times less than the bound of 1e12 that results.
"""
OF_START = 1e-3
"""Share of a value at t = 0 that counts as its usual size: with the bound of 1e6 it may grow a thousandfold."""


def usual_sizes(wiring: Wiring) -> np.ndarray:
    """The usual size of every output, in the order of the store, (n,), in its own unit.

    It is the nominal value where that is above 1; else 1 for motion and forces (a device held in a hand moves metres
    and newtons), and a million for anything else.
    """
    variables = (
        wiring.descriptions[name].variables[output]
        for name in wiring.scenario.components
        for output in wiring.outputs(name)
    )
    return np.array([_usual(variable) for variable in variables])


def _usual(variable: Variable) -> float:
    least = 1.0 if variable.unit.of_motion else _OTHERWISE
    return max(abs(variable.nominal or 0.0), least)


def bounds(wiring: Wiring, usual: np.ndarray, start: np.ndarray) -> np.ndarray:
    """What no output may pass, (n,): `experiment.bound` times its usual size, and room for those that start large."""
    began = np.where(np.isfinite(start), np.abs(start), 0.0)
    return wiring.scenario.experiment.bound * np.maximum(usual, OF_START * began)
