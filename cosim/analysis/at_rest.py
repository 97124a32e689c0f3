"""A scenario at rest at its start pose, and whether its FMUs move there as linear ones do.

A statement on every delay law is one on small motion about a pose. So it is made of the arms at rest, without what
excites them; and it says something of the FMUs only as far as these answer to a motion of a size that matters as they
answer to a tiny one. Friction, limits and contact that comes and goes do not.
"""

import numpy as np

from cosim.analysis.linear_fmu import is_channel, steady_channel
from cosim.analysis.verdict import perturbation
from cosim.engine.master import System, run
from cosim.errors import RunError
from cosim.scenario import Scenario
from cosim.signals import stem
from cosim.wiring import Wiring

SPEEDS = (1e-4, 2e-2)
"""Joint speeds [rad/s] whose effects are compared: small, and that of slow work."""
LINEAR = 0.1
"""Part of the motion by which the two may differ."""
_WATCHED = 1.0
"""Time [s] for which the motion is compared."""


def at_rest(wiring: Wiring) -> Scenario:
    """Its arms at rest, what our models excite it with zero, channels that show at once what they are sent."""
    values: dict[str, object] = {}
    for name, description in wiring.descriptions.items():
        excites = wiring.scenario.components[name].model is not None and not description.elements("q_start")
        if is_channel(description):
            values |= steady_channel(name, 0.0)
        for element in description.elements("dq_start"):
            values[f"{name}.{element}"] = 0.0
        for variable in description.variables.values() if excites else ():
            if variable.causality == "parameter" and stem(variable.name).endswith("amplitude"):
                values[f"{name}.{variable.name}"] = 0.0
    return wiring.scenario.with_values(values)


def bent(rest: Scenario, system: System) -> str:
    """Where the FMUs do not move as linear ones do, in words; empty where they do, or where no arm can be moved."""
    wiring = system.wiring(rest)
    arms = {n: len(d.elements("dq_start")) for n, d in wiring.descriptions.items() if d.elements("dq_start")}
    if not arms:
        return ""
    steps = round(_WATCHED / rest.experiment.step)
    stop = min(rest.experiment.stop, steps * rest.experiment.step)
    short = rest.with_values({"experiment.stop": stop, "experiment.record_every": 1})
    try:
        base = _motion(short, system)
        small, large = (_motion(short.with_values(perturbation(arms, v)), system) for v in SPEEDS)
    except RunError as error:
        return f"how it moves could not be looked at ({error})"
    for name, still in base.items():
        if min(len(small[name]), len(large[name])) < len(still):
            return f"{name} leaves its domain within {stop:g} s when moved at {SPEEDS[1]:g} rad/s"
        expected = (small[name] - still) * (SPEEDS[1] / SPEEDS[0])
        size = float(np.linalg.norm(expected))
        missed = float(np.linalg.norm(large[name] - still - expected))
        if missed > LINEAR * size:
            return (
                f"{name} answers to {SPEEDS[1]:g} rad/s otherwise than to {SPEEDS[0]:g} rad/s "
                f"(by {100 * missed / max(size, 1e-300):.2g} %): friction, a limit or a contact"
            )
    return ""


def _motion(scenario: Scenario, system: System) -> dict[str, np.ndarray]:
    """Joint speeds of all arms (rows, joints) by `arm.dq`."""
    result = run(scenario, system)
    if result.failure is not None:
        raise result.failure
    names: dict[str, list[str]] = {}
    for signal in result.signals:
        if stem(signal).endswith(".dq"):
            names.setdefault(stem(signal), []).append(signal)
    return {name: np.column_stack([result.signals[s] for s in signals]) for name, signals in names.items()}
