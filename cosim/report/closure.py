"""The report of `cosim close-loop`: verdict, before and after, evidence, parameters, replay, what to measure next."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from cosim.closure.closure import Closure
from cosim.closure.document import effective, sentence, simulated
from cosim.closure.model.model import Model
from cosim.closure.output import write
from cosim.closure.score.errors import torque
from cosim.closure.verdict import Answer
from cosim.errors import InputError, Problem
from cosim.report import closure_figures as plots
from cosim.report.html import Report, Section, Table, write_report
from cosim.report.plots import Figure

MOODS = {Answer.FOUND: "good", Answer.COMPLETE: "good", Answer.UNEXPLAINED: "neutral", Answer.REFUSED: "bad"}


def save(closure: Closure, folder: Path | str) -> Closure:
    """Write all files of `cosim close-loop`, the report last; returns the closure as written."""
    closure = write(closure, folder)
    write_report(page(closure), Path(folder) / "report.html")
    return closure


def page(closure: Closure) -> Report:
    """The whole report."""
    sections = [_errors, _time, _signals, _residual, _parameters, _candidates, _leftovers, _replay, _next, _warnings]
    made = [section(closure) for section in sections]
    return Report(
        "The loop closed with measured data",
        sentence(closure),
        [s for s in made if s is not None],
        {
            "recordings": ", ".join(closure.recording.files),
            "device": closure.recording.device.word,
            "filter": _filter(closure),
        },
        MOODS[closure.verdict.answer],
    )


def _filter(closure: Closure) -> str:
    if closure.before is None:
        return "-"
    widths = closure.before.setting.motion.widths
    return f"Gaussian, {1e3 * widths.total:.3g} ms wide ({widths.cutoff:.3g} Hz at half power), on both sides"


def _unit(closure: Closure) -> str:
    return "N" if closure.recording.description.prismatic else "N m"


def _models(closure: Closure) -> tuple[Model, Model] | None:
    if closure.before is None or closure.search is None:
        return None
    return closure.before, closure.verdict.models()[1]


def error_figure(closure: Closure) -> Figure:
    """Held-out torque error of every joint before and after, interval and floor. Raises InputError where refused."""
    e, labels = closure.error, closure.recording.joints
    if e is None:
        raise InputError(Problem("plot", "a recording that was not refused", "a refused one", "see warnings"))
    return plots.error_bars(e.before, e.after, e.interval, closure.floor or (None,) * len(labels), labels)


def _errors(closure: Closure) -> Section | None:
    e = closure.error
    if e is None:
        return None
    labels = closure.recording.joints
    floor = closure.floor or (None,) * len(labels)
    errors = e.before, e.after, e.interval, floor, e.all_before, e.all_after, e.fitted_before, e.fitted_after
    rows = [(label, *(_cell(x[j]) for x in errors)) for j, label in enumerate(labels)]
    header = (
        "joint",
        "before",
        "after",
        "95 % interval",
        "floor",
        "before, with reversals",
        "after, with reversals",
        "before, fitted rows",
        "after, fitted rows",
    )
    text = (
        "RMS of the residual as a share of the RMS of the measured torque "
        "(Taati Eq. 15), both filtered alike, on held-out rows. "
        "Standstill and reversals are left out: the direction of friction is not known there; "
        "beside it the error with reversals. The floor is what repeats of one "
        "motion differ by. A dash: no repeats, or a joint that does not move in these rows."
    )
    table = Table(header, rows, "RMS error of the torque [%]", digits=3)
    return Section("Error before and after", text, [table], [error_figure(closure)])


def _cell(value: float | tuple[float, float] | None) -> float | str | None:
    """A number or an interval for a table, None (a dash) where it is not known."""
    if value is None or not np.isfinite(value).all():
        return None
    return f"{value[0]:.3g} to {value[1]:.3g}" if isinstance(value, tuple) else value


def _held(model: Model) -> np.ndarray:
    rows = model.setting.rows
    return rows.test if rows.test.any() else ~rows.test


def _time(closure: Closure) -> Section | None:
    models = _models(closure)
    if models is None:
        return None
    before, after = models
    rows = _held(before)
    time = before.setting.motion.time[before.setting.rows.index][rows]
    figure = plots.torque_before_after(
        time,
        torque(before)[:, rows],
        before.residual[:, rows],
        after.residual[:, rows],
        closure.recording.joints,
        _unit(closure),
    )
    return Section("Measured against model", figures=[figure])


def _signals(closure: Closure) -> Section | None:
    """The residual against the signal of each finding or leftover."""
    models = _models(closure)
    if models is None:
        return None
    figures = []
    for joint, name in _explaining(closure)[:4]:
        signal = _signal(models[0], name)
        use = models[0].setting.use[joint]
        if signal is not None:
            residuals = [model.residual[joint][use] for model in models]
            caption = f"Residual of joint {joint + 1} against {name}: means of bins with 95 % intervals."
            figures.append(plots.against_signal(signal[use], residuals[0], residuals[1], name, _unit(closure), caption))
    return Section("Residual against the signal that explains it", figures=figures) if figures else None


REVERSAL = "signed distance since the last reversal of joint"
EXPLAINED_BY = {
    "stribeck": "dq",
    "coulomb_asymmetry": "dq",
    "viscous_asymmetry": "dq",
    "torque_offset": "dq",
    "quadratic_drag": "dq",
    "load_friction": "tau",
    "position_friction": "q",
    "position_torque": "q",
    "torque_ripple": "q",
    "hysteresis": REVERSAL,
    "friction_drift": "time",
    "actuator_lag": "tau rate",
    "time_delay": "tau rate",
    "torque_saturation": "tau",
    "torque_deadband": "tau",
    "torque_gain": "tau",
    "joint_elasticity": "tau",
    "backlash": "tau",
    "encoder_offset": "q",
    "base_tilt": "q",
    "payload": "q",
    "external_contact": "q",
}


def _explaining(closure: Closure) -> list[tuple[int, str]]:
    pairs = []
    for found in closure.verdict.findings:
        kind = EXPLAINED_BY.get(found.name) or next(iter(found.effect.signals), "dq")
        for j in found.joints:
            other = int(found.choice.theta[0]) + 1 if found.name == "joint_coupling" else j
            pairs.append((j - 1, kind if kind == "time" else f"{kind} {other if other > 0 else j}"))
    for leftover in closure.verdict.leftovers:
        name = leftover.signals[0].replace("history of ", "")
        pairs.append((leftover.joint, name if name == "time" else f"{name.rstrip('0123456789')} {name[-1]}"))
    return list(dict.fromkeys(pairs))


def _signal(model: Model, name: str) -> np.ndarray | None:
    motion, index = model.setting.motion, model.setting.rows.index
    if name == "time":
        return motion.time[index]
    kind, _, number = name.rpartition(" ")
    source: np.ndarray | None = {
        "q": motion.q,
        "dq": motion.dq,
        "ddq": motion.ddq,
        "tau": motion.tau,
        "tau rate": motion.rate(motion.tau),
        REVERSAL: since_reversal(motion.q, motion.bounds),
    }.get(kind)
    if source is None or not number.isdigit() or not 0 < int(number) <= source.shape[1]:
        return None
    return source[index, int(number) - 1]


def since_reversal(q: np.ndarray, bounds: Iterable[tuple[int, int]]) -> np.ndarray:
    """Distance (n, nj) that each joint has moved since it turned last, with the sign of its direction, in each run of
    rows from a to b: what presliding and cables depend on. q (n, nj) [rad or m].
    """
    out = np.zeros_like(q)
    for a, b in bounds:
        for j in range(q.shape[1]):
            move = np.diff(q[a:b, j], prepend=q[a, j])
            turns = np.flatnonzero(np.diff(np.sign(move)) != 0) + 1
            gone = np.cumsum(move)
            start = np.zeros(b - a)
            start[turns] = np.diff(gone[turns - 1], prepend=0.0)
            out[a:b, j] = gone - np.cumsum(start)
    return out


def _residual(closure: Closure) -> Section | None:
    models = _models(closure)
    if models is None:
        return None
    before, after = models
    s = before.setting
    step = float(np.median(np.diff(s.rows.index))) * s.motion.step
    figures = [plots.whiteness(before.residual, after.residual, step, closure.recording.joints)]
    correlations = []
    m, index = s.motion, s.rows.index
    for j, label in enumerate(closure.recording.joints):
        signals = {
            f"q{j + 1}": m.q[index, j],
            f"dq{j + 1}": m.dq[index, j],
            f"ddq{j + 1}": m.ddq[index, j],
            f"tau{j + 1}": m.tau[index, j],
        }
        signals |= {name: values[index] for name, values in list(m.other.items())[:2]}
        correlations.append(plots.cross_correlation(before.residual[j], signals, step, label))
    figures.append(Figure(correlations, "Correlation of the residual with other signals.", name="correlation"))
    return Section("What the residual is made of", figures=figures)


def _parameters(closure: Closure) -> Section | None:
    rows = [
        (
            f.name,
            f.joints,
            f"{label}{' (effective)' * (label in effective(f))}",
            value,
            f"{f.interval[label][0]:.4g} to {f.interval[label][1]:.4g}",
            f.effect.equation,
        )
        for f in closure.verdict.findings
        for label, value in f.parameters.items()
    ]
    if not rows:
        return None
    text = "95 % intervals from the jackknife over contiguous blocks, all parameters of the model refitted together."
    if any(map(effective, closure.verdict.findings)):
        text += (
            " Compliance and damping beside a gap are effective values: they "
            "hold how the link bounces between its sides, "
            "which smoothed motion hides."
        )
    return Section(
        "Parameters of the effects",
        text,
        [Table(("effect", "joints", "FMU parameter", "value", "interval", "equation"), rows, digits=4)],
    )


def _candidates(closure: Closure) -> Section | None:
    if closure.search is None:
        return None
    tables = []
    for number, step in enumerate(closure.search.steps, 1):
        rows = []
        taken = step.taken and step.taken.choices[-1].key
        for x in step.found[:14]:
            state = "taken" if x.choice.key == taken else "clear of chance" if x.clear else "within chance"
            joints = [j + 1 for j in x.choice.joints]
            rows.append((x.choice.effect.name, joints, x.nats, x.z, 100 * x.share, state))
        header = ("effect", "joints", "gain [nats]", "z", "share of torque [%]", "decision")
        tables.append(Table(header, rows, f"Round {number}: candidates beside what was accepted before", digits=3))
    untestable = [
        (c.choice.effect.name, [j + 1 for j in c.choice.joints], c.reason, c.choice.effect.needs)
        for c in closure.search.untestable
    ]
    if untestable:
        tables.append(Table(("effect", "joints", "why", "needs"), untestable, "What this data cannot show"))
    text = (
        f"{closure.search.trials} hypotheses were tried. Gains are in nats of the recorded torque; z is the gain in "
        "standard deviations of what chance makes of this very recording (signs of its pieces at random), and has to "
        "pass the largest that chance makes of the whole library; rigid body and friction are fitted again with every "
        "candidate."
    )
    return Section("Candidates and evidence", text, tables)


def _leftovers(closure: Closure) -> Section | None:
    rows = [
        (
            x.joint + 1,
            x.family.title + ("" if x.sure else " (comes closest; more than the sensors' noise is left)"),
            x.nats,
        )
        for x in closure.verdict.leftovers[:12]
    ]
    rows += [
        (
            ", ".join(str(j + 1) for j in c.joints),
            f"{c.effect.name} (withdrawn): {why}",
            None,
        )
        for c, why in closure.verdict.withdrawn
    ]
    if not rows:
        return None
    text = (
        "Functions that are fitted, not known, still lower the error of "
        "blocks that the fit has not seen, without a name."
    )
    return Section("What is left without a name", text, [Table(("joint", "what it is", "gain [nats]"), rows, digits=3)])


def _replay(closure: Closure) -> Section | None:
    r = closure.replay
    if r is None:
        return None
    labels = closure.recording.joints
    errors = r.before, r.after, r.interval, r.position_before, r.position_after
    rows = [(label, *(_cell(x[j]) for x in errors)) for j, label in enumerate(labels)]
    header = ("joint", "torque before [%]", "torque after [%]", "95 % interval", "position before", "position after")
    figures = []
    if len(r.time):
        figures = [plots.replayed(r.time, r.tau, r.tau_before, r.tau_after, labels, _unit(closure))]
    text = (
        f"The recorded experiment ({r.kind}) as a co-simulation with the old and "
        f"the new FMU, held-out rows. Positions: RMS in rad or m. "
        "A replay can disagree with the torque error: its errors feed back "
        "through the controller."
    )
    if found := simulated(closure):
        text += f"\n\n{found}"
    if r.warnings:
        text += "\n\n" + "\n\n".join(r.warnings)
    return Section("Replay as a co-simulation", text, [Table(header, rows, digits=3)], figures)


def _next(closure: Closure) -> Section | None:
    lines = [
        f"{f.name} on joint(s) {', '.join(map(str, f.joints))}: {f.separated_by}."
        for f in closure.verdict.findings
        if f.aliases
    ]
    lines += [f"joint {x.joint + 1}, {x.family.title}: {x.family.separated_by}." for x in closure.verdict.leftovers]
    if closure.search is not None:
        needs = {
            c.choice.effect.name: c.choice.effect.needs for c in closure.search.untestable if c.choice.effect.needs
        }
        lines += [f"To see {name}: {need}." for name, need in needs.items()]
    return Section("What to measure next", "\n\n".join(lines)) if lines else None


def _warnings(closure: Closure) -> Section | None:
    return Section("Warnings", "\n\n".join(closure.warnings)) if closure.warnings else None
