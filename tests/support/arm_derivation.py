"""The arm derived from the energies of its segments, in sympy: the oracle of the numpy model and of every misprint.

Nothing here is taken from the equations of motion in the papers. Input: where each body's centre is, which angle
turns it, its mass and inertia. Output: the Lagrangian and what follows from it.
"""

from functools import cache

import sympy as sp
from attrs import frozen

q1, q2, q3 = Q = sp.symbols("q1:4", real=True)
w1, w2, w3 = W = sp.symbols("w1:4", real=True)
a1, a2, a3 = A = sp.symbols("a1:4", real=True)
l1, l2, l3, l5, l6, g = sp.symbols("l1 l2 l3 l5 l6 g", real=True)
ma, mc, mbe, mdf = sp.symbols("m_a m_c m_be m_df", positive=True)
base_yy = sp.Symbol("I_baseyy", positive=True)
INERTIA = {name: sp.symbols(f"I_{name}xx I_{name}yy I_{name}zz", positive=True) for name in ("a", "c", "be", "df")}
PI = sp.symbols("p1:9", real=True)


@frozen
class Arm:
    """What follows from the energies: kinetic T and potential V, M, C, N, and pi as functions of the segments."""

    kinetic: sp.Expr
    potential: sp.Expr
    mass: sp.Matrix
    coriolis: sp.Matrix
    gravity: sp.Matrix
    pi: tuple


def yaw(angle):
    """Turn about the vertical y axis: z towards x."""
    return sp.Matrix([[sp.cos(angle), 0, sp.sin(angle)], [0, 1, 0], [-sp.sin(angle), 0, sp.cos(angle)]])


def pitch(angle):
    """Turn in the plane of the arm: z (radial) towards y (up)."""
    return sp.Matrix([[1, 0, 0], [0, sp.cos(angle), sp.sin(angle)], [0, -sp.sin(angle), sp.cos(angle)]])


def rate(expression):
    """d/dt of an expression or a matrix in the angles and rates."""
    return (
        sp.Add(*(sp.diff(expression, q) * w for q, w in zip(Q, W, strict=True)))
        if isinstance(expression, sp.Expr)
        else expression.applyfunc(rate)
    )


def tidy(expression):
    """Expand, and write sin^2 as 1 - cos^2."""
    squares = {sp.sin(q) ** 2: 1 - sp.cos(q) ** 2 for q in Q}
    return sp.expand(sp.expand(expression).subs(squares))


def position(along_upper, along_fore):
    """A point in the base frame (origin at the shoulder), so far along the upper arm and the forearm."""
    radial = along_upper * sp.cos(q2) + along_fore * sp.sin(q3)
    height = along_upper * sp.sin(q2) - along_fore * sp.cos(q3)
    return yaw(q1) * sp.Matrix([0, height, radial])


def spin_energy(name, angle):
    """Rotational energy of a body that yaws with q1 and pitches with `angle`; omega from R^T dR/dt."""
    rotation = yaw(q1) * pitch(angle)
    skew = (rotation.T * rate(rotation)).applyfunc(tidy)
    omega = (skew[2, 1], skew[0, 2], skew[1, 0])
    return sum(i * w**2 for i, w in zip(INERTIA[name], omega, strict=True)) / 2


def travel_energy(mass, centre):
    """Kinetic energy of a mass at a point."""
    velocity = rate(centre)
    return mass * tidy(velocity.dot(velocity)) / 2


def christoffel(mass):
    """C with C_ij = sum_k (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) dq_k / 2."""

    def entry(i, j):
        return (
            sum(
                (sp.diff(mass[i, j], Q[k]) + sp.diff(mass[i, k], Q[j]) - sp.diff(mass[j, k], Q[i])) * W[k]
                for k in range(3)
            )
            / 2
        )

    return sp.Matrix(3, 3, entry)


@cache
def arm() -> Arm:
    """Energies of A, C, BE, DF and the base; I_a, I_c about the centres, I_be, I_df about the shoulder."""
    centre_a, centre_c = position(l1, l2 / 2), position(l1 / 2, l3)
    kinetic = (
        travel_energy(ma, centre_a)
        + travel_energy(mc, centre_c)
        + base_yy * w1**2 / 2
        + spin_energy("a", q3)
        + spin_energy("c", q2)
        + spin_energy("be", q2)
        + spin_energy("df", q3)
    )
    potential = g * (ma * centre_a[1] + mc * centre_c[1] + mbe * position(l5, 0)[1] + mdf * position(0, -l6)[1])
    mass = sp.hessian(kinetic, W)
    gravity = sp.Matrix([sp.diff(potential, q) for q in Q])
    return Arm(kinetic, potential, mass, christoffel(mass), gravity, _parameters(mass, gravity))


def _parameters(mass, gravity):
    """The eight parameters read off M and N at poses where they stand alone."""
    half = sp.pi / 2
    yaw_at = {pose: mass[0, 0].subs({q2: pose[0], q3: pose[1]}) for pose in ((0, 0), (half, 0), (0, half), (0, -half))}
    p2 = (yaw_at[0, 0] - yaw_at[half, 0]) / 2
    p4 = (yaw_at[0, half] - yaw_at[0, -half]) / 2
    p3 = (yaw_at[0, 0] - yaw_at[0, half] + p4) / 2
    p1 = yaw_at[0, 0] - p2 - p3
    p7, p8 = gravity[1].subs(q2, 0), gravity[2].subs(q3, half)
    return tuple(tidy(p) for p in (p1, p2, p3, p4, mass[1, 1], mass[2, 2], p7, p8))


@cache
def euler_lagrange():
    """tau (3,) from d/dt dL/dw - dL/dq, in the segments' symbols: no mass matrix, no Christoffel symbols."""
    found = arm()
    lagrangian = found.kinetic - found.potential
    torques = []
    for q, w in zip(Q, W, strict=True):
        momentum = sp.diff(lagrangian, w)
        change = rate(momentum) + sum(sp.diff(momentum, v) * a for v, a in zip(W, A, strict=True))
        torques.append(change - sp.diff(lagrangian, q))
    return tuple(torques)


@cache
def reduced() -> Arm:
    """The same arm written in the eight parameters alone; `tests/arm/test_arm_derivation.py` proves that nothing is
    lost.
    """
    p = PI
    mass = sp.Matrix(
        [
            [p[0] + p[1] * sp.cos(2 * q2) + p[2] * sp.cos(2 * q3) + p[3] * sp.cos(q2) * sp.sin(q3), 0, 0],
            [0, p[4], -p[3] * sp.sin(q2 - q3) / 2],
            [0, -p[3] * sp.sin(q2 - q3) / 2, p[5]],
        ]
    )
    potential = p[6] * sp.sin(q2) - p[7] * sp.cos(q3)
    rates = sp.Matrix(W)
    gravity = sp.Matrix([sp.diff(potential, q) for q in Q])
    return Arm((rates.T * mass * rates)[0] / 2, potential, mass, christoffel(mass), gravity, p)


@cache
def torque_rows():
    """tau (3,) = M a + C w + N in the eight parameters."""
    found = reduced()
    return tuple(found.mass * sp.Matrix(A) + found.coriolis * sp.Matrix(W) + found.gravity)


def is_zero(expression) -> bool:
    """Identically zero: every sine and cosine of sums written out in exponentials of single angles, then expanded."""
    return sp.expand(sp.expand_trig(expression).rewrite(sp.exp)) == 0
