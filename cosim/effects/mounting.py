"""Effects of how the arm stands and what it carries: base tilt, encoder offset, payload."""

import numpy as np

from cosim.effects.effect import Alias, Effect, EffectEstimate, Scene
from cosim.effects.transmission import displaced, pressed

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
    aliases = (
        Alias("encoder_offset", "a wide range of q1"),
        Alias("torque_offset", "a wide range of q1"),
        Alias("position_torque", "a wide range of q1"),
    )
    needs = "gravity that is not balanced, a wide range of q1"

    def joint_sets(self, scene: Scene):
        return ((0, 1, 2),) if scene.device == "phantom" else ()

    def untestable(self, scene: Scene, joints) -> str:
        return (
            ""
            if scene.pi is not None and np.abs(scene.pi[6:]).max() > 1e-3
            else "the arm is balanced: gravity has no moment"
        )

    def columns(self, scene, joints, theta):
        p7, p8 = scene.pi[6:]
        (s1, s2, s3), (c1, c2, c3) = np.sin(scene.motion.q.T), np.cos(scene.motion.q.T)
        reach = p7 * c2 + p8 * s3
        return {
            0: np.stack((c1 * reach, -s1 * reach), axis=1),
            1: np.stack((-p7 * s1 * s2, -p7 * c1 * s2), axis=1),
            2: np.stack((p8 * s1 * c3, p8 * c1 * c3), axis=1),
        }

    def labels(self, joints, theta):
        return ("base_tilt[1]", "base_tilt[2]")

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
    aliases = (
        Alias("base_tilt", "a wide range of q1"),
        Alias("torque_offset", "a wide range of the joint, or a mechanical reference of its zero"),
        Alias("position_torque", "a mechanical reference of its zero"),
    )

    def untestable(self, scene: Scene, joints: tuple[int, ...]) -> str:
        if scene.rigid_slopes is None:
            return "the device has no equations of motion"
        if scene.device == "phantom" and joints == (0,):
            return "nothing in the model depends on q1"
        return ""

    def columns(self, scene, joints, theta):
        return displaced(scene, joints[0], -np.ones((len(scene.motion.time), 1)))

    def labels(self, joints, theta):
        return (f"encoder_offset[{joints[0] + 1}]",)

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
    aliases = (Alias("torque_gain", "gravity held at rest in two poses, a known mass"),)
    needs = "declared parameters: otherwise it is absorbed in them"

    def joint_sets(self, scene: Scene):
        return ((0, 1, 2),) if scene.device == "phantom" else ()

    def untestable(self, scene: Scene, joints) -> str:
        return "" if scene.declared else "absorbed in the fitted parameters: declare them to see it"

    def columns(self, scene, joints, theta):
        from cosim.arm.dynamics import inverse_dynamics
        from cosim.arm.kinematics import L1, L2
        from cosim.arm.segments import point_mass_pi

        m = scene.motion
        torque = inverse_dynamics(point_mass_pi(1.0, L1, L2, scene.gravity), m.q, m.dq, m.ddq)
        return {j: torque[:, [j]] for j in range(3)}

    def labels(self, joints, theta):
        return ("payload",)

    def unphysical(self, estimate: EffectEstimate) -> str:
        return "negative mass" if estimate.beta[0] < 0 else ""
