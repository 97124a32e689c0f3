"""Friction that a dry and a viscous coefficient do not hold, each in two or three forms.

`level` adds to the dry friction of the machine, in the direction of motion; `add` is a torque against it.
"""

from collections.abc import Callable, Sequence
from math import exp, pi, sqrt, tanh

import numpy as np

from tests.support.laboratory_c.additions import Addition
from tests.support.laboratory_c.scales import JointScales


class SpeedLevel(Addition):
    """Dry friction with a further part size * shape(|v|)."""

    name = "stribeck"
    depends = ("direction", "speed")

    def __init__(self, scene: JointScales, form: str, shape: Callable[[float], float], **told: float) -> None:
        super().__init__(0.4 * scene.dry, 4 * scene.dry, scene.joint, **told)
        self.form, self.shape = form, shape

    def level(self, t: float, q: float, v: float, load: float, dry: float) -> float:
        return self.size * self.shape(abs(v))


def tustin(scene: JointScales) -> SpeedLevel:
    vs = scene.speed * scene.factor(0.08, 0.8)
    return SpeedLevel(scene, "falls exponentially with speed (Tustin)", lambda v: exp(-v / vs), speed=vs)


def gauss(scene: JointScales) -> SpeedLevel:
    vs = scene.speed * scene.factor(0.1, 1.0)
    return SpeedLevel(scene, "falls with the square of speed (Gauss)", lambda v: exp(-((v / vs) ** 2)), speed=vs)


def makkar(scene: JointScales) -> SpeedLevel:
    fast = scene.speed * scene.factor(0.15, 1.0)
    return SpeedLevel(scene, "1 - tanh(v/v_s), smooth (after Makkar)", lambda v: 1 - tanh(v / fast), speed=fast)


class OneSidedDry(Addition):
    """More dry friction in one direction; `blend` [rad/s or m/s] is the speed over which it comes."""

    name = "coulomb_asymmetry"
    depends = ("direction",)

    def __init__(self, scene: JointScales, form: str, blend: float) -> None:
        super().__init__(0.4 * scene.dry, 3 * scene.dry, scene.joint)
        self.form, self.blend, self.way = form, blend, scene.sign()

    def level(self, t: float, q: float, v: float, load: float, dry: float) -> float:
        if v * self.way <= 0:
            return 0.0
        return self.size if self.blend == 0 else self.size * tanh(abs(v) / self.blend)


def two_levels(scene: JointScales) -> OneSidedDry:
    return OneSidedDry(scene, "two levels, by direction", 0.0)


def pawl(scene: JointScales) -> OneSidedDry:
    return OneSidedDry(scene, "a pawl that drags in one direction, hardly at a creep", 0.03 * scene.speed)


class OneSidedViscous(Addition):
    """Viscous drag that differs by direction, by a law of the speed in the direction `way`."""

    name = "viscous_asymmetry"
    depends = ("direction", "speed")

    def __init__(self, scene: JointScales, form: str, law: Callable[[float], float]) -> None:
        super().__init__(scene.viscous, 20 * scene.viscous, scene.joint)
        self.form, self.law, self.way = form, law, scene.sign()

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        out[self.joint] -= self.way * self.size * self.law(self.way * v[self.joint])


def two_coefficients(scene: JointScales) -> OneSidedViscous:
    return OneSidedViscous(scene, "two coefficients, by direction", lambda v: max(v, 0.0))


def check_valve(scene: JointScales) -> OneSidedViscous:
    w = scene.speed * scene.factor(0.05, 0.3)
    return OneSidedViscous(
        scene, "a damper with a check valve: half a hyperbola", lambda v: (v + sqrt(v * v + w * w) - w) / 2
    )


class FluidDrag(Addition):
    """size * |v / typical speed|^power sgn v."""

    name = "quadratic_drag"
    depends = ("speed",)

    def __init__(self, scene: JointScales, form: str, power: float, laminar: float = 0.0) -> None:
        super().__init__(0.3 * scene.load, 3 * scene.load, scene.joint, power=power)
        self.form, self.power, self.speed, self.laminar = form, power, scene.speed, laminar

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        w = v[self.joint]
        fast = abs(w) / self.speed
        if fast > self.laminar:
            drag = self.size * fast**self.power
        else:
            drag = self.size * fast * self.laminar ** (self.power - 1)
        out[self.joint] -= drag if w > 0 else -drag


def square(scene: JointScales) -> FluidDrag:
    return FluidDrag(scene, "air: the square of speed", 2.0)


def paddle(scene: JointScales) -> FluidDrag:
    return FluidDrag(scene, "a paddle: a power of speed", scene.between(1.7, 2.6))


def laminar_first(scene: JointScales) -> FluidDrag:
    return FluidDrag(scene, "laminar up to a speed, then its square", 2.0, scene.between(0.3, 0.8))


class LoadedFriction(Addition):
    """Dry friction that grows with the torque in the gear."""

    name = "load_friction"
    depends = ("direction", "load")

    def __init__(self, scene: JointScales, form: str, law: Callable[[float, float], float]) -> None:
        super().__init__(0.1, 0.7, scene.joint)
        self.form, self.law = form, law

    def level(self, t: float, q: float, v: float, load: float, dry: float) -> float:
        return self.size * self.law(load, v)


def share(scene: JointScales) -> LoadedFriction:
    return LoadedFriction(scene, "a share of the motor's torque", lambda load, v: abs(load))


def preloaded(scene: JointScales) -> LoadedFriction:
    p = scene.load * scene.factor(0.3, 1.5)
    form = "bearings under preload: root of the sum of squares of load and preload"
    return LoadedFriction(scene, form, lambda load, v: sqrt(load * load + p * p) - p)


def efficiency(scene: JointScales) -> LoadedFriction:
    back = scene.between(0.1, 0.5)
    form = "efficiency: more is lost while the motor drives than while it brakes"
    return LoadedFriction(scene, form, lambda load, v: abs(load) * (1.0 if load * v > 0 else back))


class PlacedFriction(Addition):
    """Dry friction that depends on the place."""

    name = "position_friction"
    depends = ("direction", "q")

    def __init__(
        self, scene: JointScales, form: str, shape: Callable[[float], float], most: float, **told: float
    ) -> None:
        super().__init__(0.4 * scene.dry, most * scene.dry, scene.joint, **told)
        self.form, self.shape = form, shape

    def level(self, t: float, q: float, v: float, load: float, dry: float) -> float:
        return self.size * self.shape(q)


def bent_shaft(scene: JointScales) -> PlacedFriction:
    pitch = 2 * pi / int(scene.rng.integers(1, 5)) if scene.span > 1 else scene.span * scene.between(0.2, 0.7)
    phase = scene.between(0, 2 * pi)
    form = "a bent shaft: a wave of the angle"
    return PlacedFriction(scene, form, lambda q: float(np.sin(2 * pi * q / pitch + phase)), 0.9, pitch=pitch)


def worn_spot(scene: JointScales) -> PlacedFriction:
    at, wide = scene.place(0.25, 0.75), scene.span * scene.between(0.05, 0.15)
    return PlacedFriction(scene, "a spot that rubs", lambda q: exp(-(((q - at) / wide) ** 2)), 5, at=at, wide=wide)


def guide(scene: JointScales) -> PlacedFriction:
    knots = np.linspace(*scene.range, 6)
    values = scene.rng.uniform(0, 1.5, 6)
    return PlacedFriction(
        scene,
        "a guide that was fitted by hand: straight lines between six places",
        lambda q: float(np.interp(q, knots, values)),
        2,
    )


class Warming(Addition):
    """Friction that changes while the machine warms up: less by size * share(t) of dry and viscous friction."""

    name = "friction_drift"
    depends = ("direction", "time")

    def __init__(self, scene: JointScales, form: str, constant: float, by_power: bool, oil: float) -> None:
        super().__init__(0.3 * scene.dry, 2.5 * scene.dry, scene.joint)
        self.form, self.constant, self.by_power, self.oil = form, constant, by_power, oil
        self.power = scene.dry * scene.speed * 0.9
        self.warm, self.drag = 0.0, scene.viscous / scene.dry
        self.step = 0.0

    def begin(self) -> None:
        self.warm = 0.0

    def reset(self, step: float) -> None:
        self.step = step  # the runs of one recording follow each other: it stays warm

    def commit(self, t: float, q: Sequence[float], v: Sequence[float], load: float) -> None:
        heat = abs(v[self.joint] * load) / self.power if self.by_power else 1.0
        self.warm += self.step / self.constant * (min(heat, 3.0) - self.warm)

    def level(self, t: float, q: float, v: float, load: float, dry: float) -> float:
        return self.size * ((1 - self.warm) * (1 - self.oil) + self.oil * exp(-2 * self.warm))

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        if self.oil:
            out[self.joint] -= self.size * self.drag * exp(-2 * self.warm) * v[self.joint]


def exponential_warming(scene: JointScales) -> Warming:
    return Warming(
        scene, "dry friction falls exponentially in time", scene.duration * scene.between(0.15, 0.6), False, 0
    )


def heated_by_losses(scene: JointScales) -> Warming:
    return Warming(
        scene,
        "warmth of first order, heated by the power of the motor",
        scene.duration * scene.between(0.2, 0.6),
        True,
        0,
    )


def oil_warming(scene: JointScales) -> Warming:
    return Warming(
        scene,
        "oil thins exponentially with warmth, dry and viscous part",
        scene.duration * scene.between(0.3, 0.8),
        False,
        1.0,
    )


class Presliding(Addition):
    """Torque with a memory of the way: beside the machine's friction, as of seals and cables."""

    name = "hysteresis"
    depends = ("history of q", "q")

    def __init__(self, scene: JointScales, form: str, way: float) -> None:
        super().__init__(0.5 * scene.dry, 4 * scene.dry, scene.joint, way=way)
        self.form, self.way = form, way
        self.last: float | None = None
        self.reset(0.0)

    def reset(self, step: float) -> None:
        self.last, self.state = None, np.zeros(0).tolist()

    def moved(self, dx: float) -> list[float]:
        """The state after a further way dx."""
        raise NotImplementedError

    def torque(self, state: list[float]) -> float:
        """The share of `size`."""
        return state[0]

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        dx = 0.0 if self.last is None else q[self.joint] - self.last
        out[self.joint] -= self.size * self.torque(self.moved(dx))

    def commit(self, t: float, q: Sequence[float], v: Sequence[float], load: float) -> None:
        if self.last is not None:
            self.state = self.moved(q[self.joint] - self.last)
        self.last = q[self.joint]


class Dahl(Presliding):
    """dz/dx = (1 - z sgn dx) / way, solved exactly over a step."""

    def reset(self, step: float) -> None:
        self.last, self.state = None, [0.0]

    def moved(self, dx: float) -> list[float]:
        s = 1.0 if dx > 0 else -1.0
        return [s + (self.state[0] - s) * exp(-abs(dx) / self.way)]


class BoucWen(Presliding):
    """dz/dx = (1 - |z|^n (b sgn(dx z) + 1 - b)) / way."""

    def __init__(self, scene: JointScales, form: str, way: float, power: float, b: float) -> None:
        self.power, self.b = power, b
        super().__init__(scene, form, way)

    def reset(self, step: float) -> None:
        self.last, self.state = None, [0.0]

    def moved(self, dx: float) -> list[float]:
        z = self.state[0]
        turn = self.b if dx * z >= 0 else -self.b
        return [z + dx / self.way * (1 - abs(z) ** self.power * (turn + 1 - self.b))]


class SlippingSprings(Presliding):
    """Iwan: parallel springs, each of which slips at its own torque; weights add up to one."""

    def __init__(self, scene: JointScales, form: str, way: float, count: int) -> None:
        weights = scene.rng.uniform(0.5, 1.5, count)
        self.weights = (weights / weights.sum()).tolist()
        self.slips = [way * (m + 1) / count for m in range(count)]
        super().__init__(scene, form, way)

    def reset(self, step: float) -> None:
        self.last, self.state = None, [0.0] * len(self.slips)

    def moved(self, dx: float) -> list[float]:
        return [max(-w, min(w, x + dx)) for x, w in zip(self.state, self.slips, strict=True)]

    def torque(self, state: list[float]) -> float:
        return sum(k * x / w for k, x, w in zip(self.weights, state, self.slips, strict=True))


def dahl(scene: JointScales) -> Presliding:
    return Dahl(scene, "Dahl", scene.span * scene.factor(0.02, 0.12))


def bouc_wen(scene: JointScales) -> Presliding:
    way = scene.span * scene.factor(0.04, 0.2)
    return BoucWen(
        scene, "a cable that drags along (Bouc and Wen)", way, scene.between(1.0, 2.0), scene.between(0.5, 0.8)
    )


def slipping_springs(scene: JointScales) -> Presliding:
    return SlippingSprings(scene, "five springs that slip (Iwan)", scene.span * scene.factor(0.04, 0.25), 5)
