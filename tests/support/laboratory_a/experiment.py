"""An experiment drawn at random for a phenomenon: machine, motion, controller, logger; and the sizes that follow."""

from dataclasses import dataclass

import numpy as np

from tests.support.laboratory_a import machines, motion
from tests.support.laboratory_a.laws import ExperimentSizes
from tests.support.laboratory_a.simulation import ControlledArm, SidePieces

DECLARED = {"torque_gain", "payload", "encoder_offset"}
"""Visible only where the rigid part is given."""
SEVERAL = {"joint_coupling", "other_angle", "speed_product"}
PLAIN = {"torque_offset", "coulomb_asymmetry"}
"""Device axis has an offset of its own, which is these two."""
QUICK = {"joint_elasticity", "backlash", "actuator_lag", "time_delay"}
"""Hidden by slow motion."""
SIGNS = {
    "tanh(v/v0)": np.tanh,
    "v/sqrt(v^2 + v0^2)": lambda x: x / np.sqrt(1 + x * x),
    "2/pi atan(v/v0)": lambda x: 2 / np.pi * np.arctan(x * 1.5),
}


@dataclass(frozen=True)
class LaboratoryLogger:
    """Encoder resolution (n,) in rad, noise of the torque (n,) in N m with correlation of neighbouring samples."""

    rate: float
    resolution: np.ndarray
    noise: np.ndarray
    colour: float
    cutoff: float
    degrees: bool
    writes_speed: bool
    writes_reference: bool
    time_restarts: bool
    split: bool


@dataclass(frozen=True)
class DrawnExperiment:
    machine: machines.DrawnMachine
    loop: ControlledArm
    pieces: SidePieces
    settings: ExperimentSizes
    logger: LaboratoryLogger
    runs: np.ndarray
    sign_form: str
    motions: list[str]


def machine_for(rng, wanted: set[str]) -> machines.DrawnMachine:
    """A machine on which all the wanted phenomena could show."""
    declared, several, gears = wanted & DECLARED, wanted & SEVERAL, wanted & {"joint_elasticity", "backlash"}
    plain = wanted & PLAIN
    kind = rng.choice(["one", "three", "six", "phantom"], p=[0.5, 0.17, 0.1, 0.23])
    if several and kind == "one":
        kind = rng.choice(["three", "phantom"])
    if len(wanted) > 1 and kind == "six":
        kind = "three"
    if gears and kind in ("three", "six"):
        kind = "phantom" if several else "one"
    if kind == "one":
        hangs = rng.random() < 0.5 or "encoder_offset" in wanted
        if "base_tilt" in wanted and hangs and not declared:
            declared = {"base_tilt"}
        given = "rigid" if declared else rng.choice(["rigid", "columns"]) if plain else None
        given = given or rng.choice(["axis", "axis", "columns", "rigid"])
        if "base_tilt" in wanted and hangs:
            given = "rigid"
        if "payload" in wanted:
            given = "rigid"
        fine = "backlash" in wanted or rng.random() < 0.12
        return machines.own_axis(rng, given, hangs, 0.25e-3 if fine else 0.5e-3)
    if kind == "phantom":
        known = declared or rng.random() < 0.3
        fine = 0.25e-3 if "backlash" in wanted else 0.5e-3
        return machines.phantom(rng, "phantom declared" if known else "phantom fit", fine)
    given = "rigid" if declared or kind == "six" or "base_tilt" in wanted else rng.choice(["rigid", "columns"])
    return machines.chain(rng, 3 if kind == "three" else 6, given)


def timing(rng, machine, rate, whole):
    """Runs in steps (R, 2), and the pieces' grid."""
    h = machine.h
    every = round(1 / (rate * h))
    piece = (1.0 if machine.h > 0.6e-3 else 2.5) // (every * h) * every
    total = min(machine.longest, whole)
    count = 1 if rng.random() < 0.5 or total < 12 else int(rng.integers(2, 1 + min(8, total // 5)))
    lengths = rng.dirichlet(np.full(count, 20.0)) * total
    steps = (lengths / h / every).astype(int) * every
    ends = np.cumsum(steps)
    return np.stack([ends - steps, ends], axis=1), every, int(piece)


def draw(rng, wanted: set[str], excitation: str | None = None) -> DrawnExperiment:
    machine = machine_for(rng, wanted)
    n, h, arm = machine.arm.n, machine.h, machine.arm
    joint = int(rng.integers(n))
    if wanted & {"base_tilt", "payload"} and n > 1:
        joint = int(rng.integers(1, min(n, 3)))
    other = int(rng.choice([k for k in range(n) if k != joint])) if n > 1 else 0
    whole = float(np.exp(rng.uniform(np.log(12), np.log(machine.longest))))
    rates = [r for r in (100, 200, 250, 500, 1000, 2000, 4000) if r * h <= 1 and r * whole < 50_000]
    rate = float(rng.choice(rates))
    runs, every, piece = timing(rng, machine, rate, whole)
    f = float(np.exp(rng.uniform(*np.log(machine.f))))
    quick = bool(wanted & QUICK)
    if quick:
        f = machine.f[1] * rng.uniform(0.7, 1.4)
    reference, motions = planned(rng, machine, runs, h, f, excitation)
    q, v, a = reference
    coarse = slice(None, None, max(1, q.shape[1] // 8000))
    torque = sampled_inverse(machine, q, v, a)
    own = arm.felt_inertia(q[:, coarse], machine.rotor)
    speed, acceleration = rms(v), rms(a)
    size = own * acceleration + 0.25 * rms(torque)
    noise = size * rng.uniform(0.01, 0.04, n) * (0.5 if quick else 1.0)
    coulomb = size * rng.uniform(0.1, 0.35, n)
    viscous = size * rng.uniform(0.05, 0.25, n) / speed
    smooth = np.maximum(rng.uniform(0.01, 0.03, n) * speed, 5 * h * coulomb / own)
    form = str(rng.choice(list(SIGNS)))
    bandwidth = max(rng.uniform(15, 35), 22 * f) * (0.7 if quick else 1.0)
    style, damping = str(rng.choice(["PD", "PID", "PD with feedforward"])), rng.uniform(0.7, 1.1)
    kp, kd = own * bandwidth**2, 2 * damping * own * bandwidth
    ki = kp * bandwidth / 5 if style == "PID" else 0 * kp
    ahead = torque + coulomb[:, None] * np.tanh(v / (5 * smooth[:, None])) if "feed" in style else 0 * torque
    ahead = ahead * rng.uniform(0.85, 1.0)
    standing = torque * (style == "PID")
    loop = ControlledArm(
        arm, machine.rotor, coulomb, viscous, smooth, SIGNS[form], kp, kd, ki, joint, other, rng.random() < 0.7
    )
    warm = int((1.2 if h > 0.6e-3 else 1.5) / h) // every * every
    starts = [(x, lo, hi - 1) for lo, hi in runs for x in range(lo, hi, piece)]
    first, lowest, highest = np.array(starts).T
    pause = 0.0 if rng.random() < 0.5 else rng.uniform(1, 20)
    time = np.arange(q.shape[1]) * h + pause * np.repeat(np.arange(len(runs)), np.diff(runs, axis=1)[:, 0])
    pieces = SidePieces(h, np.concatenate([q, v, ahead, standing]), time, first, lowest, highest, warm, piece, every)
    turning = "one_way" in motions
    total = torque[joint] + coulomb[joint] * np.sign(v[joint]) + viscous[joint] * v[joint]
    settings = ExperimentSizes(
        noise=noise[joint],
        tau=rms(total),
        torque_rate=rms(np.gradient(total[coarse], h * (coarse.step or 1))),
        peak=float(np.max(abs(total))),
        centre=0.0 if turning else float(np.mean(q[joint])),
        reach=1.5 if turning else float(np.ptp(q[joint]) / 2),
        speed=speed[joint],
        acceleration=acceleration[joint],
        coulomb=coulomb[joint],
        inertia=own[joint] - machine.rotor[joint],
        rotor=machine.rotor[joint],
        load=rms(torque[joint] - machine.rotor[joint] * a[joint]),
        smooth=smooth[joint],
        h=h,
        bandwidth=bandwidth,
        duration=float(time[-1]),
        other_reach=float(np.ptp(q[other]) / 2),
        other_speed=speed[other],
        other_acceleration=acceleration[other],
        lever=machine.lever,
        gravity=n > 1 or arm.hangs,
        collocated=loop.encoder_at_motor,
        sign=lambda x: SIGNS[form](x / smooth[joint]),
    )
    logger = draw_logger(rng, rate, noise, own, f, len(runs))
    return DrawnExperiment(machine, loop, pieces, settings, logger, runs, form, [*motions, style])


def rms(x):
    return np.sqrt(np.mean(np.square(x), axis=-1))


def planned(rng, machine, runs, h, f, excitation):
    """(3, n, N) references of all runs, and the names of their forms."""
    n, forms = machine.arm.n, list(motion.RICH)
    if excitation == "poor" or (excitation is None and rng.random() < 0.08):
        forms = list(motion.POOR)
    if machine.arm.n == 1 and (excitation == "one way" or (excitation is None and rng.random() < 0.06)):
        forms = [motion.one_way]
    parts, names = [], []
    for lo, hi in runs:
        t = np.arange(hi - lo) * h
        form = forms[rng.integers(len(forms))]
        names.append(form.__name__)
        joints = [
            motion.reference(rng, form, t, machine.centre[k], machine.reach[k], f * rng.uniform(0.8, 1.2))
            for k in range(n)
        ]
        parts.append(np.stack(joints, axis=1))
    return np.concatenate(parts, axis=2), sorted(set(names))


def sampled_inverse(machine, q, v, a):
    """Rigid torque along the reference; of a chain at every tenth step, linear between."""
    rotor = machine.rotor[:, None]
    if machine.arm.n == 1 or machine.description.startswith("phantom"):
        return machine.arm.inverse(q, v, a, rotor)
    some = np.unique(np.append(np.arange(0, q.shape[1], 10), q.shape[1] - 1))
    rough = machine.arm.inverse(q[:, some], v[:, some], a[:, some], rotor)
    return np.stack([np.interp(np.arange(q.shape[1]), some, row) for row in rough])


def draw_logger(rng, rate, noise, inertia, f, runs):
    """An encoder just good enough: its noise in the filtered ddq is 0.1 to 0.5 of the torque's noise."""
    cutoff = min(max(40 * f, 20.0), 60.0, 0.3 * rate)
    gain = (2 * np.pi * cutoff) ** 2 / np.sqrt(5) * np.sqrt(2 * cutoff / rate) / np.sqrt(12)
    resolution = rng.uniform(0.1, 0.5) * noise / inertia / gain
    counts = 2.0 ** np.clip(np.ceil(np.log2(2 * np.pi / resolution)), 11, 24)
    return LaboratoryLogger(
        rate=rate,
        resolution=2 * np.pi / counts,
        noise=noise,
        colour=0.0 if rng.random() < 0.6 else float(np.exp(-1 / (rate * rng.uniform(0.002, 0.03)))),
        cutoff=cutoff,
        degrees=bool(rng.random() < 0.15),
        writes_speed=bool(rng.random() < 0.2),
        writes_reference=bool(rng.random() < 0.4),
        time_restarts=bool(runs > 1 and rng.random() < 0.5),
        split=bool(rng.random() < 0.3),
    )
