"""Effects of time and of the outside: friction drift, undeclared contact, coupling between joints."""

from abc import abstractmethod
from collections.abc import Callable, Hashable, Sequence
from itertools import product
from typing import ClassVar

import numpy as np

from cosim.effects.effect import Alias, Effect, EffectEstimate, per_joint
from cosim.effects.motion import Columns, Joints, Theta
from cosim.effects.moving_arm import MovingArm
from cosim.effects.scene import Scene
from cosim.measured.label import Label

DAMPED = 0.15  # of a wall's spring force: a smaller damping is indistinguishable from none, whatever its sign
SPEEDS, ANGLES = ("rad/s", "m/s"), ("rad", "m")  # units of the motion of another joint
LEAD = 0.04  # s, of a step of what a wall pushes ahead of its touch
LASTING = 1e3  # lengths of the recording: a drift that goes on as it began


class FrictionDrift(Effect):
    """Friction that changes over the recording, as by warming up; theta = (time constant T [s],).

    Half of a recording hardly determines T, and its estimate misfits the other half. T is therefore the length of the
    recording, between a drift that goes on as it began and one that has ended, unless another leaves a clearly smaller
    error.
    """

    name = "friction_drift"
    signals: tuple[str, ...] = ("time", "dq")
    of_time = True
    dynamic = True
    title = "friction that drifts with time"
    equation = "tau += d T (1 - exp(-t / T)) (Coulomb s(dq) + viscous dq); T large: d t"
    source = "Bittencourt, Gunnarsson 2012, J. Dyn. Sys. Meas. Control 134(5)"
    unit = "1/s"
    # of the initial slope: for the same growth, half or twice T changes it by a quarter either way
    form: float = 0.12
    aliases: tuple[Alias, ...] = ()
    needs = "repeats of the same motion at different times"

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        return tuple((float(share * np.ptp(scene.motion.time)),) for share in (1.0, LASTING, 2.0, 0.5, 0.2, 0.08))

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        m, j = scene.motion, joints[0]
        clock = m.time - m.time.min()
        grown = theta[0] * -np.expm1(-clock / theta[0])[:, None]
        return {
            j: grown
            * (max(scene.coulomb[j], 1e-9) * scene.sign[:, joints] + max(scene.viscous[j], 0.0) * m.dq[:, joints])
        }

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("friction_drift", joints),)

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        slope = {per_joint("friction_drift", estimate.joints): float(estimate.beta[0])}
        if estimate.theta[0] > 0.1 * LASTING * np.ptp(estimate.scene.motion.time):
            return slope
        return slope | {per_joint("friction_drift_time", estimate.joints): estimate.theta[0]}

    def unphysical(self, estimate: EffectEstimate) -> str:
        span, constant = np.ptp(estimate.scene.motion.time), estimate.theta[0]
        end = 1 + estimate.beta[0] * constant * -np.expm1(-span / constant)
        return "friction would fall below zero" if end < -0.2 else ""


def _arm(scene: Scene) -> MovingArm:
    assert scene.arm is not None, "only an arm has a set of joints for a contact of its tip"
    return scene.arm


class UnilateralSpring(Effect):
    """Something that pushes while it is touched, and never pulls: spring and damper, coefficients (k, c)."""

    met: str
    """What is met, in words."""

    @abstractmethod
    def depth(self, scene: Scene, joints: Joints, theta: Theta) -> np.ndarray:
        """How far (n,) it is pressed in; not touched where negative."""

    def unphysical(self, estimate: EffectEstimate) -> str:
        if estimate.beta[0] < 0:
            return f"a {self.met} that pulls"
        if estimate.sure_sign(1) < 0 and self._damped(estimate) > DAMPED:
            return f"damping of the {self.met} that feeds energy in"
        inside = float((self.depth(estimate.scene, estimate.joints, estimate.theta) > 0).mean())
        return (
            f"it would touch {100 * inside:.0f} % of the time: a torque of position, not a contact"
            if inside > 0.6
            else ""
        )

    def _damped(self, estimate: EffectEstimate) -> float:
        """Size of the force of damping beside that of the spring."""
        spring, damping = (
            np.concatenate(list(self.columns(estimate.scene, estimate.joints, estimate.theta).values())) * estimate.beta
        ).T
        return float(np.sqrt((damping**2).sum() / max((spring**2).sum(), 1e-300)))


class ExternalContact(UnilateralSpring):
    """The tip touches something that was not declared: a wall of stiffness k; theta = (normal n, distance d [m], lead
    [s]).

    Linear in k and c where the wall pushes, which it does while n.x - d and n.x - d + lead n.dx > 0: lead is c / k
    where it fits best.
    """

    name = "external_contact"
    # on simulated arms without noise both parameters err by less than half of that: the form of the friction law
    # hardly matters for a wall
    form: float = 0.01
    title = "undeclared contact of the tip"
    met = "wall"
    equation = "tau += J^T n max(k (n.x - d) + c n.dx, 0) where n.x > d, k > 0"
    source = "unilateral spring"
    unit = "N/m"
    aliases: tuple[Alias, ...] = (Alias("position_torque", "the same angles with the other joints elsewhere"),)
    needs = "recorded tip force, or a contact that is entered and left several times"

    def joint_sets(self, scene: Scene) -> tuple[Joints, ...]:
        return scene.whole_arm

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        x = _arm(scene).tip
        normals = np.array([n for n in np.ndindex(3, 3, 3) if n != (1, 1, 1)]) - 1.0
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        out = []
        for n in normals:
            shares = (60, 80, 88, 92, 95, 97, 98.5, 99.4) if np.abs(n).max() > 0.9 else (65, 85, 96)
            for d in np.percentile(x[::10] @ n, shares):
                out.append((*map(float, n), float(d), 0.0))
        return tuple(out)

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (0, 1, 2, 3, 4)

    def moved(self, theta: Theta, index: int, step: float) -> Theta:
        n = np.array(theta[:3])
        if index == 3:
            return (*theta[:3], theta[3] + 0.04 * step, theta[4])
        if index == 4:
            return (*theta[:4], max(theta[4] + LEAD * step, 0.0))
        n[index] += step
        return (*map(float, n / max(np.linalg.norm(n), 1e-9)), *theta[3:])

    def near(self, scene: Scene, theta: Theta) -> Callable[[Sequence[float]], Theta]:
        """The wall turns about where it is touched, and moves by parts of the tip's way: about the far base, each small
        turn would take it away from the arm.
        """
        tip, normal = _arm(scene).tip, np.array(theta[:3])
        deep = tip @ normal - theta[3]
        touched = tip[deep >= min(0.0, float(deep.max()))].mean(axis=0)
        size = float(np.sqrt(tip.var(axis=0).sum()))

        def at(steps: Sequence[float]) -> Theta:
            turned = normal + steps[:3]
            turned /= max(np.linalg.norm(turned), 1e-9)
            distance = theta[3] + (turned - normal) @ touched + size * steps[3]
            return (*map(float, turned), float(distance), max(theta[4] + LEAD * steps[4], 0.0))

        return at

    def depth(self, scene: Scene, joints: Joints, theta: Theta) -> np.ndarray:
        return _arm(scene).tip @ np.array(theta[:3]) - theta[3]

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        arm, ahead = np.array(theta[:3]) @ _arm(scene).jacobian, theta[4]
        depth, speed = self.depth(scene, joints, theta), np.einsum("nj,nj->n", arm, scene.motion.dq)
        pushes = (depth > 0) & (depth + ahead * speed > 0)
        return {j: arm[:, [j]] * np.where(pushes, (depth, speed), 0.0).T for j in joints}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (Label("contact_stiffness"), Label("contact_damping"))

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        values = super().parameters(estimate)
        damping = Label("contact_damping")
        return values | {damping: max(values[damping], 0.0)}

    def theta_labels(self, joints: Joints) -> tuple[Label, ...]:
        return (*(Label("contact_normal", k) for k in (1, 2, 3)), Label("contact_distance"))


class JointStop(UnilateralSpring):
    """Something is met by one joint beyond an angle: a stop, a cushion, a hand; theta = (side, angle [rad], lead [s]).

    side is 1 where it is met at larger angles, -1 at smaller ones. It pushes while x = side (q - angle) > 0 and
    x + lead side dq > 0: lead is c / k where it fits best.
    """

    name = "external_contact"
    form: float = 0.01
    title = "a stop or a contact of one joint"
    met = "stop"
    equation = "tau += side max(k x + c dx, 0) where x = side (q - angle) > 0, k > 0"
    source = "unilateral spring"
    unit = "N.m/rad"
    signals: tuple[str, ...] = ("q", "dq")
    aliases: tuple[Alias, ...] = ()
    needs = "a contact that is entered and left several times"
    SHARES: ClassVar[tuple[float, ...]] = (50, 65, 75, 83, 89, 93, 96, 98, 99.3)

    @property
    def key(self) -> Hashable:
        return self.name, "one joint"

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        q = scene.motion.q[:, joints[0]]
        high, low = np.percentile(q, self.SHARES), np.percentile(q, 100 - np.array(self.SHARES))
        return (*((1.0, float(d), 0.0) for d in high), *((-1.0, float(d), 0.0) for d in low))

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (1, 2)

    def moved(self, theta: Theta, index: int, step: float) -> Theta:
        side, angle, lead = theta
        return (side, angle + 0.2 * step, lead) if index == 1 else (side, angle, max(lead + LEAD * step, 0.0))

    def depth(self, scene: Scene, joints: Joints, theta: Theta) -> np.ndarray:
        side, angle, _ = theta
        return side * (scene.motion.q[:, joints[0]] - angle)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        (j,), (side, _, lead) = joints, theta
        depth, speed = self.depth(scene, joints, theta), side * scene.motion.dq[:, j]
        pushes = (depth > 0) & (depth + lead * speed > 0)
        return {j: side * np.where(pushes, (depth, speed), 0.0).T}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("stop_stiffness", joints), per_joint("stop_damping", joints))

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        stiffness, damping = self.labels(estimate.joints, estimate.theta)
        side, angle, _ = estimate.theta
        values = {stiffness: float(estimate.beta[0]), damping: max(float(estimate.beta[1]), 0.0)}
        return values | {per_joint("stop_side", estimate.joints): side, per_joint("stop_angle", estimate.joints): angle}

    def theta_labels(self, joints: Joints) -> tuple[Label, ...]:
        return (per_joint("stop_side", joints), per_joint("stop_angle", joints))


class JointCoupling(Effect):
    """A torque on one joint from the motion of another; theta = (joint, shape, speed v over which the Coulomb part
    turns).

    s(dq) = dq / sqrt(dq^2 + v^2) has a speed of its own, since the coupling need not follow the friction law of the
    other joint, which is fitted without the rows near its reversals.
    """

    name = "joint_coupling"
    form: float = 0.005  # the joint's own law of friction has little in common with the speed of another joint
    title = "coupling from another joint"
    equation = "tau_i += b dq_j + c s(dq_j), or k q_j"
    source = "cable routing, coupled wrist drives"
    aliases: tuple[Alias, ...] = ()
    needs = "the other joint's motion"
    SHAPES = ("viscous", "coulomb", "both", "spring")
    WIDTHS = (
        0.003,
        0.02,
        0.1,
    )  # of the other joint's top speed, over which the coupled Coulomb friction turns, to start from
    SHARED = ("dq_other", "dq + dq_other", "dq - dq_other")  # speeds that friction beside a recorded speed may follow
    ANGLE = len(SHARED)  # number of the shape of a spring beside a recorded angle

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        if scene.joints == 1:
            speeds = product(range(len(_recorded(scene, SPEEDS))), range(self.ANGLE))
            angles = product(range(len(_recorded(scene, ANGLES))), (self.ANGLE,))
            return tuple((-1.0 - k, float(shape)) for k, shape in (*speeds, *angles))
        others = [j for j in range(scene.joints) if j != joints[0]]
        shapes = [
            (k, w)
            for k, name in enumerate(self.SHAPES)
            for w in (self.WIDTHS if name in ("coulomb", "both") else (0.0,))
        ]
        return tuple((float(j), float(k), w * scene.speed_range(j)[1]) for j in others for k, w in shapes)

    def place(self, joints: Joints, theta: Theta) -> str:
        other = f" from joint {int(theta[0]) + 1}" if theta[0] >= 0 else ""
        return f"{super().place(joints, theta)}{other}"

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (2,) if theta[0] >= 0 and theta[2] > 0 else ()

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        if theta[0] < 0:
            return {joints[0]: self._from_recorded(scene, int(-theta[0] - 1), int(theta[1]))}
        j, shape = int(theta[0]), self.SHAPES[int(theta[1])]
        dq, q = scene.motion.dq[:, [j]], scene.motion.q[:, [j]]
        s = dq / np.sqrt(dq**2 + max(theta[2], 1e-12) ** 2)
        parts = {"viscous": (dq,), "coulomb": (s,), "both": (dq, s), "spring": (q,)}[shape]
        return {joints[0]: np.concatenate(parts, axis=1)}

    def _from_recorded(self, scene: Scene, number: int, shape: int) -> np.ndarray:
        """A recorded angle, or viscous and Coulomb columns of a recorded speed, or of its sum or difference with the
        joint's own.

        A motor that drives two joints (TX40: q_m6 = 32 q6 + 32 q5) has its friction on the sum.
        """
        m, name = scene.motion, _recorded(scene, ANGLES if shape == self.ANGLE else SPEEDS)[number]
        other = m.smooth(m.other[name][:, None])
        if shape == self.ANGLE:
            return other
        speed = (other, m.dq + other, m.dq - other)[shape]
        width = 0.02 * np.percentile(np.abs(speed), 99)
        return np.concatenate([speed, speed / np.sqrt(speed**2 + max(width, 1e-12) ** 2)], axis=1)

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        """Of the coupling with the number of its pair of joints (`pair_number`)."""
        theta, beta = estimate.theta, map(float, estimate.beta)
        if theta[0] < 0:
            if theta[1] == self.ANGLE:
                return {Label("coupling_stiffness of q_other"): next(beta)}
            speed = self.SHARED[int(theta[1])]
            return dict(zip((Label(f"coupling_{n} of {speed}") for n in ("viscous", "coulomb")), beta, strict=True))
        shape = self.SHAPES[int(theta[1])]
        k = pair_number(estimate.scene.joints, estimate.joints[0], int(theta[0]))
        names = {"both": ("viscous", "coulomb"), "spring": ("stiffness",)}.get(shape, (shape,))
        values = dict(zip((Label(f"coupling_{n}", k) for n in names), beta, strict=True))
        return values | ({Label("coupling_velocity", k): theta[2]} if self.continuous(theta) else {})

    def untestable(self, scene: Scene, joints: Joints) -> str:
        return "" if self.grid(scene, joints) else "no motion of another joint recorded"


def pair_number(joints: int, on: int, other: int) -> int:
    """The number, from 1, of the coupling on one joint from another (both from 0): (0, 1), (0, 2), .., (1, 0), .."""
    return on * (joints - 1) + other - (other > on) + 1


def pair_of(joints: int, number: int) -> tuple[int, int]:
    """The joints (from 0) of a coupling: on which it acts, and from which it comes."""
    on, other = divmod(number - 1, joints - 1)
    return on, other + (other >= on)


def _recorded(scene: Scene, units: tuple[str, ...]) -> list[str]:
    """Recorded signals beside a single joint that have one of these units."""
    return sorted(name for name, unit in scene.units.items() if unit in units and name in scene.motion.other)
