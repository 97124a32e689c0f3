"""One identification: from a recording to parameters with intervals, errors on held-out rows, and doubts."""

import numpy as np
from attrs import evolve, field, frozen

from cosim.errors import InputError
from cosim.identification.doubted import Doubted, doubted
from cosim.identification.estimate import estimate
from cosim.identification.fit import Fit, fit
from cosim.identification.identifiability import Identifiability
from cosim.identification.intervals import BLOCKS, Spread
from cosim.identification.linear_model import FRICTION, LinearModel
from cosim.identification.method import Method, suggested, taati
from cosim.identification.models import linear_model
from cosim.identification.stack import Stack, everything, with_columns
from cosim.measured.label import Label
from cosim.measured.notes import Doubt
from cosim.measured.recording import Recording

STILL = 30.0  # encoder counts: a joint that moves less is taken as still


@frozen
class Parameter:
    """value, std and 95 % interval with the residual's correlation counted, std_white as least squares gives it.

    withheld: kinds of doubts for which there is no interval (NaN).
    """

    label: Label
    value: float
    std: float
    std_white: float
    interval: tuple[float, float]
    unit: str
    withheld: tuple[str, ...] = ()


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
    doubts: tuple[Doubt, ...] = field(default=())

    @property
    def model(self) -> LinearModel:
        """The linear model of the recording's device."""
        return linear_model(self.recording.device, self.recording.description)

    @property
    def withheld(self) -> tuple[Label, ...]:
        """Parameters whose interval is withheld."""
        return tuple(p.label for p in self.parameters if p.withheld)

    @property
    def predicted(self) -> np.ndarray:
        """Filtered torque (n, nj) of the model."""
        return self.stack.y @ self.params

    @property
    def residual(self) -> np.ndarray:
        """measured - predicted, (n, nj)."""
        return self.stack.tau - self.predicted


def identify(recording: Recording, method: Method | None = None) -> Identification:
    """Fit the device's linear model. Raises InputError where there is too little to fit."""
    fitted, left = _narrowest(recording, method or suggested(recording))
    full = fitted.stack
    params = _spread_out(fitted.params, fitted.shown.base, full.y.shape[2])
    definite, doubts = _physics(fitted.model, full.labels, params)
    found = Identification(
        recording,
        fitted.method,
        full,
        params,
        _parameters(fitted, left),
        rms_percent(full, params, full.fit),
        rms_percent(full, params, full.held_out),
        rms_percent(full, params, everything(full).held_out),
        fitted.spread,
        fitted.shown,
        definite,
        doubts=(*recording.doubts, *left.doubts),
    )
    late = (doubt.text for doubt in left.doubts)
    return evolve(
        found, warnings=(*recording.warnings, *full.notes, *doubts, *late, *_doubts(found), *_withheld(found))
    )


def _narrowest(recording: Recording, method: Method) -> tuple[Fit, Doubted]:
    """The fit with the narrowest intervals, of those with the filters that the method tries."""
    found, problem = [], None
    for tried in method.tried():
        try:
            fitted = fit(recording, tried)
        except InputError as error:
            problem = problem or error
            continue
        left = doubted(fitted)
        widths = zip(fitted.base.labels, left.half_width.tolist(), strict=True)
        found.append((np.mean([np.log(width) for label, width in widths if label.name != "slow"]), fitted, left))
    if not found and problem:
        raise problem
    _, fitted, left = min(found, key=lambda entry: entry[0])
    return fitted, left


def _withheld(found: Identification) -> list[str]:
    """Which parameters have no interval, and why."""
    names: dict[tuple[str, ...], list[str]] = {}
    for p in found.parameters:
        if p.withheld:
            names.setdefault(p.withheld, []).append(str(p.label))
    return [
        f"no interval for {', '.join(labels)}: a doubt about the recording ({', '.join(kinds)}) was not mended"
        for kinds, labels in names.items()
    ]


def identify_as_paper(recording: Recording) -> Identification:
    """The paper's estimator on the same recording."""
    return identify(recording, taati(recording))


def rms_percent(full: Stack, params: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Taati Eq. 15 per joint, 100 sqrt(sum r^2 / sum tau^2) over the marked equations (n, nj); NaN without rows."""
    residual = np.where(rows, full.tau - full.y @ params, 0.0)
    measured = np.where(rows, full.tau, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return 100 * np.sqrt((residual**2).sum(axis=0) / (measured**2).sum(axis=0))


def _spread_out(values: np.ndarray, base: tuple[int, ...], size: int) -> np.ndarray:
    full = np.zeros(size)
    full[list(base)] = values
    return full


def _parameters(fitted: Fit, left: Doubted) -> tuple[Parameter, ...]:
    """All parameters in order; one outside the base is zero without an interval (its effect is in the base ones)."""
    table = []
    widths, base, nothing = fitted.spread, fitted.shown.base, (np.nan, np.nan)
    for k, (label, unit) in enumerate(zip(fitted.stack.labels, fitted.stack.units, strict=True)):
        kinds = left.withheld.get(label, ())
        if k not in base:
            table.append(Parameter(label, 0.0, np.nan, np.nan, nothing, unit, kinds))
            continue
        b = base.index(k)
        value, half = float(fitted.params[b]), float(left.half_width[b])
        if kinds:
            table.append(Parameter(label, value, np.nan, np.nan, nothing, unit, kinds))
            continue
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
    if found.spread.blocks < BLOCKS:
        doubts.append(f"only {found.spread.blocks} independent blocks: intervals are rough")
    return doubts + _against_declared(found) + _outside(found.stack)


def _against_declared(found: Identification) -> list[str]:
    """Declared parameters that lie outside their intervals: a payload, a gain error, or a declaration that is wrong."""
    pairs = zip(found.parameters, found.model.declared().tolist(), strict=False)
    outside = [str(p.label) for p, value in pairs if not (p.withheld or p.interval[0] <= value <= p.interval[1])]
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
