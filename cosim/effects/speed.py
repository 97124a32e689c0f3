"""Effects of the speed of a joint: offset, asymmetries, Stribeck, quadratic drag."""

import numpy as np

from cosim.effects.effect import Alias, Effect, EffectEstimate, per_joint
from cosim.effects.motion import Columns, Joints, Theta
from cosim.effects.scene import Scene
from cosim.measured.label import Label

ENDED = 0.5  # Stribeck speed over the largest speed: above it the end of its fall is not seen
RISEN = 0.5  # the smooth sign of the friction law at the Stribeck speed


class TorqueOffset(Effect):
    """A constant torque that the motor must supply."""

    name = "torque_offset"
    title = "constant torque offset"
    equation = "tau += offset"
    source = "Swevers, Verdonck, De Schutter 2007, IEEE Control Systems 27(5)"
    aliases: tuple[Alias, ...] = (
        Alias(
            "coulomb_asymmetry",
            "nothing in motion data: hold the arm still and creep in both directions, or turn it over",
            always=True,
        ),
        Alias("base_tilt", "a wide range of q1, or the arm turned about the vertical"),
        Alias("encoder_offset", "a wide range of the joint, or a mechanical reference of its zero"),
    )

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return {joints[0]: np.ones((len(scene.motion.time), 1))}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("torque_offset", joints),)


class CoulombAsymmetry(Effect):
    """A Coulomb level that depends on the direction of motion."""

    name = "coulomb_asymmetry"
    title = "Coulomb friction that depends on the direction"
    equation = "tau += a s(dq)^2"
    signals: tuple[str, ...] = ("dq",)
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7)"
    aliases: tuple[Alias, ...] = (
        Alias(
            "torque_offset",
            "nothing in motion data: hold the arm still and creep in both directions, or turn it over",
            always=True,
        ),
        Alias("viscous_asymmetry", "both directions at clearly different speeds"),
    )

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return {joints[0]: scene.sign[:, joints] ** 2}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("coulomb_asymmetry", joints),)

    def unphysical(self, estimate: EffectEstimate) -> str:
        level = estimate.scene.coulomb[estimate.joints[0]]
        if abs(estimate.beta[0]) - 2 * estimate.std[0] > max(level, 0):
            return "the asymmetry is larger than the Coulomb level itself: one direction would be driven by friction"
        return ""


class ViscousAsymmetry(Effect):
    """A viscosity that depends on the direction of motion."""

    name = "viscous_asymmetry"
    title = "viscous friction that depends on the direction"
    equation = "tau += a |dq|"
    signals: tuple[str, ...] = ("dq",)
    source = "Janot, Gautier, Brunot 2019, EMPS reference models"
    unit = "N.m.s/rad"
    aliases: tuple[Alias, ...] = (Alias("torque_offset", "both directions at clearly different speeds"),)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return {joints[0]: np.abs(scene.motion.dq[:, joints])}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("viscous_asymmetry", joints),)


class Stribeck(Effect):
    """More friction at low speed than at high speed."""

    name = "stribeck"
    title = "Stribeck friction"
    equation = "tau += a exp(-(|dq| / v)^d) s(dq), a > 0"
    signals: tuple[str, ...] = ("dq",)
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7), Eq. 8"
    aliases: tuple[Alias, ...] = (
        Alias(
            "hysteresis", "slow sweeps that reverse at many places: presliding counts distance, Stribeck counts speed"
        ),
        Alias("quadratic_drag", "speeds above 3 rad/s"),
    )

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        low, high = scene.speed_range(joints[0])
        speeds = np.geomspace(max(1.5 * low, 0.02 * high), 0.7 * high, 9)
        return tuple((float(v), d) for v in speeds for d in (2.0, 1.0))

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (0,)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        speed, exponent = theta
        ratio = np.abs(scene.motion.dq[:, joints]) / speed
        return {joints[0]: np.exp(-(ratio**exponent)) * scene.sign[:, joints]}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("stribeck", joints),)

    def theta_labels(self, joints: Joints) -> tuple[Label, ...]:
        return (per_joint("stribeck_velocity", joints), per_joint("stribeck_exponent", joints))

    def unphysical(self, estimate: EffectEstimate) -> str:
        if estimate.beta[0] < 0:
            return (
                "negative amplitude: friction falls towards zero speed, which "
                "is presliding or a soft sign, not Stribeck"
            )
        speed, scene, joint = estimate.theta[0], estimate.scene, estimate.joints[0]
        if speed > ENDED * scene.speed_range(joint)[1]:
            return "it falls over the whole range of speeds: a law of the low speeds has an end within it"
        if np.abs(scene.sign[np.abs(scene.motion.dq[:, joint]) <= speed, joint]).max(initial=0.0) < RISEN:
            return (
                "it falls where the smooth sign of the friction law has not "
                "risen yet: the form of that sign, not Stribeck"
            )
        return ""


class QuadraticDrag(Effect):
    """Drag that grows with the square of the speed."""

    name = "quadratic_drag"
    title = "quadratic drag"
    equation = "tau += c dq |dq|, c > 0"
    signals: tuple[str, ...] = ("dq",)
    source = "aerodynamic or churning loss"
    unit = "N.m.s2/rad2"
    aliases: tuple[Alias, ...] = (Alias("stribeck", "speeds above 3 rad/s"),)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        dq = scene.motion.dq[:, joints]
        return {joints[0]: dq * np.abs(dq)}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("quadratic_drag", joints),)

    def unphysical(self, estimate: EffectEstimate) -> str:
        return "negative drag feeds energy in" if estimate.beta[0] < 0 else ""
