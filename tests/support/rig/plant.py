"""A batch of PHANToM arms with friction and hidden effects, integrated at once by RK4; every field is (S,) or (3, S).

    M(q) ddq + C(q, dq) dq + N(q) = delivered torque - friction - required torques of the effects
    energies: T = 1/2 M11 w1^2 + 1/2 p5 w2^2 + 1/2 p6 w3^2 - p4/2 sin(q2 - q3) w2 w3,  V = p7 sin q2 - p8 cos q3

Friction is either a smooth law (tanh or algebraic) inside the Runge-Kutta stages, or a true sign law with stiction by
an impulse after each step that stops the joint when it can (Moreau's time stepping).
"""

from dataclasses import dataclass, field, fields

import numpy as np

L1, L2 = 0.215, 0.170
SEGMENT = (
    np.array((2.832787775, 1.1318928125, -0.3912006625, 0.91229875, 2.426395625, 0.931885625, -16.2980397, -73.7552097))
    * 1e-3
)
SIGN, TANH, ALGEBRAIC = 0, 1, 2
ELEMENTS = 3  # elasto-plastic elements of a presliding friction
NEXT, BEFORE = [1, 2, 0], [2, 0, 1]  # of each joint, the next one and the one before


def _joint(value=0.0):
    return field(default_factory=lambda: np.full(3, value))


@dataclass
class RigPlant:
    """One arm. All zero effects: the complete model (rigid body, viscous and Coulomb friction)."""

    pi: np.ndarray = field(default_factory=lambda: SEGMENT.copy())
    viscous: np.ndarray = field(default_factory=lambda: np.array((2.0e-3, 1.5e-3, 1.0e-3)))
    coulomb: np.ndarray = field(default_factory=lambda: np.array((25e-3, 9e-3, 9e-3)))
    law: float = TANH
    width: float = 0.01  # rad/s, of the smooth laws
    stribeck: np.ndarray = _joint()  # N.m above Coulomb at rest
    stribeck_velocity: np.ndarray = _joint(0.1)
    stribeck_exponent: float = 2.0  # 2 Gaussian, 1 exponential (Tustin)
    coulomb_up: np.ndarray = _joint()  # added to the level of positive motion
    coulomb_down: np.ndarray = _joint()
    viscous_up: np.ndarray = _joint()
    viscous_down: np.ndarray = _joint()
    offset: np.ndarray = _joint()
    load: np.ndarray = _joint()  # friction per transmitted torque
    friction_wave: np.ndarray = _joint()  # Coulomb level times (1 + wave cos(q - phase))
    friction_phase: np.ndarray = _joint(0.7)
    spring: np.ndarray = _joint()  # N.m/rad about spring_zero
    spring_zero: np.ndarray = _joint(0.3)
    spring_cubic: np.ndarray = _joint()
    ripple: np.ndarray = _joint()
    ripple_order: np.ndarray = _joint(11.0)
    ripple_phase: np.ndarray = _joint(0.4)
    presliding: np.ndarray = _joint()  # N.m of elasto-plastic elements
    presliding_length: np.ndarray = _joint(0.02)
    drag: np.ndarray = _joint()
    lag: np.ndarray = _joint()
    delay: np.ndarray = _joint()
    gain: np.ndarray = _joint()
    limit_share: np.ndarray = _joint(0.0)  # of the torque along the reference that lies beyond the drive's limit
    deadband: np.ndarray = _joint()
    compliance: np.ndarray = _joint()  # rad/(N.m); 0 rigid
    motor_inertia: np.ndarray = _joint(3e-4)
    gap: np.ndarray = _joint()  # rad, whole width of the backlash
    payload: float = 0.0
    tilt: np.ndarray = field(default_factory=lambda: np.zeros(2))
    encoder_offset: np.ndarray = _joint()
    warm_up: np.ndarray = _joint()  # friction times (1 + warm_up (1 - exp(-t / warm_time)))
    warm_time: float = 40.0
    wall_stiffness: float = 0.0
    wall_damping: float = 0.0
    wall_normal: np.ndarray = field(default_factory=lambda: np.array((0.0, 0.0, 1.0)))
    wall_share: float = 0.85  # of the reference that lies before the wall
    couple_viscous: np.ndarray = field(default_factory=lambda: np.zeros(9))  # [3 i + j]: torque on i from joint j
    couple_coulomb: np.ndarray = field(default_factory=lambda: np.zeros(9))
    couple_spring: np.ndarray = field(default_factory=lambda: np.zeros(9))
    # outside the library
    hum: np.ndarray = _joint()  # N.m sin(2 pi f t)
    hum_frequency: float = 0.37
    drag_at_angle: np.ndarray = _joint()  # b q^2 dq
    cross: np.ndarray = _joint()  # c dq1 dq2
    eddy: np.ndarray = _joint()  # c v / (1 + (v/v0)^2)
    eddy_velocity: np.ndarray = _joint(0.5)
    touch: np.ndarray = _joint()  # N.m between touch_from and touch_to
    touch_from: float = 12.0
    touch_to: float = 20.0
    wander: np.ndarray = _joint()  # N.m, a random walk with a corner of 0.05 Hz
    fading_gain: np.ndarray = _joint()  # 1/(N.m)^2: the drive delivers u (1 - c u^2), iron that saturates
    eccentric: np.ndarray = _joint()  # rad: the encoder shows q + e sin(3 q), a disc off its centre behind a gear
    squeeze: np.ndarray = _joint()  # Coulomb level times (1 + c q_next^2): cables that the next joint tightens
    sticky: np.ndarray = (
        _joint()
    )  # share by which the Coulomb level jumps up for 1.5 s in every 4, dirt on a wheel that turns slowly
    loaded_ripple: np.ndarray = _joint()  # of the delivered torque, times sin(order q): a toothed gear
    flywheel: np.ndarray = _joint()  # kg.m^2: torque from the acceleration of the next joint, a motor carried along
    windage: np.ndarray = _joint()  # N.m.s^3: c v^3
    crosstalk: np.ndarray = _joint()  # of the next joint's command, added to this one's: amplifiers that share a rail
    sag: np.ndarray = _joint()  # 1/s: the drive delivers u exp(-c t), magnets that warm up
    lost_counts: np.ndarray = _joint()  # rad by which the encoder is off from `lost_at` on
    lost_at: float = 9.0
    bumper: np.ndarray = _joint()  # N.m/rad of a rubber stop beyond `bumper_from`
    bumper_from: float = 0.15


def stack(plants):
    """Fields of many plants as arrays with the run as the last axis."""
    return Batch(
        {f.name: np.stack([np.asarray(getattr(p, f.name), float) for p in plants], axis=-1) for f in fields(RigPlant)}
    )


class Batch:
    """Fields of S plants; `with_payload` is applied to pi here (a point mass at the tip)."""

    def __init__(self, values):
        self.__dict__.update(values)
        m, g = self.payload, 9.81
        l1, l2 = L1, L2
        # point mass at (l1 c2 + l2 s3): M11 += m r^2; M22 += m l1^2; M33 += m l2^2; M23 += -m l1 l2 sin(q2-q3)
        extra = np.array((l1**2 / 2 + l2**2 / 2, l1**2 / 2, -(l2**2) / 2, 2 * l1 * l2, l1**2, l2**2, g * l1, g * l2))
        self.true_pi = self.pi + extra[:, None] * m
        self.size = m.shape[-1]
        self.elastic = bool((self.compliance > 0).any() or (self.gap > 0).any())
        self.wall_place, self.limit = np.full(self.size, 1e9), np.full((3, self.size), 1e9)
        self.active = {k: bool(np.any(v)) for k, v in values.items()}


def rigid_terms(p, q, w, tilt):
    """M (five entries), and C dq + N (3, S) of the Lagrange equations, gravity leaning by `tilt` (2, S) [rad]."""
    q1, q2, q3 = q
    w1, w2, w3 = w
    s2, c2, s3, c3 = np.sin(q2), np.cos(q2), np.sin(q3), np.cos(q3)
    sd, cd = s2 * c3 - c2 * s3, c2 * c3 + s2 * s3
    p1, p2, p3, p4, p5, p6, p7, p8 = p
    m11 = p1 + p2 * (1 - 2 * s2 * s2) + p3 * (1 - 2 * s3 * s3) + p4 * c2 * s3
    m23 = -0.5 * p4 * sd
    d2 = -4 * p2 * s2 * c2 - p4 * s2 * s3
    d3 = -4 * p3 * s3 * c3 + p4 * c2 * c3
    h1 = (d2 * w2 + d3 * w3) * w1
    h2 = -0.5 * d2 * w1 * w1 + 0.5 * p4 * cd * w3 * w3
    h3 = -0.5 * d3 * w1 * w1 - 0.5 * p4 * cd * w2 * w2
    n2, n3 = p7 * c2, p8 * s3
    if tilt is None:
        return m11, p5, p6, m23, np.stack((h1, h2 + n2, h3 + n3))
    # V = p7 u.up + p8 f.up with u = (s1 c2, s2, c1 c2), f = (s1 s3, -c3, c1 s3), up ~ (tilt_x, 1, tilt_z) normalised
    a, b = tilt
    norm = 1 / np.sqrt(1 + a * a + b * b)
    s1, c1 = np.sin(q1), np.cos(q1)
    reach = p7 * c2 + p8 * s3
    g1 = (a * c1 - b * s1) * reach
    side = a * s1 + b * c1
    return (
        m11,
        p5,
        p6,
        m23,
        np.stack((h1 + norm * g1, h2 + norm * (n2 - p7 * s2 * side), h3 + norm * (n3 + p8 * c3 * side))),
    )


def solve(m11, m22, m33, m23, f):
    """M^-1 f for the arm's mass matrix, f (3, S)."""
    det = m22 * m33 - m23 * m23
    out = np.empty(f.shape)
    out[0] = f[0] / m11
    out[1] = (m33 * f[1] - m23 * f[2]) / det
    out[2] = (m22 * f[2] - m23 * f[1]) / det
    return out


def tip(q):
    r = L1 * np.cos(q[1]) + L2 * np.sin(q[2])
    return np.stack((np.sin(q[0]) * r, L2 - L2 * np.cos(q[2]) + L1 * np.sin(q[1]), np.cos(q[0]) * r - L1))


def tip_torque(q, f):
    """J^T f by the derivatives of `tip`."""
    s1, c1 = np.sin(q[0]), np.cos(q[0])
    r = L1 * np.cos(q[1]) + L2 * np.sin(q[2])
    along = s1 * f[0] + c1 * f[2]
    return np.stack(
        (
            r * (c1 * f[0] - s1 * f[2]),
            -L1 * np.sin(q[1]) * along + L1 * np.cos(q[1]) * f[1],
            L2 * np.cos(q[2]) * along + L2 * np.sin(q[2]) * f[1],
        )
    )


def tip_velocity(q, w):
    s1, c1 = np.sin(q[0]), np.cos(q[0])
    r = L1 * np.cos(q[1]) + L2 * np.sin(q[2])
    dr = -L1 * np.sin(q[1]) * w[1] + L2 * np.cos(q[2]) * w[2]
    return np.stack(
        (c1 * w[0] * r + s1 * dr, L2 * np.sin(q[2]) * w[2] + L1 * np.cos(q[1]) * w[1], -s1 * w[0] * r + c1 * dr)
    )


def smooth_sign(b, w):
    return np.where(b.law == ALGEBRAIC, w / np.sqrt(w * w + b.width**2), np.tanh(w / b.width))


def levels(b, q, w, drive, t, positive):
    """Coulomb level (3, S) of the direction of motion, everything that scales with the sign of the velocity."""
    level = b.coulomb + np.where(positive, b.coulomb_up, b.coulomb_down)
    if b.active["stribeck"]:
        ratio = np.abs(w) / b.stribeck_velocity
        level = level + b.stribeck * np.exp(-(ratio**b.stribeck_exponent))
    if b.active["friction_wave"]:
        level = level * (1 + b.friction_wave * np.cos(q - b.friction_phase))
    if b.active["load"]:
        level = level + b.load * np.abs(drive)
    if b.active["warm_up"]:
        level = level * (1 + b.warm_up * (1 - np.exp(-t / b.warm_time)))
    if b.active["squeeze"]:
        level = level * (1 + b.squeeze * q[NEXT] ** 2)
    if b.active["sticky"]:
        level = level * (1 + b.sticky * (np.mod(t, 4.0) < 1.5))
    return level


def resisting(b, q, w, t, slip, drive):
    """Torques (3, S) that the motor must supply besides the rigid body, sign friction of `SIGN` runs left out."""
    viscous = b.viscous + np.where(w > 0, b.viscous_up, b.viscous_down)
    out = viscous * w
    if b.active["warm_up"]:
        out = out * (1 + b.warm_up * (1 - np.exp(-t / b.warm_time)))
    s = smooth_sign(b, w)
    out = out + np.where(b.law == SIGN, 0.0, levels(b, q, w, drive, t, s > 0) * s)
    out = out + b.offset
    a = b.active
    if a["spring"] or a["spring_cubic"]:
        d = q - b.spring_zero
        out = out + b.spring * d + b.spring_cubic * d**3
    if a["ripple"]:
        out = out + b.ripple * np.sin(b.ripple_order * q + b.ripple_phase)
    if a["presliding"]:
        out = out + b.presliding * (np.add.reduce(slip, axis=0) / ELEMENTS)
    if a["drag"]:
        out = out + b.drag * w * np.abs(w)
    if a["couple_viscous"] or a["couple_coulomb"] or a["couple_spring"]:
        sign = np.tanh(w / 0.01)
        for j in range(3):  # [j::3]: torques on all joints from joint j
            out = out + b.couple_viscous[j::3] * w[j] + b.couple_coulomb[j::3] * sign[j] + b.couple_spring[j::3] * q[j]
    if a["hum"]:
        out = out + b.hum * np.sin(2 * np.pi * b.hum_frequency * t)
    if a["drag_at_angle"]:
        out = out + b.drag_at_angle * q * q * w
    if a["cross"]:
        out = out + b.cross * w[0] * w[1]
    if a["eddy"]:
        out = out + b.eddy * w / (1 + (w / b.eddy_velocity) ** 2)
    if a["touch"]:
        out = out + b.touch * ((t > b.touch_from) & (t < b.touch_to))
    if a["windage"]:
        out = out + b.windage * w**3
    if a["bumper"]:
        out = out + b.bumper * np.maximum(q - b.bumper_from, 0.0)
    if a["loaded_ripple"]:
        out = out + b.loaded_ripple * np.abs(drive) * np.sin(b.ripple_order * q + b.ripple_phase)
    return out


def wall(b, q, w):
    """J^T f of a wall that the tip meets; unilateral spring and damper."""
    x, v = tip(q), tip_velocity(q, w)
    deep = (x * b.wall_normal).sum(axis=0) - b.wall_place
    speed = (v * b.wall_normal).sum(axis=0)
    force = np.where(deep > 0, np.maximum(b.wall_stiffness * deep + b.wall_damping * speed, 0.0), 0.0)
    return tip_torque(q, -force * b.wall_normal)


class Arms:
    """State of S arms and the step that advances them by `h` seconds under a held torque command."""

    def __init__(self, b, q, h):
        self.b, self.h, self.t = b, h, 0.0
        self.q, self.w = q.copy(), np.zeros_like(q)
        self.qm, self.wm = q.copy(), np.zeros_like(q)
        self.slip = np.zeros((ELEMENTS, *q.shape))
        self.lagged = np.zeros_like(q)
        self.buffer = np.zeros((int(np.ceil(b.delay.max() / h)) + 2, *q.shape))
        self.count = 0
        self.tilt = b.tilt if b.active["tilt"] else None

    @property
    def angle(self):
        """What the encoder sits on: the motor where a joint is elastic."""
        return np.where(self.b.compliance > 0, self.qm, self.q) if self.b.elastic else self.q

    def delivered(self, command, wander):
        b = self.b
        u = (1 + b.gain) * command
        if b.active["crosstalk"]:
            u = u + b.crosstalk * command[NEXT]
        if b.active["sag"]:
            u = u * np.exp(-b.sag * self.t)
        if b.active["delay"]:
            self.buffer[self.count % len(self.buffer)] = u
            back = np.minimum(np.round(b.delay / self.h).astype(int), self.count)
            u = np.take_along_axis(self.buffer, ((self.count - back) % len(self.buffer))[None], axis=0)[0]
        self.count += 1
        if b.active["fading_gain"]:
            u = u * (1 - np.minimum(b.fading_gain * u**2, 1 / 3))
        u = np.clip(u, -b.limit, b.limit)
        if b.active["deadband"]:
            u = np.sign(u) * np.maximum(np.abs(u) - b.deadband, 0.0)
        if b.active["lag"]:
            fade = np.where(b.lag > 0, np.exp(-self.h / np.maximum(b.lag, 1e-9)), 0.0)
            self.lagged = u + (self.lagged - u) * fade
            u = self.lagged
        return u - wander

    def step(self, command, wander):
        b, h = self.b, self.h
        u = self.delivered(command, wander)
        (self._elastic if b.elastic else self._rigid)(u)
        if b.active["presliding"]:
            moving = np.where(b.compliance > 0, self.wm, self.w) if b.elastic else self.w
            for k in range(ELEMENTS):
                self.slip[k] = np.clip(self.slip[k] + moving * h / (b.presliding_length * (0.4 + 0.6 * k)), -1, 1)
        self.t += h

    def _rigid(self, u):
        b, h, t = self.b, self.h, self.t

        def rates(q, w, t):
            m11, m22, m33, m23, n = rigid_terms(b.true_pi, q, w, self.tilt)
            force = u - n - resisting(b, q, w, t, self.slip, u)
            if b.active["wall_stiffness"]:
                force = force + wall(b, q, w)
            acceleration = solve(m11, m22, m33, m23, force)
            for _ in range(8 if b.active["flywheel"] else 0):  # a small part of the mass matrix: iterated
                carried = b.flywheel * acceleration[NEXT] + (b.flywheel * acceleration)[BEFORE]
                acceleration = solve(m11, m22, m33, m23, force - carried)
            return w, acceleration

        self.q, self.w = rk4(rates, self.q, self.w, t, h)
        self.w = self._stopped(self.q, self.w, u)

    def _stopped(self, q, w, u):
        b, h = self.b, self.h
        if not (b.law == SIGN).any():
            return w
        level = np.where(b.law == SIGN, levels(b, q, w, u, self.t, w > 0), 0.0)
        m11, m22, m33, m23, _ = rigid_terms(b.true_pi, q, w, None)
        det = m22 * m33 - m23 * m23
        i22, i33, i23 = m33 / det, m22 / det, -m23 / det
        f1 = np.clip(m11 * w[0] / h, -level[0], level[0])
        f2, f3 = np.zeros_like(f1), np.zeros_like(f1)
        for _ in range(3):  # projected Gauss-Seidel on the impulses of joints 2 and 3
            f2 = np.clip(f2 + (w[1] / h - i22 * f2 - i23 * f3) / i22, -level[1], level[1])
            f3 = np.clip(f3 + (w[2] / h - i23 * f2 - i33 * f3) / i33, -level[2], level[2])
        return np.stack((w[0] - h * f1 / m11, w[1] - h * (i22 * f2 + i23 * f3), w[2] - h * (i23 * f2 + i33 * f3)))

    def _elastic(self, u):
        b, h, t = self.b, self.h, self.t
        soft = b.compliance > 0
        stiffness = np.where(soft, 1 / np.maximum(b.compliance, 1e-9), 0.0)
        damping = 2 * 0.05 * np.sqrt(stiffness * b.motor_inertia)

        def transmitted(q, w, qm, wm):
            twist = qm - q
            beyond = twist - np.clip(twist, -b.gap / 2, b.gap / 2)
            engaged = (np.abs(twist) >= b.gap / 2) | (b.gap == 0)
            return stiffness * beyond + np.where(engaged, damping * (wm - w), 0.0)

        def rates(x, v, t):
            q, qm, w, wm = x[:3], x[3:], v[:3], v[3:]
            m11, m22, m33, m23, n = rigid_terms(b.true_pi, q, w, self.tilt)
            link = transmitted(q, w, qm, wm)
            rub = resisting(b, np.where(soft, qm, q), np.where(soft, wm, w), t, self.slip, u)
            force = np.where(soft, link, u - rub) - n
            if b.active["wall_stiffness"]:
                force = force + wall(b, q, w)
            am = np.where(soft, (u - link - rub) / b.motor_inertia, 0.0)
            return v, np.concatenate((solve(m11, m22, m33, m23, force), am))

        x, v = rk4(rates, np.concatenate((self.q, self.qm)), np.concatenate((self.w, self.wm)), t, h)
        self.q, self.w, self.qm, self.wm = x[:3], v[:3], x[3:], v[3:]


def rk4(rates, x, v, t, h):
    a1, b1 = rates(x, v, t)
    a2, b2 = rates(x + h / 2 * a1, v + h / 2 * b1, t + h / 2)
    a3, b3 = rates(x + h / 2 * a2, v + h / 2 * b2, t + h / 2)
    a4, b4 = rates(x + h * a3, v + h * b3, t + h)
    return x + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4), v + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
