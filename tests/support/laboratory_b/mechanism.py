"""What may happen at a joint, as the simulation asks for it step by step, and how it is told in words."""

from collections.abc import Callable
from dataclasses import dataclass, field

from scipy.optimize import brentq

from tests.support.laboratory_b.chain import TipLoad

Law = Callable[[float, float, float, float, float, float], float]
"""(t, q, dq, load, q of the neighbour, dq of the neighbour) -> N m; load is the torque that the gear carries."""
Amplifier = Callable[[float, float, float], float]
"""(t, command, dq) -> true torque of the motor [N m]."""


@dataclass(frozen=True)
class SpringGear:
    """A rotor before a spring: torque from twist [rad] and its rate [rad/s]; the rotor's share of the inertia."""

    law: Callable[[float, float], float]
    rotor: float  # [kg m^2]

    def twist(self, torque: float) -> float:
        """At which the spring carries this torque [N m] at rest."""
        return float(brentq(lambda x: self.law(x, 0.0) - torque, -3.0, 3.0))


@dataclass(frozen=True)
class Mechanism:
    """Laws are made anew for every run by what stands here: step [s] -> law with its state."""

    friction: tuple[Callable[[float], Law], ...] = ()  # adds to the level of dry friction
    torque: tuple[Callable[[float], Law], ...] = ()  # acts on the link
    amplifier: tuple[Callable[[float], Amplifier], ...] = ()
    gear: SpringGear | None = None
    tip_load: TipLoad | None = None
    tilt: tuple[float, float] = (0.0, 0.0)  # of the base about x and y [rad]
    encoder_zero: float = 0.0  # logged angle - angle [rad]
    sensor_zero: float = 0.0  # logged torque - torque [N m]

    def beside(self, other: "Mechanism") -> "Mechanism":
        return Mechanism(
            self.friction + other.friction,
            self.torque + other.torque,
            self.amplifier + other.amplifier,
            self.gear or other.gear,
            self.tip_load or other.tip_load,
            (self.tilt[0] + other.tilt[0], self.tilt[1] + other.tilt[1]),
            self.encoder_zero + other.encoder_zero,
            self.sensor_zero + other.sensor_zero,
        )


@dataclass(frozen=True)
class JointScene:
    """Magnitudes of the experiment at the joint, from a run in which nothing special happens."""

    torque: float  # RMS of the command [N m]
    peak: float  # largest command [N m]
    dry: float  # dry friction [N m]
    speed: float  # RMS [rad/s]
    top: float  # largest speed [rad/s]
    low: float  # range of the angle [rad]
    high: float
    inertia: float  # [kg m^2]
    duration: float  # [s]
    other_speed: float  # RMS of the neighbour's speed [rad/s]
    rotor: float | None  # of an arm's joint, which its model knows [kg m^2]

    def inside(self, fraction: float) -> float:
        return self.low + fraction * (self.high - self.low)

    def rotor_share(self, drawn: float) -> float:
        """The motor's share of the inertia: the arm's, or the drawn one of a single joint."""
        return drawn if self.rotor is None else min(self.rotor / self.inertia, 0.9)

    @property
    def span(self) -> float:
        return self.high - self.low


@dataclass(frozen=True)
class Occurrence:
    """One phenomenon in one form, with a free size (1 is ordinary)."""

    form: str
    depends_on: tuple[str, ...]
    at: Callable[[float], Mechanism]
    parameters: Callable[[float], dict[str, str]] = field(default=lambda size: {})
    alike: tuple[str, ...] = ()  # contract names for physically the same thing
    signal: str | None = None  # a column that the logger keeps of it


def of_state(law: Law) -> Callable[[float], Law]:
    """A law without memory."""
    return lambda step: law
