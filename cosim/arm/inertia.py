"""What a rigid body weighs: mass, centre of mass, inertia; moved, put together, doubted."""

from collections.abc import Iterable

import numpy as np
from attrs import field, frozen

ROUNDING = 1e-6
"""Share of the largest principal moment by which printed digits may break the triangle inequality or positive
moments.
"""

LONGEST = 2.0
"""Radius of gyration [m] beyond which a link of an arm is doubtful: mm taken for m, say, or inertia without mass."""


@frozen(eq=False)
class BodyInertia:
    """mass [kg], centre (3,) [m], inertia (3, 3) [kg m^2] about the centre of mass, axes of the frame."""

    mass: float
    centre: np.ndarray = field(converter=lambda v: np.array(v, dtype=float))
    inertia: np.ndarray = field(converter=lambda v: np.array(v, dtype=float))

    @classmethod
    def nothing(cls) -> "BodyInertia":
        """A body without mass and inertia."""
        return cls(0.0, np.zeros(3), np.zeros((3, 3)))

    @property
    def empty(self) -> bool:
        """True where it has neither mass nor inertia."""
        return self.mass == 0 and not self.inertia.any()

    def moved(self, rotation: np.ndarray, origin: np.ndarray) -> "BodyInertia":
        """The same body in a frame in which its own frame has this rotation (3, 3) and origin (3,)."""
        return BodyInertia(self.mass, rotation @ self.centre + origin, rotation @ self.inertia @ rotation.T)

    def joined(self, other: "BodyInertia") -> "BodyInertia":
        """Both as one rigid body, by Steiner's theorem: + m1 m2 / (m1 + m2) (d^2 1 - d d')."""
        mass = self.mass + other.mass
        if mass == 0:
            return BodyInertia(0.0, self.centre, self.inertia + other.inertia)
        centre = (self.mass * self.centre + other.mass * other.centre) / mass
        d = other.centre - self.centre
        apart = self.mass * other.mass / mass * (d @ d * np.eye(3) - np.outer(d, d))
        return BodyInertia(mass, centre, self.inertia + other.inertia + apart)

    def principal(self) -> np.ndarray:
        """Principal moments (3,) [kg m^2], smallest first."""
        return np.linalg.eigvalsh(self.inertia)

    def faults(self) -> Iterable[tuple[str, str, str]]:
        """What no body can have: (expected, got, advice)."""
        if self.mass < 0:
            yield "a mass of zero or more", f"{self.mass:g} kg", ""
        moments = self.principal()
        if moments[0] < -ROUNDING * max(abs(moments[2]), 1e-12):
            got = f"principal moments {_listed(moments)} kg m^2"
            yield (
                "an inertia whose principal moments are zero or more",
                got,
                "look at the products of inertia and their signs",
            )

    def doubts(self) -> Iterable[str]:
        """What a body cannot have, but an equation of motion can be solved with; in words."""
        low, middle, high = self.principal()
        if low + middle < high * (1 - ROUNDING):
            excess = 100 * (high / (low + middle) - 1) if low + middle > 0 else np.inf
            yield (
                f"principal moments {_listed((low, middle, high))} kg m^2 break the triangle inequality "
                f"by {excess:.3g} %: no distribution of mass has them"
            )
        if high > self.mass * LONGEST**2:
            yield f"inertia {high:.3g} kg m^2 for {self.mass:.3g} kg: a radius of gyration beyond {LONGEST:g} m"


def _listed(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
