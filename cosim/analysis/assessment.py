"""What theory says of a scenario at a pose: damping counted on, criteria, robust bound, spectrum, margins,
passivity.
"""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from attrs import field, frozen

from cosim.analysis.criteria import Coupling, Criterion, delay_sum, sallam_eq10
from cosim.analysis.damping import LeastViscosity, least_joint_viscosity, least_task_viscosity
from cosim.analysis.linearisation import LinearFmu, LinearLoop
from cosim.analysis.passivity import PortPassivity, port_passivity
from cosim.analysis.robust import delay_law_bound
from cosim.analysis.spectrum import abscissa, max_delay
from cosim.wiring import Wiring

CONTROLLER = "PLikeController"
MEMORYLESS = (CONTROLLER, "VariableDelayChannel", "Operator", "Environment", "Recording", "Excitation")
"""Sampled models without hidden memory that acts on the loop: others make a linearisation from their inputs and outputs
incomplete.
"""


@frozen
class CoupledSide:
    """One arm's coupling: K [N/m], B [N s/m] of the controller per axis (joint space: N m/rad, N m s/rad), plant
    viscosity.
    """

    arm: str
    stiffness: np.ndarray = field(eq=False)
    damping: np.ndarray = field(eq=False)
    joint_space: bool
    viscous: tuple[float, ...]
    compensated: bool

    @property
    def viscosity(self) -> LeastViscosity:
        """Least viscosity of the plant where the controller acts."""
        return least_joint_viscosity(self.viscous) if self.joint_space else _least_task(self.viscous)

    @property
    def effective(self) -> np.ndarray:
        """Damping per axis that a criterion may count on."""
        return self.damping + self.viscosity.value


@lru_cache(maxsize=64)
def _least_task(viscous: tuple[float, ...]) -> LeastViscosity:
    return least_task_viscosity(np.array(viscous))


def sides(wiring: Wiring) -> tuple[CoupledSide, CoupledSide] | None:
    """The two coupled arms of a teleoperation scenario; None where it is none or an arm is coupled in another way."""
    if wiring.scenario.arms is None:
        return None
    local, remote = (_side(wiring, arm) for arm in wiring.scenario.arms)
    if local is None or remote is None or local.joint_space != remote.joint_space:
        return None
    return local, remote


def _side(wiring: Wiring, arm: str) -> CoupledSide | None:
    if wiring.descriptions[arm].model != "PhantomArm":
        return None
    values = _LoopValues(wiring, arm)
    plant = (tuple(values.vector("viscous").tolist()), bool(values.vector("gravity_compensation")[0]))
    wired = {link.target.variable for link in wiring.links if link.target.component == arm}
    if "x_ref[1]" in wired and values.vector("stiffness").any():
        return CoupledSide(arm, values.vector("stiffness"), values.vector("damping"), False, *plant)
    drivers = {link.source.component for link in wiring.links if link.target.component == arm}
    for name in wiring.scenario.components:
        if name in drivers and wiring.descriptions[name].model == CONTROLLER:
            gains = _LoopValues(wiring, name)
            joint = gains.item("space") == "joint"
            prefix = "joint_" if joint else ""
            return CoupledSide(arm, gains.vector(prefix + "stiffness"), gains.vector(prefix + "damping"), joint, *plant)
    return None


class _LoopValues:
    """Start values of a component's parameters: the scenario's, else the FMU's own."""

    def __init__(self, wiring: Wiring, name: str) -> None:
        self.wiring, self.name, self.description = wiring, name, wiring.descriptions[name]

    def vector(self, name: str) -> np.ndarray:
        return np.array([self.wiring.start(self.name, element) for element in self.description.elements(name)])

    def item(self, name: str) -> str:
        return self.description.variables[name].item(self.vector(name)[0])


def coupling(pair: tuple[CoupledSide, CoupledSide]) -> Coupling:
    """Gains and effective damping of two sides."""
    return Coupling(pair[0].stiffness, pair[1].stiffness, pair[0].effective, pair[1].effective)


@frozen
class Theory:
    """The conditions at one pose. None where a condition does not apply to the scenario."""

    pose: tuple[float, ...]
    delays: tuple[float, float]
    longest: tuple[float, float]
    constant: bool
    pair: tuple[CoupledSide, CoupledSide] | None
    delay_sum: Criterion | None
    sallam_eq10: Criterion | None
    law_bound: float | None
    abscissa: float | None

    @property
    def known_mass(self) -> bool:
        """Whether the small-gain bound covers the delays."""
        return self.law_bound is not None and max(self.longest) < self.law_bound

    @property
    def any_mass(self) -> bool:
        """Whether the delay-sum condition covers the delays."""
        return self.delay_sum is not None and self.delay_sum.holds


def theory(wiring: Wiring, loop: LinearLoop) -> Theory:
    """All conditions for the delays of the scenario. The criteria take the greatest delays, the spectrum the mean
    ones.
    """
    pair, family = sides(wiring), loop.family()
    gains = coupling(pair) if pair and family else None
    return Theory(
        pose_of(wiring),
        loop.delays,
        loop.longest,
        loop.constant,
        pair,
        delay_sum(gains, *loop.longest) if gains else None,
        sallam_eq10(gains, *loop.longest) if gains else None,
        delay_law_bound(family) if family else None,
        _finite(abscissa(loop.system())) if complete(wiring) else None,
    )


def complete(wiring: Wiring) -> bool:
    """Whether the linearisation sees all of the loop: no sampled FMU with a memory of its own in it."""
    fed = {link.target.component for link in wiring.links} & {link.source.component for link in wiring.links}
    return all(wiring.descriptions[n].integrates or wiring.descriptions[n].model in MEMORYLESS for n in fed)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def pose_of(wiring: Wiring) -> tuple[float, ...]:
    """Start pose of the local arm (or of the first arm) [rad]; empty without one."""
    names = wiring.scenario.arms or [
        n for n in wiring.scenario.components if wiring.descriptions[n].elements("q_start")
    ]
    return tuple(_LoopValues(wiring, names[0]).vector("q_start").tolist()) if names else ()


def boundary(loop: LinearLoop) -> float | None:
    """Largest constant delay each way [s] by the exact spectrum; None where the loop has no channel."""
    family = loop.family()
    return max_delay(family) if family else None


def plant_ports(loop: LinearLoop, pair: tuple[CoupledSide, CoupledSide] | None) -> Mapping[str, PortPassivity]:
    """Passivity of the port of each arm, force on the tip to velocity of the tip, where both are wired."""
    found = {}
    for side in pair or ():
        fmu = loop.fmus[side.arm]
        ports = ([i for i in fmu.inputs if i.startswith("f")], [o for o in fmu.outputs if o.startswith("dx[")])
        if len(ports[0]) >= 3 and len(ports[1]) == 3:
            found[side.arm] = _port(fmu, ports[0][:3], ports[1])
    return found


def _port(fmu: LinearFmu, inputs: list[str], outputs: list[str]) -> PortPassivity:
    columns, rows = [fmu.inputs.index(i) for i in inputs], [fmu.outputs.index(o) for o in outputs]
    total = np.abs(fmu.a)
    kept = [k for k in range(len(fmu.states)) if total[k].any() or np.abs(fmu.b[k]).any()]
    return port_passivity(
        fmu.a[np.ix_(kept, kept)], fmu.b[np.ix_(kept, columns)], fmu.c[np.ix_(rows, kept)], fmu.d[np.ix_(rows, columns)]
    )
