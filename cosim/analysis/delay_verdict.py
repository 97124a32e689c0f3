"""`cosim stability --any-delay`: the two-sided verdict on a scenario, with its destroying law in the FMUs."""

import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
from attrs import evolve, field, frozen

from cosim.analysis.any_delay import CLASS, EQUAL, Destroyer, Say, TwoSided, certified, laws, two_sided, widened
from cosim.analysis.assessment import boundary as constant_boundary
from cosim.analysis.at_rest import at_rest, bent
from cosim.analysis.certificate_file import ProvenSystem
from cosim.analysis.examination import Examined, examine
from cosim.analysis.linearisation import linearise
from cosim.analysis.opened import FREQUENCIES, NotOpenError, OpenedLoop, opened
from cosim.analysis.parting import LoopPart, parted
from cosim.analysis.prediction import predict
from cosim.analysis.replay import COMPONENT, TRACE, PlayedLaw, replayed, replaying, write_trace
from cosim.analysis.stepped import Stepped, stepped
from cosim.engine.isolation import called
from cosim.engine.reference import RunProgress
from cosim.errors import RunError
from cosim.fmu import FmuSet
from cosim.results.summary import number
from cosim.scenario import Scenario

_REACH = 6.0
"""Destroying laws are sought up to this times the bound of small gain where constant delays set no bound."""
_MOST = 1200
"""Delay in steps up to which destroying laws are sought: the map over a period holds twice as many past samples."""
_TRIES = 4
"""Laws that are played in the FMUs, each with more delay than the one before, until one grows there."""


@frozen
class OpenedAtRest:
    """The loop of a scenario at rest opened at its channels, or None and why; `bent`: where its FMUs are not linear."""

    loop: OpenedLoop | None
    why: str = ""
    bent: str = ""


def open_at_rest(scenario: Scenario, system: FmuSet, mark: np.ndarray | None = None) -> OpenedAtRest:
    """Open the loop of a scenario at rest, and look whether its FMUs move as linear ones do. Raises RunError.

    mark: where it says which FMU is at work (see cosim.engine.reference.marked).
    """
    rest = at_rest(system.wiring(scenario))
    try:
        found = examine(system.wiring(rest), system, mark)
        discrete = stepped(found)
        loop = opened(found.wiring, discrete)
        crooked = _missed(found, discrete) or bent(rest, system)
    except NotOpenError as error:
        return OpenedAtRest(None, str(error))
    return OpenedAtRest(loop, "", crooked)


def _missed(found: Examined, discrete: Stepped) -> str:
    """Where the linear loop does not predict a short run of the FMUs; empty where it does."""
    assert discrete.loop is not None, "a loop that could be opened"
    short = predict(found, discrete.loop, 0.0)
    return "" if short.good else f"the linear loop misses {short.signal} by {100 * short.error:.2g} %"


@frozen
class AnyDelay:
    """The verdict: what is proven for every law, and the law of the smallest T that was seen to grow in the FMUs.

    `withheld` says why there is no certificate or no destroying law, by `certificate` and `destroying`.
    """

    system: ProvenSystem | None
    found: TwoSided | None
    destroyer: Destroyer | None
    replay: PlayedLaw | None
    withheld: Mapping[str, str]
    boundary: float | None
    seconds: float
    missed: float = field(default=0.0)

    @property
    def certified(self) -> float | None:
        """Largest T [s] proven stable for every law."""
        return self.system.certified if self.system and self.system.certificates else None

    @property
    def destroyed_at(self) -> float | None:
        """Smallest T [s] of a law that makes the FMUs grow."""
        return self.destroyer.max_delay if self.destroyer else None

    @property
    def gap_percent(self) -> float | None:
        """(destroying - certificate) / certificate [%]."""
        return _gap(self.destroyed_at, self.certified)

    def words(self) -> list[tuple[str, str]]:
        """What was asked and what is known of it."""
        replay, gap = self.replay, self.gap_percent
        safe = f"stable for every law from 0 to {self.certified:.4g} s each way" if self.certified else ""
        grown = ""
        if self.destroyed_at and replay and replay.growth_rate is not None:
            grown = f"a law up to {self.destroyed_at:.4g} s grows in the FMUs, {replay.growth_rate:+.3g} 1/s"
        return [
            ("any delay law, proven", safe or f"not given: {self.withheld['certificate']}"),
            ("any delay law, destroyed", grown or f"not given: {self.withheld['destroying']}"),
            *([("gap between the two", f"{gap:.2g} %")] if gap is not None else []),
        ]

    def to_dict(self) -> dict[str, object]:
        """`any_delay` of stability.json."""
        kinds = {"independent": CLASS, "equal": EQUAL}
        found, slope = (self.found.destroyers, self.found.slope) if self.found else ({}, None)
        return {
            "class": laws(slope),
            "slope": slope,
            "certificate": number(self.certified),
            "destroying": number(self.destroyed_at),
            "gap_percent": number(self.gap_percent),
            "withheld": dict(self.withheld),
            "certificate_covers": "the sampled linear loop at rest at the start pose; equal ways and slower laws too",
            "constant_delay": number(self.boundary),
            "linear": {
                name: None
                if (law := found.get(kind)) is None
                else {
                    "destroying": law.max_delay,
                    "growth_rate": law.law.growth_rate,
                    "gap_percent": number(_gap(law.max_delay, self.certified)),
                }
                for name, kind in kinds.items()
            },
            "replay": None if self.replay is None else _replay(self.replay, self.destroyer),
            "reduction_error": self.missed,
            "loops": [part.loop.channels for part in self.system.parts] if self.system else [],
            "seconds": self.seconds,
        }


def _gap(high: float | None, low: float | None) -> float | None:
    return 100.0 * (high / low - 1.0) if high and low else None


def _replay(replay: PlayedLaw, destroyer: Destroyer | None) -> dict[str, object]:
    return {
        "growth_rate": number(replay.growth_rate),
        "interval": None if replay.interval is None else list(replay.interval),
        "predicted": destroyer.law.growth_rate if destroyer else None,
        "why": replay.why or None,
    }


def any_delay(
    scenario: Scenario,
    system: FmuSet,
    boundary: float | None = None,
    say: Say = lambda text: None,
    progress: Callable[[RunProgress], None] | None = None,
    slope: float | None = None,
) -> AnyDelay:
    """The verdict on a scenario with at least one channel.

    slope: seconds a second by which the delays change at most; None: at any speed.

    boundary: largest constant delay each way [s], which no destroying law of the smallest bound exceeds; None where it
    is not known. say: is told what is being done; progress: see `cosim.run`. Raises RunError.
    """
    began = time.process_time()
    say("opening the loop at its channels")
    open_ = called(partial(open_at_rest, scenario, system), OpenedAtRest, scenario, system, "the loop was opened")
    if open_.loop is None or open_.bent:
        why = f"the linear loop is not the whole of it: {open_.bent}" if open_.loop else open_.why
        return AnyDelay(None, None, None, None, dict.fromkeys(("certificate", "destroying"), why), boundary, 0.0)
    parts = parted(open_.loop)
    found = two_sided(parts, *_bounds(parts, boundary), say, slope)
    withheld = {} if found.certificates else {"certificate": found.unproven}
    proven = ProvenSystem.of(scenario, open_.loop, parts, found.certificates)
    destroyer, replay = _played(scenario, system, proven, found, say, progress)
    if destroyer is None:
        withheld["destroying"] = _unseen(found, replay)
    took = time.process_time() - began
    return AnyDelay(proven, found, destroyer, replay, withheld, boundary, took, open_.loop.missed)


def linear_verdict(scenario: Scenario, system: FmuSet) -> TwoSided | None:
    """What is proven and destroyed of the linear loop, played in no FMU; None where the loop cannot be opened."""
    parts = _parts(scenario, system)
    limit = constant_boundary(linearise(scenario, system))
    return None if parts is None else two_sided(parts, *_bounds(parts, limit), lambda text: None)


def holds_for_every_law(scenario: Scenario, system: FmuSet, longest: float) -> bool:
    """Whether a cheap certificate proves that no delay law up to `longest` [s] destroys the loop at rest."""
    parts = _parts(scenario, system)
    return parts is not None and certified(parts, int(np.ceil(longest / parts[0].loop.step * (1.0 - 1e-12))))


def _parts(scenario: Scenario, system: FmuSet) -> tuple[LoopPart, ...] | None:
    open_ = open_at_rest(scenario, system)
    return None if open_.loop is None or open_.bent else parted(open_.loop)


def _bounds(parts: tuple[LoopPart, ...], boundary: float | None) -> tuple[int, int]:
    """Delays [steps] between which destroying laws are sought: bound of small gain, and that of constant delays."""
    gain = max(float(np.linalg.norm(part.loop.increments(FREQUENCIES), 2, axis=(1, 2)).max()) for part in parts)
    low, step = max(int(0.9 / gain), 1), parts[0].loop.step
    high = _REACH * low if boundary is None or not np.isfinite(boundary) else 1.02 * boundary / step
    return low, max(int(np.ceil(min(high, _MOST))), low) + 2


def _played(
    scenario: Scenario,
    system: FmuSet,
    proven: ProvenSystem,
    found: TwoSided,
    say: Say,
    progress: Callable[[RunProgress], None] | None,
) -> tuple[Destroyer | None, PlayedLaw | None]:
    """The destroying law that grows in the FMUs, stretched where it does not, and its replay."""
    destroyer, replay = found.destroyer, None
    for turn in range(_TRIES if destroyer else 0):
        assert destroyer is not None
        say(f"playing the law of {destroyer.max_delay:.4g} s in the FMUs")
        replay = play(scenario, system, proven, destroyer, progress)
        if replay.grows or replay.why:
            break
        more = max(round(0.002 * 2**turn * destroyer.law.ages.max()), 1)
        destroyer = widened(destroyer, proven.parts[destroyer.part].loop, more, found.slope)
    return (destroyer if replay and replay.grows else None), replay


def play(
    scenario: Scenario,
    system: FmuSet,
    proven: ProvenSystem,
    destroyer: Destroyer,
    progress: Callable[[RunProgress], None] | None = None,
) -> PlayedLaw:
    """The replay of one law, its trace in a folder that lives as long as the run."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wiring = system.wiring(scenario)
        write_trace(destroyer.ages, proven.step, proven.channels, folder / TRACE)
        played = replaying(wiring, destroyer.ages, proven.channels, folder)
        try:
            replay = replayed(played, destroyer.ages.shape[1], progress)
        except RunError as error:
            return PlayedLaw(None, None, None, np.zeros((0, 2)), str(error))
    trace = evolve(played.components[COMPONENT], recording=TRACE)
    return evolve(replay, scenario=evolve(played, components={**played.components, COMPONENT: trace}))


def _unseen(found: TwoSided, replay: PlayedLaw | None) -> str:
    if found.destroyer is None:
        return "the search found no law that makes the linear loop grow; nothing follows from that"
    if replay is not None and replay.why:
        return f"a law makes the linear loop grow, and was not seen in the FMUs: {replay.why}"
    rate = "" if replay is None or replay.growth_rate is None else f" ({replay.growth_rate:+.4g} 1/s)"
    return f"the law that makes the linear loop grow does not grow in the FMUs{rate}"
