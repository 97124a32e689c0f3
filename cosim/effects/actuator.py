"""Effects between the commanded and the delivered torque: lag, delay, gain, saturation, dead band.

The recorded torque is the command u; the delivered torque is A(u). With the model's own prediction p of the delivered
torque the command is u = A^-1(p), so the columns below are u - p for a unit of the parameter. They are formed from the
prediction where possible, so that noise of the torque is not on both sides of the regression.

Lag and delay are found by passing the recorded torque through them, which is exact at any size. The rest of the
parameter is the coefficient of one column, the slope of the prediction.
"""

import numpy as np

from cosim.effects.effect import Alias, Effect, EffectEstimate, per_joint
from cosim.effects.motion import Columns, Joints, Motion, Theta
from cosim.effects.scene import Scene
from cosim.measured.label import Label

_FAST = "excitation with periods near the lag itself (fast chirps or steps of torque)"
_LINK = "an encoder on the link, or larger and smaller motions: a lag does not depend on the amplitude"
_BEHIND = (Alias("backlash", _LINK, 0.45), Alias("joint_elasticity", _LINK, 0.45))
LONGEST = 0.06  # s, of lags and delays that a torque loop may have
SAMPLES_OF_A_RECORDING = 1.5  # lags up to this many samples belong to the sampling, not to the plant
USUAL = 0.4  # share of commands within a dead band, above which it is no dead band but the usual torque
STARVED = 0.85  # share of commands beyond a limit, above which hardly more than the sign is delivered


class Late(Effect):
    """The torque comes later than its command, by theta (s) and the coefficient of its slope."""

    actuator = True
    unit = "s"
    sharp = False
    dynamic = True
    late = True
    least: float = 0.2
    slack: float = 1.0
    needs = "fast excitation"

    def joint_sets(self, scene: Scene) -> tuple[Joints, ...]:
        singles = super().joint_sets(scene)
        return (*singles, tuple(range(scene.joints))) if scene.joints > 1 else singles

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        step = scene.motion.sample
        return tuple((float(d),) for d in np.geomspace(2 * step, max(6 * step, LONGEST), 10))

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (0,)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        rate = scene.motion.rate(scene.prediction)
        return {j: rate[:, [j]] for j in joints}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (Label(self.name),)

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        """The whole lag of every joint, with the sampling skew of the model and the hold of a sampled torque."""
        value = float(self.amount(estimate.beta, estimate.theta)[0]) + estimate.scene.skew
        return {per_joint(self.name, (j,)): value for j in estimate.joints}

    def unphysical(self, estimate: EffectEstimate) -> str:
        value, least = (
            float(self.amount(estimate.beta, estimate.theta)[0]),
            SAMPLES_OF_A_RECORDING * estimate.scene.motion.sample,
        )
        if value < 0:
            return "negative: the torque would come before its command"
        if value - 2 * estimate.std[0] < least:
            return f"{1e3 * value:.2g} ms is within the {SAMPLES_OF_A_RECORDING} samples that recording itself may cost"
        return "" if 1 / 3 < value / estimate.theta[0] < 3 else "the slope and the shift of the torque disagree"


class ActuatorLag(Late):
    """First-order lag of the torque."""

    name = "actuator_lag"
    title = "actuator lag"
    equation = "T d(tau)/dt = u - tau"
    source = "electrical time constant of motor and amplifier"
    aliases: tuple[Alias, ...] = (Alias("time_delay", _FAST, always=True), *_BEHIND)
    relatives: tuple[str, ...] = ("time_delay", "joint_elasticity")

    def delivered(self, motion: Motion, torque: np.ndarray, theta: Theta) -> np.ndarray:
        from scipy.signal import bilinear, lfilter, lfilter_zi

        b, a = bilinear([1.0], [theta[0], 1.0], 1 / motion.step)
        start = lfilter_zi(b, a)[:, None]
        return motion.per_run(lambda part: np.asarray(lfilter(b, a, part, axis=0, zi=start * part[0])[0]), torque)


class TimeDelay(Late):
    """A pure delay of the torque."""

    name = "time_delay"
    title = "time delay of the torque"
    equation = "tau(t) = u(t - d)"
    source = "bus, sampling and computing time"
    aliases: tuple[Alias, ...] = (Alias("actuator_lag", _FAST, always=True), *_BEHIND)
    relatives: tuple[str, ...] = ("actuator_lag", "backlash")

    def delivered(self, motion: Motion, torque: np.ndarray, theta: Theta) -> np.ndarray:
        return motion.advanced(torque, -theta[0], order=3)


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
    aliases: tuple[Alias, ...] = (Alias("payload", "gravity held at rest in two poses, a known mass"),)
    needs = "declared parameters: otherwise the gain is absorbed in the parameters"

    def untestable(self, scene: Scene, joints: Joints) -> str:
        return "" if scene.declared else "absorbed in the fitted parameters: declare them to see it"

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        return {joints[0]: -scene.prediction[:, joints]}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("torque_gain", joints),)

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        share = float(np.clip(estimate.beta[0], -0.9, 0.9))
        return {per_joint("torque_gain", estimate.joints): share / (1 - share)}

    def unphysical(self, estimate: EffectEstimate) -> str:
        return "a gain of more than a factor" if not -1 < estimate.beta[0] < 0.6 else ""


class TorqueSaturation(Effect):
    """Commands beyond a limit are not delivered."""

    name = "torque_saturation"
    measured = True
    sharp = False  # K is in the column already
    actuator = True
    title = "torque saturation"
    equation = "tau = clip(u, -L, L), so u = p + (u - clip(u, -L, L))"
    source = "current limit of the amplifier"
    aliases: tuple[Alias, ...] = ()
    needs = "commands beyond the limit"

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        u = np.abs(scene.motion.tau_raw[:, joints[0]])
        return tuple(
            (float(x),)
            for x in np.unique(np.percentile(u, (20, 30, 40, 50, 60, 68, 75, 80, 84, 87, 90, 92, 94, 96, 97, 98, 99)))
        )

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (0,)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        limit = theta[0]
        return {joints[0]: scene.motion.of_torque(joints[0], lambda u: u - np.clip(u, -limit, limit))[:, None]}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (Label("share beyond the limit"),)

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        return {per_joint("torque_saturation", estimate.joints): estimate.theta[0]}

    def theta_labels(self, joints: Joints) -> tuple[Label, ...]:
        return (per_joint("torque_saturation", joints),)

    def unphysical(self, estimate: EffectEstimate) -> str:
        beyond = float(np.mean(np.abs(estimate.scene.motion.tau_raw[:, estimate.joints[0]]) > estimate.theta[0]))
        if beyond > STARVED:
            return (
                f"{100 * beyond:.0f} % of the commands lie beyond the limit: a "
                f"loop so starved of torque would not track"
            )
        return _whole(estimate, "of what the command has beyond the limit is missing")


class TorqueDeadband(Effect):
    """Small commands are not delivered."""

    name = "torque_deadband"
    measured = True
    sharp = False  # K is in the column already
    actuator = True
    title = "dead band of the torque"
    equation = "tau = u - clip(u, -d, d), so u = p + clip(u, -d, d)"
    source = "amplifier, valve or brush"
    aliases: tuple[Alias, ...] = (Alias("load_friction", "torque at rest, both signs"),)
    needs = "commands that change sign while the joint moves"

    def grid(self, scene: Scene, joints: Joints) -> tuple[Theta, ...]:
        u = np.abs(scene.motion.tau_raw[:, joints[0]])
        return tuple((float(x),) for x in np.geomspace(0.02, 0.6, 9) * np.percentile(u, 90))

    def continuous(self, theta: Theta) -> tuple[int, ...]:
        return (0,)

    def columns(self, scene: Scene, joints: Joints, theta: Theta) -> Columns:
        dead = theta[0]
        return {joints[0]: scene.motion.of_torque(joints[0], lambda u: np.clip(u, -dead, dead) / dead)[:, None]}

    def labels(self, joints: Joints, theta: Theta) -> tuple[Label, ...]:
        return (per_joint("torque_deadband", joints),)

    def parameters(self, estimate: EffectEstimate) -> dict[Label, float]:
        return {per_joint("torque_deadband", estimate.joints): float(estimate.beta[0])}

    def unphysical(self, estimate: EffectEstimate) -> str:
        if estimate.beta[0] < 0:
            return "negative"
        within = float(np.mean(np.abs(estimate.scene.motion.tau_raw[:, estimate.joints[0]]) < estimate.theta[0]))
        if within > USUAL:
            return (
                f"{100 * within:.0f} % of the commands lie within the dead band: "
                f"a loop so starved of torque would not track"
            )
        ratio = estimate.beta[0] / estimate.theta[0]
        slack = 3 * estimate.std[0] / estimate.theta[0]
        return "" if 0.5 - slack < ratio < 2.0 + slack else "the height and the width of the dead band disagree"


def _whole(estimate: EffectEstimate, what: str) -> str:
    low, high = estimate.beta[0] - 3 * estimate.std[0] - 0.15, estimate.beta[0] + 3 * estimate.std[0] + 0.15
    return "" if low < 1 < high else f"{estimate.beta[0]:.2f} instead of all {what}"
