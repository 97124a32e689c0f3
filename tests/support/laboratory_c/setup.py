"""Drawn experiments: machine, friction, servo, motions, rates; before anything happens in them."""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from typing import Literal

import numpy as np

from tests.support.laboratory_c.arrays import Array
from tests.support.laboratory_c.control import Cascade
from tests.support.laboratory_c.machines import Boom, G, Lift, Machine, PlanarChain
from tests.support.laboratory_c.motions import LIKELY, MOTIONS, Room, from_rest, turning
from tests.support.laboratory_c.simulation import Friction

Told = Literal["axis", "regressor", "rigid", "robot"]
"""How the recording is described: one joint, base columns, a told rigid torque, a URDF."""


@dataclass(frozen=True)
class Body:
    """A drawn machine with the rooms of its joints."""

    word: str
    machine: Machine
    friction: Friction
    rooms: tuple[Room, ...]
    linear: tuple[bool, ...]
    """Which joints slide [m, N]."""
    links: tuple[tuple[float, float, float], ...] = ()
    """Mass [kg], centre [m], inertia about it [kg m^2] of the links of a chain."""


@dataclass(frozen=True)
class ExperimentPlan:
    """Everything that stands still: what a plain run of it needs, and how it is logged."""

    body: Body
    told: Told
    joint: int
    """The described one; the one that something befalls, of a robot."""
    controller: Cascade
    step: float
    tick: int
    """Steps between two ticks of the controller."""
    every: int
    """Steps between two rows."""
    references: tuple[Array, ...]
    motions: tuple[str, ...]
    count: tuple[float, ...]

    @property
    def rate(self) -> float:
        return 1 / (self.step * self.every)

    @property
    def duration(self) -> float:
        return sum(len(r) for r in self.references) * self.tick * self.step


def draw_lift(rng: np.random.Generator) -> Body:
    moved = rng.uniform(3, 15)
    counter = moved * rng.choice([0.0, rng.uniform(0.3, 1.0)])
    machine = Lift(moved, counter, (rng.uniform(4, 20),))
    room = Room(-0.25, rng.uniform(0.1, 0.35), rng.uniform(0.2, 0.5), rng.uniform(1.5, 5))
    friction = Friction((rng.uniform(10, 45),), (rng.uniform(30, 180),))
    return Body("lift", machine, friction, (room,), (True,))


def draw_pendulum(rng: np.random.Generator) -> Body:
    mass, centre = rng.uniform(0.8, 3), rng.uniform(0.2, 0.4)
    inertia = mass * centre**2 * rng.uniform(1.05, 1.4)
    machine = PlanarChain((inertia,), (mass * centre,), (1.3 * centre,), (inertia * rng.uniform(0.2, 0.8),), G, -pi / 2)
    wide = rng.uniform(0.7, 2.6)
    room = Room(-wide * rng.uniform(0.5, 1), wide, rng.uniform(1.5, 5), rng.uniform(8, 25))
    dry = mass * centre * G * rng.uniform(0.05, 0.25)
    return Body("inverted pendulum", machine, Friction((dry,), (dry * rng.uniform(0.05, 0.3),)), (room,), (False,))


def chain(
    rng: np.random.Generator,
    links: list[tuple[float, float, float]],
    lengths: list[float],
    rotors: list[float],
    vertical: bool,
    by_urdf: bool,
) -> PlanarChain:
    """Link by link: mass [kg], centre [m] and inertia [kg m^2] about it."""
    n = len(links)
    beyond = [sum(m for m, _, _ in links[i + 1 :]) for i in range(n)]
    inertias = [m * c**2 + i + b * a**2 for (m, c, i), a, b in zip(links, lengths, beyond)]
    moments = [m * c + b * a for (m, c, _), a, b in zip(links, lengths, beyond)]
    pull = G if vertical else 0.0
    return PlanarChain(tuple(inertias), tuple(moments), tuple(lengths), tuple(rotors), pull, 0.0, by_urdf)


def drawn_links(
    rng: np.random.Generator, masses: list[float], lengths: list[float]
) -> list[tuple[float, float, float]]:
    shares = rng.uniform(0.35, 0.6, len(masses))
    return [(m, a * s, m * a**2 * rng.uniform(0.06, 0.12)) for m, a, s in zip(masses, lengths, shares.tolist())]


def draw_scara(rng: np.random.Generator) -> Body:
    lengths = [rng.uniform(0.2, 0.35), rng.uniform(0.15, 0.3)]
    links = drawn_links(rng, [rng.uniform(2, 4), rng.uniform(1, 2.5)], lengths)
    machine = chain(rng, links, lengths, [rng.uniform(0.05, 0.2), rng.uniform(0.01, 0.06)], False, False)
    rooms = (
        Room(-2.0, 2.0, rng.uniform(1.5, 5), rng.uniform(8, 25)),
        Room(-2.3, 2.3, rng.uniform(2, 6), rng.uniform(10, 30)),
    )
    dry = (rng.uniform(0.4, 1.8), rng.uniform(0.15, 0.7))
    friction = Friction(dry, (dry[0] * rng.uniform(0.1, 0.4), dry[1] * rng.uniform(0.1, 0.4)))
    return Body("SCARA", machine, friction, rooms, (False, False), tuple(links))


def draw_boom(rng: np.random.Generator) -> Body:
    tube, centre = rng.uniform(1.5, 4), rng.uniform(0.3, 0.5)
    over = tube * centre + rng.uniform(0.3, 1.2) - rng.choice([0.0, 1.0]) * tube * centre
    machine = Boom(
        tube * centre**2 + rng.uniform(0.5, 1.5), over, tube, centre, (rng.uniform(0.2, 1.0), rng.uniform(1, 5))
    )
    rooms = (
        Room(-0.9, 1.2, rng.uniform(0.8, 2), rng.uniform(4, 12)),
        Room(0.0, 0.5, rng.uniform(0.3, 0.8), rng.uniform(2, 8)),
    )
    dry = (rng.uniform(0.8, 3), rng.uniform(4, 15))
    friction = Friction(dry, (dry[0] * rng.uniform(0.1, 0.5), dry[1] * rng.uniform(0.3, 1.5)))
    return Body("telescopic boom", machine, friction, rooms, (False, True))


def draw_arm(rng: np.random.Generator) -> Body:
    lengths = [rng.uniform(0.25, 0.35), rng.uniform(0.2, 0.3), rng.uniform(0.08, 0.15)]
    links = drawn_links(rng, [rng.uniform(2, 3.5), rng.uniform(1.2, 2.2), rng.uniform(0.5, 1.0)], lengths)
    rotors = [rng.uniform(0.08, 0.25), rng.uniform(0.04, 0.12), rng.uniform(0.005, 0.02)]
    machine = chain(rng, links, lengths, rotors, True, True)
    rooms = tuple(
        Room(m - w, m + w, rng.uniform(1, 3), rng.uniform(6, 18)) for m, w in ((0.5, 1.2), (-0.6, 1.4), (0.2, 1.6))
    )
    dry = (rng.uniform(0.6, 2), rng.uniform(0.3, 1), rng.uniform(0.05, 0.2))
    viscous = tuple(float(d * rng.uniform(0.1, 0.4)) for d in dry)
    return Body("planar arm", machine, Friction(dry, viscous), rooms, (False,) * 3, tuple(links))


BODIES: dict[str, Callable[[np.random.Generator], Body]] = {
    "lift": draw_lift, "pendulum": draw_pendulum, "scara": draw_scara, "boom": draw_boom, "arm": draw_arm,
}  # fmt: skip


def inertias(body: Body) -> tuple[float, ...]:
    """Of the joints in the middle of their rooms, rotors with them."""
    mass = body.machine.mass([(r.low + r.high) / 2 for r in body.rooms])
    return tuple(mass[j][j] + rotor for j, rotor in enumerate(body.machine.rotors))


def servo(rng: np.random.Generator, body: Body, count: tuple[float, ...]) -> Cascade:
    """A cascade of usual quality."""
    about = inertias(body)
    held = [abs(x) for x in body.machine.bias([(r.low + r.high) / 2 for r in body.rooms], [0.0] * len(about))]
    limit = tuple(
        4 * (i * r.acceleration + d + h) + 2 * h for i, r, d, h in zip(about, body.rooms, body.friction.dry, held)
    )
    band = rng.uniform(40, 90)
    return Cascade(about, count, band, band * rng.uniform(0.12, 0.25), float(rng.choice([0.0, 0.5, 0.9])),
                   rng.uniform(2e-4, 8e-4), body.machine, limit)  # fmt: skip


RATES = (100, 200, 250, 500, 1000, 2000)


def drawn_motions(rng: np.random.Generator, body: Body, runs: int) -> list[list[str]]:
    """A word for each joint of each run."""
    words = list(MOTIONS)
    if body.word == "inverted pendulum" and rng.random() < 0.06:
        return [["turning"]] * runs
    return [[str(rng.choice(words, p=LIKELY)) for _ in body.rooms] for _ in range(runs)]


def draw(rng: np.random.Generator, body: Body, told: Told, joint: int, longest: float) -> ExperimentPlan:
    """An experiment of 10 to 60 s (`longest`) with at most 50,000 rows."""
    n = len(body.rooms)
    rate = float(rng.choice(RATES[:5] if n > 1 else RATES))
    control = max(rate, 1000.0)
    step = 1 / max(2000.0, control)
    duration = float(np.exp(rng.uniform(np.log(10), np.log(60 if n == 1 else 45 if n == 2 else 30))))
    duration = min(duration, longest, 50_000 / rate)
    runs = 1 if duration < 15 else int(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15]))
    t = np.arange(int(duration / runs * control)) / control
    words = drawn_motions(rng, body, runs)
    references = [
        from_rest(t, [(turning if w == "turning" else MOTIONS[w])(rng, t, room) for w, room in zip(row, body.rooms)])
        for row in words
    ]
    count = tuple(
        float(np.exp(rng.uniform(np.log(5e-7), np.log(5e-6)))) if s else 2 * pi / float(2 ** rng.integers(17, 21))
        for s in body.linear
    )
    controller = servo(rng, body, count)
    return ExperimentPlan(body, told, joint, controller, step, round(1 / control / step), round(1 / rate / step),
                      tuple(references), tuple(" ".join(row) for row in words), count)  # fmt: skip
