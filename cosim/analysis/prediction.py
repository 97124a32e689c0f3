"""How well the linear loop predicts a short run of the FMUs from a disturbed state: the check on what rests on it."""

import numpy as np
from attrs import frozen

from cosim.analysis.examination import Examined
from cosim.analysis.step_loop import StepLoop
from cosim.engine.compiled import CompiledExecutor
from cosim.engine.initialisation import initialise
from cosim.engine.reference import Execution, Watch
from cosim.errors import RunError
from cosim.signals import is_real, stem
from cosim.wiring import Wiring

KICK = 1e-5
"""By how much every wired output is disturbed at t = 0, in its unit, with signs at random."""
BEYOND = 0.3
"""Time [s] for which a run goes on after the delays of both ways have passed."""
MOST = 2000
GOOD = 0.1
"""Part of a signal by which a prediction may be wrong for the linear loop to be evidence: a tenth, since it is the sign
of a growth rate that is read from it; the error itself is always told.
"""


@frozen
class Prediction:
    """The greatest part of any group of signals (`arm_l.x`) that was missed, where, and the time predicted [s]."""

    error: float
    signal: str
    duration: float

    @property
    def good(self) -> bool:
        """Whether the linear loop moves as the FMUs do."""
        return self.error <= GOOD


def predict(found: Examined, loop: StepLoop, delays: float) -> Prediction:
    """Compare the linear loop with the FMUs; `delays` [s]: both ways. Raises RunError where an FMU fails.

    Half the difference of two runs with opposite disturbances, so that forces and terms of second order drop out.
    """
    wiring = found.wiring
    step = wiring.schedule.step_ns / 1e9
    steps = int(min(wiring.scenario.experiment.steps, np.clip(np.ceil((delays + BEYOND) / step), 50, MOST)))
    kick = _kick(wiring)
    seen = 0.5 * (_run(found, kick, steps) - _run(found, -kick, steps))
    expected = _linear(wiring, loop, kick, steps)
    worst = max(_errors(wiring, seen, expected), default=(0.0, ""))
    return Prediction(*worst, steps * step)


def _kick(wiring: Wiring) -> np.ndarray:
    wired = {str(link.source) for link in wiring.links}
    kinds = (wiring.descriptions[n].variables[o] for n in wiring.scenario.components for o in wiring.outputs(n))
    chosen = [name in wired and is_real(kind) for name, kind in zip(wiring.signals, kinds)]
    return KICK * np.array(chosen) * np.random.default_rng(5).choice([-1.0, 1.0], len(chosen))


def _run(found: Examined, kick: np.ndarray, steps: int) -> np.ndarray:
    """Outputs (steps + 1, n) of the FMUs after their stored outputs were disturbed."""
    wiring = found.wiring
    instances = [found.alone[name].instance for name in wiring.scenario.components]
    store = initialise(wiring, instances)
    store += np.concatenate([kick, kick])
    n = wiring.schedule.outputs
    table = np.zeros((steps + 1, n))
    job = Execution(wiring.schedule, instances, store, table, np.arange(n), 1, steps, Watch((), np.full(n, np.inf)))
    ending = CompiledExecutor()(job, None)
    if ending.failure is not None:
        raise ending.failure
    if ending.steps < steps:
        raise RunError(wiring.scenario.name, ending.steps * wiring.schedule.step_ns / 1e9, ending.message)
    return table


def _linear(wiring: Wiring, loop: StepLoop, kick: np.ndarray, steps: int) -> np.ndarray:
    """The same of the linear loop, from rest."""
    n, phases = wiring.schedule.outputs, wiring.schedule.phases
    z, table = np.zeros(loop.matrix.shape[0]), np.zeros((steps + 1, n))
    z[:n], z[n : 2 * n] = kick, kick
    table[0] = kick
    for k in range(steps):
        turn = k % len(phases)
        z = loop.phases[turn] @ z
        table[k + 1] = z[phases[turn].record.source]
    return table


def _errors(wiring: Wiring, seen: np.ndarray, expected: np.ndarray) -> list[tuple[float, str]]:
    """Part missed and name, for every group of wired signals that moved beyond rounding."""
    wired = {str(link.source) for link in wiring.links}
    groups: dict[str, list[int]] = {}
    for place, name in enumerate(wiring.signals):
        if name in wired:
            groups.setdefault(stem(name), []).append(place)
    found = []
    for name, places in groups.items():
        size = np.linalg.norm(seen[1:, places])
        if size > 1e-9 * KICK:
            found.append((float(np.linalg.norm((seen - expected)[1:, places]) / size), name))
    return found
