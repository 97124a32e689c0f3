"""What stands in no list of effects."""

from collections.abc import Sequence
from math import exp, pi, sin

import numpy as np

from tests.support.laboratory_c.additions import Addition
from tests.support.laboratory_c.scales import JointScales


class Unlisted(Addition):
    """Called `unknown` in the truth; `logs` gives the name of a column that shows the cause, where one is logged."""

    name = "unknown"
    logs: str | None = None

    def cause(self, t: float) -> float:
        """What a logged column would hold."""
        return 0.0


class NeighbourRubs(Unlisted):
    depends = ("direction", "q of the other joint")
    form = "dry friction that depends on the neighbour's place"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(0.5 * scene.dry, 3 * scene.dry, scene.joint)
        self.other = scene.other or 0
        places = scene.q[:, self.other]
        self.mean, self.spread, self.share = float(places.mean()), float(places.std()), 0.0

    def commit(self, t: float, q: Sequence[float], v: Sequence[float], load: float) -> None:
        self.share = (q[self.other] - self.mean) / self.spread

    def level(self, t: float, q: float, v: float, load: float, dry: float) -> float:
        return self.size * (1 + self.share) / 2


class ProductOfSpeeds(Unlisted):
    depends = ("speed", "speed of the other joint")
    form = "a torque with the product of two joints' speeds (gyro of a spindle)"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(0.15 * scene.load, 2 * scene.load, scene.joint)
        self.other = scene.other or 0
        self.scale = scene.speed * float(np.sqrt(np.mean(scene.v[:, self.other] ** 2)))

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        out[self.joint] -= self.size * v[self.joint] * v[self.other] / self.scale


class Floor(Unlisted):
    depends = ("time",)
    form = "the floor shakes at one frequency"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(0.1 * scene.load, scene.load, scene.joint)
        self.frequency, self.phase = scene.factor(0.8, 9.0), scene.between(0, 2 * pi)
        self.told = {"frequency": self.frequency}

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        out[self.joint] += self.size * sin(2 * pi * self.frequency * t + self.phase)


class SlowCause(Unlisted):
    """Ambient temperature or supply: a slow signal of time."""

    def __init__(self, scene: JointScales, word: str, logged: bool) -> None:
        super().__init__(0.1 * scene.load, scene.load, scene.joint)
        parts = range(1, 5)
        self.waves = [
            (k / scene.duration * scene.between(0.6, 1.4), scene.between(0, 2 * pi), 1 / k**0.5) for k in parts
        ]
        self.logs = word if logged else None
        self.depends = (word,) if logged else (f"{word} (not logged)", "time")
        self.form = f"a torque with the {word}{'' if logged else ' (not logged)'}"

    def cause(self, t: float) -> float:
        return sum(a * sin(2 * pi * f * t + p) for f, p, a in self.waves)

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        out[self.joint] += self.size * self.cause(t)


class Fan(Unlisted):
    depends = ("time",)
    form = "a fan that switches on and off"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(0.15 * scene.load, scene.load, scene.joint)
        self.times = np.cumsum(scene.rng.exponential(scene.duration / 8, 60)).tolist()

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        if sum(t > switch for switch in self.times[:20]) % 2:
            out[self.joint] += self.size


class Jams(Unlisted):
    depends = ("time",)
    form = "a bearing that jams at random moments"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(0.8 * scene.dry, 5 * scene.dry, scene.joint)
        self.moments = scene.rng.uniform(0, scene.duration, max(3, int(scene.duration / 3))).tolist()
        self.long = scene.between(0.1, 0.4)

    def level(self, t: float, q: float, v: float, load: float, dry: float) -> float:
        return self.size if any(0 < t - moment < self.long for moment in self.moments) else 0.0


class Dwelling(Unlisted):
    depends = ("time at rest",)
    form = "grease that sets while the joint stands and is worked off over a way"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(1.0 * scene.dry, 5 * scene.dry, scene.joint)
        self.slow, self.way, self.set = 0.05 * scene.speed, 0.08 * scene.span, 0.0
        self.reset(0.001)

    def begin(self) -> None:
        self.set = 0.0

    def reset(self, step: float) -> None:
        self.step = step

    def commit(self, t: float, q: Sequence[float], v: Sequence[float], load: float) -> None:
        speed = abs(v[self.joint])
        if speed < self.slow:
            self.set += self.step / 0.4 * (1 - self.set)
        self.set *= exp(-speed * self.step / self.way)

    def level(self, t: float, q: float, v: float, load: float, dry: float) -> float:
        return self.size * self.set


class Swinging(Unlisted):
    depends = ("time",)
    form = "a hose that swings at the joint: a light pendulum of its own"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(0.15 * scene.inertia, 0.9 * scene.inertia, scene.joint)
        self.w, self.z = 2 * pi * scene.factor(0.7, 3.0), 0.03
        self.reset(0.001)

    def reset(self, step: float) -> None:
        self.step, self.at, self.speed = step, None, 0.0

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        if self.at is not None:
            lag, rate = self.at - q[self.joint], self.speed - v[self.joint]
            out[self.joint] += self.size * (self.w * self.w * lag + 2 * self.z * self.w * rate)

    def commit(self, t: float, q: Sequence[float], v: Sequence[float], load: float) -> None:
        if self.at is None:
            self.at = q[self.joint]
        pull = self.w * self.w * (q[self.joint] - self.at) + 2 * self.z * self.w * (v[self.joint] - self.speed)
        self.speed += self.step * pull
        self.at += self.step * self.speed


class EccentricDisc(Unlisted):
    depends = ("ddq", "dq", "q")
    form = "an encoder's disc out of centre: an error once a turn of the motor"

    def __init__(self, scene: JointScales) -> None:
        super().__init__(0.002 * scene.span, 0.02 * scene.span, scene.joint)
        self.order, self.phase = 2 * pi * scene.factor(3, 9) / scene.span, scene.between(0, 2 * pi)

    def reading(self, q: float) -> float:
        return q + self.size * sin(self.order * q + self.phase)


def warm_room(scene: JointScales) -> SlowCause:
    return SlowCause(scene, "room temperature", True)


def supply(scene: JointScales) -> SlowCause:
    return SlowCause(scene, "supply voltage", False)


OUTSIDE = (Floor, warm_room, supply, Fan, Jams, Dwelling, Swinging, EccentricDisc)
WITH_NEIGHBOUR = (NeighbourRubs, ProductOfSpeeds)
