"""The arm once more, from its energies alone, for the tests of the C plant: nothing here comes from the C sources.

T = dq' M dq / 2 and V as functions of q; every derivative is a complex step (exact to rounding), so neither a
Christoffel symbol nor a gravity torque is written down.
"""

import numpy as np

L1, L2, GRAVITY = 0.215, 0.170, 9.81
STEP = 1e-30  # of the complex step: no subtraction, so no loss


def segment_pi() -> np.ndarray:
    """pi of CF's segments (PHYSICS 1), from masses and inertias."""
    ma, mc, mbe, mdf, l3, l5, l6 = 0.0202, 0.0249, 0.2359, 0.1906, 0.0325, -0.0368, 0.0527
    a, c, be, df = (
        np.array(v) * 1e-4
        for v in ((0.4864, 0.001843, 0.4864), (0.959, 0.959, 0.0051), (11.09, 10.06, 0.591), (7.11, 0.629, 6.246))
    )
    base = 11.87e-4
    return np.array(
        [
            (a[1] + a[2] + 2 * base + be[1] + be[2] + c[1] + c[2] + df[1] + df[2]) / 2
            + (4 * L1**2 * ma + L2**2 * ma + L1**2 * mc + 4 * l3**2 * mc) / 8,
            (be[1] - be[2] + c[1] - c[2]) / 2 + L1**2 * (4 * ma + mc) / 8,
            (a[1] - a[2] + df[1] - df[2]) / 2 - (L2**2 * ma + 4 * l3**2 * mc) / 8,
            L1 * (L2 * ma + l3 * mc),
            be[0] + c[0] + L1**2 * ma + L1**2 * mc / 4,
            a[0] + df[0] + L2**2 * ma / 4 + l3**2 * mc,
            GRAVITY / 2 * (2 * L1 * ma + 2 * l5 * mbe + L1 * mc),
            GRAVITY / 2 * (L2 * ma + 2 * l3 * mc - 2 * l6 * mdf),
        ]
    )


PI = segment_pi()


def position(q):
    r = L1 * np.cos(q[1]) + L2 * np.sin(q[2])
    return np.array([np.sin(q[0]) * r, L2 - L2 * np.cos(q[2]) + L1 * np.sin(q[1]), np.cos(q[0]) * r - L1])


def gradient(function, q):
    """d function / d q by complex steps; the last axis is q's."""
    columns = [np.imag(function(np.asarray(q, complex) + 1j * STEP * np.eye(3)[i])) / STEP for i in range(3)]
    return np.stack(columns, axis=-1)


def jacobian(q):
    return gradient(position, q)


def mass(q, pi=PI):
    m11 = pi[0] + pi[1] * np.cos(2 * q[1]) + pi[2] * np.cos(2 * q[2]) + pi[3] * np.cos(q[1]) * np.sin(q[2])
    m23 = -pi[3] / 2 * np.sin(q[1] - q[2])
    zero = 0 * m11
    return np.array([[m11, zero, zero], [zero, pi[4] + zero, m23], [zero, m23, pi[5] + zero]])


def potential(q, pi=PI):
    return pi[6] * np.sin(q[1]) - pi[7] * np.cos(q[2])


def energy(q, dq, pi=PI):
    return 0.5 * dq @ mass(q, pi) @ dq + potential(q, pi)


def bias(q, dq, pi=PI):
    """C dq + N = dM/dt dq - grad(dq' M dq)/2 + grad V."""
    rate = gradient(lambda p: mass(p, pi), q) @ dq
    return rate @ dq - 0.5 * gradient(lambda p: dq @ mass(p, pi) @ dq, q) + gradient(lambda p: potential(p, pi), q)


def acceleration(q, dq, torque, f=(0, 0, 0), pi=PI):
    """ddq of M ddq + C dq + N = torque + J' f."""
    return np.linalg.solve(mass(q, pi), np.asarray(torque) + jacobian(q).T @ np.asarray(f) - bias(q, dq, pi))


def random_pose(random):
    """q in the workspace with its linkage."""
    while True:
        q = np.radians(random.uniform([-90, -57.7, -25.7], [90, 115, 167.5]))
        if -55 <= np.degrees(q[1] - q[2]) <= 65 and abs(L1 * np.cos(q[1]) + L2 * np.sin(q[2])) > 0.02:
            return q


def rk4(rate, state, step, steps):
    """Classical Runge-Kutta in numpy; rate(state) -> derivative."""
    for _ in range(steps):
        k1 = rate(state)
        k2 = rate(state + step / 2 * k1)
        k3 = rate(state + step / 2 * k2)
        k4 = rate(state + step * k3)
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state
