"""Effects of mounting and load of the arm: base tilt, encoder offset, payload."""

import numpy as np

from cosim.effects.effect import Alias, Effect, EffectEstimate, per_joint
from cosim.effects.motion import Columns, Joints, Theta
from cosim.effects.moving_arm import MovingArm
from cosim.effects.scene import Scene
from cosim.effects.transmission import displaced, pressed
from cosim.measured.label import Label

PRESSED = Alias(
    "backlash", "a load that changes its sign: a gap that it keeps pressed to one side is an offset of half of it"
)


class BaseTilt(Effect):
    """Gravity does not point along the base's vertical."""

    name = "base_tilt"
    title = "tilted base"
    equation = "V = p7 u.g + p8 f.g with g = (a, 1, b): torques a, b times the derivatives of p7 u + p8 f along x and z"
    source = "rotation of gravity, PHYSICS section 1"
    unit = "rad"
    sharp = False
    dynamic = True
    aliases: tuple[Alias, ...] = (
        Alias("encoder_offset", "a wide range of q1"),
        Alias("torque_offset", "a wide range of q1"),
        Alias("position_torque", "a wide range of q1"),
    )
    needs = "gravity that is not balanced, a wide range of q1"

    def joint_sets(self, scene: Scene) -> tuple[Joints, ...]:
        return scene.whole_arm

    def untestable(self, scene: Scene, joints: Joints) -> str:
        arm, pi = self._arm(scene)
        return "the arm is balanced: gravity has no moment" if arm.geometry.balanced(pi) else ""

    def unseen(self, scene: Scene) -> tuple[str, ...]:
        return ("q",) if scene.device.recorded_columns else ()

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        arm, pi = self._arm(scene)
        return arm.geometry.tilt_torque(scene.motion.q, pi)

    @staticmethod
    def _arm(scene: Scene) -> tuple[MovingArm, np.ndarray]:
        assert scene.arm is not None and scene.pi is not None, "only an arm has a set of joints for this effect"
        return scene.arm, scene.pi

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (Label("base_tilt", 1), Label("base_tilt", 2))

    def unphysical(self, estimate: EffectEstimate) -> str:
        return "a tilt of more than half a radian" if np.abs(estimate.beta).max() > 0.5 else ""


class EncoderOffset(Effect):
    """The encoder's zero is not the model's zero."""

    name = "encoder_offset"
    title = "encoder offset"
    equation = "the model holds at q - offset (q_true = q_measured - offset)"
    source = "homing error"
    unit = "rad"
    sharp = False
    dynamic = True
    aliases: tuple[Alias, ...] = (
        Alias("base_tilt", "a wide range of q1"),
        Alias("torque_offset", "a wide range of the joint, or a mechanical reference of its zero"),
        Alias("position_torque", "a mechanical reference of its zero"),
    )

    def joint_sets(self, scene: Scene) -> tuple[Joints, ...]:
        """Joints on whose angle anything in the model depends."""
        idle = () if scene.arm is None else filter(scene.arm.geometry.idle, range(scene.joints))
        return tuple((j,) for j in range(scene.joints) if j not in set(idle))

    def untestable(self, scene: Scene, joints: Joints) -> str:
        return "the device has no equations of motion" if scene.rigid_slopes is None else ""

    def unseen(self, scene: Scene) -> tuple[str, ...]:
        return ("q", "ddq") if scene.device.recorded_columns else ()

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return displaced(scene, joints[0], -np.ones((len(scene.motion.time), 1)))

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("encoder_offset", joints),)

    def inherent(self, estimate: EffectEstimate) -> tuple[Alias, ...]:
        side = pressed(estimate.scene, estimate.joints[0])
        return (*super().inherent(estimate), *((PRESSED,) if side * estimate.beta[0] > 0 else ()))

    def unphysical(self, estimate: EffectEstimate) -> str:
        return "an offset of more than half a radian" if abs(estimate.beta[0]) > 0.5 else ""


class Payload(Effect):
    """A mass at the tip that the declared parameters do not know."""

    name = "payload"
    title = "payload at the tip"
    equation = "pi += m dpi/dm of a point mass at the tip"
    source = "point mass: PHYSICS section 1"
    unit = "kg"
    sharp = False
    aliases: tuple[Alias, ...] = (Alias("torque_gain", "gravity held at rest in two poses, a known mass"),)
    needs = "declared parameters: otherwise it is absorbed in them"

    def joint_sets(self, scene: Scene) -> tuple[Joints, ...]:
        return scene.whole_arm

    def untestable(self, scene: Scene, joints: Joints) -> str:
        return "" if scene.declared else "absorbed in the fitted parameters: declare them to see it"

    def unseen(self, scene: Scene) -> tuple[str, ...]:
        told = scene.device.recorded_columns and scene.declared  # columns that are fitted absorb it
        return ("q", "ddq", "tau") if told else ()

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        assert scene.arm is not None, "only an arm has a set of joints for this effect"
        torque = scene.arm.geometry.payload_torque(scene.motion, scene.gravity)
        return {j: torque[:, [j]] for j in joints}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (Label("payload"),)

    def unphysical(self, estimate: EffectEstimate) -> str:
        return "negative mass" if estimate.beta[0] < 0 else ""
