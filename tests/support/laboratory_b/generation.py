"""From a seed to a recording: draws what happens, sizes it against the noise, and measures how much of it shows."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal
from zlib import crc32

import numpy as np

from tests.support.laboratory_b import drive, friction, surroundings
from tests.support.laboratory_b.logger import LoggedTrace, logged
from tests.support.laboratory_b.mechanism import JointScene, Mechanism, Occurrence
from tests.support.laboratory_b.nominal import NominalModel, base_columns, exact_rms, rms
from tests.support.laboratory_b.plant import ExactTrace, Pendulum, simulate
from tests.support.laboratory_b.setup import LabSetup, arm_setup, axis_setup

Rng = np.random.Generator
Kind = Literal["one", "complete", "pair", "outside"]
Form = Callable[[Rng, JointScene], Occurrence]

FORMS: dict[str, tuple[Form, ...]] = {**friction.FORMS, **drive.FORMS, **surroundings.FORMS}
HIDDEN_ON_AN_AXIS = {
    *("torque_offset", "coulomb_asymmetry", "torque_gain", "payload", "base_tilt", "encoder_offset", "joint_coupling")
}
"""The fit of one joint (inertia, a sin q + b cos q, offset, friction) takes these in, or they need a second joint."""
TRUSTED = {"torque_gain", "payload", "base_tilt", "encoder_offset"}
"""Seen against a rigid torque that is told, not fitted."""
LOADED_JOINT = {"payload", "encoder_offset", "base_tilt", "torque_gain"}
"""On the shoulder or the elbow, where gravity and the tip matter."""
HEAVY_JOINT = {"joint_elasticity", "backlash"}
"""On one of the first three, where the link is heavy against the rotor."""
MOST = {
    "joint_elasticity": 6.0,
    "backlash": 4.0,
    "actuator_lag": 8.0,
    "time_delay": 8.0,
    "torque_gain": 6.0,
    "base_tilt": 5.0,
    "encoder_offset": 6.0,
    "coulomb_asymmetry": 8.0,
    "stribeck": 10.0,
    "torque_saturation": 6.0,
}
"""Largest size that a workshop would still call a drive (12 Hz fall to 5, 50 ms, 30 %, 0.25 rad)."""
SAME_PLACE = (
    {"joint_elasticity", "backlash"},
    {"actuator_lag", "time_delay"},
    {"torque_offset", "coulomb_asymmetry"},
    {"position_torque", "external_contact"},
)
LEAST_NOISE, MOST_NOISE = 0.004, 0.06
"""Floor over the RMS of the torque, as current sensors and force sensors have it."""


@dataclass(frozen=True)
class Sized:
    name: str
    occurrence: Occurrence
    size: float
    added: float  # N m

    @property
    def mechanism(self) -> Mechanism:
        return self.occurrence.at(self.size)


@dataclass(frozen=True)
class GeneratedRecording:
    setup: LabSetup
    model: NominalModel
    happened: tuple[Sized, ...]
    data: LoggedTrace
    plain: LoggedTrace  # the same without what happened, noise and all
    trace: ExactTrace
    floor: float  # N m
    added: float  # N m, of all together
    seed: int
    kind: Kind

    @property
    def shows(self) -> float:
        return self.added / self.floor

    @property
    def mechanism(self) -> Mechanism:
        return together(self.happened)

    def write(self, folder) -> None:
        from tests.support.laboratory_b.files import write

        write(self, folder)


def together(happened: tuple[Sized, ...]) -> Mechanism:
    found = Mechanism()
    for one in happened:
        found = found.beside(one.mechanism)
    return found


@dataclass(frozen=True)
class Undisturbed:
    """The experiment without anything special, and what the ordinary model leaves of it."""

    setup: LabSetup
    model: NominalModel
    trace: ExactTrace
    rest: float  # exact signals
    least: float  # counted signals without noise of the torque

    def scene(self) -> JointScene:
        e, trace = self.setup.experiment, self.trace
        q, dq, u = trace.q[:, e.joint], trace.dq[:, e.joint], trace.command[:, e.joint]
        single = isinstance(e.body, Pendulum)
        inertia = e.body.inertia if single else float(e.loop.kp[e.joint]) / self.stiffness()
        return JointScene(
            *(rms(u), float(np.quantile(np.abs(u), 0.998)), float(e.dry[e.joint]), rms(dq), float(np.abs(dq).max())),
            *(float(q.min()), float(q.max()), inertia, float(trace.t[-1]), rms(trace.dq[:, e.neighbour])),
            None if single else e.body.links[e.joint].rotor,
        )

    def stiffness(self) -> float:
        """kp over inertia [1/s^2], from kd = 1.6 inertia w and kp = inertia w^2."""
        loop, j = self.setup.experiment.loop, self.setup.experiment.joint
        return float(1.6 * loop.kp[j] / loop.kd[j]) ** 2

    def added(self, mechanism: Mechanism) -> tuple[float, ExactTrace]:
        """RMS that a mechanism adds to what the ordinary model leaves of exact signals [N m]."""
        trace = simulate(self.setup.experiment, mechanism)
        seen = as_seen(trace, mechanism, self.setup.experiment.joint)
        return math.sqrt(max(exact_rms(self.model, seen, self.setup.logger.cutoff) ** 2 - self.rest**2, 0.0)), trace


def as_seen(trace: ExactTrace, mechanism: Mechanism, joint: int) -> ExactTrace:
    """Exact signals with the zeros of encoder and current sensor."""
    q, u = trace.q.copy(), trace.command.copy()
    q[:, joint] += mechanism.encoder_zero
    u[:, joint] += mechanism.sensor_zero
    return replace(trace, q=q, command=u)


def undisturbed(setup: LabSetup, rng: Rng, trusted: bool) -> Undisturbed:
    trace = simulate(setup.experiment, Mechanism())
    model = NominalModel(setup.experiment)
    if not isinstance(setup.experiment.body, Pendulum):
        wrong, way = rng.uniform(-1, 1), rng.random()
        if trusted:
            model = replace(model, given=1 + 1e-3 * wrong)
        elif way < 0.6:
            model = replace(model, kept=base_columns(setup.experiment, trace))
        else:
            model = replace(model, given=1 + 0.05 * wrong, beside=True)
    quiet = logged(setup.logger, trace, setup.experiment.joint, (0.0, 0.0), np.zeros(len(trace.t)))
    return Undisturbed(setup, model, trace, exact_rms(model, trace, setup.logger.cutoff), quiet.floor(model)[0])


def sized(
    plain: Undisturbed, name: str, occurrence: Occurrence, low: float, high: float, tries: int
) -> tuple[Sized, ExactTrace]:
    """Finds a size whose added RMS lies in the range [N m]."""
    found: list[tuple[float, float, ExactTrace]] = []
    size = 1.0
    for _ in range(tries):
        added, trace = plain.added(occurrence.at(size))
        found.append((size, added, trace))
        if low <= added <= high:
            break
        goal = low * 1.15 if added < low else high * 0.9
        wanted = size * min(max(goal / max(added, 1e-9), 0.15), 4.0)
        if size == min(wanted, MOST.get(name, math.inf)):
            break
        size = min(wanted, MOST.get(name, math.inf))
    size, added, trace = min(found, key=lambda f: abs(math.log(max(f[1], 1e-9) / min(max(f[1], low), high))))
    return Sized(name, occurrence, size, added), trace


def generate(
    seed: int,
    kind: Kind = "one",
    phenomenon: str | None = None,
    strength: float | None = None,
    longest: float = 180.0,
    joints: int | None = None,
) -> GeneratedRecording:
    """A recording by its seed; `strength` asks for a value of `shows`, `longest` [s] and `joints` (1, 3, 6)
    limit the draw.
    """
    rng = np.random.default_rng([seed, crc32(kind.encode()), crc32((phenomenon or "").encode())])
    names = drawn_names(rng, kind, phenomenon)
    shows = float(np.exp(rng.uniform(np.log(0.5), np.log(5.0)))) if strength is None else strength
    setup = drawn_setup(rng, kind, names, longest, joints)
    plain = undisturbed(setup, rng, bool(TRUSTED & set(names)))
    happened, trace, added = drawn_effects(rng, plain, kind, names, shows)
    torque = plain.scene().torque
    weakest = min((one.added for one in happened), default=0.0)
    floor = weakest / shows if happened else torque * float(np.exp(rng.uniform(np.log(0.005), np.log(0.05))))
    size = max(math.sqrt(max(floor**2 - plain.least**2, 0.0)), 0.5 * LEAST_NOISE * torque)
    noise = size * setup.logger.noise(rng, len(trace.t) // setup.logger.every + 1)
    mechanism, joint = together(happened), setup.experiment.joint
    data = logged(setup.logger, trace, joint, (mechanism.encoder_zero, mechanism.sensor_zero), noise)
    without = logged(setup.logger, plain.trace, joint, (0.0, 0.0), noise)
    return GeneratedRecording(
        setup, plain.model, happened, data, without, trace, without.floor(plain.model)[0], added, seed, kind
    )


def drawn_names(rng: Rng, kind: Kind, phenomenon: str | None) -> tuple[str, ...]:
    """Contract names; `unknown:form` where no name fits."""
    everything = sorted(FORMS)
    first, second = rng.permutation(everything)[:2].tolist()
    if kind == "complete":
        return ()
    if kind == "outside":
        forms = (*surroundings.OUTSIDE_ANYWHERE, *surroundings.OUTSIDE_TWO_JOINTS)
        chosen = forms[int(rng.integers(len(forms)))].__name__
        return (f"unknown:{phenomenon or chosen}",)
    if kind == "one":
        return (phenomenon or first,)
    first = phenomenon or first
    while second == first or any({first, second} <= place for place in SAME_PLACE):
        second = str(rng.choice(everything))
    return first, second


def forms_of(name: str) -> tuple[Form, ...]:
    if not name.startswith("unknown:"):
        return FORMS[name]
    outside = (*surroundings.OUTSIDE_ANYWHERE, *surroundings.OUTSIDE_TWO_JOINTS)
    return tuple(form for form in outside if form.__name__ == name.removeprefix("unknown:"))


def drawn_setup(rng: Rng, kind: Kind, names: tuple[str, ...], longest: float, joints: int | None) -> LabSetup:
    two = {f"unknown:{form.__name__}" for form in surroundings.OUTSIDE_TWO_JOINTS}
    needs_arm = bool((HIDDEN_ON_AN_AXIS | two) & set(names))
    drawn = int(rng.choice([3, 6] if needs_arm else [1, 1, 3, 6]))
    size = joints or drawn
    if size == 1:
        return axis_setup(rng, min(longest, 60.0) if kind == "pair" else longest)
    low, high = (1, 3) if LOADED_JOINT & set(names) else (0, 3) if HEAVY_JOINT & set(names) else (0, size)
    joint = int(rng.integers(low, high))
    return arm_setup(rng, size, joint, min(longest, 10.0) if kind == "pair" else longest)


def drawn_effects(
    rng: Rng, plain: Undisturbed, kind: Kind, names: tuple[str, ...], shows: float
) -> tuple[tuple[Sized, ...], ExactTrace, float]:
    scene = plain.scene()
    found: list[Sized] = []
    trace, added, torque = plain.trace, 0.0, scene.torque
    low = shows * max(1.02 * plain.least, LEAST_NOISE * torque)
    high = max(shows * math.hypot(plain.least, MOST_NOISE * torque), 1.1 * low)
    for name in names:
        forms = forms_of(name)
        occurrence = forms[int(rng.integers(len(forms)))](rng, scene)
        one, trace = sized(plain, name, occurrence, low, high, 3 if kind == "pair" else 4)
        found.append(one)
        added = one.added
        low, high = max(added / 1.3, 0.8 * low), max(added * 1.7, low)  # the second of a pair is about as strong
    if len(found) > 1:
        added, trace = plain.added(together(tuple(found)))
    return tuple(found), trace, added
