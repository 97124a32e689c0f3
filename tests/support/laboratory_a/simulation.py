"""Closed loops integrated side by side: pieces of the recording times variants of the plant, third-order
Adams-Bashforth.

A long recording is cut into pieces; each starts a second or two early, on its reference, so that at its first logged
sample the loop has forgotten how it was started. A column is one piece of one variant.
"""

from dataclasses import dataclass

import numpy as np

from tests.support.laboratory_a.laws import LaboratoryLaw, LoopMoment

WEIGHTS = np.array([[1, 0, 0], [1.5, -0.5, 0], [23 / 12, -16 / 12, 5 / 12]])


@dataclass(frozen=True)
class ControlledArm:
    """An arm with drives under its controller. Per joint (n,): rotor, friction, gains; joint: the one with the laws."""

    arm: object
    rotor: np.ndarray
    coulomb: np.ndarray
    viscous: np.ndarray
    smooth: np.ndarray
    sign: object
    kp: np.ndarray
    kd: np.ndarray
    ki: np.ndarray
    joint: int
    other: int
    encoder_at_motor: bool


@dataclass(frozen=True)
class SidePieces:
    """Which steps of the whole time axis each column runs through. reference: (4 n, N): q, dq, feedforward,
    at-rest torque."""

    h: float
    reference: np.ndarray
    time: np.ndarray
    first: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    warm: int
    length: int
    every: int

    def logged(self) -> list[np.ndarray]:
        """The logged steps of each piece."""
        ends = np.minimum(self.first + self.length, self.highest + 1)
        return [np.arange(first, end, self.every) for first, end in zip(self.first, ends)]


@dataclass(frozen=True)
class NoiselessSignals:
    """Noiseless signals (n, V, N): measured q and its derivatives, commands."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    u: np.ndarray


def begin(loop: ControlledArm, laws, amplitudes, h: float):
    """The arm with its mounting, and what stands in the joint, the drive, the gear and the encoder."""
    arm, torques, drives, gear, offset = loop.arm, [], [], None, 0.0
    for law, a in zip(laws, amplitudes):
        made = law.begin(a, h)
        if law.place == "joint":
            torques.append(made)
        elif law.place == "drive":
            drives.append(made)
        elif law.place == "gear":
            gear = made
        elif law.place == "payload":
            arm = arm.with_payload(a, made)
        elif law.place == "tilt":
            arm = arm.tilted(a, made)
        else:
            offset = offset + a
    return arm, torques, drives, gear, offset


def simulate(
    loop: ControlledArm, pieces: SidePieces, laws: list[LaboratoryLaw], amplitudes: np.ndarray
) -> NoiselessSignals:
    """amplitudes (laws, V), 0 where a law is absent."""
    h, n, j = pieces.h, loop.arm.n, loop.joint
    count, variants = len(pieces.first), amplitudes.shape[1]
    wide = np.tile(np.arange(count), variants)
    arm, torques, drives, gear, offset = begin(loop, laws, np.repeat(amplitudes, count, axis=1), h)
    size = len(wide)
    steps = pieces.warm + pieces.length
    index = pieces.first - pieces.warm + np.arange(steps)[:, None]
    inside = np.clip(index, pieces.lowest, pieces.highest)
    references = pieces.reference[:, inside].transpose(1, 0, 2)
    references[:, n : 2 * n][np.broadcast_to((index < pieces.lowest)[:, None], (steps, n, count))] = 0
    times = (pieces.time[inside] + (index - inside) * h)[:, wide]

    column = lambda x: np.asarray(x, dtype=float)[:, None]  # noqa: E731
    rotor, kp, kd, ki = column(loop.rotor), column(loop.kp), column(loop.kd), column(loop.ki)
    coulomb, viscous, smooth = column(loop.coulomb), column(loop.viscous), column(loop.smooth)
    carried = np.broadcast_to(rotor, (n, size)).copy()
    transmit, flexible = gear or (None, None)
    if gear:
        carried[j, flexible] = 0
    at_motor = gear is not None and loop.encoder_at_motor

    start = references[0][:, wide]
    q, v = start[:n].copy(), start[n : 2 * n].copy()
    integral = start[3 * n :].copy()
    theta, omega = q[j].copy(), v[j].copy()
    a = np.zeros_like(q)
    history = [np.zeros((3, *q.shape)), np.zeros((3, *q.shape)), np.zeros((3, 2, size))]
    load = np.zeros(size)
    shift = np.zeros((n, 1)) + np.zeros(size)
    shift[j] = offset
    rows = range(pieces.warm, steps, pieces.every)
    kept = np.empty((4, len(rows), n, size))

    for k in range(steps):
        r = references[k][:, wide]
        drive_q, drive_v = (theta, omega) if gear else (q[j], v[j])
        mq, mv = q + shift, v
        if at_motor:
            mq, mv = mq.copy(), v.copy()
            mq[j], mv[j] = theta + offset, omega
        error = r[:n] - mq
        integral += h * ki * error
        u = r[2 * n : 3 * n] + kp * error + kd * (r[n : 2 * n] - mv) + integral
        now = LoopMoment(times[k], drive_q, drive_v, load, u[j], q[loop.other], v[loop.other], a[loop.other])
        given = u[j]
        for drive in drives:
            now.u = given
            given = drive(now)
        if gear:
            side = v.copy()
            side[j] = omega
        else:
            side = v
        torque = u - coulomb * loop.sign(side / smooth) - viscous * side
        own = torque[j] + given - u[j]
        for law in torques:
            own = own + law(now)
        torque[j] = own
        if gear:
            through = transmit(theta - q[j], omega - v[j])
            torque[j] = np.where(flexible, through, own)
        a = arm.accelerate(q, v, torque, carried)
        load = torque[j] - carried[j] * a[j]
        alpha = np.where(flexible, (own - through) / loop.rotor[j], a[j]) if gear else a[j]
        if k >= pieces.warm and (k - pieces.warm) % pieces.every == 0:
            at = (k - pieces.warm) // pieces.every
            ma = a
            if at_motor:
                ma = a.copy()
                ma[j] = alpha
            kept[:, at] = mq, mv, ma, u
        slot, order = k % 3, min(k, 2)
        for past, rate in zip(history, (v, a, np.stack([omega, alpha]) if gear else None)):
            if rate is not None:
                past[slot] = rate
        w = h * WEIGHTS[order]
        one, two = (slot - 1) % 3, (slot - 2) % 3
        past = history[0]
        q = q + (w[0] * past[slot] + w[1] * past[one] + w[2] * past[two])
        past = history[1]
        v = v + (w[0] * past[slot] + w[1] * past[one] + w[2] * past[two])
        if gear:
            past = history[2]
            turn, rise = w[0] * past[slot] + w[1] * past[one] + w[2] * past[two]
            theta, omega = theta + turn, omega + rise
    return NoiselessSignals(*join(kept, pieces, variants, count))


def join(kept, pieces: SidePieces, variants: int, count: int):
    """(4, n, V, N): the pieces end to end; the last piece of a run is cut at the start of the next."""
    four, rows, n, _ = kept.shape
    whole = kept.reshape(four, rows, n, variants, count).transpose(0, 2, 3, 4, 1)
    return np.concatenate([whole[..., k, : len(rows)] for k, rows in enumerate(pieces.logged())], axis=-1)
