"""Effects of the angle of a joint: friction that varies with it, springs and cables, ripple, hysteresis."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from cosim.effects.effect import Alias, Effect, EffectEstimate, per_joint
from cosim.effects.motion import Columns, Joints, Motion, Theta
from cosim.effects.scene import Scene
from cosim.measured.label import Label

FEWEST = 1.4  # cycles of a ripple within the range of the motion


class PositionFriction(Effect):
    """A Coulomb level that changes around the turn."""

    name = "position_friction"
    amplitude = True
    title = "Coulomb friction that depends on the angle"
    equation = "tau += (a sin n q + b cos n q) s(dq), n cycles a turn"
    signals: tuple[str, ...] = ("q", "dq")
    source = "eccentric bearings and gears; Armstrong-Helouvry 1991"
    aliases: tuple[Alias, ...] = (Alias("load_friction", "the same angles under another load"),)

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        """Orders from one wave a turn, which even a part of a turn shows, to the highest that the filter passes."""
        span, (_, top) = scene.angle_range(joints[0]), scene.speed_range(joints[0])
        highest = min(1.0 / (scene.motion.widths.total * max(top, 1e-9)), 24.0)
        orders = np.arange(1.0, max(highest, 1.0) + 1e-9, max(min(1.0, np.pi / max(span, 1e-9)), 0.1))
        return tuple((float(n),) for n in orders[:60] if n == 1.0 or n * span > 2 * np.pi * FEWEST)

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return () if theta[0] == 1.0 else (0,)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        q, s = theta[0] * scene.motion.q[:, joints], scene.sign[:, joints]
        return {joints[0]: np.concatenate((np.sin(q) * s, np.cos(q) * s), axis=1)}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        """FMU parameters of one cycle a turn; other orders are in no FMU."""
        names = ("position_friction_sin", "position_friction_cos")
        if theta[0] == 1.0:
            return tuple(per_joint(name, joints) for name in names)
        return tuple(Label(f"{name} of n q{joints[0] + 1}") for name in names)

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        order = {} if estimate.theta[0] == 1.0 else {Label(f"n of joint {estimate.joints[0] + 1}"): estimate.theta[0]}
        return super().parameters(estimate) | order

    def untestable(self, scene: Scene, joints: Joints) -> str:
        return "the joint turns less than 0.2 rad" if scene.angle_range(joints[0]) < 0.2 else ""

    def unphysical(self, estimate: EffectEstimate) -> str:
        j = estimate.joints[0]
        low, high = np.percentile(estimate.scene.motion.q[:, j], (1, 99))
        q = estimate.theta[0] * np.linspace(low, high, 50)
        level = estimate.scene.coulomb[j] + estimate.beta[0] * np.sin(q) + estimate.beta[1] * np.cos(q)
        slack = 3 * np.abs(estimate.std).sum()
        return "the Coulomb level would be negative within the range of motion" if level.min() < -slack else ""


class PositionTorque(Effect):
    """A torque that only depends on the angle: cable, return spring, counterbalance."""

    name = "position_torque"
    signals: tuple[str, ...] = ("q",)
    title = "torque that depends on the angle"
    equation = "tau += k q (+ k3 q^3), or + k q + k2 q^2 (+ k3 q^3), or + a sin q + b cos q"
    source = "Taati et al. 2008, section 4.2 (counterbalance); cable harness"
    unit = "N.m/rad"
    sharp = False
    aliases: tuple[Alias, ...] = (
        Alias("base_tilt", "a wide range of q1, or the arm turned about the vertical"),
        Alias("encoder_offset", "a wide range of the joint, or a mechanical reference of its zero"),
        Alias("torque_offset", "a wider range of the joint"),
        Alias("payload", "faster motion: a mass shows in the acceleration too"),
    )
    SHAPES = ((1,), (1, 2), (1, 2, 3), (1, 3), (0, 1), (0, 1, 2), (0, 1, 2, 3), (8, 9))
    NAMES = {
        0: "torque_offset",
        1: "position_torque",
        2: "position_torque_quadratic",
        3: "position_torque_cubic",
        8: "position_torque_sin",
        9: "position_torque_cos",
    }

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        return tuple((float(k),) for k in range(len(self.SHAPES)))

    def simpler(self, theta: Theta) -> tuple[Theta, ...]:
        own = set(self.SHAPES[int(theta[0])])
        held = [k for k, shape in enumerate(self.SHAPES) if set(shape) < own]
        return tuple((float(k),) for k in sorted(held, key=lambda k: len(self.SHAPES[k])))

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        q = scene.motion.q[:, joints]
        powers = {8: np.sin, 9: np.cos}
        parts = [powers[k](q) if k in powers else q**k for k in self.SHAPES[int(theta[0])]]
        return {joints[0]: np.concatenate(parts, axis=1)}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return tuple(per_joint(self.NAMES[k], joints) for k in self.SHAPES[int(theta[0])])

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        return dict(zip(self.labels(estimate.joints, estimate.theta), map(float, estimate.beta), strict=True))


class TorqueRipple(Effect):
    """Cogging or torque ripple: periodic in the angle."""

    name = "torque_ripple"
    amplitude = True
    title = "torque ripple"
    equation = "tau += a sin(n q) + b cos(n q), n cycles a turn of the joint"
    signals: tuple[str, ...] = ("q",)
    source = "Holtz, Springob 1996, IEEE Trans. Ind. Electronics 43(2)"
    aliases: tuple[Alias, ...] = (Alias("position_torque", "finer steps of angle, slowly"),)
    needs = "speeds low enough for the filter to pass the ripple"

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        span = scene.angle_range(joints[0])
        speed = float(np.sqrt(np.mean(scene.motion.dq[:, joints[0]] ** 2)))
        if span < 1e-3 or speed <= 0:
            return ()
        lowest = (FEWEST + 0.1) * 2 * np.pi / span
        highest = min(1.2 / (scene.motion.widths.total * speed), 400.0)
        if highest <= lowest:
            return ()
        step = 0.45 * 2 * np.pi / span
        orders = np.arange(lowest, highest, step)
        return tuple((float(n),) for n in orders[:160])

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (0,)

    def moved(self, theta: Theta, index: int, step: float) -> Theta:
        return (theta[0] + 4 * step,)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        q = scene.motion.q[:, joints]
        return {joints[0]: np.concatenate((np.sin(theta[0] * q), np.cos(theta[0] * q)), axis=1)}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("ripple_sin", joints), per_joint("ripple_cos", joints))

    def theta_labels(self, joints: Joints) -> tuple[Label, ...]:
        return (per_joint("ripple_order", joints),)

    def untestable(self, scene: Scene, joints: Joints) -> str:
        return (
            "" if self.grid(scene, joints) else "the motion is too fast or too small for any ripple to pass the filter"
        )

    def unphysical(self, estimate: EffectEstimate) -> str:
        cycles = estimate.theta[0] * estimate.scene.angle_range(estimate.joints[0]) / (2 * np.pi)
        return "" if cycles >= FEWEST else f"{cycles:.2g} cycles in the range of the motion: no period to be seen"


class Hysteresis(Effect):
    """Friction that builds up over a distance after a reversal: presliding, cable, gear.

    z is Dahl's state, or three elasto-plastic elements in parallel, z = sum w_k z_k, w = (1 - tilt, 1, 1 + tilt)/3,
    that yield over length (1/ratio, 1, ratio): dz_k/dt = dq / length_k within |z_k| < 1 (Iwan 1966, J. Appl. Mech.
    33(4); Maxwell slip). theta = (length [rad], ratio, tilt). Ratio 0 is Dahl's law; the elements are its richer form.
    """

    name = "hysteresis"
    title = "hysteresis (presliding, cable)"
    equation = "tau += h z, dz/dt = dq (1 - z sgn(dq)) / length, or z = sum w_k z_k of elasto-plastic elements, h > 0"
    signals: tuple[str, ...] = ("history of q",)
    source = "Dahl 1968, TOR-158(3107-18); Iwan 1966, J. Appl. Mech. 33(4); Al-Bender, Lampaert, Swevers 2005"
    aliases: tuple[Alias, ...] = (
        Alias("stribeck", "slow sweeps that reverse at many places: presliding counts distance, Stribeck counts speed"),
        Alias("backlash", "an encoder on the link"),
        Alias("joint_elasticity", "an encoder on the link"),
    )
    FIRST, RATIOS = (2.0, 0.2), (1.2, 8.0)  # ratio and tilt at which the search begins, least and largest ratio

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        lengths = scene.angle_range(joints[0]) * np.geomspace(0.003, 0.5, 9)
        return tuple((float(x), *form) for form in ((0.0, 0.0), self.FIRST) for x in lengths)

    def simpler(self, theta: Theta) -> tuple[Theta, ...]:
        return ((theta[0], 0.0, 0.0),) if theta[1] else ()

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (0, 1, 2) if theta[1] else (0,)

    def moved(self, theta: Theta, index: int, step: float) -> Theta:
        length, ratio, tilt = super().moved(theta, index, step) if index < 2 else (*theta[:2], theta[2] + step)
        if not ratio:
            return (length, 0.0, 0.0)
        return (length, float(np.clip(ratio, *self.RATIOS)), float(np.clip(tilt, -1.0, 1.0)))

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return {joints[0]: _presliding(scene.motion, joints[0], (theta,))}

    def columns_of_all(self, scene: Scene, joints: Joints, thetas: Sequence[Theta]) -> Sequence[Columns]:
        if type(self).columns is not Hysteresis.columns:  # an effect of a user's own
            return super().columns_of_all(scene, joints, thetas)
        states = _presliding(scene.motion, joints[0], thetas)
        return [{joints[0]: states[:, [k]]} for k in range(len(thetas))]

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("hysteresis", joints),)

    def theta_labels(self, joints: Joints) -> tuple[Label, ...]:
        return tuple(per_joint(f"hysteresis_{name}", joints) for name in ("length", "ratio", "tilt"))

    def unphysical(self, estimate: EffectEstimate) -> str:
        return "a negative hysteresis gives energy back" if estimate.beta[0] < 0 else ""


def _presliding(motion: Motion, joint: int, thetas: Sequence[Theta]) -> np.ndarray:
    """State (n, k) of each theta: of Dahl's law, or of the elements."""
    states = np.empty((len(motion.time), len(thetas)))
    length, ratio, tilt = np.array(thetas).T
    rich = ratio > 0
    if not rich.all():
        states[:, ~rich] = dahl(motion, joint, length[~rich])
    if rich.any():
        states[:, rich] = elements(motion, joint, length[rich], ratio[rich], tilt[rich])
    return states


def dahl(motion: Motion, joint: int, length: np.ndarray) -> np.ndarray:
    """States z (n, k) of dz/dt = dq (1 - z sgn(dq)) / length for lengths (k,): u = 1 - z sgn(dq) falls to
    u exp(-d / length) over a distance d.
    """
    return _strokes(motion, joint, length, lambda u, gone: u * np.exp(-gone))


def elements(motion: Motion, joint: int, length: np.ndarray, ratio: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """z (n, k) of three elasto-plastic elements: u falls to u - d / length_j, until nothing is left."""
    each = np.stack((length / ratio, length, length * ratio))
    weight = np.stack((1 - tilt, np.ones_like(tilt), 1 + tilt)) / 3
    z = _strokes(motion, joint, each.ravel(), lambda u, gone: np.maximum(u - gone, 0.0))
    return (z.reshape(len(z), *each.shape) * weight).sum(axis=1)


def _strokes(
    motion: Motion, joint: int, length: np.ndarray, left: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """States z (n, k) over each run from z = 0, for lengths (k,); exact for a constant direction between samples.

    left(u, gone): the remainder of u = 1 - z sgn(dq) after distances in one direction, in units of the length. Moves
    below the standstill noise count as well.
    """
    out = np.empty((len(motion.time), len(length)))
    for a, b in motion.bounds:
        move = np.diff(motion.q[a:b, joint], prepend=motion.q[a, joint])
        edges = np.r_[0, np.flatnonzero(np.diff(np.sign(move)) != 0) + 1, b - a]
        z = np.zeros(len(length))
        for start, stop in itertools.pairwise(edges):
            toward, gone = np.sign(move[start] / length), np.abs(np.cumsum(move[start:stop])[:, None] / length)
            out[a + start : a + stop] = toward - toward * left(1 - toward * z, gone) if move[start] else z
            z = out[a + stop - 1]
    return out
