"""The experiment in the laboratory: a joint or an arm under its controller, step by step, with what happens to it."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from tests.support.laboratory_b.chain import GRAVITY, SerialArm
from tests.support.laboratory_b.mechanism import Mechanism

Array = np.ndarray


@dataclass(frozen=True)
class Pendulum:
    """inertia ddq = torque - weight sin(q) - friction; weight 0 where the axis is vertical."""

    inertia: float  # [kg m^2]
    weight: float  # [N m]


@dataclass(frozen=True)
class ServoLoop:
    """kp e + ki integral(e) + kd de/dt + feed times the model's gravity, on counted angles."""

    kp: Array
    ki: Array
    kd: Array
    feed: float
    every: int  # steps of the simulation in one period


@dataclass(frozen=True)
class LabExperiment:
    """All that is fixed before anything special happens; lists are by run, arrays by joint."""

    body: Pendulum | SerialArm
    joint: int  # the described one
    neighbour: int
    dry: Array
    viscous: Array
    loop: ServoLoop
    step: float  # [s]
    references: tuple[Array, ...]  # (steps, joints) [rad]
    counts: float  # encoder's step [rad]

    @property
    def joints(self) -> int:
        return self.dry.size

    @property
    def starts(self) -> Array:
        """Start of each run [s]: half a second between two."""
        lengths = [len(r) * self.step + 0.5 for r in self.references]
        return np.concatenate([[0.0], np.cumsum(lengths)[:-1]])


@dataclass(frozen=True)
class ExactTrace:
    """What truly happened, one row a step. q is what the encoder sees (the rotor where the gear flexes)."""

    t: Array
    run: Array
    q: Array  # (rows, joints)
    dq: Array
    ddq: Array
    command: Array
    motor: Array  # true torque of the described joint's motor [N m]
    dry: Array  # its dry friction, as a torque on the joint
    extra: Array  # its torque by laws of torque
    link: Array  # (rows, 2) angle and speed of the described joint's link

    def thinned(self, every: int) -> "ExactTrace":
        return ExactTrace(**{name: getattr(self, name)[::every] for name in self.__dataclass_fields__})


def simulate(experiment: LabExperiment, mechanism: Mechanism) -> ExactTrace:
    single = isinstance(experiment.body, Pendulum)
    parts = []
    for n, (reference, start) in enumerate(zip(experiment.references, experiment.starts, strict=True)):
        one = (pendulum_run if single else arm_run)(experiment, mechanism, reference, float(start))
        parts.append({**one, "run": np.full(len(reference), n + 1)})
    return ExactTrace(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


class JointLaws:
    """The described joint's laws of one run, each called once a step."""

    def __init__(self, mechanism: Mechanism, step: float):
        self.frictions = [make(step) for make in mechanism.friction]
        self.torques = [make(step) for make in mechanism.torque]
        self.amplifiers = [make(step) for make in mechanism.amplifier]

    def motor(self, t: float, u: float, v: float) -> float:
        for law in self.amplifiers:
            u = law(t, u, v)
        return u

    def dry(self, base: float, *state: float) -> float:
        return max(base + sum([law(*state) for law in self.frictions]), 0.0)

    def extra(self, *state: float) -> float:
        return sum([law(*state) for law in self.torques])


def stopped(v: float, most: float) -> float:
    """Speed after dry friction that may take `most` of it (Moreau's step: it never turns the movement back)."""
    return 0.0 if abs(v) <= most else v - math.copysign(most, v)


def derivative(reference: Array, step: float) -> Array:
    return np.gradient(reference, step, axis=0)


def pendulum_run(experiment: LabExperiment, mechanism: Mechanism, reference: Array, start: float) -> dict[str, Array]:
    body, loop, h = experiment.body, experiment.loop, experiment.step
    laws, gear = JointLaws(mechanism, h), mechanism.gear
    kp, ki, kd = float(loop.kp[0]), float(loop.ki[0]), float(loop.kd[0])
    f0, b, weight, counts = float(experiment.dry[0]), float(experiment.viscous[0]), body.weight, experiment.counts
    rotor = gear.rotor if gear else body.inertia
    inertia = body.inertia - rotor if gear else body.inertia
    r, dr = reference[:, 0].tolist(), derivative(reference, h)[:, 0].tolist()
    period, every = h * loop.every, loop.every
    smooth = 1 - math.exp(-2 * math.pi * 40 * period)
    q = r[0]
    link = q - gear.twist(weight * math.sin(q)) if gear else q
    v = dlink = u = total = seen = 0.0
    last = round(q / counts) * counts
    load = weight * math.sin(q)
    rows = []
    for k in range(len(r)):
        t = start + k * h
        if k % every == 0:
            qm = round(q / counts) * counts
            seen += smooth * ((qm - last) / period - seen)
            last = qm
            error = r[k] - qm
            total += ki * error * period
            u = kp * error + total + kd * (dr[k] - seen) + loop.feed * weight * math.sin(qm)
        act = laws.motor(t, u, v)
        dry = laws.dry(f0, t, q, v, load, 0.0, 0.0)
        extra = laws.extra(t, link, dlink, load, 0.0, 0.0)
        gravity = weight * math.sin(link)
        passed = gear.law(q - link, v - dlink) if gear else extra - gravity
        free = v + h * (act - b * v + (-passed if gear else passed)) / rotor
        after = stopped(free, h * dry / rotor)
        rows.append((q, v, (after - v) / h, u, act, (after - free) * rotor / h, extra, link, dlink))
        load = passed if gear else body.inertia * (after - v) / h - passed
        v = after
        q += h * v
        if gear:
            dlink += h * (passed - gravity + extra) / inertia
            link += h * dlink
        else:
            link, dlink = q, v
    table = np.array(rows)
    if not np.isfinite(table).all():
        raise FloatingPointError("the joint's simulation diverged")
    names = ("q", "dq", "ddq", "command")
    found = {name: table[:, n : n + 1] for n, name in enumerate(names)}
    found |= {"motor": table[:, 4], "dry": table[:, 5], "extra": table[:, 6], "link": table[:, 7:9]}
    return {"t": start + h * np.arange(len(r)), **found}


def arm_run(experiment: LabExperiment, mechanism: Mechanism, reference: Array, start: float) -> dict[str, Array]:
    loop, h, j, other = experiment.loop, experiment.step, experiment.joint, experiment.neighbour
    laws, gear = JointLaws(mechanism, h), mechanism.gear
    model = mujoco.MjModel.from_xml_string(
        experiment.body.mjcf(h, gravity_of(mechanism), mechanism.tip_load, j if gear else None)
    )
    data = mujoco.MjData(model)
    steps, n = reference.shape
    d_reference = derivative(reference, h)
    data.qpos[:] = reference[0]
    model.dof_frictionloss[:] = experiment.dry
    mujoco.mj_forward(model, data)
    rows = {name: np.zeros((steps, n)) for name in ("q", "dq", "ddq", "command")}
    single = np.zeros((steps, 5))
    period, every, counts = h * loop.every, loop.every, experiment.counts
    smooth = 1 - math.exp(-2 * math.pi * 40 * period)
    f0, b, viscous = float(experiment.dry[j]), float(experiment.viscous[j]), experiment.viscous
    seen, total, u = np.zeros(n), np.zeros(n), np.zeros(n)
    angle, v = float(reference[0, j]), 0.0
    if gear:
        data.qpos[j] -= gear.twist(float(data.qfrc_bias[j]))
    link, dlink = float(data.qpos[j]), 0.0
    q = reference[0].copy()
    last = np.round(q / counts) * counts
    load = float(data.qfrc_bias[j])
    rotor = gear.rotor if gear else 0.0
    for k in range(steps):
        t = start + k * h
        if k % every == 0:
            qm = np.round(q / counts) * counts
            seen += smooth * ((qm - last) / period - seen)
            last = qm
            error = reference[k] - qm
            total += loop.ki * error * period
            u = loop.kp * error + total + loop.kd * (d_reference[k] - seen)
            if loop.feed:
                u += loop.feed * data.qfrc_bias
        speeds = data.qvel.copy()
        oq, ov = float(q[other]), float(speeds[other])
        act = laws.motor(t, float(u[j]), v)
        dry = laws.dry(f0, t, angle, v, load, oq, ov)
        extra = laws.extra(t, link, dlink, load, oq, ov)
        applied = u - viscous * speeds
        if gear:
            passed = gear.law(angle - link, v - dlink)
            applied[j] = passed + extra
            model.dof_frictionloss[j] = 1e-6
        else:
            applied[j] = act - b * v + extra
            model.dof_frictionloss[j] = max(dry, 1e-6)
        data.qfrc_applied = applied
        mujoco.mj_step(model, data)
        rows["q"][k], rows["dq"][k], rows["ddq"][k], rows["command"][k] = q, speeds, data.qacc, u
        if gear:
            free = v + h * (act - b * v - passed) / rotor
            after = stopped(free, h * dry / rotor)
            rows["dq"][k, j], rows["ddq"][k, j] = v, (after - v) / h
            single[k] = act, (after - free) * rotor / h, extra, link, dlink
            v, load = after, passed
            angle += h * v
        else:
            rubbed = float(data.qfrc_constraint[j])
            single[k] = act, rubbed, extra, link, dlink
            v, angle = float(data.qvel[j]), float(data.qpos[j])
            load = act + rubbed
        link, dlink = float(data.qpos[j]), float(data.qvel[j])
        q = data.qpos.copy()
        q[j] = angle
    if data.time < (steps - 0.5) * h:  # MuJoCo starts anew where a state is not finite
        raise FloatingPointError("the arm's simulation diverged")
    names = ("motor", "dry", "extra")
    found = {name: single[:, m] for m, name in enumerate(names)}
    return {"t": start + h * np.arange(steps), **rows, **found, "link": single[:, 3:5]}


def gravity_of(mechanism: Mechanism) -> tuple[float, float, float]:
    """Gravity in the frame of the base that is turned about x, then about y."""
    x, y = mechanism.tilt
    return (
        GRAVITY * math.sin(y) * math.cos(x),
        -GRAVITY * math.sin(x),
        -GRAVITY * math.cos(y) * math.cos(x),
    )
