"""Rigid machines: a lift, a planar chain of one to three links, a telescopic boom; each forwards and backwards.

Forwards (`mass`, `bias`: Python floats, for the simulation) and backwards (`columns`: torque = columns @ parameters,
for the student who fits). SI: rad or m, N m or N.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, pi, sin
from typing import Protocol

import numpy as np

from tests.support.laboratory_c.arrays import Array

G = 9.81


class Machine(Protocol):
    """What the simulation and the student need of rigid bodies; `rotors` are the motors' inertias at the joints."""

    @property
    def rotors(self) -> tuple[float, ...]: ...

    def mass(self, q: Sequence[float]) -> list[list[float]]:
        """Mass matrix without rotors."""
        ...

    def bias(self, q: Sequence[float], v: Sequence[float]) -> list[float]:
        """Torques of Coriolis, centrifugal forces and gravity."""
        ...

    def columns(self, j: int, q: Array, v: Array, a: Array) -> Array:
        """(rows, p): columns of joint j, the rotor's among them."""
        ...

    def parameters(self, j: int) -> Array:
        """(p,): what stands before the columns of joint j."""
        ...

    def tip(self, q: Sequence[float]) -> tuple[tuple[float, float], list[tuple[float, float]]]:
        """Place of the tip in its plane [m] and its derivative by each joint."""
        ...

    def with_tip(self, mass: float, beyond: float, inertia: float) -> "Machine":
        """With a weight [kg] beyond the tip [m], inertia [kg m^2] about its own centre."""
        ...

    def tilted(self, along: float, across: float) -> "Machine":
        """On a base that is turned in its plane (`along`) or out of it (`across`) [rad]."""
        ...


def potential(machine: Machine, q: Sequence[float]) -> float:
    """Potential energy [J] relative to q = 0, by gravity's torque integrated on the straight way (Gauss, 20 points)."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    rest = [0.0] * len(q)
    total = 0.0
    for x, w in zip((nodes + 1) / 2, weights / 2, strict=True):
        pull = machine.bias([float(x) * angle for angle in q], rest)
        total += w * sum(p * angle for p, angle in zip(pull, q, strict=True))
    return float(total)


@dataclass(frozen=True)
class Lift:
    """Carriage on a vertical ball screw; `moved` [kg] hangs on it, `counter` [kg] pulls it up over a pulley."""

    moved: float
    counter: float
    rotors: tuple[float, ...]

    def mass(self, q: Sequence[float]) -> list[list[float]]:
        return [[self.moved + self.counter]]

    def bias(self, q: Sequence[float], v: Sequence[float]) -> list[float]:
        return [G * (self.moved - self.counter)]

    def columns(self, j: int, q: Array, v: Array, a: Array) -> Array:
        return np.column_stack([a[:, 0], np.ones(len(a))])

    def parameters(self, j: int) -> Array:
        return np.array([self.moved + self.counter + self.rotors[0], self.bias([0.0], [0.0])[0]])

    def tip(self, q: Sequence[float]) -> tuple[tuple[float, float], list[tuple[float, float]]]:
        return (0.0, q[0]), [(0.0, 1.0)]

    def with_tip(self, mass: float, beyond: float, inertia: float) -> "Lift":
        return replace(self, moved=self.moved + mass)

    def tilted(self, along: float, across: float) -> "Lift":
        raise NotImplementedError("hidden in the weight of a lift")


@dataclass(frozen=True)
class PlanarChain:
    """Links in one plane, described by absolute angles th_i = q_1 + ... + q_i: abs_i = I_i th_i'' +
    sum_k l_min P_max (cos(th_i - th_k) th_k'' + sin(th_i - th_k) th_k'^2) + pull P_i cos(th_i - heading).

    I_i [kg m^2] holds what hangs on link i as points at its end, P_i [kg m] likewise; lengths [m] of all links.
    """

    inertias: tuple[float, ...]
    moments: tuple[float, ...]
    lengths: tuple[float, ...]
    rotors: tuple[float, ...]
    pull: float = 0.0
    """Gravity within the plane [m/s^2]."""
    heading: float = 0.0
    offset_centres: bool = False
    """Whether the student's columns let centres of mass lie beside the links (a URDF does)."""

    def _angles(self, q: Sequence[float]) -> list[float]:
        total, out = 0.0, []
        for angle in q:
            total += angle
            out.append(total)
        return out

    def mass(self, q: Sequence[float]) -> list[list[float]]:
        th, n = self._angles(q), len(q)
        absolute = [[0.0] * n for _ in range(n)]
        for i in range(n):
            absolute[i][i] = self.inertias[i]
            for k in range(i + 1, n):
                absolute[i][k] = absolute[k][i] = self.lengths[i] * self.moments[k] * cos(th[i] - th[k])
        return [[sum(absolute[i][k] for i in range(a, n) for k in range(b, n)) for b in range(n)] for a in range(n)]

    def bias(self, q: Sequence[float], v: Sequence[float]) -> list[float]:
        th, om, n = self._angles(q), self._angles(v), len(q)
        out = [0.0] * n
        total = 0.0
        for i in range(n - 1, -1, -1):
            total += self.pull * self.moments[i] * cos(th[i] - self.heading)
            for k in range(n):
                if k != i:
                    low, high = (i, k) if i < k else (k, i)
                    total += self.lengths[low] * self.moments[high] * sin(th[i] - th[k]) * om[k] * om[k]
            out[i] = total
        return out

    def _moment_column(self, m: int, j: int, turn: float, th: Array, om: Array, al: Array) -> Array:
        """Torque of joint j for P_m = 1, the centre turned by `turn` [rad] from the link."""
        total = self.pull * np.cos(th[:, m] + turn - self.heading)
        for i in range(m):
            between = th[:, i] - th[:, m] - turn
            total = total + self.lengths[i] * (np.cos(between) * al[:, i] - np.sin(between) * om[:, i] ** 2)
            if i >= j:
                total = total + self.lengths[i] * (np.cos(between) * al[:, m] + np.sin(between) * om[:, m] ** 2)
        return total

    def columns(self, j: int, q: Array, v: Array, a: Array) -> Array:
        th, om, al = (np.cumsum(x, axis=1) for x in (q, v, a))
        found = [a[:, j]] if j else []
        for m in range(len(self.rotors)):
            found.append(al[:, m] if m >= j else np.zeros(len(q)))
            turns = (0.0, pi / 2) if self.offset_centres else (0.0,)
            for turn in turns:
                if m >= j and (self.pull or m):
                    found.append(self._moment_column(m, j, turn, th, om, al))
                else:
                    found.append(np.zeros(len(q)))
        table = np.column_stack(found)
        return table if self.offset_centres else table[:, self._used(j)]

    def _used(self, j: int) -> list[int]:
        """Of the columns for one joint those that are not zero whatever it does."""
        first, used = (1 if j else 0), [0] if j else []
        for m in range(j, len(self.rotors)):
            used += [first + 2 * m] + ([first + 2 * m + 1] if self.pull or m else [])
        return used

    def parameters(self, j: int) -> Array:
        found = [self.rotors[j]] if j else []
        for m in range(len(self.rotors)):
            found.append(self.inertias[m] + (self.rotors[0] if j == 0 and m == 0 else 0.0))
            found += [self.moments[m], 0.0] if self.offset_centres else [self.moments[m]]
        return np.array(found) if self.offset_centres else np.array(found)[self._used(j)]

    def tip(self, q: Sequence[float]) -> tuple[tuple[float, float], list[tuple[float, float]]]:
        th = self._angles(q)
        x = y = 0.0
        by = []
        for i in range(len(q) - 1, -1, -1):
            x += self.lengths[i] * cos(th[i])
            y += self.lengths[i] * sin(th[i])
            by.append((-y, x))
        return (x, y), by[::-1]

    def with_tip(self, mass: float, beyond: float, inertia: float) -> "PlanarChain":
        arms = [*self.lengths[:-1], self.lengths[-1] + beyond]
        inertias = [i + mass * arm**2 for i, arm in zip(self.inertias, arms, strict=True)]
        inertias[-1] += inertia
        moments = [p + mass * arm for p, arm in zip(self.moments, arms, strict=True)]
        return replace(self, inertias=tuple(inertias), moments=tuple(moments))

    def tilted(self, along: float, across: float) -> "PlanarChain":
        if self.pull:
            return replace(self, heading=self.heading + along, pull=self.pull * cos(across))
        return replace(self, pull=G * sin(across), heading=along)


@dataclass(frozen=True)
class Boom:
    """A boom in the vertical plane (joint 1, rad above the level) with a tube that slides out (joint 2, m).

    Its inertia about the pivot is whole + 2 tube centre s + tube s^2, its moment over + tube s, s the way out.
    """

    whole: float
    over: float
    tube: float
    centre: float
    rotors: tuple[float, ...]
    level: float = 0.0

    def mass(self, q: Sequence[float]) -> list[list[float]]:
        return [[self.whole + self.tube * q[1] * (2 * self.centre + q[1]), 0.0], [0.0, self.tube]]

    def bias(self, q: Sequence[float], v: Sequence[float]) -> list[float]:
        arm = self.tube * (self.centre + q[1])
        turn = 2 * arm * v[0] * v[1] + G * cos(q[0] - self.level) * (self.over + self.tube * q[1])
        return [turn, -arm * v[0] * v[0] + G * self.tube * sin(q[0] - self.level)]

    def columns(self, j: int, q: Array, v: Array, a: Array) -> Array:
        (p, s), (dp, ds), (ddp, dds) = q.T, v.T, a.T
        if j:
            return np.column_stack([dds, G * np.sin(p) - s * dp**2, -(dp**2)])
        tube = s**2 * ddp + 2 * s * ds * dp + G * s * np.cos(p)
        return np.column_stack([ddp, G * np.cos(p), tube, 2 * s * ddp + 2 * ds * dp])

    def parameters(self, j: int) -> Array:
        if j:
            return np.array([self.tube + self.rotors[1], self.tube, self.tube * self.centre])
        return np.array([self.whole + self.rotors[0], self.over, self.tube, self.tube * self.centre])

    def tip(self, q: Sequence[float]) -> tuple[tuple[float, float], list[tuple[float, float]]]:
        reach, c, s = self.centre + 0.3 + q[1], cos(q[0]), sin(q[0])
        return (reach * c, reach * s), [(-reach * s, reach * c), (c, s)]

    def with_tip(self, mass: float, beyond: float, inertia: float) -> "Boom":
        at = self.centre + 0.3 + beyond
        tube = self.tube + mass
        centre = (self.tube * self.centre + mass * at) / tube
        return replace(
            self, whole=self.whole + mass * at**2 + inertia, over=self.over + mass * at, tube=tube, centre=centre
        )

    def tilted(self, along: float, across: float) -> "Boom":
        return replace(self, level=self.level + along)
