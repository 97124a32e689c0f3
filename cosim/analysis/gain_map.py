"""The greatest delay that a loop bears, over two of its gains: the map on which a live page shows where it is."""

from collections.abc import Callable, Sequence

import numpy as np
from attrs import field, frozen

from cosim.analysis.assessment import boundary
from cosim.analysis.linearisation import linearise
from cosim.engine.master import System
from cosim.errors import InputError, RunError
from cosim.scenario import Scenario


@frozen(eq=False)
class GainMap:
    """Largest constant delay each way (m, n) [s] by the exact spectrum of the loop at its start pose, inf where every
    delay is borne, over a gain `across` (n,) at values of another one `beside` (m,).
    """

    across: np.ndarray
    beside: np.ndarray
    delay: np.ndarray = field(repr=False)


class NoMapError(Exception):
    """The loop has no such boundary, or its equations do not tell all of it; says why."""


def gain_map(
    scenario: Scenario,
    system: System,
    across: tuple[Sequence[str], np.ndarray],
    beside: tuple[Sequence[str], np.ndarray],
    say: Callable[[str], None] = lambda _: None,
) -> GainMap:
    """The map of a scenario on loaded FMUs. across, beside: names of start values that are one gain, and its values;
    `beside` may have no names and one value. Raises NoMapError.
    """
    (names, values), (others, levels) = across, beside
    rows = []
    for level in levels:
        say(f"stability map: {len(rows) * len(values)} of {len(levels) * len(values)} places")
        fixed = dict.fromkeys(others, float(level))
        rows.append([_borne(scenario.with_values(fixed | dict.fromkeys(names, float(v))), system) for v in values])
    return GainMap(values, levels, np.array(rows))


def _borne(scenario: Scenario, system: System) -> float:
    try:
        loop = linearise(scenario, system)
    except (InputError, RunError) as error:
        raise NoMapError(str(error)) from error
    for name, why in loop.unseen.items():
        raise NoMapError(f"{name} {why}")
    found = boundary(loop)
    if found is None:
        raise NoMapError("the loop has no channel, or a signal passes two")
    return found
