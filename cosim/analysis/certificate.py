"""A proof of stability for every delay law up to a bound, as plain data hold it."""

from typing import Any

import numpy as np
from attrs import cmp_using, field, frozen

from cosim.analysis.delay_grid import DelayGrid
from cosim.analysis.sampled_loop import SampledLoop
from cosim.errors import InputError, Problem


@frozen
class Multiplier:
    """A quadratic form that is never negative, up to the rest, on what any delay law makes of a signal.

    Over v = (w[k - lift_1], .., y_1[k], ..): v^T form v + sum_i rests_i r_i^2 >= 0 for every law of the grid, where r_i
    is the distance from a mean of two knots. `form` symmetric (lifts + points), `rests` (lifts,) >= 0.
    """

    form: np.ndarray = field(converter=lambda rows: np.array(rows, dtype=float), eq=cmp_using(np.array_equal))
    rests: np.ndarray = field(converter=lambda row: np.array(row, dtype=float), eq=cmp_using(np.array_equal))

    def fits(self, lifts: int, size: int) -> bool:
        """Whether the shapes are those of a grid with so many lifts, and all numbers finite."""
        shapes = self.form.shape == (size, size) and self.rests.shape == (lifts,)
        return shapes and bool(np.all(np.isfinite(self.form)) and np.all(np.isfinite(self.rests)))


@frozen
class Certificate:
    """Claim: the loop is exponentially stable whatever each channel's delay does between 0 and the last knot.

    The channels' laws need not have anything to do with one another. `uses` says which multiplier serves a channel.
    Nothing in here has to be believed: `proof.proven` checks it.
    """

    loop: SampledLoop
    grid: DelayGrid
    multipliers: tuple[Multiplier, ...] = field(converter=tuple)
    uses: tuple[int, ...] = field(converter=tuple)

    @property
    def most(self) -> int:
        """Largest delay each way, in steps."""
        return self.grid.most

    @property
    def max_delay(self) -> float:
        """Largest delay each way [s]."""
        return self.most * self.loop.step

    def __attrs_post_init__(self) -> None:
        lifts, size = len(self.grid.lifts), len(self.grid.lifts) + len(self.grid.points)
        problems = [
            Problem(f"multiplier {k}", f"a symmetric form {(size, size)} and {lifts} rests >= 0", str(m.form.shape))
            for k, m in enumerate(self.multipliers)
            if not (m.fits(lifts, size) and np.array_equal(m.form, m.form.T) and np.all(m.rests >= 0.0))
        ]
        if len(self.uses) != self.loop.channels or not set(self.uses) <= set(range(len(self.multipliers))):
            problems.append(Problem("uses", f"a multiplier for each of {self.loop.channels} channels", str(self.uses)))
        if problems:
            raise InputError(problems)

    def to_dict(self) -> dict[str, object]:
        """Plain data; every number is a float that its decimal form gives back to the bit."""
        loop = self.loop
        return {
            "loop": {
                "step": loop.step,
                "transition": loop.transition.tolist(),
                "drive": loop.drive.tolist(),
                "moved": loop.moved.tolist(),
                "moved_now": loop.moved_now.tolist(),
            },
            "slope": self.grid.slope,
            "lifts": list(self.grid.lifts),
            "knots": [list(row) for row in self.grid.knots],
            "uses": list(self.uses),
            "multipliers": [{"form": m.form.tolist(), "rests": m.rests.tolist()} for m in self.multipliers],
        }


def certificate_of(data: dict[str, Any], where: str = "certificate") -> Certificate:
    """A certificate from `Certificate.to_dict`. Raises InputError where something is missing or does not fit."""
    try:
        return Certificate(
            SampledLoop(**data["loop"]),
            DelayGrid(data["lifts"], data["knots"], data["slope"]),
            [Multiplier(**m) for m in data["multipliers"]],
            data["uses"],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(Problem(where, "the keys and numbers of a certificate", repr(error))) from error
