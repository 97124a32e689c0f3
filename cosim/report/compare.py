"""Report of a comparison: verdicts, what was given, signals over one another with their differences, maps."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim.report.html import Report, Section, Table, cell
from cosim.report.plots import COLOURS, TIME, Colour, Figure, Mark, Plot, PlotAxis, Series, Strip
from cosim.report.sweep import MARKS
from cosim.results.compared import RunsCompared, given
from cosim.results.pairs import SignalPair, TracesPair
from cosim.results.provenance import command_line, versions
from cosim.signals import stem
from cosim.sweeps.shift import MapsCompared, StabilityMap

_DASHES = ((), (7, 3), (2, 2), (9, 3, 2, 3))
_MOST = 12  # vectors that are drawn, those that differ most before others


def comparison_report(found: RunsCompared | MapsCompared) -> Report:
    """The page of a comparison."""
    return _runs_report(found) if isinstance(found, RunsCompared) else _sweeps_report(found)


def overview(found: RunsCompared | MapsCompared) -> Figure:
    """The figure of a comparison in one: the vector that differs most, or the boundaries of all maps."""
    if isinstance(found, MapsCompared):
        return _boundaries(found)
    worst = max((p.worst for p in found.pairs), key=lambda s: (s.moves and s.share > 0.0, s.share))
    return _overlay(found, stem(worst.match.name))


def _mood(agrees: bool | None) -> str:
    return {True: "good", False: "bad", None: "neutral"}[agrees]


def _facts() -> dict[str, object]:
    return {"versions": versions(), "command": command_line()}


def _title(names: Sequence[str]) -> str:
    return f"{', '.join(names[1:])} against {names[0]}"


def _verdicts(found: RunsCompared | MapsCompared) -> str:
    said = [f"{p.other.name}: {found.verdict(k)}." for k, p in enumerate(found.pairs)]
    if found.agrees is not None:
        said.insert(0, "All within the tolerance." if found.agrees else "Not within the tolerance.")
    return "\n\n".join(said)


# --- runs -------------------------------------------------------------------------------------------------------------


def _runs_report(found: RunsCompared) -> Report:
    names = [run.traces.name for run in found.runs]
    sections = [_summaries(found), _given(found), *_signals(found), _table(found), _notes(found)]
    kept = [section for section in sections if section is not None]
    return Report(_title(names), _verdicts(found), kept, _facts(), _mood(found.agrees))


_ROWS = (
    ("outcome", "outcome", 1.0),
    ("growth rate of small disturbances [1/s]", "growth_rate", 1.0),
    ("its 95 % interval [1/s]", "growth_rate_interval", 1.0),
    ("tracking, RMS of |x_l − x_r| [mm]", "tracking_rmse", 1e3),
    ("motor limit first reached [s]", "limit_hit_at", 1.0),
    ("effects", "effects", 1.0),
)


def _summaries(found: RunsCompared) -> Section | None:
    """What was found in each run, side by side."""
    summaries = [run.summary for run in found.runs]
    rows = []
    for title, key, factor in _ROWS:
        values = [s.get(key) for s in summaries]
        values = [v.get("total") if isinstance(v, dict) else v for v in values]
        if any(v not in (None, [], ()) for v in values):
            rows.append([title, *(_cell(v, factor) for v in values)])
    rows += _measures(summaries)
    if not rows:
        return None
    return Section("What was found", tables=[Table(["", *(run.traces.name for run in found.runs)], rows)])


def _measures(summaries: Sequence[Any]) -> list[list[str]]:
    """Rows of the measures, each with its unit, as summary.json has them."""
    found = [summary.get("measures") or {} for summary in summaries]
    units = {name: measure["unit"] for measures in found for name, measure in measures.items()}
    return [
        [f"{name.replace('_', ' ')} [{unit}]", *(cell(m[name]["value"], 4) if name in m else "–" for m in found)]
        for name, unit in units.items()
    ]


def _cell(value: object, factor: float) -> str:
    return cell(value * factor if isinstance(value, float) else value, 5)


def _given(found: RunsCompared) -> Section | None:
    rows = [[what, *(cell(v) for v in values)] for what, values in given(found.runs)]
    if not rows:
        return None
    table = Table(["", *(run.traces.name for run in found.runs)], rows)
    return Section("What was given to them", "What differs between them before they began.", [table])


def _signals(found: RunsCompared) -> list[Section]:
    """The vectors that differ most, over one another, and their differences."""
    shares: dict[str, tuple[bool, float]] = {}
    for p in found.pairs:
        for s in p.signals:
            name = stem(s.match.name)
            shares[name] = max(shares.get(name, (False, 0.0)), (s.moves, s.share))
    chosen = sorted((name for name, (_, share) in shares.items() if share), key=shares.__getitem__, reverse=True)
    if not chosen:
        return []
    text = "Those that differ most, over the range of the reference, come first, those without a range last. "
    if found.tolerance is not None:
        text += "The strip is the height of the tube; a curve may leave it where the tube's width allows that."
    return [Section("Signals", text, figures=[_overlay(found, name) for name in chosen[:_MOST]])]


def _overlay(found: RunsCompared, name: str) -> Figure:
    """A vector of all runs, an element a plot, each with the differences from the reference below it."""
    pairs = [[s for s in p.signals if stem(s.match.name) == name] for p in found.pairs]
    elements = list(dict.fromkeys(s.match.name for signals in pairs for s in signals))
    worst = sorted(elements, key=lambda e: -max(s.share for signals in pairs for s in signals if s.match.name == e))
    plots = []
    for element in [e for e in elements if e in worst[:3]]:
        mine = [(p, s) for p, signals in zip(found.pairs, pairs) for s in signals if s.match.name == element]
        unit = mine[0][1].match.unit.replace(".", "·")
        reference = found.runs[0].traces
        series = [Series(reference.name, reference.time, mine[0][1].match.reference, Colour.INK)]
        series += [_curve(found, p, s.match.values) for p, s in mine]
        plots.append(Plot(series, TIME, PlotAxis(f"[{unit}]"), element, link="time", height=170))
        apart = [
            _curve(found, p, s.match.values - np.interp(p.other.time, reference.time, s.match.reference))
            for p, s in mine
        ]
        heights = {s.found.height for _, s in mine if s.found.height is not None}
        strips = [Strip(-h, h) for h in heights]
        plots.append(Plot(apart, TIME, PlotAxis(f"difference [{unit}]"), link="time", height=110, strips=strips))
    return Figure(plots, f"{name}: all items, and what each is from the reference.", name=name)


def _curve(found: RunsCompared, p: TracesPair, values: np.ndarray) -> Series:
    k = found.pairs.index(p)
    return Series(p.other.name, p.other.time, values, COLOURS[k % len(COLOURS)], dash=_DASHES[(k + 1) % len(_DASHES)])


def _table(found: RunsCompared) -> Section:
    """Every signal of every pair."""
    tables = []
    for p in found.pairs:
        rows = [_row(s) for s in sorted(p.signals, key=lambda s: -s.share)]
        head = ["signal", "unit", "greatest difference", "at [s]", "RMS", "of its range [%]"]
        head += [] if found.tolerance is None else ["half height of tube", "samples outside [%]", "first outside [s]"]
        tables.append(Table(head, rows, f"{p.other.name} against {p.reference.name}: {len(rows)} signals", 4))
    return Section("Every signal", _tube_words(found), tables)


def _tube_words(found: RunsCompared) -> str:
    if found.tolerance is None:
        return ""
    widths = ", ".join(f"{p.tube_time:g} s for {p.other.name}" for p in found.pairs)
    return (
        "The tube is what a rectangle covers whose centre moves along the reference: its half height is "
        f"{found.tolerance.relative:g} times the largest range of the vector's elements, its half width {widths}."
    )


def _row(s: SignalPair) -> list[object]:
    f, share = s.found, 100 * s.share
    row: list[object] = [
        s.match.name,
        s.match.unit,
        f.greatest,
        f.at,
        f.rms,
        share if np.isfinite(share) else "range is 0",
    ]
    return row if f.height is None else [*row, f.height, 100 * (f.outside or 0.0), f.first_outside]


def _notes(found: RunsCompared) -> Section | None:
    notes = [(p.other.name, note) for p in found.pairs for note in p.notes]
    return Section("Notes", tables=[Table(("", "note"), notes)]) if notes else None


# --- sweeps -----------------------------------------------------------------------------------------------------------


def _sweeps_report(found: MapsCompared) -> Report:
    sections = [*_maps(found), *_shift(found), _shift_table(found), _set(found), _changes(found)]
    names = [m.name for m in found.maps]
    kept = [s for s in sections if s is not None]
    return Report(_title(names), _verdicts(found), kept, _facts(), _mood(found.agrees))


def _axis(m: StabilityMap, name: str) -> PlotAxis:
    axis = m.axes[name]
    label = f"{name} [{axis['unit']}]" if axis["unit"] else name
    texts = [e for e in axis["entries"] if isinstance(e, str)]
    return (
        PlotAxis(label, names=texts) if texts else PlotAxis(label, (axis["low"], axis["high"]), axis["scale"] == "log")
    )


def _numeric(m: StabilityMap) -> list[str]:
    return [n for n, a in m.axes.items() if not any(isinstance(e, str) for e in a["entries"])]


def _frame(m: StabilityMap) -> list[str]:
    return list(m.frame) if m.traced == 2 else _numeric(m)[:2]


def _maps(found: MapsCompared) -> list[Section]:
    """The maps side by side."""
    frame = _frame(found.maps[0])
    if len(frame) < 2:
        return []
    plots = [
        Plot([*_clouds(m, frame), *_lines(m, Colour.INK)], _axis(m, frame[0]), _axis(m, frame[1]), m.name, height=330)
        for m in found.maps
    ]
    return [
        Section("Maps side by side", figures=[Figure(plots, "All points and the boundary.", columns=2, name="maps")])
    ]


def _clouds(m: StabilityMap, frame: Sequence[str]) -> list[Series]:
    outcomes = np.array([str(outcome) for outcome in m.columns["outcome"]])
    x, y = (np.array(m.columns[name], dtype=float) for name in frame)
    return [
        Series(
            o.replace("_", " "),
            x[outcomes == o],
            y[outcomes == o],
            MARKS[o][0],
            Mark.POINTS,
            symbol=MARKS[o][1],
            size=6.0,
        )
        for o in dict.fromkeys(map(str, m.columns["outcome"]))
    ]


def _lines(m: StabilityMap, colour: Colour, name: str = "boundary", dash: tuple[float, ...] = ()) -> list[Series]:
    """Boundaries over two axes, the first with a name."""
    if m.traced != 2:
        return []
    lines = [line for label in dict.fromkeys(m.summary["boundary_labels"]) for line in m.lines(label)]
    return [
        Series("" if k else name, line[:, 0], line[:, 1], colour, dash=dash, size=2.2) for k, line in enumerate(lines)
    ]


def _boundaries(found: MapsCompared) -> Figure:
    """The boundaries of all maps over one another, or their crossings; else the first map's points."""
    reference = found.maps[0]
    if reference.traced == 1:
        return _crossings(found)
    frame = _frame(reference)
    colours = [(m, (Colour.INK, *COLOURS)[k % 7], _DASHES[k % len(_DASHES)]) for k, m in enumerate(found.maps)]
    series = [s for m, colour, dash in colours for s in _lines(m, colour, m.name, dash)]
    series = series or _clouds(reference, frame)
    plot = Plot(series, _axis(reference, frame[0]), _axis(reference, frame[1]), height=420)
    return Figure([plot], "Boundaries over one another.", name="boundaries")


def _crossings(found: MapsCompared) -> Figure:
    """Where the boundary crosses the traced axis, for every entry of the others."""
    reference = found.maps[0]
    labels = list(dict.fromkeys(label for m in found.maps for label in m.summary["boundary_labels"]))
    series = []
    for k, m in enumerate(found.maps):
        known = [
            (labels.index(n), float(line[0][-1]))
            for line, n in zip(m.summary["boundary"], m.summary["boundary_labels"])
        ]
        x, y = np.array(known, dtype=float).reshape(-1, 2).T
        symbol, colour = "os^D"[k % 4], (Colour.INK, *COLOURS)[k % 7]
        series.append(Series(m.name, x, y, colour, Mark.POINTS, symbol=symbol, size=8.0))
    axis = _axis(reference, reference.frame[-1])
    plot = Plot(series, PlotAxis("", names=labels), PlotAxis(axis.label, log=axis.log), height=340)
    return Figure([plot], "Where the boundary crosses.", name="boundaries")


def _shift(found: MapsCompared) -> list[Section]:
    reference = found.maps[0]
    if not reference.frame or not any(m.summary["boundary"] for m in found.maps):
        return []
    figures = [_boundaries(found)]
    if reference.traced == 2:
        x, y = (_axis(reference, name) for name in reference.frame)
        series = [
            Series(f"{p.other.name} {s.label}".strip(), s.x, s.shift, COLOURS[k % len(COLOURS)])
            for k, p in enumerate(found.pairs)
            for s in p.shifts
            if len(s.x)
        ]
        if series:
            plot = Plot(series, x, PlotAxis(f"shift of {y.label}"), height=200)
            figures.append(Figure([plot], f"How far the boundary has moved along {reference.frame[1]}.", name="shift"))
    return [Section("The boundary", figures=figures)]


def _shift_table(found: MapsCompared) -> Section | None:
    rows = [
        [
            p.other.name,
            s.label or "-",
            *(s.to_dict()[key] for key in ("mean_shift", "greatest_shift", "greatest_at")),
            100 * s.alone,
            s.to_dict()["distance"],
        ]
        for p in found.pairs
        for s in p.shifts
    ]
    if not rows:
        return None
    x, y = (found.maps[0].axes[name] for name in (found.maps[0].frame[0], found.maps[0].frame[-1]))
    head = [
        "map",
        "curve",
        f"mean shift [{y['unit']}]",
        f"greatest shift [{y['unit']}]",
        f"at {x['name']} [{x['unit']}]",
        "only in one [%]",
        "distance",
    ]
    text = (
        f"The shift is along {y['name']}, at every place of the other axis where both maps have one crossing. "
        "The distance is that of Hausdorff, with each axis as long as its range; a tolerance refers to it."
    )
    return Section("Shift in numbers", text, [Table(head, rows, digits=4)])


def _set(found: MapsCompared) -> Section | None:
    """What the sweeps fix, where they differ."""
    fixed = [
        {
            "scenario": m.summary["sweep"].get("scenario"),
            "effects": m.summary["sweep"].get("effects"),
            **m.summary["sweep"].get("set", {}),
        }
        for m in found.maps
    ]
    keys = dict.fromkeys(key for table in fixed for key in table)
    rows = [[key, *(cell(t.get(key)) for t in fixed)] for key in keys if len({str(t.get(key)) for t in fixed}) > 1]
    return Section("What was given to them", "", [Table(["", *(m.name for m in found.maps)], rows)]) if rows else None


def _changes(found: MapsCompared) -> Section | None:
    rows = [
        [p.other.name, a.replace("_", " "), b.replace("_", " "), n]
        for p in found.pairs
        for (a, b), n in sorted(p.changes.items(), key=lambda entry: -entry[1])
    ]
    if not rows:
        return None
    head = ["map", f"in {found.maps[0].name}", "here", "points"]
    return Section("Equal points", "Points that both maps have, by their outcomes.", [Table(head, rows)])
