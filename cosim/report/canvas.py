"""Figures for papers and notebooks: the only module that imports matplotlib.

Figures are made without pyplot, so nothing is global and threads do not meet.
"""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure as MplFigure
from matplotlib.rcsetup import cycler

from cosim.errors import InputError, Problem
from cosim.report.packing import extremes
from cosim.report.plots import COLOURS, Colour, Figure, HeatMap, Mark, Plot, PlotAxis, Series

TONES = {
    Colour.BLUE: "#0072B2",
    Colour.ORANGE: "#E69F00",
    Colour.GREEN: "#009E73",
    Colour.RED: "#D55E00",
    Colour.PURPLE: "#CC79A7",
    Colour.SKY: "#56B4E9",
    Colour.INK: "#222222",
    Colour.GREY: "#8a8f98",
}
NO_VALUE = "#f3c9b5"
INCH = 25.4  # mm
POINT = INCH / 72  # mm
PIXEL = 0.7  # points a pixel of a page's lines
MOST = 20_000
"""Rows of a curve in a figure: more than any printer resolves."""

_STYLE: dict[Any, object] = {
    "font.family": ["DejaVu Sans", "sans-serif"],
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": "#b8bcc4",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=[TONES[colour] for colour in COLOURS]),
    "axes.formatter.useoffset": False,
    "grid.color": "#e6e8ec",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "cosim",
}


def drawn(figure: Figure, width: float = 200.0, height: float | None = None) -> MplFigure:
    """The figure as matplotlib draws it; width and height of the whole [mm] (default: by its plots)."""
    rows = -(-len(figure.plots) // figure.columns)
    tall = [
        max(p.height for p in figure.plots[k : k + figure.columns]) for k in range(0, len(figure.plots), figure.columns)
    ]
    height = height or sum(tall) * 0.22 + 8.0 * rows + 6.0
    with matplotlib.rc_context(_STYLE):
        fig = MplFigure(figsize=(width / INCH, height / INCH), layout="constrained")
        grid = fig.subplots(rows, figure.columns, squeeze=False, height_ratios=tall)
        for axes in grid.flat[len(figure.plots) :]:
            axes.set_axis_off()
        for k, (plot, axes) in enumerate(zip(figure.plots, grid.flat)):
            below = figure.plots[k + figure.columns : k + figure.columns + 1]
            _draw(axes, plot, last=not below or below[0].x.label != plot.x.label)
    return fig


def save_figure(figure: Figure, path: Path, width: float, height: float | None = None) -> Path:
    """Write a figure of a width [mm]; the ending of the name says the format. Raises InputError for one that there is
    not.
    """
    fig = drawn(figure, width, height)
    known = fig.canvas.get_supported_filetypes()
    ending = path.suffix.removeprefix(".").lower()
    if ending not in known:
        raise InputError(Problem("--out", f"a file that ends in {', '.join(sorted(known))}", repr(path.name)))
    path.parent.mkdir(parents=True, exist_ok=True)
    with matplotlib.rc_context(_STYLE):
        fig.savefig(path, dpi=300, metadata={"Date": None} if ending == "svg" else None)
    return path


def _draw(axes: Axes, plot: Plot, last: bool) -> None:
    """One plot. A `$` of a name begins no formula."""
    if plot.heat is not None:
        _heat(axes, plot.heat)
    for strip in plot.strips:
        (axes.axvspan if strip.upright else axes.axhspan)(
            strip.low, strip.high, color=TONES[Colour.GREY], alpha=0.2, lw=0
        )
    for guide in plot.guides:
        line = axes.axvline if guide.upright else axes.axhline
        line(guide.value, color=TONES[guide.colour], lw=0.8, ls=_dash(guide.dash), label=_label(guide.name))
    for series in plot.series:
        _series(axes, series)
    _axis(axes, "x", plot.x, named=last)
    _axis(axes, "y", plot.y)
    axes.set_title(plot.title, parse_math=False)
    if plot.equal:
        axes.set_aspect("equal", adjustable="datalim")
    if sum(bool(name) for name in axes.get_legend_handles_labels()[1]) > (not plot.title):
        legend = axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1, ncols=4, handlelength=1.6)
        for text in legend.get_texts():
            text.set_parse_math(False)


def _label(name: str) -> str:
    """A name in a legend; matplotlib leaves out what begins with an underscore, and what has no name."""
    return f"\u200b{name}" if name.startswith("_") else name or "_"


def _dash(dash: tuple[float, ...]) -> Any:
    return (0, dash) if dash else "-"


def _series(axes: Axes, s: Series) -> None:
    colour, label = TONES[s.colour], _label(s.name)
    if s.mark is Mark.BARS:
        axes.bar(s.x, s.y, s.size, 0.0 if s.base is None else s.base, color=colour, label=label)
    elif s.mark is Mark.POINTS:
        axes.plot(s.x, s.y, s.symbol, color=colour, ms=s.size * PIXEL, mew=0.8, ls="none", label=label)
    else:
        rows = extremes([s.y], MOST) if np.all(np.diff(s.x) >= 0) else extremes([s.x, s.y], MOST)
        axes.plot(s.x[rows], s.y[rows], color=colour, lw=s.size * PIXEL, ls=_dash(s.dash), label=label)
    if s.error is not None:
        tone = TONES[Colour.INK if s.mark is Mark.BARS else s.colour]
        axes.errorbar(s.x, s.y, np.maximum(np.nan_to_num(s.error), 0.0), fmt="none", ecolor=tone, capsize=2, lw=0.9)


def _heat(axes: Axes, heat: HeatMap) -> None:
    low, high = heat.limits
    norm: dict[str, Any] = {"norm": LogNorm(low, high)} if heat.log else {"vmin": low, "vmax": high}
    colours = matplotlib.colormaps["RdBu" if heat.diverging else "viridis_r"].with_extremes(bad=NO_VALUE)
    places = heat.x, heat.y, np.ma.masked_invalid(heat.values)
    mesh = axes.pcolormesh(*places, cmap=colours, shading="gouraud", rasterized=True, **norm)
    axes.figure.colorbar(mesh, ax=axes, label=heat.label)


def _axis(axes: Axes, direction: str, axis: PlotAxis, named: bool = True) -> None:
    own = axes.xaxis if direction == "x" else axes.yaxis
    if axis.log:
        getattr(axes, f"set_{direction}scale")("log")
    if axis.names:
        own.set_ticks(range(len(axis.names)), axis.names)
    if axis.limits is not None:
        getattr(axes, f"set_{direction}lim")(*axis.limits)
    elif direction == "x" and not axis.names:
        axes.margins(x=0.01)
    if named:
        own.set_label_text(axis.label, parse_math=False)
    else:
        axes.tick_params(labelbottom=False)
