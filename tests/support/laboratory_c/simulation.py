"""Classical Runge-Kutta steps through a machine with its drives and its sampled controller.

Dry friction is a slider on a very stiff spring: force = clip(k z + d v, -level, level), the way z pulled along by the
joint; its spring gives way by less than the encoder sees. The motor's torque is constant over a step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from tests.support.laboratory_c.additions import Addition, does
from tests.support.laboratory_c.arrays import Array
from tests.support.laboratory_c.control import Cascade
from tests.support.laboratory_c.machines import Machine

Forces = Callable[[float, list[float], list[float]], list[float]]


@dataclass(frozen=True)
class Friction:
    """Of the complete model, for each joint."""

    dry: tuple[float, ...]
    viscous: tuple[float, ...]


@dataclass(frozen=True)
class SimulatedRun:
    """One run on the simulation's steps: (steps, n). `torque` is what the drive reports, `motor` what it makes, both
    over the step that begins here; q and v are the rotors'.
    """

    q: Array
    v: Array
    torque: Array
    motor: Array
    step: float
    start: float


def solved(m: list[list[float]], b: list[float]) -> list[float]:
    """m^-1 b for one, two or three rows (m symmetric)."""
    if len(b) == 1:
        return [b[0] / m[0][0]]
    if len(b) == 2:
        (p, r), (_, s) = m
        det = p * s - r * r
        return [(s * b[0] - r * b[1]) / det, (p * b[1] - r * b[0]) / det]
    (p, r, s), (_, u, w), (_, _, z) = m
    c0, c1, c2 = u * z - w * w, s * w - r * z, r * w - s * u
    det = p * c0 + r * c1 + s * c2
    c3, c4, c5 = p * z - s * s, r * s - p * w, p * u - r * r
    return [(c0 * b[0] + c1 * b[1] + c2 * b[2]) / det, (c1 * b[0] + c3 * b[1] + c4 * b[2]) / det,
            (c2 * b[0] + c4 * b[1] + c5 * b[2]) / det]  # fmt: skip


class Plant:
    """State, step and memory of one machine with all that happens in it."""

    def __init__(self, machine: Machine, friction: Friction, additions: Sequence[Addition], step: float) -> None:
        for addition in additions:
            addition.begin()
            machine = addition.mounted(machine)
        self.machine, self.friction, self.step = machine, friction, step
        self.additions = additions
        self.adders = [a for a in additions if does(a, "add")]
        self.drivers = [a for a in additions if does(a, "drive")]
        self.committers = [a for a in additions if does(a, "commit")]
        self.levels = [[a for a in additions if a.joint == j and does(a, "level")] for j in range(len(friction.dry))]
        self.gear = next((a for a in additions if does(a, "twist")), None)
        self.n = len(friction.dry)
        self.rotors = list(machine.rotors)

    def start(self, q: Sequence[float]) -> None:
        self.q, self.v, self.t = list(q), [0.0] * self.n, 0.0
        self.link, self.link_v = (self.q[self.gear.joint], 0.0) if self.gear else (0.0, 0.0)
        self.anchor, self.slid = list(q), [0.0] * self.n
        least = [self.rotors[j] + self._least(q, j) for j in range(self.n)]
        self.k = [0.12 * m / self.step**2 for m in least]
        self.d = [0.8 * sqrt(k * m) for k, m in zip(self.k, least, strict=True)]
        self.motor = [0.0] * self.n
        for addition in self.additions:
            addition.reset(self.step)

    def _least(self, q: Sequence[float], j: int) -> float:
        """The inertia that the joint feels while all others are free, without rotors: 1 / (M^-1)_jj."""
        if self.gear and self.gear.joint == j:
            return 0.0
        m = self.machine.mass(q)
        for i in range(self.n):
            m[i][i] += self.rotors[i]
        unit = [0.0] * self.n
        unit[j] = 1.0
        return 1 / solved(m, unit)[j] - self.rotors[j]

    def dry(self, t: float, j: int, q: float, v: float) -> float:
        """Force of the slider."""
        level = self.friction.dry[j]
        for a in self.levels[j]:
            level += a.level(t, q, v, self.motor[j], self.friction.dry[j])
        level = max(level, 0.0)
        force = self.k[j] * (self.slid[j] + q - self.anchor[j]) + self.d[j] * v
        return max(-level, min(level, force))

    def forces(self, t: float, q: list[float], v: list[float]) -> list[float]:
        """On the rotors, without rigid bodies."""
        out = [self.motor[j] - self.friction.viscous[j] * v[j] - self.dry(t, j, q[j], v[j]) for j in range(self.n)]
        for a in self.adders:
            a.add(t, q, v, out)
        return out

    def rates(self, t: float, q: list[float], v: list[float], link: float, link_v: float) -> tuple[list[float], float]:
        """Accelerations of the rotors, and of the link behind a flexible gear."""
        out = self.forces(t, q, v)
        if self.gear is None:
            m, bias = self.machine.mass(q), self.machine.bias(q, v)
            for j in range(self.n):
                m[j][j] += self.rotors[j]
                out[j] -= bias[j]
            return solved(m, out), 0.0
        g = self.gear.joint
        through = self.gear.twist(q[g] - link, v[g] - link_v)
        ql, vl = list(q), list(v)
        ql[g], vl[g] = link, link_v
        rotor = (out[g] - through) / self.rotors[g]
        out[g] = through
        m, bias = self.machine.mass(ql), self.machine.bias(ql, vl)
        for j in range(self.n):
            m[j][j] += 0.0 if j == g else self.rotors[j]
            out[j] -= bias[j]
        a = solved(m, out)
        linked, a[g] = a[g], rotor
        return a, linked

    def advance(self) -> None:
        """One step of the classical Runge-Kutta method; then the memories follow."""
        h, t, q, v, x, y = self.step, self.t, self.q, self.v, self.link, self.link_v
        half = h / 2
        a1, b1 = self.rates(t, q, v, x, y)
        v2 = [p + half * a for p, a in zip(v, a1)]
        y2 = y + half * b1
        a2, b2 = self.rates(t + half, [p + half * s for p, s in zip(q, v)], v2, x + half * y, y2)
        v3 = [p + half * a for p, a in zip(v, a2)]
        y3 = y + half * b2
        a3, b3 = self.rates(t + half, [p + half * s for p, s in zip(q, v2)], v3, x + half * y2, y3)
        v4 = [p + h * a for p, a in zip(v, a3)]
        y4 = y + h * b3
        a4, b4 = self.rates(t + h, [p + h * s for p, s in zip(q, v3)], v4, x + h * y3, y4)
        self.q = [p + h / 6 * (s1 + 2 * s2 + 2 * s3 + s4) for p, s1, s2, s3, s4 in zip(q, v, v2, v3, v4)]
        self.v = [p + h / 6 * (s1 + 2 * s2 + 2 * s3 + s4) for p, s1, s2, s3, s4 in zip(v, a1, a2, a3, a4)]
        self.link = x + h / 6 * (y + 2 * y2 + 2 * y3 + y4)
        self.link_v = y + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
        self.t = t + h
        self._follow()

    def _follow(self) -> None:
        """The slider is where its spring holds no more than the level of friction."""
        for j in range(self.n):
            level = self.friction.dry[j]
            for a in self.levels[j]:
                level += a.level(self.t, self.q[j], self.v[j], self.motor[j], self.friction.dry[j])
            most = max(level, 0.0) / self.k[j]
            self.slid[j] = max(-most, min(most, self.slid[j] + self.q[j] - self.anchor[j]))
            self.anchor[j] = self.q[j]
        for a in self.committers:
            a.commit(self.t, self.q, self.v, self.motor[a.joint])


def simulate(plant: Plant, controller: Cascade, reference: Array, tick: int, start: float) -> SimulatedRun:
    """A run under control: (ticks, n) `reference`, `tick` steps between its rows; `start`: time of its begin [s]."""
    n, steps = plant.n, len(reference) * tick
    readers = [[a for a in plant.additions if a.joint == j and does(a, "reading")] for j in range(n)]
    begin = reference[0].tolist()
    plant.start([x - sum(a.reading(x) - x for a in readers[j]) for j, x in enumerate(begin)])
    plant.t = start
    controller.reset(reference, plant.step * tick)
    loop = 1 - np.exp(-plant.step / controller.current).item()
    q, v, torque, motor = (np.empty((steps, n)) for _ in range(4))
    current, wanted = controller.first(plant.machine, reference[0].tolist()), [0.0] * n
    for k in range(steps):
        if k % tick == 0:
            seen = list(plant.q)
            for j in range(n):
                for a in readers[j]:
                    seen[j] = a.reading(seen[j])
            wanted = controller.update(k // tick, seen)
        current = [c + (w - c) * loop for c, w in zip(current, wanted)]
        plant.motor = list(current)
        for a in plant.drivers:
            plant.motor[a.joint] = a.drive(plant.t, plant.motor[a.joint], plant.v[a.joint])
        q[k], v[k], torque[k], motor[k] = plant.q, plant.v, current, plant.motor
        plant.advance()
    return SimulatedRun(q, v, torque, motor, plant.step, start)
