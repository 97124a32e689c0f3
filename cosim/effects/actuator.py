"""Effects between the commanded and the delivered torque: lag, delay, gain, saturation, dead band.

The recorded torque is the command u; the delivered torque is A(u). With the model's own prediction p of the delivered torque the
command is u = A^-1(p), so the columns below are u - p for a unit of the parameter. They are formed from the prediction where they can
be, so that noise of the torque does not stand on both sides.
"""

import numpy as np

from cosim.effects.effect import Alias, Effect, Estimate, Scene, Theta, per_joint

_FAST = "excitation with periods near the lag itself (fast chirps or steps of torque)"
_LINK = "an encoder on the link, or larger and smaller motions: a lag does not depend on the amplitude"
SAMPLES_OF_A_RECORDING = 1.5  # lags up to this many samples belong to the sampling, not to the plant
USUAL = 0.4  # share of commands beyond a limit, above which it is no limit but the usual torque


class ActuatorLag(Effect):
    """First-order lag of the torque."""

    name = "actuator_lag"
    actuator = True
    title = "actuator lag"
    equation = "T d(tau)/dt = u - tau, so u = p + T dp/dt"
    source = "electrical time constant of motor and amplifier"
    unit = "s"
    sharp = False
    dynamic = True
    slack = 1.0
    aliases = (Alias("time_delay", _FAST, always=True), Alias("backlash", _LINK, 0.45), Alias("joint_elasticity", _LINK, 0.45))
    needs = "fast excitation"

    def joint_sets(self, scene: Scene):
        singles = super().joint_sets(scene)
        return (*singles, tuple(range(scene.joints))) if scene.joints > 1 else singles

    def columns(self, scene, joints, theta):
        rate = scene.motion.rate(scene.prediction)
        return {j: rate[:, [j]] for j in joints}

    def labels(self, joints, theta):
        return ("actuator_lag",)

    def parameters(self, estimate: Estimate) -> dict[str, float]:
        return _on_each("actuator_lag", estimate)

    def unphysical(self, estimate: Estimate) -> str:
        return _too_short(estimate.beta[0], estimate.std[0], estimate.scene)


class TimeDelay(Effect):
    """A pure delay of the torque."""

    name = "time_delay"
    actuator = True
    title = "time delay of the torque"
    equation = "tau(t) = u(t - d), so u(t) = p(t + d)"
    source = "bus, sampling and computing time"
    unit = "s"
    sharp = False
    dynamic = True
    slack = 1.0
    aliases = (Alias("actuator_lag", _FAST, always=True), Alias("backlash", _LINK, 0.45), Alias("joint_elasticity", _LINK, 0.45))
    needs = "fast excitation"

    def joint_sets(self, scene: Scene):
        singles = super().joint_sets(scene)
        return (*singles, tuple(range(scene.joints))) if scene.joints > 1 else singles

    def grid(self, scene: Scene, joints: tuple[int, ...]) -> tuple[Theta, ...]:
        step = scene.motion.sample
        return tuple((float(d),) for d in np.geomspace(2 * step, max(60 * step, 0.06), 8))

    def continuous(self, theta):
        return (0,)

    def columns(self, scene, joints, theta):
        change = (scene.motion.advanced(scene.prediction, theta[0]) - scene.prediction) / theta[0]
        return {j: change[:, [j]] for j in joints}

    def labels(self, joints, theta):
        return ("time_delay",)

    def parameters(self, estimate: Estimate) -> dict[str, float]:
        return _on_each("time_delay", estimate)

    def unphysical(self, estimate: Estimate) -> str:
        if reason := _too_short(estimate.beta[0], estimate.std[0], estimate.scene):
            return reason
        ratio = estimate.beta[0] / estimate.theta[0]
        return "" if 1 / 3 < ratio < 3 else "the slope and the shift of the delay disagree"


def _on_each(name: str, estimate: Estimate) -> dict[str, float]:
    """The lag of every joint with what the model had taken for sampling: the whole of it, the hold of a sampled torque included."""
    return {per_joint(name, (j,)): float(estimate.beta[0]) + estimate.scene.skew for j in estimate.joints}


def _too_short(value: float, std: float, scene: Scene) -> str:
    if value < 0:
        return "negative: the torque would come before its command"
    if value - 2 * std < SAMPLES_OF_A_RECORDING * scene.motion.sample:
        return f"{1e3 * value:.2g} ms is within the {SAMPLES_OF_A_RECORDING} samples that recording itself may cost"
    return ""


class TorqueGain(Effect):
    """The delivered torque is (1 + g) times the command."""

    name = "torque_gain"
    actuator = True
    title = "gain error of the torque"
    equation = "tau = (1 + g) u, so u = p - g / (1 + g) p"
    source = "torque constant, amplifier; Taati et al. 2008 divide the command by about 2.7"
    unit = "1"
    sharp = False
    aliases = (Alias("payload", "gravity held at rest in two poses, a known mass"),)
    needs = "declared parameters: otherwise the gain is absorbed in the parameters"

    def untestable(self, scene: Scene, joints: tuple[int, ...]) -> str:
        return "" if scene.declared else "absorbed in the fitted parameters: declare them to see it"

    def columns(self, scene, joints, theta):
        return {joints[0]: -scene.rigid[:, joints]}

    def labels(self, joints, theta):
        return (per_joint("torque_gain", joints),)

    def parameters(self, estimate: Estimate) -> dict[str, float]:
        share = float(np.clip(estimate.beta[0], -0.9, 0.9))
        return {per_joint("torque_gain", estimate.joints): share / (1 - share)}

    def unphysical(self, estimate: Estimate) -> str:
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
    aliases = ()
    needs = "commands beyond the limit"

    def grid(self, scene: Scene, joints: tuple[int, ...]) -> tuple[Theta, ...]:
        u = np.abs(scene.motion.tau_raw[:, joints[0]])
        return tuple((float(x),) for x in np.unique(np.percentile(u, (50, 60, 68, 75, 80, 84, 87, 90, 92, 94, 96, 97, 98, 99))))

    def continuous(self, theta):
        return (0,)

    def columns(self, scene, joints, theta):
        limit = theta[0]
        return {joints[0]: scene.motion.of_torque(joints[0], lambda u: u - np.clip(u, -limit, limit))[:, None]}

    def labels(self, joints, theta):
        return ("share beyond the limit",)

    def parameters(self, estimate: Estimate) -> dict[str, float]:
        return {per_joint("torque_saturation", estimate.joints): estimate.theta[0]}

    def theta_labels(self, joints):
        return (per_joint("torque_saturation", joints),)

    def unphysical(self, estimate: Estimate) -> str:
        beyond = float(np.mean(np.abs(estimate.scene.motion.tau_raw[:, estimate.joints[0]]) > estimate.theta[0]))
        if beyond > USUAL:
            return f"{100 * beyond:.0f} % of the commands lie beyond the limit: a loop so starved of torque would not track"
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
    aliases = (Alias("load_friction", "torque at rest, both signs"),)
    needs = "commands that change sign while the joint moves"

    def grid(self, scene: Scene, joints: tuple[int, ...]) -> tuple[Theta, ...]:
        u = np.abs(scene.motion.tau_raw[:, joints[0]])
        return tuple((float(x),) for x in np.geomspace(0.02, 0.6, 9) * np.percentile(u, 90))

    def continuous(self, theta):
        return (0,)

    def columns(self, scene, joints, theta):
        dead = theta[0]
        return {joints[0]: scene.motion.of_torque(joints[0], lambda u: np.clip(u, -dead, dead) / dead)[:, None]}

    def labels(self, joints, theta):
        return (per_joint("torque_deadband", joints),)

    def parameters(self, estimate: Estimate) -> dict[str, float]:
        return {per_joint("torque_deadband", estimate.joints): float(estimate.beta[0])}

    def unphysical(self, estimate: Estimate) -> str:
        if estimate.beta[0] < 0:
            return "negative"
        ratio = estimate.beta[0] / estimate.theta[0]
        slack = 3 * estimate.std[0] / estimate.theta[0]
        return "" if 0.5 - slack < ratio < 2.0 + slack else "the height and the width of the dead band disagree"


def _whole(estimate: Estimate, what: str) -> str:
    low, high = estimate.beta[0] - 3 * estimate.std[0] - 0.15, estimate.beta[0] + 3 * estimate.std[0] + 0.15
    return "" if low < 1 < high else f"{estimate.beta[0]:.2f} instead of all {what}"
