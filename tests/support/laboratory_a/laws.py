"""What a law of the laboratory is, what it may know of the experiment, and the state that it sees at a moment."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray


@dataclass
class LoopMoment:
    """One moment, by column (B,): time since the machine was switched on, drive side of the joint, the other joint."""

    t: Array
    q: Array
    v: Array
    load: Array
    u: Array
    other_q: Array
    other_v: Array
    other_a: Array


@dataclass(frozen=True)
class ExperimentSizes:
    """Sizes of the experiment, from which a law takes its own: RMS values of the planned motion, friction, noise."""

    noise: float
    tau: float
    torque_rate: float
    peak: float
    centre: float
    reach: float
    speed: float
    acceleration: float
    coulomb: float
    inertia: float
    rotor: float
    load: float
    smooth: float
    h: float
    bandwidth: float
    duration: float
    other_reach: float
    other_speed: float
    other_acceleration: float
    lever: float
    gravity: bool
    collocated: bool
    sign: Callable[[Array], Array]


@dataclass(frozen=True)
class LaboratoryLaw:
    """One phenomenon with its amplitudes; `begin(A, h)` gives a function of the moment. A = 0 is absence.

    place: joint (adds a torque), drive (changes the command), gear (motor and link apart), payload, tilt, encoder.
    fixed: further parameters; signals: logged signals of the room as functions of time, with unit.
    """

    name: str
    form: str
    depends_on: tuple[str, ...]
    parameter: str
    unit: str
    scale: float
    begin: Callable[[Array, float], Callable]
    place: str = "joint"
    limit: float = np.inf
    fixed: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    signals: Mapping[str, tuple[Callable[[Array], Array], str]] = field(default_factory=dict)

    def amplitude(self, levels: Array) -> Array:
        return np.sign(self.scale) * np.minimum(abs(self.scale) * levels, self.limit)


def formula(f: Callable[[Array, LoopMoment], Array]) -> Callable:
    """`begin` of a law without memory: f(A, now)."""
    return lambda amplitude, h: lambda now: f(amplitude, now)
