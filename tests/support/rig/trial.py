"""One trial: a rig's run through the tool, and what came of it beside what was hidden."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tests.support.rig.cases import Case
from tests.support.rig.experiment import Measured, RigExperiment

if TYPE_CHECKING:
    from cosim.closure.closure import Closure

os.environ.setdefault("OMP_NUM_THREADS", "1")
PART = 500  # runs that are simulated at once: a part takes a minute and a half however small


@dataclass
class TrialOutcome:
    """Verdict of the tool on one run; errors per joint are RMS of the held-out moving rows before and after [N.m]."""

    label: str
    size: float
    seed: int
    truth: dict
    verdict: str
    found: list = field(default_factory=list)  # (name, joints, aliases)
    unknown: list = field(default_factory=list)  # (joint, signals)
    withdrawn: list = field(default_factory=list)
    parameters: dict = field(default_factory=dict)
    interval: dict = field(default_factory=dict)
    before: list = field(default_factory=list)
    after: list = field(default_factory=list)
    viscous: list = field(default_factory=list)
    good: bool = True

    def hit(self, name, joints):
        """Whether the effect is named on its joints, by itself or in an alias set of at most three."""
        return any((f[0] == name or name in f[2]) and set(f[1]) == set(joints) and len(f[2]) <= 2 for f in self.found)

    @property
    def right(self):
        return all(self.hit(name, joints) for name, joints in self.truth.items())

    @property
    def extra(self):
        """Named effects that are not, and whose aliases are not, among the hidden ones."""
        return [f for f in self.found if not any(n == f[0] or n in f[2] for n in self.truth)]


def recording(run: Measured, case: Case):
    """The run as the tool reads it: second half held out."""
    from cosim.measured import PhantomDevice, Recording, RecordingDescription, Run

    n = len(run.time)
    description = RecordingDescription()
    if case.declared:
        description = RecordingDescription(PhantomDevice(declared_pi=tuple(map(float, case.plant.pi))))
    one = Run("rig", run.time, run.q, run.tau, np.arange(n) >= n // 2, q_ref=run.q_ref)
    return Recording(description, (one,))


def held_torque(model) -> list[float]:
    """RMS of the torque of the held-out moving rows, per joint [N.m]; NaN where there are none."""
    from cosim.closure.score.errors import torque

    rows = model.setting.rows
    used = (rows.test & rows.moving.T, torque(model))
    return [float(np.sqrt(np.mean(y[u] ** 2))) if u.any() else float("nan") for u, y in zip(*used, strict=True)]


def judge(task) -> dict:
    """Close the loop on one run; a plain dictionary, for other processes."""
    from cosim.closure.closure import Options, close_loop

    run, case, experiment = task
    out = TrialOutcome(
        case.label, case.size, experiment.seed, {k: sorted(v) for k, v in case.truth.items()}, "", good=run.good
    )
    if not run.good:
        return asdict(out)
    return asdict(answered(out, lambda: close_loop(recording(run, case), Options(replayed=False))))


def answered(out: TrialOutcome, close: Callable[[], Closure]) -> TrialOutcome:
    """The outcome with what the tool found."""
    try:
        closure = close()
    except Exception as error:  # noqa: BLE001 - a study counts it as a wrong answer and goes on
        out.verdict = f"error: {error!r}"
        return out
    verdict = closure.verdict
    out.verdict = verdict.answer.value
    out.found = [(f.name, list(f.joints), list(f.aliases)) for f in verdict.findings]
    out.withdrawn = [(c.effect.name, [j + 1 for j in c.joints], why) for c, why in verdict.withdrawn]
    out.unknown = [(x.joint + 1, list(x.signals)) for x in verdict.leftovers]
    for f in verdict.findings:
        out.parameters |= {str(label): value for label, value in f.parameters.items()}
        out.interval |= {str(label): list(pair) for label, pair in f.interval.items()}
    if closure.error is not None:
        whole = held_torque(closure.before)
        out.before, out.after = (
            [float(e / 100 * w) for e, w in zip(errors, whole, strict=True)]
            for errors in (closure.error.before, closure.error.after)
        )
        out.viscous = closure.before.friction_levels[0].tolist()
    return out


def run_all(
    tasks: list[tuple[Case, RigExperiment]], duration: float, workers: int = 1, out: Path | None = None, tell=print
):
    """Outcomes of all tasks: simulated and judged in parts, one part a process at a time, each outcome kept as a line
    of `out` at once.

    Tasks that `out` holds already are not run again, so a study that was stopped goes on where it was.
    """
    done = (
        {key(o): o for o in (TrialOutcome(**json.loads(line)) for line in out.read_text().splitlines())}
        if out and out.exists()
        else {}
    )
    wanted = [(case.label, case.size, experiment.seed) for case, experiment in tasks]
    left = [task for task, name in zip(tasks, wanted, strict=True) if name not in done]
    count = min(-(-len(left) // (PART * workers)) * workers, len(left))  # parts, as many for every worker
    with ProcessPoolExecutor(workers) as pool:
        for outcomes in pool.map(_simulated_and_judged, [(left[k::count], duration, out) for k in range(count)]):
            done |= {key(o): o for o in outcomes}
            tell(f"  {len(done)} of {len(wanted)}")
    return [done[name] for name in wanted]


def _simulated_and_judged(part) -> list[TrialOutcome]:
    from tests.support.rig.experiment import record

    tasks, duration, out = part
    runs = record([case.plant for case, _ in tasks], [experiment for _, experiment in tasks], duration)
    outcomes = []
    for run, (case, experiment) in zip(runs, tasks, strict=True):
        outcomes.append(TrialOutcome(**judge((run, case, experiment))))
        if out:
            with out.open("a") as lines:
                lines.write(json.dumps(asdict(outcomes[-1])) + "\n")
    return outcomes


def key(outcome: TrialOutcome) -> tuple[str, float, int]:
    """What tells one trial of a study from the others."""
    return outcome.label, outcome.size, outcome.seed
