"""The scenario `controllers` with one of the controllers on both sides, and its signals as arrays."""

from collections.abc import Mapping

import numpy as np

from cosim.engine.master import Result, run
from cosim.scenario import load_scenario

SIDES = {"controller_l.side": "local", "controller_r.side": "remote"}
RELEASED = {
    f"operator.{name}": 0.0
    for name in ("hand_mass", "hand_stiffness", "hand_damping", "grip_stiffness", "grip_damping")
} | {"arm_r.contact_stiffness": 0.0, "arm_r.contact_damping": 0.0}
"""No hand and no wall."""


def teleoperate(model: str, values: Mapping[str, object], stop: float = 2.0) -> Result:
    """A run with `model` on both sides and values at paths."""
    given = {"controller_*.model": model, "experiment.stop": stop, "experiment.record_every": 1}
    return run(load_scenario("controllers").with_values(given | dict(values)))


def vector(result: Result, name: str) -> np.ndarray:
    """(n, size) of `arm_l.x`, of as many elements as it has; one column for a scalar."""
    return result.vector(name)
