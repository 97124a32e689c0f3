"""What one thing that happens in a machine may do to it, and nothing of what it does: the base of all forms.

`size` scales a form; a form without size does nothing. All act on one joint, `joint`, unless they say otherwise.
"""

from collections.abc import Sequence

from tests.support.laboratory_c.machines import Machine


class Addition:
    """One form of a phenomenon. Times in s, angles in rad (ways in m), torques in N m (forces in N)."""

    name: str = ""
    depends: tuple[str, ...] = ()
    form: str = ""

    def __init__(self, size: float, most: float, joint: int, **told: float) -> None:
        self.size, self.most, self.joint, self.told = size, most, joint, told

    def begin(self) -> None:
        """Before every recording: forgets what lasts from run to run."""

    def reset(self, step: float) -> None:
        """Before every run; `step` is the simulation's [s]."""

    def add(self, t: float, q: Sequence[float], v: Sequence[float], out: list[float]) -> None:
        """Adds torques on the joints to `out`."""

    def level(self, t: float, q: float, v: float, load: float, dry: float) -> float:
        """Added to the level of dry friction in the direction of v; may be negative."""
        return 0.0

    def drive(self, t: float, torque: float, v: float) -> float:
        """The torque that the motor really makes of the one that the drive reports; called once a step."""
        return torque

    def commit(self, t: float, q: Sequence[float], v: Sequence[float], load: float) -> None:
        """At the end of every step."""

    def twist(self, twist: float, speed: float) -> float:
        """Torque through the gear by the angle and speed of rotor less link (elastic forms only)."""
        return 0.0

    def mounted(self, machine: Machine) -> Machine:
        """The machine as it is mounted."""
        return machine

    def reading(self, q: float) -> float:
        """What the encoder shows (and the controller believes)."""
        return q

    def reported(self, torque: float) -> float:
        """What the drive reports of the torque."""
        return torque

    def parameters(self) -> dict[str, float]:
        return {"size": self.size, **self.told}


def does(addition: Addition, what: str) -> bool:
    """Whether a form has its own `what`, so that the simulation has to ask it."""
    return getattr(type(addition), what) is not getattr(Addition, what)
