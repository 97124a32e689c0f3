"""Effects between the commanded and the delivered torque: lag, delay, gain, saturation, dead band.

The recorded torque is the command u; the delivered torque is A(u) = p, the model's prediction. A lag or delay has an
inverse, which acts on the prediction: u = A^-1(p) is compared with the recorded torque, which stays as it is.
Saturation and dead band have none: A(u) is compared with p, and what they erase of u is charged for (`log_density`).
"""

from abc import abstractmethod

import numpy as np

from cosim.effects.constants import SIZE
from cosim.effects.effect import Alias, Effect, EffectEstimate, per_joint
from cosim.effects.motion import Columns, Joints, Motion, Theta
from cosim.effects.scene import Scene
from cosim.measured.label import Label

_FAST = "excitation with periods near the lag itself (fast chirps or steps of torque)"
_LINK = "an encoder on the link, or larger and smaller motions: a lag does not depend on the amplitude"
_BEHIND = (Alias("backlash", _LINK), Alias("joint_elasticity", _LINK))
LONGEST = 0.06  # s, of lags and delays that a torque loop may have
LEAST_LAG = 1.5  # samples: half a sample of hold and one of exchange, which recording may cost, are no lag of the drive


class Late(Effect):
    """The torque comes later than its command, by theta (s)."""

    actuator = True
    smooths = True
    unit = "s"
    dynamic = True
    family = "what the drive delivers of its command, and when"
    slack: float = 1.0
    needs = "fast excitation"

    def joint_sets(self, scene: Scene) -> tuple[Joints, ...]:
        singles = super().joint_sets(scene)
        return (*singles, tuple(range(scene.joints))) if scene.joints > 1 else singles

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        least = LEAST_LAG * scene.motion.sample
        return tuple((float(d),) for d in np.geomspace(least, max(2 * least, LONGEST), 7))

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (0,)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return {}

    @abstractmethod
    def command(self, motion: Motion, dense: np.ndarray, index: np.ndarray, theta: Theta) -> np.ndarray:
        """The command (m, k) at the rows `index` for which smooth torques (n, k) are delivered."""

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return ()

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        return {per_joint(self.name, (j,)): estimate.theta[0] for j in estimate.joints}

    def unphysical(self, estimate: EffectEstimate) -> str:
        least = LEAST_LAG * estimate.scene.motion.sample
        if estimate.theta[0] < least * (1 - 1e-9):
            return f"within the {LEAST_LAG:g} samples that recording itself may cost"
        return "longer than the drive of any joint" if estimate.theta[0] > max(2 * least, 2 * LONGEST) else ""


class ActuatorLag(Late):
    """First-order lag of the torque."""

    name = "actuator_lag"
    title = "actuator lag"
    equation = "T d(tau)/dt = u - tau"
    source = "electrical time constant of motor and amplifier"
    aliases: tuple[Alias, ...] = (Alias("time_delay", _FAST, always=True), *_BEHIND)

    def command(self, motion: Motion, dense: np.ndarray, index: np.ndarray, theta: Theta) -> np.ndarray:
        return dense[index] + theta[0] * motion.rate(dense)[index]


class TimeDelay(Late):
    """A pure delay of the torque."""

    name = "time_delay"
    title = "time delay of the torque"
    equation = "tau(t) = u(t - d)"
    source = "bus, sampling and computing time"
    aliases: tuple[Alias, ...] = (Alias("actuator_lag", _FAST, always=True), *_BEHIND)

    def command(self, motion: Motion, dense: np.ndarray, index: np.ndarray, theta: Theta) -> np.ndarray:
        ends = np.array([b - 1 for _, b in motion.bounds])[motion.run[index]]
        place = np.minimum(index + theta[0] / motion.step, ends)
        low = np.floor(place).astype(int)
        share = (place - low)[:, None]
        return dense[low] * (1 - share) + dense[np.minimum(low + 1, ends)] * share


class TorqueGain(Effect):
    """The delivered torque is (1 + g) times the command."""

    name = "torque_gain"
    actuator = True
    title = "gain error of the torque"
    equation = "tau = (1 + g) u, so u = p - g / (1 + g) p"
    source = "torque constant, amplifier; Taati et al. 2008 divide the command by about 2.7"
    unit = "1"
    sharp = False
    dynamic = True
    signals: tuple[str, ...] = ("tau",)
    aliases: tuple[Alias, ...] = (Alias("payload", "gravity held at rest in two poses, a known mass"),)
    needs = "declared parameters: otherwise the gain is absorbed in the parameters"

    def untestable(self, scene: Scene, joints: Joints) -> str:
        return "" if scene.declared else "absorbed in the fitted parameters: declare them to see it"

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return {joints[0]: -scene.prediction[:, joints]}

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        share = float(np.clip(estimate.beta[0], -0.9, 0.9))
        return {per_joint("torque_gain", estimate.joints): share / (1 - share)}

    def unphysical(self, estimate: EffectEstimate) -> str:
        return "a gain of more than a factor" if not -1 < estimate.beta[0] < 0.6 else ""


class Erasing(Effect):
    """A part of the command is not delivered, whatever it was: theta (N m)."""

    actuator = True
    signals: tuple[str, ...] = ("tau",)

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (0,)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return {}

    @abstractmethod
    def delivered(self, u: np.ndarray, theta: Theta) -> tuple[np.ndarray, np.ndarray]:
        """The delivered torque (n,) and where (n,) it tells the command."""

    def tells(self, theta: Theta) -> bool:
        """Whether a torque that the model predicts tells the command, however small it is."""
        return False

    def command(self, torque: np.ndarray, theta: Theta) -> np.ndarray:
        """The command (n,) that a predicted torque tells of; what is lost is not made up."""
        return torque

    @abstractmethod
    def lost_density(self, u: np.ndarray, theta: Theta) -> float:
        """Density [1/(N m)] of commands (n,) within what is lost: what a row costs that is erased."""

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return ()

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        return {per_joint(self.name, estimate.joints): estimate.theta[0]}


class TorqueSaturation(Erasing):
    """Commands beyond a limit are not delivered."""

    name = "torque_saturation"
    title = "torque saturation"
    equation = "tau = clip(u, -L, L)"
    source = "current limit of the amplifier"
    needs = "commands beyond the limit"

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        u = np.abs(scene.motion.tau_raw[:, joints[0]])
        shares = (20, 30, 40, 50, 60, 68, 75, 80, 84, 87, 90, 92, 94, 96, 97, 98, 99, 99.5)
        return tuple((float(x),) for x in np.unique(np.percentile(u, shares)))

    def delivered(self, u: np.ndarray, theta: Theta) -> tuple[np.ndarray, np.ndarray]:
        return np.clip(u, -theta[0], theta[0]), np.abs(u) < theta[0]

    def lost_density(self, u: np.ndarray, theta: Theta) -> float:
        """Of an exponential distribution of the excess, at its mean."""
        beyond = np.abs(u)[np.abs(u) > theta[0]] - theta[0]
        return 1 / (np.e * max(float(beyond.mean()), 1e-12)) if len(beyond) else 0.0


class TorqueDeadband(Erasing):
    """Small commands are not delivered; theta = (d, whole): larger ones less d (0), or as they are (1), as where an
    amplifier has a least output.
    """

    name = "torque_deadband"
    title = "dead band of the torque"
    equation = "tau = u - clip(u, -d, d), or u where |u| > d"
    source = "amplifier, valve or brush"
    aliases: tuple[Alias, ...] = (Alias("load_friction", "torque at rest, both signs"),)
    needs = "commands that change sign while the joint moves"

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        u = np.abs(scene.motion.tau_raw[:, joints[0]])
        most = 0.6 * float(np.percentile(u, 90))
        least = max(SIZE * most, float(np.percentile(u, 0.5)))  # beyond all commands it would erase nothing
        less = [(float(x), 0.0) for x in np.geomspace(least, most, 14)] if least < most else []
        least = max(0.03 * most, least)
        whole = [(float(x), 1.0) for x in np.geomspace(least, most, 16)] if least < most else []
        return (*less, *whole)  # of the latter all commands between two differ: they stand closer together

    def delivered(self, u: np.ndarray, theta: Theta) -> tuple[np.ndarray, np.ndarray]:
        limit, whole = theta
        kept = np.abs(u) > limit
        return np.where(kept, u, 0.0) if whole else u - np.clip(u, -limit, limit), kept

    def tells(self, theta: Theta) -> bool:
        return not theta[1]

    def command(self, torque: np.ndarray, theta: Theta) -> np.ndarray:
        limit, whole = theta
        return torque if whole else torque + limit * np.sign(torque)

    def lost_density(self, u: np.ndarray, theta: Theta) -> float:
        return 1 / (2 * max(theta[0], 1e-12))

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        limit, whole = estimate.theta
        return {per_joint("torque_threshold" if whole else self.name, estimate.joints): limit}
