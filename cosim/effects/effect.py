"""What an effect is: a name, its physics, the columns it adds to the regression, when it is physical, what it is
mistaken for.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np
from attrs import field, frozen

Theta = tuple[float, ...]


@frozen(eq=False)
class Scene:
    """What an effect may look at: the motion and the model as it stands, n rows at the full rate, nj joints.

    sign (n, nj) smooth sign of dq by the friction law in use; rigid, prediction (n, nj) torque of the rigid body and of
    the whole
    model [N.m]; friction (n, nj); viscous, coulomb (nj,); rigid_slopes(j): derivatives of the rigid torque by q_j,
    dq_j, ddq_j, each joint -> (n,) of the
    joints that feel it, None where the device has no equations of motion; pi (8,) of the PHANToM or None; declared:
    whether pi is trusted rather than fitted; tip torque of a force by `arm`.
    motion: cosim.closure.data.motion.Motion.
    """

    motion: object
    device: str
    sign: np.ndarray
    rigid: np.ndarray
    friction: np.ndarray
    prediction: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    rigid_slopes: object = None
    pi: np.ndarray | None = None
    declared: bool = False
    gravity: float = 9.81  # negative for an arm that hangs upside down
    skew: float = 0.0  # s that the recorded torque was taken to act late by sampling
    units: Mapping[str, str] = field(factory=dict)

    @property
    def joints(self) -> int:
        return self.motion.joints

    def speed_range(self, joint: int) -> tuple[float, float]:
        """Speeds [rad/s] between which the joint mostly moves: 5th and 99th percentile of |dq|."""
        low, high = np.percentile(np.abs(self.motion.dq[:, joint]), (5, 99))
        return float(low), float(high)

    def angle_range(self, joint: int) -> float:
        """Width [rad] of the travelled range, 1st to 99th percentile."""
        low, high = np.percentile(self.motion.q[:, joint], (1, 99))
        return float(high - low)


@frozen(eq=False)
class EffectEstimate:
    """Coefficients of an effect's columns as fitted: beta, std (k,), theta, on which joints, beside what."""

    beta: np.ndarray
    std: np.ndarray
    theta: Theta
    joints: tuple[int, ...]
    scene: Scene

    def sure_sign(self, k: int = 0) -> int:
        """+1 or -1 where coefficient k is two standard deviations from zero, else 0."""
        return int(np.sign(self.beta[k])) if abs(self.beta[k]) > 2 * self.std[k] else 0


@frozen
class Alias:
    """Another effect that data may not tell from this one, and the experiment that would."""

    name: str
    separated_by: str
    reach: float = 0.75  # share of the effect's gain from which on the other counts as not told apart
    always: bool = False  # no motion tells the two: listed even where details of the friction law seem to


class Effect(ABC):
    """One physical effect that a model may lack. Subclasses are frozen and hold no data."""

    name: str = ""
    title: str = ""
    equation: str = ""
    source: str = ""
    unit: str = "N.m"
    sharp: bool = True  # columns jump with the motion and need the filter K as well
    dynamic: bool = False  # columns are formed from the model's own prediction and change with it
    measured: bool = False  # columns are formed from the measured torque: they explain a part of it by themselves
    late: bool = (
        False  # passes the recorded torque on: theta acts on that torque, the one coefficient is what theta lacks
    )
    of_time: bool = False  # a function of time: held-out rows lie beyond the fitted times and only may not contradict
    actuator: bool = False  # acts between command and delivered torque: not part of the torque that is delivered
    smooths: bool = (
        False  # passes the acceleration through a lag, and with it the encoder's noise, which is no evidence
    )
    form: float = (
        0.02  # standard deviation, as a share of a value, that filter and form of the friction law alone can make
    )
    amplitude: bool = False  # the coefficients are the parts of one amplitude, such as sine and cosine
    # share of the squared error that it has to remove where noise of the encoder, fed back into the command, mimics it
    least: float = 0.0
    signals: tuple[
        str, ...
    ] = ()  # of the joint that the torque is a function of: whether its size varies with the others is then looked for
    slack: float = 0.0  # samples by which an interval reaches further down: what recording itself may cost
    aliases: tuple[Alias, ...] = ()
    relatives: tuple[
        str, ...
    ] = ()  # names that decide by details: not told from this one where a rest without a name is left
    needs: str = ""  # what the data must hold

    @property
    def key(self) -> str:
        """What tells this effect from all others."""
        return self.name

    def joint_sets(self, scene: Scene) -> tuple[tuple[int, ...], ...]:
        """Sets of joints (0-based) on which the effect is looked for; one coefficient set each."""
        return tuple((j,) for j in range(scene.joints))

    def grid(self, scene: Scene, joints: tuple[int, ...]) -> tuple[Theta, ...]:
        """Values of the nonlinear parameters to try; one empty tuple where there are none."""
        return ((),)

    @abstractmethod
    def columns(self, scene: Scene, joints: tuple[int, ...], theta: Theta) -> Mapping[int, np.ndarray]:
        """Required torque per unit of each coefficient: joint -> (n, k)."""

    def columns_of_all(
        self, scene: Scene, joints: tuple[int, ...], thetas: Sequence[Theta]
    ) -> list[Mapping[int, np.ndarray]]:
        """Columns for each of several thetas; for effects that can form them together sooner than one by one."""
        return [self.columns(scene, joints, theta) for theta in thetas]

    @abstractmethod
    def labels(self, joints: tuple[int, ...], theta: Theta) -> tuple[str, ...]:
        """FMU parameter that each coefficient is, such as "stribeck[1]"."""

    def theta_labels(self, joints: tuple[int, ...]) -> tuple[str, ...]:
        """FMU parameter that each nonlinear parameter is."""
        return ()

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        """Which nonlinear parameters are continuous and may be refined; none by default."""
        return ()

    def richer(self, theta: Theta) -> Theta | None:
        """theta of a form with one nonlinear parameter more, to be taken where it leaves much less; None where there is
        none.
        """
        return None

    def handicap(self, scene: Scene, theta: Theta) -> float:
        """Factor on the squared error with which values of the grid compete that need better evidence than the others;
        1 for those.
        """
        return 1.0

    def moved(self, theta: Theta, index: int, step: float) -> Theta:
        """theta with one parameter moved by a step: a factor of (1 + step) for positive parameters."""
        return (*theta[:index], theta[index] * (1 + step), *theta[index + 1 :])

    def parameters(self, estimate: EffectEstimate) -> dict[str, float]:
        """FMU parameters of an estimate."""
        labels = self.labels(estimate.joints, estimate.theta) + self.theta_labels(estimate.joints)
        return dict(zip(labels, (*map(float, estimate.beta), *estimate.theta), strict=False))

    def inherent(self, estimate: EffectEstimate) -> tuple[Alias, ...]:
        """Effects that this motion cannot tell from the estimated one whatever fits better; by default those that no
        motion does.
        """
        return tuple(alias for alias in self.aliases if alias.always)

    def related(self, other: "Effect") -> bool:
        """Whether one of the two lists the other as its alias."""
        return other.name in {a.name for a in self.aliases} or self.name in {a.name for a in other.aliases}

    def delivered(self, motion, torque: np.ndarray, theta: Theta) -> np.ndarray:
        """The torque (n, k) that comes of a recorded one, for effects that are `late`."""
        return torque

    def amount(self, beta: np.ndarray, theta: Theta) -> np.ndarray:
        """What has to differ from zero for the effect to be there (k,)."""
        return beta + np.array(theta) if self.late else beta

    def precision(self, count: int) -> np.ndarray:
        """What is known of the `count` coefficients before there are data: one over the variance of each about zero
        (k,), 0 for nothing.
        """
        return np.zeros(count)

    def untestable(self, scene: Scene, joints: tuple[int, ...]) -> str:
        """Why this data cannot show the effect; empty where it can."""
        return ""

    def vague(self, scene: Scene, joints: tuple[int, ...], theta: Theta) -> str:
        """What the data do not hold that would tell the effect from others without a name; empty where they hold it."""
        return ""

    def other_laws(self, scene: Scene, joints: tuple[int, ...]) -> Mapping[str, np.ndarray]:
        """Laws of one joint without a name that may do what this one does, in words -> columns (n, k)."""
        return {}

    def unphysical(self, estimate: EffectEstimate) -> str:
        """Why the estimate cannot be this effect; empty where it can."""
        return ""


def per_joint(name: str, joints: tuple[int, ...]) -> str:
    """FMU variable of a joint's parameter: "stribeck[2]" for joints (1,)."""
    return f"{name}[{joints[0] + 1}]"
