"""One identification: from a recording to parameters with intervals, errors on held-out rows, and doubts."""

import numpy as np
from attrs import evolve, field, frozen

from cosim.errors import InputError, Problem
from cosim.identification.estimate import ParameterEstimate, estimate
from cosim.identification.identifiability import Identifiability, identifiability
from cosim.identification.intervals import Spread, spread
from cosim.identification.linear_model import FRICTION, LinearModel, linear_model
from cosim.identification.method import Method, suggested, taati
from cosim.identification.stack import Stack, coulomb_label, everything, stack, with_columns, without
from cosim.measured.label import Label
from cosim.measured.recording import Recording

LONGER = 0.7  # cutoff of a filter that leaves a sixth of the noise's variance in the acceleration
STILL = 30.0  # encoder counts: a joint that moves less is taken as still


@frozen
class Parameter:
    """value, std and 95 % interval with the residual's correlation counted, std_white as least squares gives it."""

    label: Label
    value: float
    std: float
    std_white: float
    interval: tuple[float, float]
    unit: str


@frozen(eq=False)
class Identification:
    """What one method makes of a recording. rms_* hold Eq. 15 per joint, (nj,) [%]."""

    recording: Recording
    method: Method
    stack: Stack
    params: np.ndarray
    parameters: tuple[Parameter, ...]
    rms_train: np.ndarray
    rms_held_out: np.ndarray
    rms_held_out_all: np.ndarray
    spread: Spread
    identifiability: Identifiability
    positive_definite: bool
    warnings: tuple[str, ...] = field(default=())

    @property
    def model(self) -> LinearModel:
        """The linear model of the recording's device."""
        return _model(self.recording)

    @property
    def predicted(self) -> np.ndarray:
        """Filtered torque (n, nj) of the model."""
        return self.stack.y @ self.params

    @property
    def residual(self) -> np.ndarray:
        """measured - predicted, (n, nj)."""
        return self.stack.tau - self.predicted


def _model(recording: Recording) -> LinearModel:
    return linear_model(recording.device, recording.description)


def identify(recording: Recording, method: Method | None = None) -> Identification:
    """Fit the device's linear model. Raises InputError where there is too little to fit."""
    method = method or suggested(recording)
    full = _with_plausible_tail(stack(recording, method), method, recording)
    _enough(full, recording)
    shown, base, fitted, widths = _fit(full, method, recording)
    widths = _widened(widths, base, fitted, method, recording)
    params = _spread_out(fitted.params, shown.base, full.y.shape[2])
    definite, doubts = _physics(_model(recording), full.labels, params)
    found = Identification(
        recording,
        method,
        full,
        params,
        _parameters(full, shown, fitted, widths),
        rms_percent(full, params, full.fit),
        rms_percent(full, params, full.held_out),
        rms_percent(full, params, everything(full).held_out),
        widths,
        shown,
        definite,
    )
    return evolve(found, warnings=(*recording.warnings, *full.notes, *doubts, *_doubts(found)))


def _fit(full: Stack, method: Method, recording: Recording) -> tuple[Identifiability, Stack, ParameterEstimate, Spread]:
    """Base parameters, their estimate and its spread."""
    shown = identifiability(full)
    base = with_columns(full, shown.base)
    fitted = estimate(base, method, _model(recording))
    return shown, base, fitted, spread(base, fitted)


def _widened(widths: Spread, base: Stack, fitted: ParameterEstimate, method: Method, recording: Recording) -> Spread:
    """Intervals of a recording with clipped torques, wider by what a longer common filter changes.

    The rows that are left are the slow ones. There the encoder's noise in the acceleration, whose variance falls with
    the fifth power of the filter's length, makes inertias too small by more than the spread shows.
    """
    cutoff = getattr(method.low_pass, "cutoff", None)
    if cutoff is None or all(run.clipped is None for run in recording.runs):
        return widths
    longer = stack(recording, evolve(method, low_pass=evolve(method.low_pass, cutoff=LONGER * cutoff)))
    columns = [longer.labels.index(label) for label in base.labels]
    if longer.fit.sum() < 3 * len(columns):
        return widths
    other = estimate(with_columns(longer, columns), method, _model(recording))
    return evolve(widths, half_width=widths.half_width + np.abs(other.params - fitted.params))


def _with_plausible_tail(full: Stack, method: Method, recording: Recording) -> Stack:
    """Keep a `slow` column only where the data speak for it and it is that of a smoothed sign: Coulomb friction that
    is smaller on the slowest rows, by less than half of it. Elsewhere the column would only widen the intervals.
    """
    tails = [label for label in full.labels if label.name == "slow"]
    if not tails:
        return full
    _enough(full, recording)
    _, base, fitted, widths = _fit(full, method, recording)
    value = dict(zip(base.labels, fitted.params.tolist(), strict=True))
    score = dict(zip(base.labels, (fitted.params / np.maximum(widths.std, 1e-300)).tolist(), strict=True))
    doubtful = [
        tail
        for tail in tails
        if tail not in value or score[tail] > -1 or -value[tail] > 0.5 * abs(value.get(coulomb_label(tail), 0.0))
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


def identify_as_paper(recording: Recording) -> Identification:
    """The paper's estimator on the same recording."""
    return identify(recording, taati(recording))


def rms_percent(full: Stack, params: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Taati Eq. 15 per joint, 100 sqrt(sum r^2 / sum tau^2) over the marked equations (n, nj); NaN without rows."""
    residual = np.where(rows, full.tau - full.y @ params, 0.0)
    measured = np.where(rows, full.tau, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return 100 * np.sqrt((residual**2).sum(axis=0) / (measured**2).sum(axis=0))


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


def _spread_out(values: np.ndarray, base: tuple[int, ...], size: int) -> np.ndarray:
    full = np.zeros(size)
    full[list(base)] = values
    return full


def _parameters(
    full: Stack, shown: Identifiability, fitted: ParameterEstimate, widths: Spread
) -> tuple[Parameter, ...]:
    """All parameters in order; one outside the base is zero without an interval (its effect is in the base ones)."""
    table = []
    for k, (label, unit) in enumerate(zip(full.labels, full.units, strict=True)):
        if k not in shown.base:
            table.append(Parameter(label, 0.0, np.nan, np.nan, (np.nan, np.nan), unit))
            continue
        b = shown.base.index(k)
        value, half = float(fitted.params[b]), float(widths.half_width[b])
        interval = (value - half, value + half)
        table.append(Parameter(label, value, float(widths.std[b]), float(widths.std_white[b]), interval, unit))
    return tuple(table)


def _physics(model: LinearModel, labels: tuple[Label, ...], params: np.ndarray) -> tuple[bool, list[str]]:
    """Whether the mass matrix is positive definite, and doubts: it is not, or friction does not dissipate."""
    indefinite = model.indefinite(labels, params)
    doubts = [indefinite] if indefinite else []
    for label, value in zip(labels, params.tolist(), strict=True):
        if label.name == "viscous" and value < 0:
            doubts.append(
                f"{label} = {value:.3g} is negative: it would feed energy in; a Stribeck effect that the model lacks, "
                "or the sign of dq at reversals, makes least squares give this (see close-loop)"
            )
        if label.name == "coulomb" and value < 0:
            doubts.append(f"{label} = {value:.3g} is negative: not friction; a lag between tau and q can do this")
    return not indefinite, doubts


def _doubts(found: Identification) -> list[str]:
    """Parameters that the data do not determine, rows that leave the trained speeds, few independent samples."""
    doubts = list(found.identifiability.combinations)
    wide = unexcited(found)[len(found.identifiability.unexcited) :]
    if wide:
        names = ", ".join(map(str, wide))
        doubts.append(f"not determined by this motion (interval wider than the parameter's usual size): {names}")
    if found.spread.blocks < 12:
        doubts.append(f"only {found.spread.blocks} independent blocks: intervals are rough")
    return doubts + _shifted(found) + _against_declared(found) + _outside(found.stack)


def _shifted(found: Identification) -> list[str]:
    """Whether tau is early or late against q: tau(t + d) = tau + d dtau/dt, a column fitted beside the others."""
    step = max(run.step for run in found.recording.runs)
    base = with_columns(found.stack, found.identifiability.base)
    rate = found.stack.tau_rate[:, :, None] * step
    wider = evolve(base, y=np.concatenate([base.y, rate], axis=2), labels=(*base.labels, Label("shift")))
    fitted = estimate(wider, evolve(found.method, physical=False), found.model)
    shift, std = float(fitted.params[-1]), float(spread(wider, fitted).std[-1])
    if abs(shift) < 0.25 or abs(shift) < 4 * std:
        return []
    way, advice = (
        "early",
        "a command that is held until the next sample is half a sample early: say torque_held = true",
    )
    if shift < 0:
        way, advice = ("late", "a filter on one side, or stamps taken at another time")
    return [
        f"tau is {way} against q by {abs(shift):.2g} samples "
        f"({abs(shift) * step * 1e3:.2g} ms, +-{2 * std:.1g} samples): {advice}; "
        "a lag or delay of the actuator looks the same (close-loop tells)"
    ]


def _against_declared(found: Identification) -> list[str]:
    """Declared parameters that lie outside their intervals: a payload, a gain error, or a declaration that is wrong."""
    pairs = zip(found.parameters, found.model.declared().tolist(), strict=False)
    outside = [str(p.label) for p, value in pairs if not p.interval[0] <= value <= p.interval[1]]
    names = ", ".join(outside)
    text = (
        f"declared parameters outside their 95 % intervals: {names} (a payload, a gain error, or a wrong declaration)"
    )
    return [text] if outside else []


def _outside(full: Stack) -> list[str]:
    train, test = full.settled & ~full.test, full.settled & full.test
    if not train.any() or not test.any():
        return []
    limit = 1.02 * np.abs(full.dq[train]).max(axis=0)
    count = int((np.abs(full.dq[test]) > limit).any(axis=1).sum())
    return [f"{count} of {int(test.sum())} held-out rows are faster than any training row"] if count else []


def unexcited(found: Identification) -> tuple[Label, ...]:
    """Parameters that the motion did not excite: those of dependent columns, those of joints that hardly left their
    encoder's counts, and those whose interval is wider than their usual size.
    """
    labels = list(found.identifiability.unexcited)
    labels += [label for label in _of_still_joints(found) if label not in labels]
    wide = [p.label for p in found.parameters if (p.interval[1] - p.interval[0]) / 2 > found.model.usual_size(p.label)]
    return (*labels, *(label for label in wide if label not in labels))


def _of_still_joints(found: Identification) -> list[Label]:
    """Parameters that only the motion of a still joint shows. There the columns are the encoder's noise, and least
    squares is sure of a wrong value (errors in variables).
    """
    still = [j for j in range(len(found.recording.joints)) if counts(found.recording, j) < STILL]
    return [label for j in still for label in found.model.of_joint(j) if label in found.stack.labels]


def counts(recording: Recording, joint: int) -> float:
    """Standard deviation of a joint's position in steps of its own column, the smallest change that is often there."""
    q = np.concatenate([run.q[:, joint] for run in recording.runs])
    steps = np.abs(np.diff(q))
    steps = steps[steps > 1e-9 * max(np.ptp(q), 1e-30)]
    return float(np.std(q) / np.quantile(steps, 0.05)) if len(steps) else 0.0


def without_friction(found: Identification) -> np.ndarray:
    """Parameters (p,) of the same model fitted with no friction columns (they are zero): Taati's Figs. 4 and 5."""
    friction = (*FRICTION, "slow")
    rigid = [k for k in found.identifiability.base if found.stack.labels[k].name not in friction]
    fitted = estimate(with_columns(found.stack, rigid), evolve(found.method, physical=False), found.model)
    return _spread_out(fitted.params, tuple(rigid), len(found.params))
