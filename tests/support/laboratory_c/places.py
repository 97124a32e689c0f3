"""Torques that depend on the place: cables, springs, cogging, things in the way, how a machine is mounted."""

from collections.abc import Callable, Sequence
from math import cos, exp, pi, sin

import numpy as np

from tests.support.laboratory_c.additions import Addition
from tests.support.laboratory_c.machines import Machine
from tests.support.laboratory_c.scales import JointScales


class PlaceTorque(Addition):
    """-size * shape(q)."""

    depends = ("q",)

    def __init__(
        self, scene: JointScales, name: str, form: str, shape: Callable[[float], float], size: float, **told: float
    ) -> None:
        super().__init__(size * scene.load, 12 * size * scene.load, scene.joint, **told)
        self.name, self.form, self.shape = name, form, shape

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        out[self.joint] -= self.size * self.shape(q[self.joint])


def return_spring(scene: JointScales) -> PlaceTorque:
    rest, half = scene.place(0.2, 0.8), scene.span / 2
    form = "a return spring"
    return PlaceTorque(scene, "position_torque", form, lambda q: (q - rest) / half, 0.15, rest=rest)


def hose(scene: JointScales) -> PlaceTorque:
    rest, half = scene.place(0.3, 0.7), scene.span / 2
    form = "a bundle of hoses that stiffens exponentially"
    return PlaceTorque(scene, "position_torque", form, lambda q: 0.3 * (exp(2 * (q - rest) / half) - 1), 0.1, rest=rest)


def two_leaves(scene: JointScales) -> PlaceTorque:
    low, high, half = scene.place(0.1, 0.35), scene.place(0.65, 0.9), scene.span / 2
    form = "leaf springs that are met beyond an angle at both ends"
    shape = lambda q: 2 * (max(q - high, 0.0) - max(low - q, 0.0)) / half  # noqa: E731
    return PlaceTorque(scene, "position_torque", form, shape, 0.2, low=low, high=high)


def over_centre(scene: JointScales) -> PlaceTorque:
    at, r = scene.place(0.35, 0.65), scene.between(0.3, 0.7)
    half = scene.span / 2
    form = "a spring on a crank that goes over its dead centre"
    shape = lambda q: -sin(1.3 * (q - at) / half) * (1 - r / (1.05 + r * r - 2 * r * cos(1.3 * (q - at) / half)) ** 0.5)  # noqa: E731
    return PlaceTorque(scene, "position_torque", form, shape, 0.3, centre=at)


def _order(scene: JointScales) -> float:
    """Periods over the unit of q, several within the range."""
    if scene.span > 1.0:
        return float(scene.rng.choice([4, 6, 8, 12, 16, 20, 24]))
    return 2 * pi * scene.factor(3, 14) / scene.span


def one_order(scene: JointScales) -> PlaceTorque:
    n, phase = _order(scene), scene.between(0, 2 * pi)
    return PlaceTorque(scene, "torque_ripple", "cogging of one order", lambda q: sin(n * q + phase), 0.08, order=n)


def harmonics(scene: JointScales) -> PlaceTorque:
    n, first, second = _order(scene), scene.between(0, 2 * pi), scene.between(0, 2 * pi)
    form = "cogging of an order and its double"
    return PlaceTorque(
        scene, "torque_ripple", form, lambda q: sin(n * q + first) + 0.6 * sin(2 * n * q + second), 0.07, order=n
    )


class Commutation(Addition):
    """Torque constant that ripples with the rotor's angle: the ripple is a share of the torque."""

    name = "torque_ripple"
    depends = ("q", "torque")
    form = "ripple of the torque constant (commutation)"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(0.08, 0.5, scene.joint)
        self.order, self.phase, self.at = _order(scene), scene.between(0, 2 * pi), 0.0
        self.told = {"order": self.order}

    def commit(self, t: float, q: Sequence[float], v: Sequence[float], load: float) -> None:
        self.at = q[self.joint]

    def drive(self, t: float, torque: float, v: float) -> float:
        return torque * (1 + self.size * sin(self.order * self.at + self.phase))


class Contact(Addition):
    """Something that is met beyond a place of the joint, on one side; never pulls."""

    name = "external_contact"
    depends = ("q",)

    def __init__(self, scene: JointScales, form: str, power: float, damping: float) -> None:
        super().__init__(0.6 * scene.load, 5 * scene.load, scene.joint)
        self.form, self.power, self.damping, self.way = form, power, damping, scene.sign()
        self.at = scene.place(0.65, 0.85) if self.way > 0 else scene.place(0.15, 0.35)
        self.deep = 0.2 * scene.span
        self.told = {"at": self.at}

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        deep = (q[self.joint] - self.at) * self.way / self.deep
        if deep > 0:
            push = deep**self.power * (1 + self.damping * v[self.joint] * self.way / self.deep)
            out[self.joint] -= self.way * self.size * max(push, 0.0)


def cushion(scene: JointScales) -> Contact:
    return Contact(scene, "a cushion: linear spring with losses", 1.0, scene.between(0.05, 0.2))


def ball(scene: JointScales) -> Contact:
    return Contact(scene, "Hertz with losses (Hunt and Crossley)", 1.5, scene.between(0.02, 0.1))


class SoftPlane(Addition):
    """A plane that the tip meets; pushes all joints by the transposed Jacobian."""

    name = "external_contact"
    form = "a soft plane in the way of the tip"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(0.5 * scene.load, 4 * scene.load, scene.joint)
        self.machine, turn = scene.machine, scene.between(0, 2 * pi)
        self.normal = (cos(turn), sin(turn))
        ways = [self._height(q) for q in scene.q[:: max(1, len(scene.q) // 400)].tolist()]
        self.at, high = float(np.quantile(ways, 0.8)), float(np.max(ways))
        self.deep = max(high - self.at, 1e-3)
        self.reach = 0.3
        self.depends = ("q", "q of the other joint")

    def _height(self, q: Sequence[float]) -> float:
        (x, y), _ = self.machine.tip(q)
        return x * self.normal[0] + y * self.normal[1]

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        (x, y), by = self.machine.tip(q)
        deep = (x * self.normal[0] + y * self.normal[1] - self.at) / self.deep
        if deep > 0:
            for j, (dx, dy) in enumerate(by):
                out[j] -= self.size * deep / self.reach * (dx * self.normal[0] + dy * self.normal[1])


class Leaning(Addition):
    """Somebody leans on the machine for some seconds, two or three times."""

    name = "external_contact"
    depends = ("time",)
    form = "somebody leans on it for seconds"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(0.4 * scene.load, 3 * scene.load, scene.joint)
        count, rng = int(scene.rng.integers(2, 4)), scene.rng
        self.starts = [scene.duration * (k + float(rng.uniform(0.1, 0.7))) / count for k in range(count)]
        self.long, self.ways = scene.between(1.0, 3.0), [scene.sign() for _ in range(count)]
        self.told = {f"from {k + 1}": start for k, start in enumerate(self.starts)}

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        for start, way in zip(self.starts, self.ways, strict=True):
            if 0 < t - start < self.long:
                share = (t - start) / self.long
                out[self.joint] += way * self.size * min(1.0, 8 * share, 8 * (1 - share))


class MountedOtherwise(Addition):
    """Another machine than the one that is told: a weight at the tip, or a base out of level."""

    def __init__(
        self,
        scene: JointScales,
        name: str,
        form: str,
        size: float,
        most: float,
        change: Callable[[Machine, float], Machine],
        depends: tuple[str, ...],
    ) -> None:
        super().__init__(size, most, scene.joint)
        self.name, self.form, self.change, self.depends = name, form, change, depends

    def mounted(self, machine: Machine) -> Machine:
        return self.change(machine, self.size)


def weight(scene: JointScales) -> MountedOtherwise:
    form = "a small weight at the tip"
    return MountedOtherwise(
        scene, "payload", form, 0.2, 2.0, lambda m, kg: m.with_tip(kg, 0.0, 0.0), ("ddq", "dq", "q")
    )


def tool(scene: JointScales) -> MountedOtherwise:
    beyond, radius = scene.between(0.03, 0.12), scene.between(0.02, 0.06)
    form = "a tool beyond the tip, with an inertia of its own"
    return MountedOtherwise(
        scene, "payload", form, 0.15, 1.5, lambda m, kg: m.with_tip(kg, beyond, kg * radius**2), ("ddq", "dq", "q")
    )


def tilt(scene: JointScales) -> MountedOtherwise:
    heading = scene.between(-pi, pi)
    flat = lies_flat(scene.machine)
    form = "base not level, any heading" if flat else "base turned about the joint's axis"
    way = scene.sign()
    change = (lambda m, a: m.tilted(heading, a)) if flat else (lambda m, a: m.tilted(way * a, 0.0))
    return MountedOtherwise(scene, "base_tilt", form, 0.05, 0.3, change, ("q",))


def lies_flat(machine: Machine) -> bool:
    """Whether gravity pulls at no joint."""
    n = len(machine.rotors)
    return max(abs(x) for x in machine.bias([0.3] * n, [0.0] * n)) < 1e-9


class ZeroOff(Addition):
    """The encoder's zero is off; the controller believes the encoder."""

    name = "encoder_offset"
    depends = ("q",)
    form = "zero of the encoder off"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(0.04, 0.25, scene.joint)
        self.way = scene.sign()

    def reading(self, q: float) -> float:
        return q + self.way * self.size


class DraggedAlong(Addition):
    """The neighbour drags along: a law of own and other place and speed."""

    name = "joint_coupling"

    def __init__(
        self,
        scene: JointScales,
        form: str,
        law: Callable[[float, float, float, float], float],
        size: float,
        depends: tuple[str, ...],
    ) -> None:
        super().__init__(size, 12 * size, scene.joint)
        self.form, self.law, self.depends = form, law, depends
        self.other = scene.other or 0

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        j, k = self.joint, self.other
        out[j] -= self.size * self.law(q[j], q[k], v[j], v[k])


def belt(scene: JointScales) -> DraggedAlong:
    speed = float(np.sqrt(np.mean(scene.v[:, scene.other or 0] ** 2)))
    form = "a belt over the neighbour's pulley: torque in proportion to its speed"
    return DraggedAlong(scene, form, lambda q, p, v, w: w / speed, 0.15 * scene.load, ("speed of the other joint",))


def rubbing_gears(scene: JointScales) -> DraggedAlong:
    speed = float(np.sqrt(np.mean(scene.v[:, scene.other or 0] ** 2)))
    form = "coupled gears that rub: torque by the direction of the neighbour"
    law = lambda q, p, v, w: w / (abs(w) + 0.02 * speed)  # noqa: E731
    return DraggedAlong(scene, form, law, 0.12 * scene.load, ("direction of the other joint",))


def cable_over_both(scene: JointScales) -> DraggedAlong:
    other = scene.other or 0
    mean, spread = float(scene.q[:, other].mean()), float(scene.q[:, other].std())
    form = "a cable past the neighbour: torque in proportion to its angle"
    return DraggedAlong(
        scene, form, lambda q, p, v, w: (p - mean) / spread, 0.12 * scene.load, ("q of the other joint",)
    )
