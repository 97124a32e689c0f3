"""One fit of a recording by one method: base parameters, their estimate and its spread."""

from functools import cached_property

import numpy as np
from attrs import evolve, frozen

from cosim.errors import InputError, Problem
from cosim.identification.estimate import ParameterEstimate, estimate
from cosim.identification.identifiability import Identifiability, identifiability
from cosim.identification.intervals import Spread, spread
from cosim.identification.linear_model import LinearModel
from cosim.identification.method import LeaveOut, Method
from cosim.identification.models import linear_model
from cosim.identification.stack import Stack, coulomb_label, stack, with_columns, without
from cosim.measured.label import Label
from cosim.measured.recording import Recording

HALF = 0.5  # of the Coulomb friction: a smoothed sign that takes more from the slowest rows is another effect
WIDER = 4  # times that the rows left out round a servo's dead band may grow
MARGIN = 1.5
"""Of a dead band: rows up to there are left out in the next fit. An estimate from rows of which some lie within the
band is too small; the fits go on until none does.
"""
BAND = Label("dead_band")


@frozen(eq=False)
class Fit:
    """A recording through a method's filters, and the least squares: `base` has the columns of the base parameters."""

    recording: Recording
    method: Method
    stack: Stack
    shown: Identifiability
    base: Stack
    estimate: ParameterEstimate
    spread: Spread

    @property
    def model(self) -> LinearModel:
        """The linear model of the recording's device."""
        return linear_model(self.recording.device, self.recording.description)

    @property
    def params(self) -> np.ndarray:
        """Base parameters (p,)."""
        return self.estimate.params

    @cached_property
    def free(self) -> np.ndarray:
        """Base parameters (p,) without the constraint to a physical arm: what `beside` and `otherwise` compare with."""
        if not self.method.physical:
            return self.params
        return estimate(self.base, evolve(self.method, physical=False), self.model).params

    def beside(self, columns: np.ndarray) -> ParameterEstimate:
        """The base parameters fitted with further columns (n, nj, k), whose coefficients are the last k parameters."""
        wider = self.widened(columns)
        return estimate(wider, evolve(self.method, physical=False), self.model)

    def one_beside(self, column: np.ndarray) -> tuple[np.ndarray, float]:
        """The base parameters with one further column (n, nj), (p + 1,), and the standard deviation of the last."""
        wider = self.widened(column[:, :, None])
        found = estimate(wider, evolve(self.method, physical=False), self.model)
        return found.params, float(spread(wider, found).std[-1])

    def widened(self, columns: np.ndarray) -> Stack:
        """The base columns with further ones (n, nj, k)."""
        return evolve(self.base, y=np.concatenate([self.base.y, columns], axis=2))

    def otherwise(self, recording: Recording) -> np.ndarray:
        """The same base parameters (p,) and filters with another recording of the same rows; NaN where too few rows are
        left.
        """
        full = stack(recording, self.method)
        columns = [full.labels.index(label) for label in self.base.labels]
        if full.fit.sum() < 3 * len(columns):
            return np.full(len(columns), np.nan)
        return estimate(with_columns(full, columns), evolve(self.method, physical=False), self.model).params


def fit(recording: Recording, method: Method) -> Fit:
    """Least squares by the method. Raises InputError where there is too little to fit."""
    found = _fit(recording, evolve(method, dead_band=_smallest_error(recording)))
    for _ in range(WIDER):  # until no row within the dead band is left
        band = abs(dict(zip(found.base.labels, found.params.tolist(), strict=True)).get(BAND, 0.0))
        if band <= found.method.dead_band:
            break
        found = _fit(recording, evolve(found.method, dead_band=MARGIN * band))
    return found


def _smallest_error(recording: Recording) -> float:
    """The share of a servo's usual error below which its sign is not known, as that of a speed is not (`LeaveOut`); 0
    without a servo whose dead band is to be found.
    """
    errors = [(run.tau / run.servo).ravel() for run in recording.runs if run.servo is not None]
    return LeaveOut().share * float(np.sqrt(np.mean(np.concatenate(errors) ** 2))) if errors else 0.0


def _fit(recording: Recording, method: Method) -> Fit:
    model = linear_model(recording.device, recording.description)
    full = _with_plausible_tail(stack(recording, method), method, model, recording)
    _enough(full, recording)
    return Fit(recording, method, full, *_fitted(full, method, model))


def _fitted(
    full: Stack, method: Method, model: LinearModel
) -> tuple[Identifiability, Stack, ParameterEstimate, Spread]:
    """Base parameters, their columns, their estimate and its spread."""
    shown = identifiability(full)
    base = with_columns(full, shown.base)
    found = estimate(base, method, model)
    return shown, base, found, spread(base, found)


def _with_plausible_tail(full: Stack, method: Method, model: LinearModel, recording: Recording) -> Stack:
    """Keep a `slow` column only where the data speak for it and it is that of a smoothed sign: Coulomb friction that
    is smaller on the slowest rows, by less than half of it. Elsewhere the column would only widen the intervals.
    """
    tails = [label for label in full.labels if label.name == "slow"]
    if not tails:
        return full
    _enough(full, recording)
    _, base, fitted, widths = _fitted(full, method, model)
    value = dict(zip(base.labels, fitted.params.tolist(), strict=True))
    score = dict(zip(base.labels, (fitted.params / np.maximum(widths.std, 1e-300)).tolist(), strict=True))
    doubtful = [
        tail
        for tail in tails
        if tail not in value or score[tail] > -1 or -value[tail] > HALF * abs(value.get(coulomb_label(tail), 0.0))
    ]
    kept = without(full, tuple(doubtful))
    notes = [
        f"{tail}: Coulomb friction falls short by "
        f"{-100 * value[tail] / value[coulomb_label(tail)]:.2g} % at the slowest rows in use, as "
        "a smooth sign of dq does; a column for it is fitted along"
        for tail in tails
        if tail not in doubtful
    ]
    return evolve(kept, notes=(*kept.notes, *notes))


def _enough(full: Stack, recording: Recording) -> None:
    rows, needed = int(full.fit.sum()), 3 * full.y.shape[2]
    if rows < needed:
        got = f"{rows} after filtering and leaving out reversals"
        raise InputError(
            Problem(
                ", ".join(recording.files),
                f"at least {needed} rows to fit {full.y.shape[2]} parameters",
                got,
                "record longer",
            )
        )
