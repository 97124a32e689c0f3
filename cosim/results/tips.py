"""Where the tips of two arms are beside each other, in one frame."""

from collections.abc import Mapping

import numpy as np
from attrs import frozen

from cosim.engine.master import Result
from cosim.scenario import Scenario, start_values


@frozen(eq=False)
class FacingTips:
    """Tips (n, 3) [m] in the remote arm's frame: `local` is where the local arm's tip asks the remote one to be.

    mapped: whether the remote arm's controller moves or scales the ways of the local one; else both are as recorded.
    """

    local: np.ndarray
    remote: np.ndarray
    mapped: bool

    @property
    def apart(self) -> np.ndarray:
        """local - remote (n, 3) [m]."""
        return self.local - self.remote


def facing_tips(result: Result) -> FacingTips | None:
    """The tips of a run, None without two arms.

    x_home + motion_scale (x_l - x_ref_home), by the parameters of what drives the remote arm, else x_l itself.
    """
    arms = result.scenario.arms
    if arms is None or any(f"{arm}.x[1]" not in result.signals for arm in arms):
        return None
    local, remote = (result.vector(f"{arm}.x") for arm in arms)
    values = _driving(result.scenario, arms[1])
    if not values:
        return FacingTips(local, remote, False)
    scale = float(_vector(values, "motion_scale", 1.0)[0])
    home, ref_home = (_vector(values, name, 0.0) for name in ("x_home", "x_ref_home"))
    mapped = scale != 1.0 or bool((home != ref_home).any())
    return FacingTips(home + scale * (local - ref_home) if mapped else local, remote, mapped)


def _driving(scenario: Scenario, arm: str) -> Mapping[str, object]:
    """Parameters of the component that takes a reference of the tip and drives an arm; none where there is none."""
    to_arm = {c.source.component for c in scenario.connections if c.target.component == arm}
    asked = {c.target.component for c in scenario.connections if c.target.variable.startswith("x_ref")}
    for name in sorted(to_arm & asked):
        values = start_values(scenario.components[name])
        if any(key.startswith(("motion_scale", "x_home", "x_ref_home")) for key in values):
            return values
    return {}


def _vector(values: Mapping[str, object], name: str, default: float) -> np.ndarray:
    """A parameter (3,) of a component: one value for all elements, a list, or single elements."""
    found = np.broadcast_to(np.asarray(values.get(name, default), dtype=float), (3,)).copy()
    for k in range(3):
        single = values.get(f"{name}[{k + 1}]")
        found[k] = found[k] if single is None else float(str(single))
    return found
