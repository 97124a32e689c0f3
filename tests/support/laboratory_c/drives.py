"""What a motor drive does to its torque, and what a gear does between motor and link."""

from collections import deque
from collections.abc import Callable
from math import exp, sqrt, tanh

import numpy as np

from tests.support.laboratory_c.additions import Addition
from tests.support.laboratory_c.scales import JointScales


class Lag(Addition):
    """The torque follows later than the drive reports; `order` 1, or 2 with `damping`; size: seconds."""

    name = "actuator_lag"
    depends = ("torque's past",)

    def __init__(self, scene: JointScales, form: str, order: int, damping: float) -> None:
        super().__init__(0.006, 0.05, scene.joint, damping=damping)
        self.form, self.order, self.damping = form, order, damping
        self.reset(0.001)

    def reset(self, step: float) -> None:
        self.step, self.first, self.rate = step, None, 0.0

    def drive(self, t: float, torque: float, v: float) -> float:
        if self.first is None or self.size < 1e-7:
            self.first = torque
        before = self.first
        if self.order == 1:
            keep = exp(-self.step / max(self.size, 1e-7))
            self.first = torque + (before - torque) * keep
        else:
            w, parts = (
                2 * self.damping / max(self.size, 1e-7),
                1 + int(self.step * 8 * self.damping / max(self.size, 1e-7)),
            )
            h = self.step / min(parts, 60)
            for _ in range(min(parts, 60)):
                self.rate = (self.rate + h * w * w * (torque - self.first)) / (
                    1 + 2 * h * self.damping * w + h * h * w * w
                )
                self.first += h * self.rate
        return (before + self.first) / 2 if self.order == 1 else self.first  # backward Euler has its mean delay


def first_order(scene: JointScales) -> Lag:
    return Lag(scene, "current loop of first order", 1, 0.0)


def second_order(scene: JointScales) -> Lag:
    return Lag(scene, "current loop of second order", 2, scene.between(0.6, 1.0))


class DeadTime(Addition):
    """The torque comes after size seconds; straight lines between steps. `wander` lets it vary about its mean."""

    name = "time_delay"
    depends = ("torque's past",)

    def __init__(self, scene: JointScales, form: str, wander: float) -> None:
        super().__init__(0.006, 0.04, scene.joint)
        self.form, self.wander, self.seed = form, wander, int(scene.rng.integers(2**31))
        self.begin()
        self.reset(0.001)

    def begin(self) -> None:
        self.rng = np.random.default_rng(self.seed)

    def reset(self, step: float) -> None:
        self.step, self.past = step, deque[float](maxlen=int(0.1 / step) + 4)
        self.now = self.size

    def drive(self, t: float, torque: float, v: float) -> float:
        self.past.appendleft(torque)
        if self.wander:
            self.now = self.size * (1 + self.wander * float(self.rng.uniform(-1, 1)))
        else:
            self.now = self.size
        back = min(self.now / self.step, len(self.past) - 1.001)
        if back <= 0:
            return torque
        k = int(back)
        return self.past[k] + (back - k) * (self.past[k + 1] - self.past[k])


def dead_time(scene: JointScales) -> DeadTime:
    return DeadTime(scene, "pure dead time", 0.0)


def bus(scene: JointScales) -> DeadTime:
    return DeadTime(scene, "dead time of a bus whose telegrams vary by a fifth", 0.2)


class TorqueCurve(Addition):
    """A static curve of the torque, or of torque and speed."""

    def __init__(
        self,
        scene: JointScales,
        name: str,
        form: str,
        size: float,
        most: float,
        law: Callable[[float, float, float], float],
        depends: tuple[str, ...] = ("torque",),
    ) -> None:
        super().__init__(size, most, scene.joint)
        self.name, self.form, self.law, self.depends = name, form, law, depends

    def drive(self, t: float, torque: float, v: float) -> float:
        return self.law(self.size, torque, v)


def gain(scene: JointScales) -> TorqueCurve:
    way = scene.sign()
    return TorqueCurve(
        scene, "torque_gain", "torque constant off by a share", 0.05, 0.2, lambda g, x, v: x * (1 + way * g)
    )


def iron(scene: JointScales) -> TorqueCurve:
    top = scene.most_load
    form = "torque constant that falls with the current's size (iron)"
    return TorqueCurve(scene, "torque_gain", form, 0.1, 0.45, lambda g, x, v: x * (1 - g * abs(x) / top))


def threshold(scene: JointScales) -> TorqueCurve:
    form = "commands below a threshold have no result"
    return TorqueCurve(
        scene, "torque_deadband", form, 0.2 * scene.load, 0.7 * scene.load, lambda d, x, v: x if abs(x) > d else 0.0
    )


def subtracted(scene: JointScales) -> TorqueCurve:
    form = "the threshold is missing from every command"
    return TorqueCurve(
        scene,
        "torque_deadband",
        form,
        0.2 * scene.load,
        0.7 * scene.load,
        lambda d, x, v: max(abs(x) - d, 0.0) * (1 if x > 0 else -1),
    )


def soft_threshold(scene: JointScales) -> TorqueCurve:
    form = "crossover of the output stage, soft: x^3 / (x^2 + d^2)"
    return TorqueCurve(
        scene,
        "torque_deadband",
        form,
        0.15 * scene.load,
        0.5 * scene.load,
        lambda d, x, v: x**3 / (x * x + d * d) if x else 0.0,
    )


def hard_limit(scene: JointScales) -> TorqueCurve:
    top = scene.most_load
    form = "cut off at a limit"
    return TorqueCurve(
        scene, "torque_saturation", form, 0.4, 0.75, lambda s, x, v: max(-top * (1 - s), min(top * (1 - s), x))
    )


def limit_by_speed(scene: JointScales) -> TorqueCurve:
    top, fast = scene.most_load, 3 * scene.speed

    def law(size: float, x: float, v: float) -> float:
        limit = top * max(1.2 - size * (0.7 + 0.5 * min(abs(v) / fast, 1.2)), 0.1)
        return max(-limit, min(limit, x)) if x * v > 0 else x

    form = "cut off while it drives, the lower the faster (voltage)"
    return TorqueCurve(scene, "torque_saturation", form, 0.5, 1.0, law, ("speed", "torque"))


def soft_limit(scene: JointScales) -> TorqueCurve:
    top = scene.most_load
    form = "bends softly into a limit: tanh"
    return TorqueCurve(
        scene, "torque_saturation", form, 0.5, 2.0, lambda s, x, v: tanh(s * x / top) * top / s if s > 1e-6 else x
    )


class Offset(Addition):
    """A constant of the amplifier, or of the sensor that the drive reports."""

    name = "torque_offset"

    def __init__(self, scene: JointScales, in_sensor: bool) -> None:
        super().__init__(0.1 * scene.load, 0.5 * scene.load, scene.joint)
        self.in_sensor, self.way = in_sensor, scene.sign()
        self.form = "zero of the current sensor off" if in_sensor else "constant torque of the amplifier"

    def drive(self, t: float, torque: float, v: float) -> float:
        return torque if self.in_sensor else torque + self.way * self.size

    def reported(self, torque: float) -> float:
        return torque + self.way * self.size if self.in_sensor else torque


def sensor_offset(scene: JointScales) -> Offset:
    return Offset(scene, True)


def amplifier_offset(scene: JointScales) -> Offset:
    return Offset(scene, False)


class FlexibleGear(Addition):
    """Spring and damper between rotor and link. `size` is the compliance [rad/(N m)] or the half play [rad].

    The encoder sits on the rotor.
    """

    depends = ("twist",)

    def __init__(self, scene: JointScales, name: str, form: str, size: float, most: float, kind: str) -> None:
        link = scene.machine.mass(scene.q[len(scene.q) // 2].tolist())[scene.joint][scene.joint]
        rotor = scene.machine.rotors[scene.joint]
        self.reduced = link * rotor / (link + rotor)
        self.stiff = self.reduced * 190.0**2
        super().__init__(size, most, scene.joint)
        self.name, self.form, self.kind = name, form, kind
        self.hard = scene.load
        self.size, self.most = size * self._scale(), most * self._scale()

    def _scale(self) -> float:
        if self.name == "backlash":
            return 1.0
        return 1 / self.stiff

    def twist(self, twist: float, speed: float) -> float:
        if self.kind == "play":
            over = abs(twist) - self.size
            if over <= 0:
                return 0.0
            torque = self.stiff * over + (1 if twist > 0 else -1) * 0.3 * sqrt(self.stiff * self.reduced) * speed * min(
                over / 1e-4, 1
            )
            return max(torque, 0.0) * (1 if twist > 0 else -1)
        if self.kind == "soft play":
            inner = 0.04 * self.stiff
            over = max(abs(twist) - self.size, 0.0) * (1 if twist > 0 else -1)
            return inner * twist + (self.stiff - inner) * over + 0.1 * sqrt(self.stiff * self.reduced) * speed
        k = 1 / max(self.size, 0.6 / self.stiff)
        damping = 0.12 * sqrt(k * self.reduced) * speed
        if self.kind == "stiffening":
            turn = 0.5 * self.hard / k  # the twist beyond which it is three times as stiff
            return 0.5 * k * twist * (1 + (twist / turn) ** 2 / (1 + (twist / turn) ** 2) * 2) + damping
        return k * twist + damping


def shaft(scene: JointScales) -> FlexibleGear:
    return FlexibleGear(scene, "joint_elasticity", "torsion spring and damper", 4.0, 16.0, "linear")


def strain_wave(scene: JointScales) -> FlexibleGear:
    form = "a spring that stiffens with its twist"
    return FlexibleGear(scene, "joint_elasticity", form, 3.0, 12.0, "stiffening")


def play(scene: JointScales) -> FlexibleGear:
    return FlexibleGear(
        scene, "backlash", "play, stiff flanks with damping", 0.004 * scene.span, 0.03 * scene.span, "play"
    )


def spring_in_play(scene: JointScales) -> FlexibleGear:
    form = "play with a weak spring in it (split gear)"
    return FlexibleGear(scene, "backlash", form, 0.006 * scene.span, 0.05 * scene.span, "soft play")
