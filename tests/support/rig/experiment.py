"""The experiment: sums of sinusoids under a sampled PD controller, quantised encoders, noisy torque, 1 kHz."""

from dataclasses import dataclass, field

import numpy as np

from tests.support.rig.plant import Arms, rigid_terms, stack, tip

CENTRE = np.array((0.0, 0.25, 0.35))
REACH = np.array((0.75, 0.45, 0.45))


@dataclass
class RigExperiment:
    """How one run is excited and recorded. Frequencies [rad/s]; noise [N.m]; resolution [rad]."""

    seed: int = 0
    lowest: float = 0.11
    highest: float = 5.0
    tones: int = 10
    scale: float = 1.0  # of the amplitudes
    noise: float = 5e-4
    resolution: np.ndarray = field(default_factory=lambda: np.array((0.118e-3, 0.140e-3, 0.140e-3)))
    bandwidth: float = 40.0  # rad/s, of the position loop
    gravity: bool = True  # feed forward of the weight


@dataclass
class Measured:
    """time (n,), q, tau, q_ref (n, 3) of one run and whether the arm stayed in reach."""

    time: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    q_ref: np.ndarray
    good: bool


def references(experiments, time):
    """q_ref (n, 3, S) and its rate: random phases, amplitudes that share the reach, started smoothly from rest."""
    n, size = len(time), len(experiments)
    ref, rate = np.zeros((n, 3, size)), np.zeros((n, 3, size))
    ramp = np.clip(time / 2.0, 0, 1)
    ramp, slope = ramp**2 * (3 - 2 * ramp), np.where(time < 2.0, 6 * ramp * (1 - ramp) / 2.0, 0.0)
    for s, e in enumerate(experiments):
        random = np.random.default_rng(1000 + e.seed)
        for j in range(3):
            w = np.linspace(e.lowest, e.highest, e.tones) * random.uniform(0.9, 1.1, e.tones)
            amplitude = random.uniform(0.5, 1.0, e.tones)
            phase = random.uniform(0, 2 * np.pi, e.tones)
            wave = np.sin(np.outer(time, w) + phase) @ amplitude
            factor = e.scale * REACH[j] / np.abs(wave).max()
            dwave = np.cos(np.outer(time, w) + phase) @ (amplitude * w)
            ref[:, j, s] = CENTRE[j] + factor * wave * ramp
            rate[:, j, s] = factor * (dwave * ramp + wave * slope)
    return ref, rate


def required(plant, q, w):
    """Torque (3, n) that the rigid arm with its friction needs to follow q, w (3, n), sampled at 1 kHz."""
    m11, m22, m33, m23, n = rigid_terms(plant.pi, q, w, None)
    a = np.gradient(w, 1e-3, axis=1)
    inertial = np.stack((m11 * a[0], m22 * a[1] + m23 * a[2], m33 * a[2] + m23 * a[1]))
    return inertial + n + plant.viscous[:, None] * w + plant.coulomb[:, None] * np.tanh(w / 0.02)


def record(plants, experiments, duration=30.0, substeps=2):
    """Measured runs, one for each plant and experiment; rigid and elastic arms are integrated as one batch each."""
    runs = [None] * len(plants)
    soft = [bool((np.asarray(p.compliance) > 0).any()) for p in plants]
    for kind in (False, True):
        members = [k for k, s in enumerate(soft) if s is kind]
        if members:
            made = _batch([plants[k] for k in members], [experiments[k] for k in members], duration, substeps)
            for k, run in zip(members, made, strict=True):
                runs[k] = run
    return runs


def _batch(plants, experiments, duration, substeps):
    b = stack(plants)
    n = round(duration * 1000) + 1
    time = np.arange(n) / 1000
    ref, rate = references(experiments, time)
    for s in range(b.size):
        b.wall_place[s] = np.quantile(b.wall_normal[:, s] @ tip(ref[:, :, s].T), b.wall_share[s])
        if b.limit_share[:, s].any():
            need = np.abs(required(plants[s], ref[:, :, s].T, rate[:, :, s].T))
            b.limit[:, s] = [
                np.quantile(x, 1 - share) if share else 1e9 for x, share in zip(need, b.limit_share[:, s], strict=True)
            ]
    randoms = [np.random.default_rng(17 + e.seed) for e in experiments]  # a run is the same in whatever batch
    noise = np.stack(
        [e.noise * random.standard_normal((n, 3)) for e, random in zip(experiments, randoms, strict=True)], axis=-1
    )
    push = np.zeros_like(ref)
    for s in np.flatnonzero(b.wander.any(axis=0)):
        push[:, :, s] = randoms[s].standard_normal((n, 3)) * np.sqrt(2e-3 * 2 * np.pi * 0.05)
    resolution = np.stack([e.resolution for e in experiments], axis=-1)
    bandwidth = np.array([e.bandwidth for e in experiments])
    weight = np.array([float(e.gravity) for e in experiments])
    inertia = np.array((3.2e-3, 2.6e-3, 1.2e-3))[:, None]
    kp, kd = inertia * bandwidth**2, inertia * 1.6 * bandwidth
    arms = Arms(b, ref[0], 1e-3 / substeps)
    q_out, tau_out = np.zeros((n, 3, b.size)), np.zeros((n, 3, b.size))
    seen_before, rate_seen = None, np.zeros_like(ref[0])
    fade = np.exp(-1e-3 * 2 * np.pi * 60)
    walk = np.zeros_like(ref[0])
    for k in range(n):
        angle = (
            arms.angle + b.encoder_offset + b.eccentric * np.sin(3 * arms.angle) + b.lost_counts * (arms.t > b.lost_at)
        )
        seen = np.where(resolution > 0, np.round(angle / np.where(resolution > 0, resolution, 1)) * resolution, angle)
        if seen_before is not None:
            rate_seen = fade * rate_seen + (1 - fade) * (seen - seen_before) * 1000
        seen_before = seen
        feed = np.stack((0 * seen[0], b.pi[6] * np.cos(seen[1]), b.pi[7] * np.sin(seen[2]))) * weight
        command = kp * (ref[k] - seen) + kd * (rate[k] - rate_seen) + feed
        q_out[k], tau_out[k] = seen, command
        if b.active["wander"]:
            walk = walk * (1 - 1e-3 * 2 * np.pi * 0.05) + push[k]
        with np.errstate(all="ignore"):
            for _ in range(substeps):
                arms.step(command, b.wander * walk)
    tau_out += noise
    good = np.isfinite(q_out).all(axis=(0, 1)) & (np.abs(q_out).max(axis=(0, 1)) < 3)
    return [
        Measured(time, q_out[:, :, s].copy(), tau_out[:, :, s].copy(), ref[:, :, s].copy(), bool(good[s]))
        for s in range(b.size)
    ]


def write_csv(run, path):
    """The run as time, q1..q3, tau1..tau3."""
    np.savetxt(
        path,
        np.column_stack((run.time, run.q, run.tau)),
        delimiter=",",
        header="time,q1,q2,q3,tau1,tau2,tau3",
        comments="",
        fmt="%.9g",
    )
