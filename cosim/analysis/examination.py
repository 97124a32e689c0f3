"""Every FMU of a scenario at its start: its linear equations, what they miss, and the FMU itself to try things on."""

from collections.abc import Mapping

import numpy as np
from attrs import evolve, frozen

from cosim.analysis.linear_fmu import LinearFmu, linear_fmu
from cosim.analysis.lone_fmu import LoneFmu, lone
from cosim.analysis.memory import unseen
from cosim.engine.initialisation import initialise
from cosim.engine.master import System
from cosim.engine.reference import marked
from cosim.wiring import Wiring


@frozen
class Examined:
    """The wiring, and by component its linear equations and the FMU alone; what follows restarts the FMUs."""

    wiring: Wiring
    fmus: Mapping[str, LinearFmu]
    alone: Mapping[str, LoneFmu]


def examine(wiring: Wiring, system: System, mark: np.ndarray | None = None) -> Examined:
    """Look at every component, linear at the start. Raises RunError.

    mark: where it says which FMU is at work (see cosim.engine.reference.marked).
    """
    instances, mark = system.instances(wiring), marked() if mark is None else mark
    alone, fmus = lone(wiring, instances, initialise(wiring, instances, mark)), {}
    for number, name in enumerate(wiring.scenario.components):
        mark[1] = number
        fmu = linear_fmu(wiring, name, alone[name])
        fmus[name] = fmu if fmu.why else evolve(fmu, why=unseen(wiring, name, fmu, alone[name]))
    return Examined(wiring, fmus, alone)
