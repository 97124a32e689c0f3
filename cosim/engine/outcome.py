"""How a run ended, in the words of the contract, and what that means for the user."""

from enum import Enum


class Outcome(str, Enum):
    """Outcome of a co-simulation. The value is the contract's word; `advice` says what to do with it."""

    CONVERGED = "converged"
    BOUNDED = "bounded"
    GROWING = "growing"
    LIMIT_CYCLE = "limit_cycle"
    LIMIT_HIT = "limit_hit"
    DOMAIN_EXIT = "domain_exit"
    DIVERGED = "diverged"
    INCONCLUSIVE = "inconclusive"
    NOT_JUDGED = "not_judged"
    FAILED = "failed"

    @property
    def advice(self) -> str:
        """One sentence for the user."""
        return _ADVICE[self]


_ADVICE = {
    Outcome.CONVERGED: "small disturbances die out: the loop is stable at this point",
    Outcome.BOUNDED: "the motion stays bounded; small disturbances neither grow nor die out measurably",
    Outcome.GROWING: "small disturbances grow: the loop is unstable at this point",
    Outcome.LIMIT_CYCLE: "the motion settles on an oscillation of its own: reduce gain or delay, or add damping",
    Outcome.LIMIT_HIT: "an actuator limit was reached: what follows says nothing about the linear loop",
    Outcome.DOMAIN_EXIT: (
        "the arm left the domain of its model (workspace, or M(q) not positive definite): results end there"
    ),
    Outcome.DIVERGED: "the motion left every bound: the loop is unstable, or the communication step is too long",
    Outcome.INCONCLUSIVE: "the run is too short, too noisy or forced for too long to say: "
    "run longer, let go earlier, or take smaller steps",
    Outcome.NOT_JUDGED: "the run stayed within bounds; nothing was disturbed and observed: no verdict on stability",
    Outcome.FAILED: "an FMU failed: see the message",
}
