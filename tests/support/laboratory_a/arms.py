"""Rigid arms with own equations of motion: an axis, a PHANToM-like linkage, a serial chain.

Arrays hold the joint first and the column last: q, v, tau are (n, B); B columns are integrated side by side. A
field that
differs by column (payload, direction of gravity) has a last axis of length B or 1. `rotor` (n, B) is the
reflected inertia
that turns with each link. M(q) a + bias(q, v) = tau.
"""

from dataclasses import dataclass, replace

import numpy as np

G = 9.81


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b over the first axis."""
    out = np.empty(a.shape if a.shape == b.shape else np.broadcast_shapes(a.shape, b.shape))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.subtract(a[i] * b[j], a[j] * b[i], out=out[k])
    return out


def from_the_tip(x: np.ndarray) -> np.ndarray:
    """Sums over joint i and all behind it, over the axis before the last."""
    return np.cumsum(x[..., ::-1, :], axis=-2)[..., ::-1, :]


@dataclass(frozen=True)
class SingleAxisArm:
    """One joint: J a + ml (gx sin(q + phase) - gy cos(q + phase)) = tau; (gx, gy) is gravity in the plane of
    the motion."""

    inertia: np.ndarray | float
    moment: np.ndarray | float
    length: float
    gravity: tuple[np.ndarray | float, np.ndarray | float]
    hangs: bool
    phase: float = 0.0
    n = 1

    def with_payload(self, mass, box):
        moment = self.moment + mass * self.length
        return replace(self, inertia=self.inertia + mass * (self.length**2 + box), moment=moment)

    def tilted(self, angle, azimuth):
        """A pendulum's base turns in the plane of its motion; the vertical axis leans towards `azimuth`."""
        if self.hangs:
            return replace(self, gravity=(G * np.cos(angle), G * np.sin(angle)))
        return replace(self, gravity=(G * np.sin(angle) * np.cos(azimuth), G * np.sin(angle) * np.sin(azimuth)))

    def weight(self, q):
        gx, gy = self.gravity
        return self.moment * (gx * np.sin(q + self.phase) - gy * np.cos(q + self.phase))

    def accelerate(self, q, v, tau, rotor):
        return (tau - self.weight(q)) / (self.inertia + rotor)

    def inverse(self, q, v, a, rotor):
        return (self.inertia + rotor) * a + self.weight(q)

    def felt_inertia(self, q, rotor):
        """(n,): the least inertia that a torque at one joint alone meets, 1/(M^-1)_jj."""
        return np.array([self.inertia]) + rotor

    def energy(self, q, v, rotor):
        gx, gy = self.gravity
        height = -(gx * np.cos(q + self.phase) + gy * np.sin(q + self.phase))
        return (0.5 * (self.inertia + rotor) * v**2 + self.moment * height)[0]

    def regressor(self, q, v, a):
        """(1, K, N): a, and sin q, cos q where the axis hangs."""
        return np.stack([a, np.sin(q), np.cos(q)] if self.hangs else [a], axis=1)

    def parameters(self, rotor):
        ml = self.moment * G
        weight = [ml * np.cos(self.phase), ml * np.sin(self.phase)] if self.hangs else []
        return np.array([self.inertia + rotor[0], *weight])


@dataclass(frozen=True)
class ParallelArm:
    """A PHANToM by Lagrange: T = 1/2 v' M v, V = p7 e.u2 + p8 e.u3; p (8, B), up (3, B); q2, q3 absolute.

    u2 and u3 are the directions of the two arms, e points up. The equations follow from T and V:
    bias_i = sum_k dM_ij/dq_k v_k v_j - 1/2 dM_jk/dq_i v_j v_k + dV/dq_i.
    """

    p: np.ndarray
    up: np.ndarray
    lengths: tuple[float, float] = (0.215, 0.170)
    n = 3

    def with_payload(self, mass, box):
        """A point mass at the tip r = l1 cos q2 + l2 sin q3, h = l1 sin q2 - l2 cos q3."""
        one, two = self.lengths
        more = [(one**2 + two**2) / 2, one**2 / 2, -(two**2) / 2, 2 * one * two, one**2, two**2, G * one, G * two]
        return replace(self, p=self.p + np.outer(more, mass))

    def tilted(self, angle, azimuth):
        lean = np.sin(angle)
        return replace(self, up=np.stack([lean * np.cos(azimuth), np.cos(angle), lean * np.sin(azimuth)]))

    def mass(self, q):
        """(M11, M22, M33, M23)."""
        p, (_, q2, q3) = self.p, q
        m11 = p[0] + p[1] * np.cos(2 * q2) + p[2] * np.cos(2 * q3) + p[3] * np.cos(q2) * np.sin(q3)
        return m11, p[4], p[5], -0.5 * p[3] * np.sin(q2 - q3)

    def bias(self, q, v):
        p, (q1, q2, q3), (v1, v2, v3) = self.p, q, v
        s2, c2, s3, c3 = np.sin(q2), np.cos(q2), np.sin(q3), np.cos(q3)
        by2 = -4 * p[1] * s2 * c2 - p[3] * s2 * s3  # dM11/dq2
        by3 = -4 * p[2] * s3 * c3 + p[3] * c2 * c3
        k = 0.5 * p[3] * (c2 * c3 + s2 * s3)  # dM23/dq3 = -dM23/dq2
        s1, c1 = np.sin(q1), np.cos(q1)
        ex, ey, ez = self.up
        radial, across = ex * s1 + ez * c1, ex * c1 - ez * s1
        return np.stack(
            [
                (by2 * v2 + by3 * v3) * v1 + across * (p[6] * c2 + p[7] * s3),
                -0.5 * by2 * v1**2 + k * v3**2 + p[6] * (ey * c2 - radial * s2),
                -0.5 * by3 * v1**2 - k * v2**2 + p[7] * (ey * s3 + radial * c3),
            ]
        )

    def accelerate(self, q, v, tau, rotor):
        m11, m22, m33, m23 = self.mass(q)
        f1, f2, f3 = tau - self.bias(q, v)
        m22, m33 = m22 + rotor[1], m33 + rotor[2]
        det = m22 * m33 - m23**2
        return np.stack([f1 / (m11 + rotor[0]), (m33 * f2 - m23 * f3) / det, (m22 * f3 - m23 * f2) / det])

    def inverse(self, q, v, a, rotor):
        m11, m22, m33, m23 = self.mass(q)
        rows = np.stack([m11 * a[0], m22 * a[1] + m23 * a[2], m33 * a[2] + m23 * a[1]])
        return rows + rotor * a + self.bias(q, v)

    def felt_inertia(self, q, rotor):
        m11, m22, m33, m23 = self.mass(q)
        m22, m33 = m22 + rotor[1], m33 + rotor[2]
        return np.array([np.min(m11) + rotor[0], np.min(m22 - m23**2 / m33), np.min(m33 - m23**2 / m22)])

    def energy(self, q, v, rotor):
        m11, m22, m33, m23 = self.mass(q)
        kinetic = 0.5 * (m11 * v[0] ** 2 + m22 * v[1] ** 2 + m33 * v[2] ** 2) + m23 * v[1] * v[2]
        ex, ey, ez = self.up
        radial = ex * np.sin(q[0]) + ez * np.cos(q[0])
        two = radial * np.cos(q[1]) + ey * np.sin(q[1])
        three = radial * np.sin(q[2]) - ey * np.cos(q[2])
        return kinetic + 0.5 * np.sum(rotor * v**2, axis=0) + self.p[6] * two + self.p[7] * three

    def regressor(self, q, v, a):
        """(3, 8, N): the columns of the eight parameters, each by the equations with that one alone."""
        columns = []
        for unit in np.eye(8):
            one = replace(self, p=unit[:, None])
            columns.append(one.inverse(q, v, a, 0.0))
        return np.stack(columns, axis=1)

    def parameters(self, rotor):
        p = self.p[:, 0].copy()
        p[[0, 4, 5]] += rotor
        return p


@dataclass(frozen=True)
class SerialChain:
    """A serial arm by Newton and Euler, all vectors in the base frame about its origin (Featherstone 2008, ch.
    2 and 6).

    turn (n, 3, 3) and offset (n, 3) place joint i in the frame of link i - 1; it turns about its own z. Of each link:
    mass (n, B), first moment (3, n, B) and inertia (3, 3, n, B) about the joint's origin, in the link's frame.
    """

    turn: np.ndarray
    offset: np.ndarray
    masses: np.ndarray
    moments: np.ndarray
    inertias: np.ndarray
    tip: np.ndarray
    gravity: np.ndarray

    @property
    def n(self) -> int:
        return len(self.turn)

    def with_payload(self, mass, box):
        r = self.tip
        masses, moments, inertias = (
            np.repeat(x, len(mass), axis=-1) for x in (self.masses, self.moments, self.inertias)
        )
        masses[-1] += mass
        moments[:, -1] += np.outer(r, mass)
        inertias[:, :, -1] += (np.dot(r, r) * np.eye(3) - np.outer(r, r) + box * np.eye(3))[..., None] * mass
        return replace(self, masses=masses, moments=moments, inertias=inertias)

    def tilted(self, angle, azimuth):
        lean = np.sin(angle)
        return replace(self, gravity=-G * np.stack([lean * np.cos(azimuth), lean * np.sin(azimuth), np.cos(angle)]))

    def frames(self, q):
        """Rotations (3, 3, n, B) and origins (3, n, B) of the links."""
        c, s = np.cos(q)[..., None], np.sin(q)[..., None]
        x, y, z = (self.turn[:, None, :, k] for k in range(3))
        steps = np.stack([c * x + s * y, c * y - s * x, np.broadcast_to(z, (*q.shape, 3))], axis=-1)
        rotation, origin = steps[0], np.broadcast_to(self.offset[0], (q.shape[1], 3))
        rotations, origins = [rotation], [origin]
        for step, offset in zip(steps[1:], self.offset[1:]):
            origin = origin + rotation @ offset
            rotation = rotation @ step
            rotations.append(rotation)
            origins.append(origin)
        return np.stack(rotations).transpose(2, 3, 0, 1), np.stack(origins).transpose(2, 0, 1)

    def bodies(self, q):
        """Joint screws (z, p x z), and mass, first moment and inertia of each link about the base's origin."""
        rotation, origin = self.frames(q)
        arm = np.einsum("abnk,bnk->ank", rotation, np.broadcast_to(self.moments, origin.shape))
        still = rotation.transpose(2, 3, 0, 1)
        local = self.inertias.transpose(2, 3, 0, 1)
        inertia = (still @ local @ still.swapaxes(-1, -2)).transpose(2, 3, 0, 1)
        half = arm + 0.5 * self.masses * origin
        outer = origin[:, None] * half[None]
        shift = -(outer + outer.swapaxes(0, 1))
        dot = 2 * np.sum(origin * half, axis=0)
        for k in range(3):
            shift[k, k] += dot
        axis = rotation[:, 2]
        return axis, cross(origin, axis), self.masses, arm + self.masses * origin, inertia + shift

    def mass_and_bias(self, q, v):
        """M (n, n, B) by composite bodies, bias (n, B) by Newton and Euler."""
        z, w, m, c, inertia = self.bodies(q)
        cm, cc, ci = from_the_tip(np.broadcast_to(m, q.shape)), from_the_tip(c), from_the_tip(inertia)
        moment = (ci * z[None]).sum(1) + cross(cc, w)
        force = cm * w - cross(cc, z)
        upper = np.einsum("ajk,aik->jik", z, moment) + np.einsum("ajk,aik->jik", w, force)
        n = self.n
        mass = np.where((np.arange(n)[:, None] <= np.arange(n))[..., None], upper, upper.swapaxes(0, 1))
        zv, wv = z * v, w * v
        turn, slide = np.cumsum(zv, axis=1), np.cumsum(wv, axis=1)
        angular = np.cumsum(cross(turn, zv), axis=1)
        linear = np.cumsum(cross(turn, wv) + cross(slide, zv), axis=1) - self.gravity[:, None]
        spin, push = (inertia * turn[None]).sum(1) + cross(c, slide), m * slide - cross(c, turn)
        moment = (inertia * angular[None]).sum(1) + cross(c, linear) + cross(turn, spin) + cross(slide, push)
        force = m * linear - cross(c, angular) + cross(turn, push)
        return mass, np.sum(z * from_the_tip(moment) + w * from_the_tip(force), axis=0)

    def accelerate(self, q, v, tau, rotor):
        mass, bias = self.mass_and_bias(q, v)
        for k in range(self.n):
            mass[k, k] += rotor[k]
        return np.linalg.solve(mass.transpose(2, 0, 1), (tau - bias).T[..., None])[..., 0].T

    def inverse(self, q, v, a, rotor):
        mass, bias = self.mass_and_bias(q, v)
        return np.einsum("ijk,jk->ik", mass, a) + rotor * a + bias

    def felt_inertia(self, q, rotor):
        mass = self.mass_and_bias(q, 0 * q)[0].transpose(2, 0, 1) + np.diag(rotor)
        return 1 / np.max(np.einsum("kii->ki", np.linalg.inv(mass)), axis=0)

    def energy(self, q, v, rotor):
        mass, _ = self.mass_and_bias(q, v)
        _, _, _, moment, _ = self.bodies(q)
        height = -np.sum(self.gravity[:, None] * moment, axis=(0, 1))
        return 0.5 * np.einsum("ik,ijk,jk->k", v, mass, v) + 0.5 * np.sum(rotor * v**2, axis=0) + height

    def row(self, joint, q, v, a):
        """(10 (n - joint) + 1, N): columns of one joint: of every link behind it m, first moment, inertia;
        then the rotor.

        A second writing of the dynamics, in the links' own frames: tau = s_w.n + s_v.f with
        f = m a + alpha x mc + w x (w x mc), n = I alpha + w x I w + mc x a.
        """
        rotation, origin = self.frames(q)
        z = rotation[:, 2]
        omega = np.cumsum(z * v, axis=1)
        before = np.concatenate([np.zeros_like(omega[:, :1]), omega[:, :-1]], axis=1)
        alpha = np.cumsum(z * a + cross(before, z * v), axis=1)
        lever = np.diff(origin, axis=1)
        moving = cross(alpha[:, :-1], lever) + cross(omega[:, :-1], cross(omega[:, :-1], lever))
        start = np.broadcast_to(-self.gravity[:, None], origin[:, :1].shape)
        linear = np.concatenate([start, start + np.cumsum(moving, axis=1)], axis=1)
        columns = []
        for link in range(joint, self.n):
            turn = rotation[:, :, link]
            screw = z[:, joint], cross(z[:, joint], origin[:, link] - origin[:, joint])
            world = (*screw, omega[:, link], alpha[:, link], linear[:, link])
            sw, sv, w, al, ac = (np.einsum("bak,bk->ak", turn, x) for x in world)
            columns.append(np.sum(sv * ac, axis=0))
            columns += list(cross(sv, al) + cross(cross(sv, w), w) + cross(ac, sw))
            columns += list(pairs(sw, al) + pairs(cross(sw, w), w))
        return np.stack([*columns, a[joint]])

    def row_parameters(self, joint, rotor):
        """The parameters of `row`."""
        found = []
        for link in range(joint, self.n):
            i = self.inertias[:, :, link, 0]
            found += [self.masses[link, 0], *self.moments[:, link, 0]]
            found += [i[0, 0], i[0, 1], i[0, 2], i[1, 1], i[1, 2], i[2, 2]]
        return np.array([*found, rotor[joint]])


def pairs(x, y):
    """(6, N): x' I y as columns of the symmetric I."""
    places = [(i, j) for i in range(3) for j in range(i, 3)]
    return np.stack([x[i] * y[j] + (x[j] * y[i] if i != j else 0) for i, j in places])
