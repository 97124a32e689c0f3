"""What an effect is: a name, its physics, the columns it adds to the regression, when an estimate of it is physical,
and which other effects look like it.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Sequence

import numpy as np
from attrs import frozen

from cosim.effects.motion import Columns, Joints, Theta
from cosim.effects.scene import Scene
from cosim.measured.label import Label


@frozen(eq=False)
class EffectEstimate:
    """An effect as fitted: coefficients beta and std (k,) of its columns, theta, its joints, the model beside it."""

    beta: np.ndarray
    std: np.ndarray
    theta: Theta
    joints: Joints
    scene: Scene

    def sure_sign(self, k: int = 0) -> int:
        """+1 or -1 where coefficient k is two standard deviations from zero, else 0."""
        return int(np.sign(self.beta[k])) if abs(self.beta[k]) > 2 * self.std[k] else 0


@frozen
class Alias:
    """Another effect that data may not distinguish from this one, and the experiment that would."""

    name: str
    separated_by: str
    always: bool = False  # no motion distinguishes the two: listed even where details of the friction law seem to


class Effect(ABC):
    """One physical effect that a model may lack. Subclasses hold no data, or are frozen."""

    name: str = ""
    title: str = ""
    equation: str = ""
    source: str = ""
    unit: str = "N.m"

    sharp: bool = True
    """Its columns jump with the motion and need the first smoothing filter as well."""
    dynamic: bool = False
    """Its columns are formed from the model's own prediction and change with it."""
    nameless: bool = False
    """It is a smooth function without a name, with a penalty instead of a law."""
    of_time: bool = False
    """It is a function of time. Held-out rows lie at other times, so they only may not contradict it."""
    actuator: bool = False
    """It acts between the command and the delivered torque and is no part of the latter."""
    smooths: bool = False
    """It low-passes the acceleration and with it the noise of the encoder, which is no evidence for it."""
    amplitude: bool = False
    """Its coefficients are the parts of one amplitude, such as sine and cosine."""

    form: float = 0.02
    """Standard deviation, as a share of a value, that the filter and the form of the friction law alone can cause."""
    slack: float = 0.0
    """Samples by which an interval is extended downwards: the delay that recording itself may add."""
    signals: tuple[str, ...] = ()
    """Signals of its joint that its torque is a function of, such as ("q", "dq"): its family."""
    family: str = ""
    """On what the torque depends, in words, where `signals` do not say it."""
    aliases: tuple[Alias, ...] = ()
    needs: str = ""
    """What the data must contain to show it."""

    @property
    def key(self) -> Hashable:
        """What distinguishes this effect from all others."""
        return self.name

    def joint_sets(self, scene: Scene) -> tuple[Joints, ...]:
        """Sets of joints (0-based) on which the effect is looked for; one coefficient set each."""
        return tuple((j,) for j in range(scene.joints))

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        """Values of the nonlinear parameters to try; one empty tuple where there are none."""
        return ((),)

    @abstractmethod
    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        """Required torque per unit of each coefficient: joint -> (n, k)."""

    def columns_of_all(self, scene: Scene, joints: Joints, thetas: Sequence[Theta]) -> Sequence[Columns]:
        """Columns for each of several thetas, for effects that form them faster together than one by one."""
        return [self.columns(scene, joints, theta) for theta in thetas]

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        """The FMU parameter that each coefficient is; the first is named as the effect where nothing else is said."""
        return (Label(self.name),)

    def family_of(self, joints: Joints) -> str:
        """On what its torque depends, in words."""
        if self.family or not self.signals:
            return self.family or "the motion of the arm"
        names = (
            f"history of q{joints[0] + 1}" if "history" in s else s if s == "time" else f"{s}{joints[0] + 1}"
            for s in self.signals
        )
        return f"a torque that depends on {' and '.join(names)}"

    def place(self, joints: Joints, theta: Theta) -> str:
        """Where it acts, in words; empty where that is the whole arm."""
        return f"on joint {joints[0] + 1}" if len(joints) == 1 else ""

    def theta_labels(self, joints: Joints) -> tuple[Label, ...]:
        """The FMU parameter that each nonlinear parameter is."""
        return ()

    def simpler(self, theta: Theta) -> tuple[Theta, ...]:
        """Forms of the law that this one holds and that have fewer parameters, the fewest first."""
        return ()

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        """Which nonlinear parameters are continuous and may be refined; none by default."""
        return ()

    def agreed(self, theta: Theta, beta: np.ndarray) -> Theta:
        """theta with what the coefficients (k,) say of it, where they say the same; as it is by default."""
        return theta

    def moved(self, theta: Theta, index: int, step: float) -> Theta:
        """theta with one parameter moved by a step: a factor of (1 + step) for positive parameters."""
        return (*theta[:index], theta[index] * (1 + step), *theta[index + 1 :])

    def near(self, scene: Scene, theta: Theta) -> Callable[[Sequence[float]], Theta]:
        """theta as a function of steps of its continuous parameters, along which a search for the best finds its way:
        each moved by itself, unless a law has better coordinates.
        """

        def at(steps: Sequence[float]) -> Theta:
            out = theta
            for index, step in zip(self.continuous(theta), steps, strict=True):
                out = self.moved(out, index, float(step))
            return out

        return at

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        """FMU parameters of an estimate."""
        labels = self.labels(estimate.joints, estimate.theta) + self.theta_labels(estimate.joints)
        return dict(zip(labels, (*map(float, estimate.beta), *estimate.theta), strict=False))

    def inherent(self, estimate: EffectEstimate) -> tuple[Alias, ...]:
        """Effects that this motion cannot distinguish from the estimated one, whichever fits better; by default those
        that no motion distinguishes.
        """
        return tuple(alias for alias in self.aliases if alias.always)

    def precision(self, count: int) -> np.ndarray:
        """Prior precision (count,) of the coefficients: one over the variance of each about zero, 0 for no prior."""
        return np.zeros(count)

    def untestable(self, scene: Scene, joints: Joints) -> str:
        """Why this data cannot show the effect; empty where it can."""
        return ""

    def unseen(self, scene: Scene) -> tuple[str, ...]:
        """Kinds of signals ("q", "ddq", "tau") that its torque on one joint depends on, where only equations of motion
        that the device does not have would show it as itself; empty where it can be tested or the model holds it.
        """
        return ()

    def unphysical(self, estimate: EffectEstimate) -> str:
        """Why the estimate cannot be this effect; empty where it can."""
        return ""


def per_joint(name: str, joints: Joints) -> Label:
    """The FMU's parameter of a joint: "stribeck[2]" for joints (1,)."""
    return Label.of_joint(name, joints[0])
