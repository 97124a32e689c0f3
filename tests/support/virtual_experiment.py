"""Taati's experiment on a code path of its own: prescribed or PD-controlled motion, quantised encoders, 1 kHz.

`prescribed` needs no integration: the motion is a sum of sinusoids, the torque follows from the equations of motion.
`controlled` integrates the arm under a sampled PD controller (torque held over the sample), a batch of runs at a time.
The dynamics are written out here from the energies, not taken from `cosim.arm`.
"""

import numpy as np

TURN = 2 * np.pi
ENCODER = TURN / 4000 / np.array([13.3, 11.2, 11.2])  # rad a count (PHYSICS.md 1)
SMOOTH = 0.01  # rad/s, the sign of the velocity in the FMU PhantomArm


def mass_and_bias(pi, q, dq):
    """M11, p5, p6, M23 and C dq + N of the arm; pi (..., 8), q, dq (..., 3)."""
    p = np.moveaxis(pi, -1, 0)
    q2, q3 = q[..., 1], q[..., 2]
    w1, w2, w3 = np.moveaxis(dq, -1, 0)
    s2, c2, s3, c3 = np.sin(q2), np.cos(q2), np.sin(q3), np.cos(q3)
    m11 = p[0] + p[1] * (2 * c2 * c2 - 1) + p[2] * (2 * c3 * c3 - 1) + p[3] * c2 * s3
    slope2 = -4 * p[1] * s2 * c2 - p[3] * s2 * s3
    slope3 = -4 * p[2] * s3 * c3 + p[3] * c2 * c3
    m23 = -0.5 * p[3] * (s2 * c3 - c2 * s3)
    k = 0.5 * p[3] * (c2 * c3 + s2 * s3)
    bias = np.stack(
        [
            w1 * (slope2 * w2 + slope3 * w3),
            -0.5 * slope2 * w1 * w1 + k * w3 * w3 + p[6] * c2,
            -0.5 * slope3 * w1 * w1 - k * w2 * w2 + p[7] * s3,
        ],
        axis=-1,
    )
    return m11, p[4], p[5], m23, bias


def friction(params, dq, smooth=SMOOTH):
    return params[..., 8:11] * dq + params[..., 11:14] * dq / np.sqrt(dq * dq + smooth * smooth)


def torque(params, q, dq, ddq):
    m11, m22, m33, m23, bias = mass_and_bias(params[..., :8], q, dq)
    inertial = np.stack(
        [m11 * ddq[..., 0], m22 * ddq[..., 1] + m23 * ddq[..., 2], m23 * ddq[..., 1] + m33 * ddq[..., 2]], -1
    )
    return inertial + bias + friction(params, dq)


def acceleration(params, q, dq, tau):
    m11, m22, m33, m23, bias = mass_and_bias(params[..., :8], q, dq)
    net = tau - bias - friction(params, dq)
    det = m22 * m33 - m23 * m23
    return np.stack(
        [
            net[..., 0] / m11,
            (m33 * net[..., 1] - m23 * net[..., 2]) / det,
            (m22 * net[..., 2] - m23 * net[..., 1]) / det,
        ],
        axis=-1,
    )


def counted(q, resolution=ENCODER):
    """What the encoders read: the count below, as a counter of edges does, centred."""
    return np.round(q / resolution) * resolution


def prescribed(params, excitation, duration=60.0, noise=0.0, seed=0, resolution=ENCODER, rate=1000.0):
    """time (n,), q read (n, 3), tau (n, 3) for a motion that follows the excitation exactly."""
    time = np.arange(int(duration * rate)) / rate
    q, dq, ddq = excitation.motion(time)
    tau = torque(params, q, dq, ddq)
    if noise:
        tau = tau + noise * np.random.default_rng(seed).normal(size=tau.shape)
    return time, counted(q, resolution) if resolution is not None else q, tau


def controlled(params, excitations, duration=60.0, stiffness=2.0, damping=0.08, substeps=2, resolution=ENCODER):
    """time (n,), q read and tau (n, runs, 3): PD control at 1 kHz on read angles, torque held over the sample."""
    step = 1e-3
    time = np.arange(round(duration / step)) * step
    reference = np.stack([e.motion(time)[0] for e in excitations], axis=1)
    q, dq = reference[0].copy(), np.zeros_like(reference[0])
    read_before = counted(q, resolution)
    log_q, log_tau = np.empty_like(reference), np.empty_like(reference)
    rate, h = np.zeros_like(q), step / substeps
    for n in range(len(time)):
        read = counted(q, resolution)
        rate += 0.2 * ((read - read_before) / step - rate)
        read_before = read
        tau = stiffness * (reference[n] - read) - damping * rate
        log_q[n], log_tau[n] = read, tau
        for _ in range(substeps):
            a1 = acceleration(params, q, dq, tau)
            a2 = acceleration(params, q + h / 2 * dq, dq + h / 2 * a1, tau)
            a3 = acceleration(params, q + h / 2 * dq + h * h / 4 * a1, dq + h / 2 * a2, tau)
            a4 = acceleration(params, q + h * dq + h * h / 2 * a2, dq + h * a3, tau)
            q = q + h * dq + h * h / 6 * (a1 + a2 + a3)
            dq = dq + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return time, log_q, log_tau
