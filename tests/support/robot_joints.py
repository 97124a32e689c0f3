"""Joints of a seven-joint rig with laws of their own: friction, drives, encoders, and effects that a model may lack.

The links follow a given motion; what the motors command and what the encoders show follows from it. Nothing here
imports `cosim`. Where the literature has several laws for one effect these are others than the tool's, as in
`tests.support.rig.plant`: elasto-plastic elements, two Coulomb levels for an asymmetry, a warm-up of a time of its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from attrs import Factory, evolve, frozen

if TYPE_CHECKING:
    from tests.support.robot_rig import RigMotion, RobotRig

JOINTS = 7
VISCOUS = np.array([1.2, 0.9, 0.8, 0.9, 0.4, 0.5, 0.3])
COULOMB = np.array([0.8, 0.7, 0.6, 0.7, 0.3, 0.35, 0.25])
OFFSET = np.array([0.2, -0.3, 0.1, 0.25, -0.1, 0.05, 0.08])
FRICTION = np.array([0.9, 6.0, 1.4, 4.0, 0.3, 0.4, 0.25])
"""N m, Coulomb friction of the arm whose effects are looked for: a fifth of the RMS torque of its links (joint 7: as
`COULOMB`), as of an industrial arm (Staubli TX40: 15 to 30 %). Effects and noise are as large beside it as on the
three-joint rig."""
ROTOR = np.array([0.6, 0.6, 0.45, 0.45, 0.2, 0.2, 0.2])
ELEMENTS = 3  # elasto-plastic elements of a presliding friction
FINE = 10  # steps of the presliding state within one of the record
MOMENT = 1e-3  # s, of the differences that give rates of torques


def _joint(value: float = 0.0):
    return Factory(lambda: np.full(JOINTS, value))


@frozen(eq=False)
class RigJoints:
    """Fields (7,) by joint; all effects zero: the complete model with an offset. noise [N m] of torques, or of each
    joint's; width [rad/s] of tanh in place of the sign of a speed, 0: the sign.
    """

    viscous: np.ndarray = Factory(VISCOUS.copy)
    coulomb: np.ndarray = Factory(COULOMB.copy)
    offset: np.ndarray = Factory(OFFSET.copy)
    noise: np.ndarray | float = 0.05
    width: float = 0.0
    stribeck: np.ndarray = _joint()  # N m above Coulomb at rest
    up: np.ndarray = _joint()  # N m, Coulomb level of positive motion
    down: np.ndarray = _joint()
    viscous_up: np.ndarray = _joint()
    load: np.ndarray = _joint()  # friction per torque of the links
    wave: np.ndarray = _joint()  # Coulomb level times (1 + wave cos(q - 0.7))
    spring: np.ndarray = _joint()  # N m/rad^3 and a quarter of it N m/rad
    ripple: np.ndarray = _joint()  # N m sin(11 q + 0.4)
    presliding: np.ndarray = _joint()  # N m
    drag: np.ndarray = _joint()  # N m s^2
    lag: np.ndarray = _joint()  # s
    delay: np.ndarray = _joint()  # s
    deadband: np.ndarray = _joint()  # N m
    compliance: np.ndarray = _joint()  # rad/(N m)
    encoder_offset: np.ndarray = _joint()  # rad
    warm_up: np.ndarray = _joint()  # friction times (1 + warm_up (1 - exp(-t/40 s)))
    couple_viscous: np.ndarray = Factory(lambda: np.zeros((JOINTS, JOINTS)))  # [i, j]: on i from the motion of j
    couple_coulomb: np.ndarray = Factory(lambda: np.zeros((JOINTS, JOINTS)))
    tilt: np.ndarray = Factory(lambda: np.zeros(2))  # rad
    wall: tuple[float, float, float] | None = None  # N/m, share of the motion before it, normal's elevation [rad]
    # outside the library
    hum: np.ndarray = _joint()  # N m sin(2 pi 0.37 t)
    cross: np.ndarray = _joint()  # N m s^2 dq_i dq_next
    squeeze: np.ndarray = _joint()  # Coulomb level times (1 + c q_next^2)
    touch: np.ndarray = _joint()  # N m from 12 s to 20 s
    drag_at_angle: np.ndarray = _joint()  # N m s/rad^2 q^2 dq
    flywheel: np.ndarray = _joint()  # kg m^2 of the next joint's acceleration

    def recorded(self, rig: RobotRig, motion: RigMotion, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What encoders and amplifiers show (m, 7): angles, and commands without their noise."""
        required = self.required(rig, motion, time)
        if self.lag.any():
            rate = [self.required(rig, motion, time + way * MOMENT) for way in (0.5, -0.5)]
            required = required + self.lag * (rate[0] - rate[1]) / MOMENT
        for joint in np.flatnonzero(self.delay):
            required[:, joint] = self.required(rig, motion, time + self.delay[joint])[:, joint]
        command = required + self.deadband * np.sign(required)
        angle = self._motor(rig, motion, time)[0] + self.encoder_offset
        return angle, command

    def required(self, rig: RobotRig, motion: RigMotion, time: np.ndarray) -> np.ndarray:
        """Torque (m, 7) that the drives have to deliver."""
        q, dq, ddq = self._motor(rig, motion, time)
        links = self._links(rig, motion, time)
        return links + ROTOR * ddq + self._friction(q, dq, links, time) + self._others(motion, time, q, dq, ddq)

    def _links(self, rig: RobotRig, motion: RigMotion, time: np.ndarray) -> np.ndarray:
        gravity = None
        if self.tilt.any():
            up = np.array([*self.tilt, 1.0])
            gravity = -9.81 * up / np.linalg.norm(up)
        torque = rig.torque(*motion.at(time), gravity)
        return torque if self.wall is None else torque - rig.pushed(motion.at(time)[0], *self.wall)

    def _motor(self, rig: RobotRig, motion: RigMotion, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, dq, ddq (m, 7) of the motors: q + tau/k where a spring is between motor and link."""
        q, dq, ddq = motion.at(time)
        if not self.compliance.any():
            return q, dq, ddq
        late, now, soon = (self._links(rig, motion, time + way * MOMENT) for way in (-1, 0, 1))
        c = self.compliance
        return q + c * now, dq + c * (soon - late) / (2 * MOMENT), ddq + c * (soon - 2 * now + late) / MOMENT**2

    def _sign(self, dq: np.ndarray) -> np.ndarray:
        return np.tanh(dq / self.width) if self.width else np.sign(dq)

    def _friction(self, q: np.ndarray, dq: np.ndarray, links: np.ndarray, time: np.ndarray) -> np.ndarray:
        after = np.roll(q, -1, axis=1)
        level = self.coulomb + np.where(dq > 0, self.up, self.down)
        level = level + self.stribeck * np.exp(-((dq / 0.25) ** 2))
        level = level * (1 + self.wave * np.cos(q - 0.7)) * (1 + self.squeeze * after**2) + self.load * np.abs(links)
        warm = 1 + self.warm_up * -np.expm1(-time / 40.0)[:, None]
        return self.offset + warm * (level * self._sign(dq) + (self.viscous + self.viscous_up * (dq > 0)) * dq)

    def _others(
        self, motion: RigMotion, time: np.ndarray, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray
    ) -> np.ndarray:
        away = q - motion.middle - 0.3
        out = self.spring * (away**3 + 0.25 * away) + self.ripple * np.sin(11 * q + 0.4) + self.drag * dq * np.abs(dq)
        out = out + dq @ self.couple_viscous.T + np.tanh(dq / 0.01) @ self.couple_coulomb.T
        out = out + self.hum * np.sin(2 * np.pi * 0.37 * time)[:, None] + self.cross * dq * np.roll(dq, -1, axis=1)
        out = (
            out + self.touch * ((time > 12) & (time < 20))[:, None] + self.drag_at_angle * (q - motion.middle) ** 2 * dq
        )
        out = out + self.flywheel * np.roll(ddq, -1, axis=1)
        return out + self.presliding * _slip(motion, time) if self.presliding.any() else out


def _slip(motion: RigMotion, time: np.ndarray) -> np.ndarray:
    """State (m, 7) in -1 .. 1 of elements that yield after 0.012, 0.03, 0.048 rad."""
    step = (time[1] - time[0]) / FINE
    lengths = 0.03 * (0.4 + 0.6 * np.arange(ELEMENTS))[:, None]
    state, out = np.zeros((ELEMENTS, JOINTS)), []
    for k, speed in enumerate(motion.at(time[0] + step * np.arange(FINE * len(time)))[1]):
        state = np.clip(state + speed * step / lengths, -1, 1)
        if k % FINE == 0:
            out.append(state.mean(axis=0))
    return np.array(out)


def complete(seed: int) -> RigJoints:
    """Nothing hidden; the law and the levels of friction vary with the seed."""
    random = np.random.default_rng((seed, 2))
    return RigJoints(
        viscous=FRICTION * random.uniform(0.5, 1.5, JOINTS),
        coulomb=FRICTION * random.uniform(0.8, 1.2, JOINTS),
        offset=np.zeros(JOINTS),
        noise=(0.005, 0.01, 0.02)[seed % 3] * FRICTION,
        width=(0.0, 0.01, 0.05, 0.02)[seed % 4],
    )


def only(joint: int, value: float) -> np.ndarray:
    """(7,) zero but for one joint (from 1)."""
    out = np.zeros(JOINTS)
    out[joint - 1] = value
    return out


def coupled(joint: int, value: float) -> np.ndarray:
    """(7, 7) zero but for the torque on one joint (from 1) from that two further on."""
    out = np.zeros((JOINTS, JOINTS))
    out[joint - 1, (joint + 1) % JOINTS] = value
    return out


# name -> (joint from 1, size) -> fields of RigJoints; sizes beside the joint's friction as on the three-joint rig
EFFECTS = {
    "stribeck": lambda j, a: {"stribeck": only(j, 0.15 * a * FRICTION[j - 1])},
    "coulomb_asymmetry": lambda j, a: {
        "up": only(j, 0.04 * a * FRICTION[j - 1]),
        "down": only(j, -0.04 * a * FRICTION[j - 1]),
    },
    "viscous_asymmetry": lambda j, a: {"viscous_up": only(j, 0.3 * a * FRICTION[j - 1])},
    "torque_offset": lambda j, a: {"offset": only(j, 0.04 * a * FRICTION[j - 1])},
    "load_friction": lambda j, a: {"load": only(j, 0.05 * a)},
    "position_friction": lambda j, a: {"wave": only(j, 0.15 * a)},
    "position_torque": lambda j, a: {"spring": only(j, 0.2 * a * FRICTION[j - 1])},
    "torque_ripple": lambda j, a: {"ripple": only(j, 0.04 * a * FRICTION[j - 1])},
    "hysteresis": lambda j, a: {"presliding": only(j, 0.2 * a * FRICTION[j - 1])},
    "quadratic_drag": lambda j, a: {"drag": only(j, 0.3 * a * FRICTION[j - 1])},
    "actuator_lag": lambda j, a: {"lag": only(j, 1e-2 * a)},
    "time_delay": lambda j, a: {"delay": only(j, 1e-2 * a)},
    "torque_deadband": lambda j, a: {"deadband": only(j, 0.1 * a * FRICTION[j - 1])},
    "joint_elasticity": lambda j, a: {"compliance": only(j, 2e-3 / FRICTION[j - 1] * a)},
    "base_tilt": lambda j, a: {"tilt": np.array((0.02, 0.015)) * a},
    "encoder_offset": lambda j, a: {"encoder_offset": only(j, 0.03 * a)},
    "friction_drift": lambda j, a: {"warm_up": only(j, 0.1 * a)},
    "external_contact": lambda j, a: {"wall": (300.0 * a, 0.85, 0.3 * j)},
    "joint_coupling": lambda j, a: {
        "couple_viscous": coupled(j, 0.1 * a * FRICTION[j - 1]),
        "couple_coulomb": coupled(j, 0.04 * a * FRICTION[j - 1]),
    },
}
OUTSIDE = {
    "hum": lambda j, a: {"hum": only(j, 0.1 * a * FRICTION[j - 1])},
    "cross": lambda j, a: {"cross": only(j, 0.15 * a * FRICTION[j - 1])},
    "squeeze": lambda j, a: {"squeeze": only(j, 0.15 * a)},
    "touch": lambda j, a: {"touch": only(j, 0.1 * a * FRICTION[j - 1])},
    "drag_at_angle": lambda j, a: {"drag_at_angle": only(j, 0.3 * a * FRICTION[j - 1])},
    "flywheel": lambda j, a: {"flywheel": only(j, 0.05 * a * FRICTION[j - 1])},
}
ARM_WIDE = ("base_tilt", "external_contact")


def hidden(name: str, size: float, seed: int) -> tuple[RigJoints, dict[str, set[int]]]:
    """The rig with one effect, and on which joints (from 1) it acts: "unknown" for those of OUTSIDE. The joint goes
    round with the seed; a zero of joint 1 shows nowhere.
    """
    joint = seed % JOINTS + 1
    if name == "encoder_offset" and joint == 1:
        joint = 4
    make = {**EFFECTS, **OUTSIDE}[name]
    truth = {name if name in EFFECTS else "unknown": set(range(1, JOINTS + 1)) if name in ARM_WIDE else {joint}}
    return evolve(complete(seed), **make(joint, size)), truth
