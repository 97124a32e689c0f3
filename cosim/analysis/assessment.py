"""What theory says of a scenario at a pose: criteria, robust bound, spectrum, passivity; and what it withholds."""

from collections.abc import Mapping

import numpy as np
from attrs import field, frozen

from cosim.analysis.coupling import Coupled, CoupledSide
from cosim.analysis.criteria import Coupling, Criterion, delay_sum, sallam_eq10
from cosim.analysis.linear_fmu import LinearFmu
from cosim.analysis.linearisation import LinearLoop
from cosim.analysis.passivity import PortPassivity, port_passivity
from cosim.analysis.robust import delay_law_bound
from cosim.analysis.spectrum import abscissa, max_delay
from cosim.wiring import Wiring


def coupling(pair: tuple[CoupledSide, CoupledSide]) -> Coupling:
    """Gains and effective damping of two sides."""
    return Coupling(pair[0].stiffness, pair[1].stiffness, pair[0].effective, pair[1].effective)


@frozen
class Theory:
    """The conditions at one pose. None where a condition does not apply to the scenario; `withheld` says why.

    `coupled`: what was found of the coupling of the arms, which the criteria take for granted.
    """

    pose: tuple[float, ...]
    delays: tuple[float, float]
    longest: tuple[float, float]
    constant: bool
    coupled: Coupled
    delay_sum: Criterion | None
    sallam_eq10: Criterion | None
    law_bound: float | None
    abscissa: float | None
    withheld: Mapping[str, str] = field(factory=dict)

    @property
    def pair(self) -> tuple[CoupledSide, CoupledSide] | None:
        """The two sides of a loop of springs and dampers."""
        return self.coupled.pair

    @property
    def known_mass(self) -> bool:
        """Whether the small-gain bound covers the delays."""
        return self.law_bound is not None and max(self.longest) < self.law_bound

    @property
    def any_mass(self) -> bool:
        """Whether the delay-sum condition covers the delays."""
        return self.delay_sum is not None and self.delay_sum.holds


def theory(wiring: Wiring, loop: LinearLoop, found: Coupled) -> Theory:
    """All conditions for the delays of the scenario. The criteria take the greatest delays, the spectrum the mean
    ones. A condition whose assumptions do not hold on the loop is withheld.
    """
    pair, family = found.pair, loop.family()
    gains = coupling(pair) if pair and family else None
    withheld = {}
    if gains is None or found.broken:
        withheld["delay_sum"] = "; ".join(found.broken) or "the arms are not coupled over two channels"
    hidden = _hidden(loop)
    if hidden:
        withheld |= dict.fromkeys(("spectrum", "known_mass", "margin"), hidden)
    elif family is None:
        withheld |= dict.fromkeys(("known_mass", "margin"), "the loop has no channel, or a signal passes two")
    sure = gains is not None and not found.broken
    return Theory(
        pose_of(wiring),
        loop.delays,
        loop.longest,
        loop.constant,
        found,
        delay_sum(gains, *loop.longest) if gains and sure else None,
        sallam_eq10(gains, *loop.longest) if gains else None,
        delay_law_bound(family) if family and not hidden else None,
        None if hidden else _finite(abscissa(loop.system())),
        withheld,
    )


def _hidden(loop: LinearLoop) -> str:
    """Why the linearised loop is not the whole of it; empty where it is."""
    return "; ".join(f"{name} {why}" for name, why in loop.unseen.items())


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def pose_of(wiring: Wiring) -> tuple[float, ...]:
    """Start pose of the local arm (or of the first arm) [rad]; empty without one."""
    names = wiring.scenario.arms or [
        n for n in wiring.scenario.components if wiring.descriptions[n].elements("q_start")
    ]
    if not names:
        return ()
    return tuple(wiring.start(names[0], element) for element in wiring.descriptions[names[0]].elements("q_start"))


def boundary(loop: LinearLoop) -> float | None:
    """Largest constant delay each way [s] by the exact spectrum; None where the loop has no channel, or is not all
    seen.
    """
    family = loop.family()
    return max_delay(family) if family and not loop.unseen else None


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
