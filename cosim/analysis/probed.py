"""What a hand feels through a teleoperator, by runs of its FMUs: a sine of force on each tip, what the tips do.

The same hybrid matrix as that of the linear loop (`cosim.analysis.transparency`), with all that is not linear in it:
for small forces the two agree; with friction, limits or a controller that switches, the runs are what counts.
"""

from collections.abc import Callable, Sequence

import numpy as np
from attrs import evolve

from cosim.analysis.transparency import AXES, Hybrid
from cosim.engine.master import Result
from cosim.errors import InputError, Problem
from cosim.fmu import descriptions
from cosim.scenario import Component, Connection, Scenario
from cosim.signals import Signal, stem
from cosim.wiring import wire

PROBE = "probe"
SETTLED, LOOKED_AT = 4.0, 4.0
"""Periods before the velocities are looked at (and `SETTLE` at least), and for which they are."""
SETTLE = 4.0
"""s: what began with the force has died out, in a loop that is stable at all."""
APART = 0.05
"""Part by which both halves of what is looked at may differ, or the motion has not settled."""


def probed(
    scenario: Scenario, simulate: Callable[[Scenario], Result], frequencies: Sequence[float], force: float
) -> Hybrid:
    """The hybrid matrix of runs with a force [N] at frequencies [Hz] on either tip, hand and environment taken off.

    Raises InputError for a scenario without two arms whose `f` can be wired, and where a motion does not settle.
    """
    parts = [[_columns(scenario, simulate, arm, f, force) for arm in _arms(scenario)] for f in frequencies]
    return Hybrid.of(frequencies, np.array([np.hstack(sides) for sides in parts]))


def _arms(scenario: Scenario) -> tuple[str, str]:
    wiring = wire(scenario, descriptions(scenario))
    arms = scenario.arms or ()
    if len(arms) == 2 and all({"f[3]", "dx[3]"} <= set(wiring.descriptions[arm].variables) for arm in arms):
        return arms
    raise InputError(Problem(f"{scenario.name}: transparency", "two arms with an input f and an output dx", "none"))


def _columns(
    scenario: Scenario, simulate: Callable[[Scenario], Result], arm: str, frequency: float, force: float
) -> np.ndarray:
    """Velocities (6, 3) of both tips by a force of one on each axis of an arm, complex [m/(N s)]."""
    found = []
    for axis in AXES:
        result = simulate(_with_probe(scenario, arm, axis, frequency, force))
        if result.failure is not None:
            raise result.failure
        velocities = np.column_stack([result.vector(f"{name}.dx") for name in scenario.arms or ()])
        found.append(_phasor(scenario, result.time, velocities, frequency) / (force / 1j))
    return np.column_stack(found)


def _phasor(scenario: Scenario, time: np.ndarray, values: np.ndarray, frequency: float) -> np.ndarray:
    """Complex amplitudes (6,) of values (n, 6) at a frequency, over the last periods."""
    halves = []
    for begin, end in ((1.0, 0.5), (0.5, 0.0)):
        span = LOOKED_AT / frequency
        rows = (time > time[-1] - begin * span + 1e-9) & (time <= time[-1] - end * span + 1e-9)
        wave = np.column_stack(
            [np.exp(2j * np.pi * frequency * time[rows]), np.exp(-2j * np.pi * frequency * time[rows])]
        )
        basis = np.column_stack([wave, np.ones(rows.sum()), time[rows]])
        halves.append(2.0 * np.linalg.lstsq(basis, values[rows].astype(complex), rcond=None)[0][0])
    if not np.abs(halves[1] - halves[0]).max() < APART * np.abs(halves[1]).max():
        got = f"one that has not settled after {time[-1]:.4g} s of {frequency:g} Hz"
        raise InputError(Problem(f"{scenario.name}: transparency", "a motion that settles", got, "is the loop stable?"))
    return halves[1]


def _with_probe(scenario: Scenario, arm: str, axis: int, frequency: float, force: float) -> Scenario:
    """The scenario with nothing on its tips but a sine of force on one axis of an arm."""
    amplitude = [force * (axis == k) for k in AXES]
    probe = Component("Operator", parameters={"amplitude": amplitude, "frequency": frequency})
    settling = np.ceil(max(SETTLED / frequency, SETTLE) * frequency) / frequency
    experiment = evolve(
        scenario.experiment, stop=float(settling + LOOKED_AT / frequency), record_every=1, disturb=False, order=()
    )
    free = evolve(
        scenario,
        components={**scenario.components, PROBE: probe},
        connections=tuple(_rewired(scenario, arm)),
        experiment=experiment,
    )
    walls = [n for n in scenario.arms or () if "contact_stiffness" in descriptions(free)[n].variables]
    return free.with_values({f"{n}.contact_{what}": 0.0 for n in walls for what in ("stiffness", "damping")})


def _rewired(scenario: Scenario, arm: str) -> list[Connection]:
    """Connections without those of hand and environment; who measures the force on the probed tip has the probe's."""
    tips = {f"{name}.f" for name in scenario.arms or ()}
    measured = {str(c.source) for c in scenario.connections if str(c.target) == f"{arm}.f"} | {f"{arm}.f_contact"}
    kept = [c for c in scenario.connections if stem(str(c.target)) not in tips]
    kept = [evolve(c, source=Signal(PROBE, "f")) if str(c.source) in measured else c for c in kept]
    return [*kept, Connection(Signal(PROBE, "f"), Signal(arm, "f"))]
