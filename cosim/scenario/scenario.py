"""A scenario: a co-simulation, described."""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

from attrs import frozen

from cosim.errors import InputError, Problem
from cosim.scenario.changing import assign
from cosim.scenario.checking import check
from cosim.scenario.parts import ScenarioParts


@final
@frozen
class Scenario(ScenarioParts):
    """A co-simulation, described: components with their parameters, the connections, how they are stepped."""

    def with_values(self, values: Mapping[str, object]) -> Scenario:
        """The scenario with values at paths: `arm_l.q_start[1]`, `controller_*.stiffness`, `experiment.stop`.

        The paths are those of `--set` and of sweep axes. Raises InputError with every problem found.
        """
        if not isinstance(values, Mapping):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(Problem("with_values()", "a mapping from paths to values", repr(values)[:80]))
        problems: list[Problem] = []
        changed = self
        for path, value in values.items():
            changed = assign(changed, path, value, problems)
        problems += check(changed, changed.name)
        if problems:
            raise InputError(problems)
        return changed
