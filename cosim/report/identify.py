"""The report page of an identification: verdict, parameters, errors, figures, doubts."""

import numpy as np

from cosim.identification.document import verdict
from cosim.identification.identification import Identification, unexcited, without_friction
from cosim.identification.idim import Idim
from cosim.report import identify_figures as plots
from cosim.report.data import doubt_table
from cosim.report.html import Report, Section, Table
from cosim.report.plots import Figure
from cosim.version import __version__


def page(found: Identification, paper: Identification, idim: Idim | None) -> Report:
    """The report of one identification beside the paper's estimator."""
    joints = found.recording.joints
    sections = [_parameters(found, paper), _errors(found, paper, idim), *_figures(found), _shown(found), _data(found)]
    provenance: dict[str, object] = {
        "device": found.recording.device.word,
        "files": ", ".join(found.recording.files),
        "method": found.method.text(),
        "cosim": __version__,
    }
    return Report(f"Identification: {', '.join(joints)}", verdict(found), sections, provenance, _mood(found))


def _mood(found: Identification) -> str:
    finite = found.rms_held_out[np.isfinite(found.rms_held_out)]
    return (
        "good"
        if len(finite) and finite.max() < 10 and found.positive_definite and not unexcited(found) and not found.withheld
        else "neutral"
    )


def _parameters(found: Identification, paper: Identification) -> Section:
    known = found.model.published()
    header = [
        "parameter",
        "value",
        "95 % from",
        "to",
        "std",
        "std if white",
        "paper's",
        *([known.title] if known else []),
        "unit",
    ]
    rows, papers = [], {p.label: f"{p.value:.5g}" for p in paper.parameters}
    for k, p in enumerate(found.parameters):
        other = [f"{known.values[k]:.5g}" if k < len(known.values) else None] if known else []
        reason = f"withheld: {', '.join(p.withheld)}" if p.withheld else None
        numbers = [f"{v:.5g}" if np.isfinite(v) else reason for v in p.interval]
        numbers += [f"{v:.2g}" if np.isfinite(v) else None for v in (p.std, p.std_white)]
        rows.append([str(p.label), f"{p.value:.6g}", *numbers, papers.get(p.label), *other, p.unit])
    text = (
        "The standard deviation counts the residual's correlation in time: contiguous blocks of "
        f"{found.spread.block:.2g} s are left out one at a time "
        f"({found.spread.blocks} blocks). The white-noise figure is what least "
        "squares gives by itself; it is shown to be compared, not to be used."
    )
    given = any(np.isfinite(p.std) for p in found.parameters)
    return Section("Parameters", text, [Table(header, rows)], [plots.intervals(found)] if given else [])


def _errors(found: Identification, paper: Identification, idim: Idim | None) -> Section:
    rows = []
    for j, joint in enumerate(found.recording.joints):
        rows.append([joint, "this tool, rows near reversals left out", found.rms_train[j], found.rms_held_out[j]])
        rows.append([joint, "this tool, judged on all rows", None, found.rms_held_out_all[j]])
        rows.append([joint, "paper's estimator, all rows", paper.rms_train[j], paper.rms_held_out[j]])
    if idim is not None:
        joint = found.recording.joints[0]
        rows.append([joint, idim.text, idim.published.train, idim.published.held_out])
        rows.append(
            [joint, "this tool's parameters on those same rows and band", idim.other.train, idim.other.held_out]
        )
        if idim.recentred is not None:
            rows.append(
                [
                    joint,
                    "the same IDIM-LS, force moved half a sample to the middle of its hold",
                    idim.recentred.train,
                    idim.recentred.held_out,
                ]
            )
    text = (
        "RMS% of Taati Eq. 15, 100 sqrt(sum r^2 / sum tau^2), on the filtered "
        "torque. Lines with different rows or filters judge "
        "different things: a lower band leaves out what the model cannot follow. "
        f"This tool: {found.method.text()}.\n\nPaper: {paper.method.text()}."
    )
    return Section("Errors", text, [Table(["joint", "method", "train [%]", "held out [%]"], rows)])


def torque_figure(found: Identification) -> Figure:
    """Measured and predicted torque of every joint on held-out rows."""
    return plots.torques(found, without_friction(found), found.model.frictionless())


def _figures(found: Identification) -> list[Section]:
    over = plots.residuals(found, without_friction(found))
    return [
        Section("Torques", figures=[torque_figure(found)]),
        Section("Friction", figures=[over, plots.friction(found)]),
    ]


def _shown(found: Identification) -> Section:
    shown = found.identifiability
    rows = [
        ["condition number of the scaled regressor", shown.condition],
        ["rank", f"{shown.rank} of {len(found.parameters)}"],
        ["not determined", ", ".join(map(str, unexcited(found))) or "none"],
        ["mass matrix positive definite over the workspace", found.positive_definite],
        ["equations fitted", int(found.stack.fit.sum())],
        ["independent samples that these are worth", [float(np.round(v)) for v in found.spread.effective]],
    ]
    return Section("What the motion shows", "\n\n".join(shown.combinations), [Table(["", ""], rows)])


def _data(found: Identification) -> Section:
    recording = found.recording
    rows = [
        [run.name, len(run), run.step * 1e3, f"{run.time[-1] - run.time[0]:.3g}", int(run.test.sum())]
        for run in recording.runs
    ]
    table = Table(["run", "rows", "step [ms]", "length [s]", "held out"], rows)
    told = {doubt.text for doubt in found.doubts}
    text = "\n\n".join(warning for warning in found.warnings if warning not in told)
    tables = [doubt_table(found.doubts), table] if found.doubts else [table]
    return Section("Data, repairs and doubts", text or "Nothing was repaired and nothing looks wrong.", tables)
