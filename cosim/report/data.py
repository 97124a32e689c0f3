"""The page of `cosim data`: what a recording holds, what it looks like over time, what is doubtful."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from cosim.measured.notes import Doubt
from cosim.measured.recording import Recording, Run
from cosim.measured.survey import Survey
from cosim.report.html import Report, Section, Table
from cosim.report.plots import TIME, Colour, Figure, Plot, PlotAxis, Series, curves, shaded
from cosim.results.provenance import command_line, versions

DRAWN = 6
"""Runs that are drawn, the longest ones; the table has all."""


def data_report(found: Survey) -> Report:
    """The whole page."""
    recording = found.recording
    sections = [] if recording is None else [_signals(recording), _sampling(recording), _doubts(found, recording)]
    facts = {"files": list(found.files), "described by": found.described_by, "description": found.draft or None}
    facts |= {"versions": versions(), "command": command_line()}
    mood = "bad" if recording is None else "neutral" if recording.doubts else "good"
    names = [Path(file).name for file in found.files]
    title = f"Recording {', '.join(names[:3])}{f' and {len(names) - 3} more' if len(names) > 3 else ''}"
    return Report(title, _verdict(found), [*sections, _columns(found)], facts, mood)


def doubt_table(doubts: Iterable[Doubt]) -> Table:
    """Doubts with what became of each."""
    rows = [(doubt.kind, doubt.done.value, doubt.count or None, doubt.text) for doubt in doubts]
    return Table(("doubt", "what became of it", "rows", ""), rows)


def _verdict(found: Survey) -> str:
    recording = found.recording
    if recording is None:
        return "It cannot be used as described.\n\n" + "; ".join(found.problems)
    rows, seconds = sum(map(len, recording.runs)), sum(float(r.time[-1] - r.time[0]) for r in recording.runs)
    held = f"{len(recording.runs)} run{'s' if len(recording.runs) > 1 else ''}, {rows} rows, {seconds:.4g} s"
    kinds = ", ".join(dict.fromkeys(doubt.kind for doubt in recording.doubts))
    said = f"{len(recording.doubts)} doubtful: {kinds}." if kinds else "Nothing looks wrong."
    how = "was guessed from names and values" if found.draft else f"is said in {found.described_by}"
    return f"{held}. {said}\n\nWhat the columns are {how}."


def _signals(recording: Recording) -> Section:
    longest = sorted(recording.runs, key=len, reverse=True)[:DRAWN]
    drawn = [run for run in recording.runs if any(run is one for one in longest)]
    left = len(recording.runs) - len(drawn)
    text = "Shaded: rows that are held out, on which errors are reported."
    if left:
        text += f" The {len(drawn)} longest runs are drawn; {left} more are in the table."
    return Section("Signals over time", text, figures=[_figure(recording, run, k) for k, run in enumerate(drawn, 1)])


def _figure(recording: Recording, run: Run, number: int) -> Figure:
    """Position and torque of every joint of a run; torques at the end of their range in red."""
    units = {"q": recording.description.si["q"], "tau": recording.description.torque_unit}
    plots = []
    for joint, name in enumerate(recording.joints):
        for role, words, values in (("q", "position", run.q), ("tau", "torque", run.tau)):
            series = curves(run.time, {words: values[:, joint]}, [Colour.BLUE if role == "q" else Colour.ORANGE])
            if role == "tau" and run.clipped is not None and run.clipped[:, joint].any():
                at_limit = np.where(run.clipped[:, joint], values[:, joint], np.nan)
                series.append(Series("at the end of its range", run.time, at_limit, Colour.RED, size=3.0))
            axis = PlotAxis(f"{name} {words} [{units[role]}]")
            plots.append(Plot(series, TIME, axis, link=f"run-{number}", strips=shaded(run.time, run.test)))
    return Figure(plots, f"Run {run.name}.", columns=2, name=f"run-{number}")


def _sampling(recording: Recording) -> Section:
    ranges = [f"{role} {joint}" for joint in recording.joints for role in ("q", "tau")]
    rows = [
        [
            run.name,
            len(run),
            float(run.time[-1] - run.time[0]),
            1.0 / run.step,
            int(run.test.sum()),
            0 if run.clipped is None else int(run.clipped.any(axis=1).sum()),
            *(
                f"{values[:, k].min():.4g} to {values[:, k].max():.4g}"
                for k in range(len(recording.joints))
                for values in (run.q, run.tau)
            ),
        ]
        for run in recording.runs
    ]
    header = ["run", "rows", "length [s]", "rate [Hz]", "held out", "clipped", *ranges]
    return Section("Runs", "On an even grid of time, in SI units.", [Table(header, rows)])


def _doubts(found: Survey, recording: Recording) -> Section:
    told = {doubt.text for doubt in recording.doubts}
    lines = [f"Not described: {text}." for text in found.left_out]
    lines += [warning for warning in recording.warnings if warning not in told]
    tables = [doubt_table(recording.doubts)] if recording.doubts else []
    return Section("Repairs and doubts", "\n\n".join(lines) or ("" if tables else "Nothing was repaired."), tables)


def _columns(found: Survey) -> Section:
    rows = [
        [c.name, c.kind, c.rows, c.low, c.high, c.role or None, c.unit or None, c.why or None] for c in found.columns
    ]
    header = ("column", "kind", "rows", "least", "greatest", "taken for", "unit", "why")
    return Section("Columns of the file", "Roles and units are guesses." if found.draft else "", [Table(header, rows)])
