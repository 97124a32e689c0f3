"""Friction that grows with the transmitted torque."""

import numpy as np

from cosim.effects.effect import Alias, Effect, EffectEstimate, per_joint
from cosim.effects.motion import Columns, Joints, Theta
from cosim.effects.scene import Scene
from cosim.measured.label import Label


class LoadFriction(Effect):
    """Gear or capstan friction: a share of the motor's torque.

    The load is the torque that the model predicts: the motor's, friction with it (theta 0, an implicit law), or behind
    the gear, the rigid body's alone (theta 1). Of the motor's one |tau| s(dq) is the torque itself wherever friction
    prevails, and nothing can be seen.
    """

    name = "load_friction"
    title = "load-dependent friction"
    equation = "tau += c |tau| s(dq), c > 0"
    source = "Hamon, Gautier, Garrec, Janot 2010, AIM; capstan equation for cables"
    unit = "1"
    dynamic = True
    signals: tuple[str, ...] = ("tau", "dq")
    aliases: tuple[Alias, ...] = (Alias("position_friction", "the same angles under another load"),)

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        return ((0.0,), (1.0,))

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        load = scene.rigid if theta[0] else scene.prediction
        return {joints[0]: np.abs(load[:, joints]) * scene.sign[:, joints]}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        """The FMU's load is the motor's torque; friction of the rigid body's alone is in no FMU."""
        return (
            Label(f"load_friction of the rigid torque {joints[0] + 1}")
            if theta[0]
            else per_joint("load_friction", joints),
        )

    def unphysical(self, estimate: EffectEstimate) -> str:
        if estimate.beta[0] < 0:
            return "friction that falls with the load"
        return "friction larger than the load that causes it" if estimate.beta[0] - 2 * estimate.std[0] > 1 else ""
