"""The strongest evidence that holds for a point: from a proof for every mass and delay law down to one simulation."""

from enum import Enum

from cosim.engine.outcome import Outcome


class StabilityEvidence(str, Enum):
    """What is known of a loop, strongest first; the value is the word in tables, `meaning` says it in a sentence."""

    ANY_MASS = "any mass, any delay law"
    KNOWN_MASS = "known mass, any delay law"
    ANY_LAW = "certificate, any delay law"
    CONSTANT_DELAY = "constant delay"
    SIMULATED = "simulated"
    FALSIFIED = "falsified"
    NONE = "none"

    @property
    def meaning(self) -> str:
        """One sentence for the reader."""
        return _MEANING[self]


_MEANING = {
    StabilityEvidence.ANY_MASS: (
        "the delay-sum condition holds: stable for every mass and every delay law below the bounds"
    ),
    StabilityEvidence.KNOWN_MASS: (
        "small gain with the linearised plant: stable near the pose for every delay law below the bounds"
    ),
    StabilityEvidence.ANY_LAW: (
        "a certificate for the linear loop at rest: stable near the pose for every delay law below the bounds"
    ),
    StabilityEvidence.CONSTANT_DELAY: (
        "the exact spectrum of the linearised loop lies in the left half "
        "plane: stable near the pose for this constant delay"
    ),
    StabilityEvidence.SIMULATED: "small disturbances died out in the simulated motion, and nothing more is known",
    StabilityEvidence.FALSIFIED: "small disturbances grew, in the simulation or by the exact spectrum",
    StabilityEvidence.NONE: "neither a condition nor the simulation decides",
}

UNSTABLE = (Outcome.GROWING, Outcome.LIMIT_CYCLE, Outcome.DIVERGED)
"""Outcomes that show an unstable loop."""
GROWS = 1e-6
"""Abscissa [1/s] from which a spectrum shows growth: below it stand roots of free motion that differences moved."""


def strongest(
    outcome: Outcome | None,
    any_mass: bool = False,
    known_mass: bool = False,
    abscissa: float | None = None,
    constant: bool = True,
    any_law: bool = False,
) -> StabilityEvidence:
    """The strongest evidence, given the simulated outcome (None: not simulated) and what the conditions say.

    A simulation that grows falsifies whatever a condition said (its assumptions did not hold), and so does a spectrum.
    `abscissa` [1/s] counts only for `constant` delays; None where there is no linearisation.
    """
    promised = any_mass or known_mass or any_law
    if outcome in UNSTABLE or (promised and constant and abscissa is not None and abscissa > GROWS):
        return StabilityEvidence.FALSIFIED
    if any_mass:
        return StabilityEvidence.ANY_MASS
    if known_mass:
        return StabilityEvidence.KNOWN_MASS
    if any_law:
        return StabilityEvidence.ANY_LAW
    if constant and abscissa is not None and abscissa < 0.0:
        return StabilityEvidence.CONSTANT_DELAY
    if outcome is Outcome.CONVERGED:
        return StabilityEvidence.SIMULATED
    if constant and abscissa is not None and abscissa > 0.0:
        return StabilityEvidence.FALSIFIED
    return StabilityEvidence.NONE
