"""Every FMU of a scenario at its start: its linear equations, what they miss, and the FMU itself to try things on."""

from collections.abc import Mapping

import numpy as np
from attrs import evolve, frozen

from cosim.analysis.linear_fmu import LinearFmu, linear_fmu, wired_outputs
from cosim.analysis.lone_fmu import LoneFmu, lone
from cosim.analysis.memory import known_as, unseen
from cosim.engine.master import PreparedRun, System
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
    prepared, mark = PreparedRun.of(system, wiring, ()), marked() if mark is None else mark
    store = prepared.compiled.initialise(wiring, prepared.instances, mark)
    alone, fmus = lone(wiring, prepared.instances, store), {}
    for number, name in enumerate(wiring.scenario.components):
        mark[1] = number
        fmu = _linear(wiring, name, alone[name])
        fmus[name] = fmu if fmu.why else evolve(fmu, why=unseen(wiring, name, fmu, alone[name]))
    return Examined(wiring, fmus, alone)


def _linear(wiring: Wiring, name: str, one: LoneFmu) -> LinearFmu:
    """The matrices of one component right after its initialisation, remembered for FMUs that begin as it does."""
    if not wiring.descriptions[name].sha256:
        return linear_fmu(wiring, name, one)
    key = *known_as(wiring, name), wired_outputs(wiring, name), one.base.tobytes()
    if key not in _KNOWN:
        if len(_KNOWN) > _MOST:
            _KNOWN.clear()
        _KNOWN[key] = linear_fmu(wiring, name, one)
    return _KNOWN[key]


_KNOWN: dict[tuple[object, ...], LinearFmu] = {}
_MOST = 256
