"""Stability of a scenario's loop: criteria, spectrum, margins and simulation side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from attrs import evolve, frozen

from cosim.analysis.comparison import Comparison, compare
from cosim.analysis.document import document
from cosim.analysis.falsification import Harm
from cosim.analysis.linearisation import LinearLoop, at_pose
from cosim.analysis.probed import probed
from cosim.analysis.transparency import FREQUENCIES, Hybrid
from cosim.analysis.transparency import transparency as hybrid_matrix
from cosim.api.card import card
from cosim.api.runs import loaded
from cosim.api.two_sided import TWO_SIDED, two_sided_files
from cosim.engine.isolation import runner
from cosim.engine.master import Result
from cosim.engine.master import run as run_here
from cosim.engine.reference import RunProgress
from cosim.errors import InputError, Problem, RunError
from cosim.fmu import FmuSet, open_system
from cosim.results.saving import save_files, write_json, write_text
from cosim.scenario import Scenario, to_toml
from cosim.signals import stem

if TYPE_CHECKING:
    from cosim.report.canvas import MplFigure


def stability(
    scenario: Scenario | str | Path,
    *,
    pose: Sequence[float] | None = None,
    any_delay: bool = False,
    delay_slope: float | None = None,
    falsify: int = 0,
    harm: str = "growth",
    progress: Callable[[RunProgress], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> StabilityResult:
    """Criteria, the exact spectrum, margins and a simulated growth rate of a scenario's loop.

    pose: joint angles (q1, q2, q3) [rad] of both arms (default: the scenario's start); any_delay: also the two-sided
    verdict for every delay law, which takes a minute; delay_slope: of the laws that change by so many seconds a second
    at most (default: at any speed); falsify: runs in which the worst delays, hand and losses within
    the scenario's bounds are sought, by their `harm`: "growth", "error" or "force"; progress: see `cosim.run`; say: is
    told what is being done.
    Raises InputError where the scenario does not fit its FMUs, RunError where an FMU fails.
    """
    if delay_slope is not None and not (any_delay and 0.0 <= delay_slope < np.inf):
        raise InputError(Problem("delay_slope", "a number >= 0, with any_delay", repr(delay_slope)))
    chosen = at_pose(loaded(scenario), pose)
    with open_system(chosen) as system:
        found, loop = compare(chosen, system, progress)
        if any_delay:
            from cosim.analysis.delay_verdict import any_delay as verdict

            said = verdict(chosen, system, found.max_delay, say or (lambda text: None), progress, delay_slope)
            found = evolve(found, any_delay=said)
        if falsify:
            from cosim.analysis.falsification import falsify as search

            worst = search(chosen, system, falsify, _kind(harm), say or (lambda text: None))
            found = evolve(found, falsification=worst)
        return StabilityResult(found, loop, _felt(chosen, system))


def _felt(scenario: Scenario, system: FmuSet) -> Hybrid | None:
    """What the hand feels, where the scenario is a teleoperator of our own FMUs that linear equations tell."""
    if scenario.arms is None or runner(scenario) is not run_here:
        return None
    try:
        return hybrid_matrix(scenario, system)
    except (InputError, RunError, np.linalg.LinAlgError):
        return None


def _kind(harm: str) -> Harm:
    if harm not in {kind.value for kind in Harm}:
        raise InputError(Problem("harm", "growth, error or force", repr(harm)))
    return Harm(harm)


def transparency(
    scenario: Scenario | str | Path, frequencies: Sequence[float] = FREQUENCIES, *, force: float | None = None
) -> Hybrid:
    """What the hand feels through a teleoperator: hybrid matrix, Z-width, transmitted impedance.

    frequencies: [Hz]. From its linear loop; with a `force` [N] by runs of its FMUs, a sine of that force on each tip
    and axis at each frequency: what friction, limits and switching controllers let through at that force. Raises
    InputError for a scenario without two arms that forces move, for FMUs that keep more than their linear equations
    tell (linear loop), for a motion that does not settle (runs).
    """
    chosen = loaded(scenario)
    if force is not None:
        if not 0.0 < force < float("inf"):
            raise InputError(Problem("transparency(): force", "a number above zero [N]", str(force)))
        return probed(chosen, _simulated, frequencies, force)
    with open_system(chosen) as system:
        return hybrid_matrix(chosen, system, frequencies)


def _simulated(scenario: Scenario) -> Result:
    """A run alone, without a verdict."""
    with open_system(scenario) as system:
        names = [name for name in system.wiring(scenario).signals if stem(name).endswith(".dx")]
        return runner(scenario)(scenario, system, None, names)


@final
@frozen(eq=False, repr=False)
class StabilityResult:
    """What is known of the stability of a loop, by theory and by simulation."""

    comparison: Comparison
    loop: LinearLoop
    transparency: Hybrid | None = None

    def to_dict(self) -> dict[str, Any]:
        """The content of stability.json."""
        felt = None if self.transparency is None else self.transparency.to_dict()
        return {**document(self.comparison), "transparency": felt}

    @property
    def failure(self) -> RunError | None:
        """The error of an FMU that ended the simulation; None where none did."""
        return self.comparison.judged.result.failure

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the simulation."""
        return self.comparison.judged.interrupted

    def plot(self) -> MplFigure:
        """The figure of the report: Nyquist curve, spectrum, and the growth rate against the delay."""
        from cosim.report.canvas import drawn
        from cosim.report.stability import loop_figure

        return drawn(loop_figure(self.comparison, self.loop))

    def save(self, folder: str | Path, *, report: bool = True) -> Path:
        """Write report.html and stability.json, and what there is of certificate.json, destroying.csv (a period of
        the delay law), destroying.toml (the scenario that plays it) and worst.toml; returns the folder.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        files: dict[str, Callable[[Path], object]] = {"report.html": self._write_page} if report else {}
        files |= self._two_sided() | {"stability.json": lambda path: write_json(self.to_dict(), path)}
        save_files(folder, files, ["report.html", *TWO_SIDED, "worst.toml"])
        return folder

    def _two_sided(self) -> dict[str, Callable[[Path], object]]:
        files = two_sided_files(self.comparison.any_delay)
        if worst := self.comparison.falsification:
            files["worst.toml"] = lambda path: write_text(to_toml(worst.scenario), path)
        return files

    def _write_page(self, path: Path) -> Path:
        from cosim.report.html import write_report
        from cosim.report.stability import stability_report

        return write_report(stability_report(self.comparison, self.loop, self.transparency), path)

    def __str__(self) -> str:
        """What `cosim stability` prints."""
        rows = _rows(self.comparison)
        width = max(len(name) for name, _ in rows)
        judged = self.comparison.judged
        wrong = self.comparison.contradiction
        said = f"CONTRADICTION: {wrong}" if wrong else self.comparison.evidence.meaning
        head = f"{judged.result.scenario.name}: {judged.outcome.value}; {said}"
        last = [f"warning: {wrong}; trust the simulation, not the guarantee"] if wrong else []
        return "\n".join([head, *(f"  {name:<{width}}  {value}" for name, value in rows), *last])

    def __repr__(self) -> str:
        return f"<StabilityResult {self.comparison.judged.result.scenario.name}: {self.comparison.evidence.value}>"

    def _repr_html_(self) -> str:
        return card(str(self).partition("\n")[0], dict(_rows(self.comparison)))


def _rows(found: Comparison) -> list[tuple[str, str]]:
    t, judged = found.theory, found.judged
    rows = [("pose", "q = (" + ", ".join(f"{q:g}" for q in t.pose) + ") rad")]
    if t.delay_sum and t.sallam_eq10:
        safe = _verdict(t.delay_sum.holds, "guaranteed", "not guaranteed", t.delay_sum.max_delay)
        printed = _verdict(t.sallam_eq10.holds, "satisfied", "not satisfied", t.sallam_eq10.max_delay)
        rows += [("delay-sum condition", safe), ("Sallam Eq. 10 (not sufficient)", printed)]
    elif t.pair:
        rows += [("delay-sum condition", f"not given: {t.withheld['delay_sum']}")]
    if t.law_bound is not None:
        rows += [("any law, this plant", _verdict(t.known_mass, "guaranteed", "not guaranteed", t.law_bound))]
    if t.abscissa is not None:
        limit = "" if found.max_delay is None else f", stable to {found.max_delay:.4g} s each way"
        rows += [("spectrum", f"{'unstable' if t.abscissa > 0 else 'stable'}, abscissa {t.abscissa:+.5g} 1/s{limit}")]
    if "spectrum" in t.withheld:
        rows += [("spectrum", f"not given: {t.withheld['spectrum']}")]
    rows += found.any_delay.words() if found.any_delay else []
    if worst := found.falsification:
        said = worst.to_dict()
        reached = worst.outcome.value if said["worst"] is None else f"{said['worst']:+.4g} {worst.harm.unit}"
        rows += [(f"worst {worst.harm.value} of {worst.runs} runs", f"{reached}, {worst.before:+.4g} as it stands")]
    rate = "" if judged.growth_rate is None else f", {judged.growth_rate:+.5g} 1/s"
    return [*rows, ("simulation", f"{judged.outcome.value}{rate}"), ("evidence", found.evidence.value)]


def _verdict(holds: bool, yes: str, no: str, limit: float) -> str:
    return f"{yes if holds else no}, holds to {limit:.4g} s each way"
