"""An effect that was chosen for a model: where it acts and at which values of its nonlinear parameters."""

from collections.abc import Hashable

from attrs import frozen

from cosim.effects import Effect
from cosim.effects.motion import Joints, Theta


@frozen
class ChosenEffect:
    """An effect on a set of joints (0-based) at values of its nonlinear parameters."""

    effect: Effect
    joints: Joints
    theta: Theta = ()

    @property
    def key(self) -> tuple[Hashable, Joints]:
        """What distinguishes it from other choices, whatever its nonlinear parameters."""
        return self.effect.key, self.joints
