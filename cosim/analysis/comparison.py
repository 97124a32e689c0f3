"""What theory says of a loop beside what its simulation shows."""

from collections.abc import Callable, Mapping
from functools import partial

from attrs import field, frozen

from cosim.analysis.assessment import Theory, boundary, plant_ports, theory
from cosim.analysis.evidence import StabilityEvidence, strongest
from cosim.analysis.linearisation import LinearLoop, linearise
from cosim.analysis.margin import Margins, margins
from cosim.analysis.passivity import PortPassivity
from cosim.analysis.twin import judged_run
from cosim.engine.isolation import called, runner
from cosim.engine.reference import RunProgress
from cosim.fmu import FmuSet
from cosim.results.summary import Judged
from cosim.scenario import Scenario


@frozen
class Comparison:
    """All that `cosim stability` found: theory at the pose, largest constant delay, margins, ports, the simulation."""

    theory: Theory
    max_delay: float | None
    margins: Margins | None
    ports: Mapping[str, PortPassivity]
    judged: Judged
    added_ages: Mapping[str, float] = field(factory=dict)

    @property
    def evidence(self) -> StabilityEvidence:
        """The strongest evidence that holds."""
        t = self.theory
        return strongest(self.judged.outcome, t.any_mass, t.known_mass, t.abscissa, t.constant)


def compare(
    scenario: Scenario, system: FmuSet, progress: Callable[[RunProgress], None] | None = None
) -> tuple[Comparison, LinearLoop]:
    """The comparison and the linearised loop of a scenario; FMUs of others are used in processes of their own."""
    wiring = system.wiring(scenario)
    loop = called(partial(linearise, scenario, system), LinearLoop, scenario, system, "the loop was linearised")
    said, family = theory(wiring, loop), loop.family()
    margin = margins(family, max(loop.delays)) if family and loop.delays[0] == loop.delays[1] else None
    limit = boundary(loop) if said.abscissa is not None else None
    judged = judged_run(scenario, system, progress, simulate=runner(scenario))
    ages = {"lr": wiring.age_lr, "rl": wiring.age_rl, "local_l": wiring.age_local[0], "local_r": wiring.age_local[1]}
    return Comparison(said, limit, margin, plant_ports(loop, said.pair), judged, ages), loop
