"""One trial: a rig's run through the tool, and what came of it beside what was hidden."""

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field

import numpy as np

from tests.rig.cases import Case
from tests.rig.experiment import Experiment, Measured

os.environ.setdefault("OMP_NUM_THREADS", "1")


@dataclass
class Outcome:
    """Verdict of the tool on one run; errors are held-out RMS% of the moving rows of the joint with the effect."""

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
    from cosim.measured import Description, Recording, Run

    n = len(run.time)
    description = Description()
    if case.declared:
        description = Description(parameters="declared", declared_pi=tuple(map(float, case.plant.pi)))
    one = Run("rig", run.time, run.q, run.tau, np.arange(n) >= n // 2, q_ref=run.q_ref)
    return Recording(description, (one,))


def judge(task) -> dict:
    """Close the loop on one run; a plain dictionary, for other processes."""
    from cosim.closure.closure import Options, close_loop

    run, case, experiment = task
    out = Outcome(case.label, case.size, experiment.seed, {k: sorted(v) for k, v in case.truth.items()}, "", good=run.good)
    if not run.good:
        return asdict(out)
    closure = close_loop(recording(run, case), Options(replayed=False))
    verdict = closure.verdict
    out.verdict = verdict.answer.value
    out.found = [(f.name, list(f.joints), list(f.aliases)) for f in verdict.findings]
    out.withdrawn = [(f.name, list(f.joints), why) for f, why in verdict.withdrawn]
    out.unknown = [(x.joint + 1, list(x.signals)) for x in verdict.leftovers]
    for f in verdict.findings:
        out.parameters |= f.parameters
        out.interval |= {k: list(v) for k, v in f.interval.items()}
    if closure.error is not None:
        out.before, out.after = list(closure.error.before), list(closure.error.after)
        nj = closure.before.setting.joints
        p = len(closure.before.setting.names)
        out.viscous = [float(v) for v in closure.before.fit.beta[p : p + nj]]
    return asdict(out)


def run_all(cases: list[Case], experiments: list[Experiment], duration: float, workers: int = 1, batch: int = 250, tell=print):
    """Outcomes of all cases: simulated in batches, judged in `workers` processes."""
    from tests.rig.experiment import record

    out = []
    for start in range(0, len(cases), batch):
        part, settings = cases[start : start + batch], experiments[start : start + batch]
        runs = record([c.plant for c in part], settings, duration)
        tasks = zip(runs, part, settings, strict=True)
        if workers > 1:
            with ProcessPoolExecutor(workers) as pool:
                out += [Outcome(**r) for r in pool.map(judge, tasks, chunksize=4)]
        else:
            out += [Outcome(**judge(task)) for task in tasks]
        tell(f"  {len(out)} of {len(cases)}")
    return out
