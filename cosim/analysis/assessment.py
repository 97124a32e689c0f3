"""What theory says of a scenario at a pose: criteria, robust bound, spectrum, passivity; and what it withholds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from cosim.analysis.prediction import Prediction
    from cosim.analysis.stepped import Stepped


def coupling(pair: tuple[CoupledSide, CoupledSide]) -> Coupling:
    """Gains and effective damping of two sides."""
    return Coupling(pair[0].stiffness, pair[1].stiffness, pair[0].effective, pair[1].effective)


@frozen
class Theory:
    """The conditions at one pose. None where a condition does not apply to the scenario; `withheld` says why.

    `coupled`: what was found of the coupling of the arms, which the criteria take for granted; `prediction`: how well
    the linear loop predicts the FMUs; `predicted`: its growth rate [1/s] where that is no evidence.
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
    prediction: "Prediction | None" = None
    predicted: float | None = None

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


def theory(
    wiring: Wiring,
    loop: LinearLoop,
    found: Coupled,
    discrete: "Stepped | None" = None,
    prediction: "Prediction | None" = None,
) -> Theory:
    """All conditions for the delays of the scenario. The criteria take the greatest delays, the spectrum the mean
    ones. A condition whose assumptions do not hold on the loop is withheld.

    discrete: the loop in discrete time, for FMUs that the continuous one does not see; prediction: its check on the
    FMUs.
    """
    pair, family, hidden = found.pair, loop.family(), _hidden(loop)
    gains = coupling(pair) if pair and family else None
    sure = gains is not None and not found.broken
    missed = _missed(prediction)
    withheld = {}
    if not sure:
        withheld["delay_sum"] = "; ".join(found.broken) or "the arms are not coupled over two channels"
    if hidden or missed or family is None:
        why = hidden or missed or "the loop has no channel, or a signal passes two"
        withheld |= dict.fromkeys(("known_mass", "margin"), why)
    rate = _finite(abscissa(loop.system())) if not hidden else _discrete_rate(discrete)
    doubt = missed or (_doubt(hidden, discrete) if hidden else "")
    if doubt:
        withheld["spectrum"] = doubt
    return Theory(
        pose_of(wiring),
        loop.delays,
        loop.longest,
        loop.constant,
        found,
        delay_sum(gains, *loop.longest) if gains and sure else None,
        sallam_eq10(gains, *loop.longest) if gains else None,
        delay_law_bound(family) if family and not hidden and not missed else None,
        None if doubt else rate,
        withheld,
        prediction,
        rate if doubt else None,
    )


def _missed(prediction: "Prediction | None") -> str:
    """Why the linear loop does not move as the FMUs do; empty where it does, or where that was not looked at."""
    if prediction is None or prediction.good:
        return ""
    return (
        f"the linear loop misses {prediction.signal} by {100 * prediction.error:.2g} % in a run of "
        f"{prediction.duration:g} s from a disturbed state"
    )


def _discrete_rate(discrete: "Stepped | None") -> float | None:
    return _finite(discrete.loop.abscissa) if discrete and discrete.loop else None


def _doubt(hidden: str, discrete: "Stepped | None") -> str:
    """Why the loop in discrete time proves nothing; empty where it does."""
    if discrete is None or discrete.loop is None:
        return f"{hidden}; {discrete.why}" if discrete and discrete.why else hidden
    if discrete.unproven:
        return f"{hidden}; the state of {', '.join(discrete.unproven)} cannot be saved, so that only simulation counts"
    return ""


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
