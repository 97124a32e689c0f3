"""The oracle of Sallam's loop: both arms, controllers and delays as one delay differential equation, written from the
paper.

Classic Runge-Kutta with a fixed step; the past is a cubic Hermite polynomial through tip positions and velocities.
Plain floats, nothing of cosim. Halving the step from 2 ms to 1 ms changes the tips by less than 1e-11 m at a constant
delay (tested).

A delay that varies is a law d(t, middle) [s]: `middle` is the middle of the step that t belongs to, so that at a jump,
which must lie on the grid, the step before ends with the left limit and the step behind begins with the right one.
"""

import math

import numpy as np

L1, L2 = 0.215, 0.170
SEGMENT = tuple(1e-3 * p for p in (2.832787775, 1.1318928125, -0.3912006625, 0.91229875, 2.426395625, 0.931885625))


def tip(q):
    """Tip position and Jacobian rows of one arm (3,), (3, 3)."""
    s1, c1, s2, c2, s3, c3 = (f(a) for a in q for f in (math.sin, math.cos))
    r = L1 * c2 + L2 * s3
    position = (s1 * r, L2 - L2 * c3 + L1 * s2, c1 * r - L1)
    jacobian = ((c1 * r, -L1 * s1 * s2, L2 * s1 * c3), (0.0, L1 * c2, L2 * s3), (-s1 * r, -L1 * c1 * s2, L2 * c1 * c3))
    return position, jacobian


def acceleration(q, dq, force, jacobian):
    """ddq from M ddq + C dq = J^T force, gravity compensated, without friction."""
    p1, p2, p3, p4, p5, p6 = SEGMENT
    m11 = p1 + p2 * math.cos(2 * q[1]) + p3 * math.cos(2 * q[2]) + p4 * math.cos(q[1]) * math.sin(q[2])
    m23 = -p4 / 2 * math.sin(q[1] - q[2])
    d2 = -2 * p2 * math.sin(2 * q[1]) - p4 * math.sin(q[1]) * math.sin(q[2])
    d3 = -2 * p3 * math.sin(2 * q[2]) + p4 * math.cos(q[1]) * math.cos(q[2])
    k = p4 / 2 * math.cos(q[1] - q[2])
    tau = [sum(jacobian[axis][joint] * force[axis] for axis in range(3)) for joint in range(3)]
    b1 = tau[0] - (d2 * dq[1] + d3 * dq[2]) * dq[0]
    b2 = tau[1] + d2 * dq[0] ** 2 / 2 - k * dq[2] ** 2
    b3 = tau[2] + d3 * dq[0] ** 2 / 2 + k * dq[1] ** 2
    determinant = p5 * p6 - m23 * m23
    return b1 / m11, (p6 * b2 - m23 * b3) / determinant, (p5 * b3 - m23 * b2) / determinant


def constant(delay):
    return lambda t, middle: delay


def sinusoidal(low, high, period, phase):
    return lambda t, middle: low + (high - low) / 2 * (1 + math.sin(2 * math.pi * t / period + phase))


def sawtooth(low, high, period):
    """Rises from low to high in every period, then falls at once."""
    return lambda t, middle: low + (high - low) * (t / period - math.floor(middle / period))


class MonolithicLoop:
    """Local and remote arm, coupled with gains K [N/m], B [N s/m] over a law of delay [s] there and one back."""

    def __init__(self, there, back, step, stiffness=0.25, damping=0.09, amplitude=0.004, release=20.0):
        self.delays, self.step, self.stiffness, self.damping = (back, there), step, stiffness, damping
        self.amplitude, self.release = amplitude, release
        self.positions, self.velocities = [], []

    def state(self, q_start=(0.0, 0.3, 0.4)):
        return (*q_start, 0.0, 0.0, 0.0) * 2

    def operator(self, time, middle):
        if middle > self.release:
            return (0.0, 0.0, 0.0)
        wave = self.amplitude * math.sin(2 * math.pi * 0.05 * time)
        return (wave, 0.8 * wave, 0.6 * wave)

    def past(self, time, arm):
        """Tip of an arm at an earlier time, by cubic Hermite; the start before time 0."""
        if time <= 0.0:
            return self.positions[0][arm]
        place = time / self.step
        i = min(int(place + 1e-9), len(self.positions) - 2)
        s, h = place - i, self.step
        h00, h10, h01, h11 = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2, s * s * (3 - 2 * s), s * s * (s - 1)
        return [
            h00 * a + h10 * h * va + h01 * b + h11 * h * vb
            for a, va, b, vb in zip(
                self.positions[i][arm], self.velocities[i][arm], self.positions[i + 1][arm], self.velocities[i + 1][arm]
            )
        ]

    def rates(self, time, y, middle):
        tips = [tip(y[0:3]), tip(y[6:9])]
        out = []
        for arm, other in ((0, 1), (1, 0)):
            q, dq = y[6 * arm : 6 * arm + 3], y[6 * arm + 3 : 6 * arm + 6]
            delay = self.delays[arm](time, middle)
            (x, jacobian), far = tips[arm], tips[other][0] if delay == 0.0 else self.past(time - delay, other)
            dx = [sum(row[j] * dq[j] for j in range(3)) for row in jacobian]
            force = [self.stiffness * (far[i] - x[i]) - self.damping * dx[i] for i in range(3)]
            if arm == 0:
                force = [f + o for f, o in zip(force, self.operator(time, middle))]
            out += [*dq, *acceleration(q, dq, force, jacobian)]
        return out

    def keep(self, y):
        positions, velocities = [], []
        for arm in (0, 1):
            x, jacobian = tip(y[6 * arm : 6 * arm + 3])
            dq = y[6 * arm + 3 : 6 * arm + 6]
            positions.append(x)
            velocities.append([sum(row[j] * dq[j] for j in range(3)) for row in jacobian])
        self.positions.append(positions)
        self.velocities.append(velocities)

    def run(self, stop):
        """Time (n,), joint states (n, 12) and tips (n, 2, 3)."""
        h, y = self.step, self.state()
        states = [y]
        self.keep(y)
        for n in range(round(stop / h)):
            t, middle = n * h, (n + 0.5) * h
            k1 = self.rates(t, y, middle)
            k2 = self.rates(t + h / 2, [a + h / 2 * b for a, b in zip(y, k1)], middle)
            k3 = self.rates(t + h / 2, [a + h / 2 * b for a, b in zip(y, k2)], middle)
            k4 = self.rates(t + h, [a + h * b for a, b in zip(y, k3)], middle)
            y = [a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in zip(y, k1, k2, k3, k4)]
            states.append(y)
            self.keep(y)
        return np.arange(len(states)) * h, np.array(states), np.array(self.positions)
