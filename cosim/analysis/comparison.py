"""What theory says of a loop beside what its simulation shows."""

from collections.abc import Callable, Mapping
from functools import cache, partial

import numpy as np
from attrs import evolve, field, frozen

from cosim.analysis.assessment import Theory, boundary, plant_ports, theory
from cosim.analysis.coupling import Coupled, coupled
from cosim.analysis.delay_verdict import AnyDelay
from cosim.analysis.evidence import GROWS, UNSTABLE, StabilityEvidence, strongest
from cosim.analysis.examination import examine
from cosim.analysis.falsification import Falsification
from cosim.analysis.linear_fmu import LinearFmu, steady_channel
from cosim.analysis.linearisation import LinearLoop, linear_loop
from cosim.analysis.margin import Margins, OpenResponse, margins
from cosim.analysis.opened import NotOpenError
from cosim.analysis.passivity import PortPassivity
from cosim.analysis.prediction import Prediction, predict
from cosim.analysis.stepped import Stepped, stepped
from cosim.analysis.twin import judged_run
from cosim.engine.isolation import called, runner
from cosim.engine.reference import RunProgress
from cosim.errors import RunError
from cosim.fmu import FmuSet
from cosim.results.summary import Judged
from cosim.scenario import Scenario
from cosim.wiring import Wiring


@frozen
class _Looked:
    """What was found with the FMUs at hand."""

    loop: LinearLoop
    coupled: Coupled
    stepped: Stepped
    prediction: Prediction | None


def _looked(scenario: Scenario, system: FmuSet, mark: np.ndarray | None) -> _Looked:
    """The linearised loop, in continuous and discrete time, the coupling of its arms, and how well it predicts."""
    found = examine(system.wiring(scenario), system, mark)
    loop, coupling = linear_loop(found.wiring, found.fmus), coupled(found)
    still = found if loop.constant else examine(_still(scenario, system, loop), system, mark)
    discrete = stepped(still)
    try:
        prediction = predict(still, discrete.loop, discrete.delays) if discrete.loop else None
    except RunError:
        prediction = None
    return _Looked(loop, coupling, discrete, prediction)


def _still(scenario: Scenario, system: FmuSet, loop: LinearLoop) -> Wiring:
    """The wiring with constant channels, at their mean delays."""
    if loop.constant:
        return system.wiring(scenario)
    changes: dict[str, object] = {}
    for name, bounds in loop.channels.items():
        changes |= steady_channel(name, bounds[1])
    return system.wiring(scenario.with_values(changes))


@frozen
class Comparison:
    """All that `cosim stability` found: theory at the pose, margins, ports, the simulation.

    limit: finds the largest constant delay, which takes longer than all else where a loop is a map of its FMUs.
    """

    theory: Theory
    limit: Callable[[], float | None] = field(repr=False)
    margins: Margins | None
    ports: Mapping[str, PortPassivity]
    judged: Judged
    added_ages: Mapping[str, float] = field(factory=dict)
    parts: Mapping[str, LinearFmu] = field(factory=dict, repr=False)
    stepped: Stepped | None = field(default=None, repr=False)
    any_delay: AnyDelay | None = field(default=None, repr=False)
    falsification: Falsification | None = field(default=None, repr=False)

    @property
    def max_delay(self) -> float | None:
        """Largest constant delay each way [s] by the spectrum, found when it is first asked for; None: not known."""
        return self.limit()

    @property
    def evidence(self) -> StabilityEvidence:
        """The strongest evidence that holds."""
        t = self.theory
        return strongest(self.judged.outcome, t.any_mass, t.known_mass, t.abscissa, t.constant, self.any_law)

    @property
    def any_law(self) -> bool:
        """Whether a certificate covers the delays: one for laws at any speed, or a constant delay."""
        found = self.any_delay
        if found is None or found.certified is None:
            return False
        covered = self.theory.constant or (found.found is not None and found.found.slope is None)
        return covered and max(self.theory.longest) <= found.certified

    @property
    def contradiction(self) -> str:
        """Which guarantee the simulation or the spectrum contradicts, in words; empty where none does."""
        t = self.theory
        given = [
            name
            for name, holds in (
                ("the delay-sum condition", t.any_mass),
                ("the bound for any law", t.known_mass),
                ("the certificate for any law", self.any_law),
                ("the spectrum", t.constant and t.abscissa is not None and t.abscissa < 0.0),
            )
            if holds
        ]
        worst = self.falsification is not None and self.falsification.grows
        seen = (("the simulation", self.judged.outcome in UNSTABLE), ("the worst run that was found", worst))
        grown = [name for name, grows in seen if grows]
        if t.constant and t.abscissa is not None and t.abscissa > GROWS:
            grown.append("the spectrum")
        if not given or not grown:
            return ""
        return f"{' and '.join(given)} promised a stable loop, and {' and '.join(grown)} shows that it grows"


def compare(
    scenario: Scenario, system: FmuSet, progress: Callable[[RunProgress], None] | None = None
) -> tuple[Comparison, LinearLoop]:
    """The comparison and the linearised loop of a scenario; FMUs of others are used in processes of their own."""
    wiring = system.wiring(scenario)
    looked = called(partial(_looked, scenario, system), _Looked, scenario, system, "the loop was linearised")
    loop = looked.loop
    said = theory(wiring, loop, looked.coupled, looked.stepped, looked.prediction)
    still = _still(scenario, system, loop)
    margin = _margin(said, loop, looked.stepped, still)
    if margin is not None:
        said = evolve(said, withheld={key: why for key, why in said.withheld.items() if key != "margin"})
    limit = cache(partial(_limit, said, loop, looked.stepped, still))
    asked = scenario if scenario.experiment.disturb else scenario.with_values({"experiment.disturb": True})
    judged = judged_run(asked, system, progress, simulate=runner(scenario))
    ages = {"lr": wiring.age_lr, "rl": wiring.age_rl, "local_l": wiring.age_local[0], "local_r": wiring.age_local[1]}
    return Comparison(said, limit, margin, plant_ports(loop, said.pair), judged, ages, loop.fmus, looked.stepped), loop


def _limit(said: Theory, loop: LinearLoop, discrete: Stepped, still: Wiring) -> float | None:
    """The largest constant delay each way [s]."""
    if said.abscissa is None:
        return None
    return discrete.max_delay(still) if loop.unseen else boundary(loop)


def _margin(said: Theory, loop: LinearLoop, discrete: Stepped, wiring: Wiring) -> Margins | None:
    """Margins of the linear loop, or of the FMUs' maps where it is not seen whole.

    None where the ways have different delays, or nothing is known of the spectrum.
    """
    delays = {fmu.delay for fmu in discrete.fmus.values() if fmu.delay is not None}
    if said.abscissa is None or len(delays) != 1:
        return None
    if not loop.unseen:
        family = loop.family()
        return margins(OpenResponse.of(family), max(loop.delays)) if family else None
    try:
        return margins(OpenResponse.of_maps(wiring, discrete), *delays)
    except NotOpenError:
        return None
