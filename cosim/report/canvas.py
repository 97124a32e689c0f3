"""Figures for papers and notebooks: the only module that imports matplotlib.

Figures are made without pyplot, so nothing is global and threads do not meet.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure as MplFigure
from matplotlib.rcsetup import cycler

from cosim.errors import InputError, Problem
from cosim.report.motion import ArmTrack, PacketTrack, Playback, Wall
from cosim.report.packing import extremes
from cosim.report.plots import COLOURS, Colour, Figure, HeatMap, Mark, Plot, PlotAxis, Series
from cosim.results.saving import make_writable, reason

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
    _positive("width [mm]", width)
    _positive("height [mm]", 1.0 if height is None else height)
    fig = drawn(figure, width, height)
    known = fig.canvas.get_supported_filetypes()
    ending = path.suffix.removeprefix(".").lower()
    if ending not in known:
        raise InputError(Problem("--out", f"a file that ends in {', '.join(sorted(known))}", repr(path.name)))
    _ready(path, "--out")
    with matplotlib.rc_context(_STYLE):
        fig.savefig(path, dpi=300, metadata={"Date": None} if ending == "svg" else None)
    return path


def _ready(path: Path, name: str) -> None:
    """Make the folder of a file. Raises InputError where it cannot be written to, or the file is a folder."""
    try:
        make_writable(path.parent)
    except OSError as error:
        raise InputError(Problem(name, "a file to write", f"{path}: {reason(error)}")) from None
    if path.is_dir():
        raise InputError(Problem(name, "a file to write", f"{path}, a folder"))


def _positive(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise InputError(Problem(name, "a number above zero", str(value)))


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
    _legend(axes, plot.title)


def _legend(axes: Axes, title: str) -> None:
    """Names above the plot, at the right of its title; inside where they are too long for that."""
    names = axes.get_legend_handles_labels()[1]
    if len(names) < 2 and not (names and title):
        return
    room = axes.bbox.width / axes.figure.dpi * INCH
    above = 1.5 * len(title) + sum(1.4 * len(name) + 8.0 for name in names) < room
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncols": len(names)} if above else {}
    legend = axes.legend(borderaxespad=0.1 if above else None, handlelength=1.6, **place)
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


# --- movie ------------------------------------------------------------------------------------------------------------

TURN, TILT = 0.7, 0.3  # rad: the view of the page
PICTURE = 6.4, 3.2  # inches
RATE = 25  # pictures a second


def save_movie(play: Playback, path: Path, speed: float = 1.0) -> Path:
    """The arms in motion as a movie, `speed` times as fast as they were: GIF, or what ffmpeg writes where it is
    installed. Raises InputError where that is missing.
    """
    _positive("speed", speed)
    writer = _writer(path)
    _ready(path, "--movie")
    style: dict[Any, object] = {**_STYLE, "axes.grid": False, "figure.facecolor": "white"}
    with matplotlib.rc_context(style):
        fig = MplFigure(figsize=PICTURE)
        moved = [_scene(fig, play, k) for k in range(len(play.arms))]
        moved += [_lane(fig, play, k) for k in range(len(play.packets))]
        clock = fig.text(0.5, 0.02, "", ha="center")
        pictures = max(int((play.time[-1] - play.time[0]) / speed * RATE), 1)
        with writer.saving(fig, str(path), dpi=120):
            for now in np.linspace(play.time[0], play.time[-1], pictures + 1):
                for move in moved:
                    move(float(now))
                clock.set_text(f"{play.name}   {now:.2f} s")
                writer.grab_frame()
    return path


def _writer(path: Path) -> AbstractMovieWriter:
    if path.suffix.lower() == ".gif":
        return PillowWriter(fps=RATE)
    if path.suffix.lower() not in (".mp4", ".mkv", ".mov", ".webm"):
        raise InputError(Problem("--movie", "a file that ends in .gif, .mp4, .mkv, .mov or .webm", repr(path.name)))
    if not FFMpegWriter.isAvailable():
        raise InputError(
            Problem("--movie", f"ffmpeg, which writes {path.suffix}", "none", "install it, or name a .gif")
        )
    return FFMpegWriter(fps=RATE)


def _seen(arm: ArmTrack, points: np.ndarray) -> np.ndarray:
    """Places (..., 2) on the screen of points (..., 3): up is y in a PHANToM's base frame, z in that of another arm."""
    a, b, d = np.moveaxis(points if len(arm.strokes) > 1 else points[..., [1, 2, 0]], -1, 0)
    across, depth = a * np.cos(TURN) + d * np.sin(TURN), d * np.cos(TURN) - a * np.sin(TURN)
    return np.stack([across, b * np.cos(TILT) - depth * np.sin(TILT)], axis=-1)


def _scene(fig: MplFigure, play: Playback, number: int) -> Callable[[float], None]:
    """An arm with its trace and forces on axes of its own; what moves it to a time."""
    arm, tone = play.arms[number], TONES[(Colour.BLUE, Colour.ORANGE)[number]]
    share = 0.4 if len(play.arms) == 2 else 0.9
    axes = fig.add_axes((0.02 + 0.56 * number, 0.08, share, 0.86))
    places = _seen(arm, arm.points)
    middle = (places.max(axis=(0, 1)) + places.min(axis=(0, 1))) / 2
    reach = 0.65 * max(float(np.ptp(places, axis=(0, 1)).max()), 1e-9)
    axes.set(xlim=middle[0] + reach * np.array([-1, 1]), ylim=middle[1] + reach * np.array([-1, 1]), aspect="equal")
    axes.set_axis_off()
    axes.set_title(arm.name, parse_math=False)
    for wall in play.walls:
        if wall.arm == arm.name:
            axes.fill(*_seen(arm, _patch(wall, arm.tip, 0.5 * reach)).T, color=TONES[Colour.GREY], alpha=0.3)
    trace = axes.plot([], [], color=tone, lw=0.8)[0]
    links = [axes.plot([], [], color=TONES[Colour.INK], lw=2.5 if k < 3 else 1.2)[0] for k in range(len(arm.strokes))]
    greatest = max((float(np.linalg.norm(f, axis=1).max()) for a in play.arms for f in a.forces.values()), default=0.0)
    arrows = [
        (axes.plot([], [], color=TONES[colour], lw=1.8, label=name)[0], force)
        for (name, force), colour in zip(arm.forces.items(), (Colour.RED, Colour.GREEN))
    ]
    if arrows:
        axes.legend(loc="lower left", handlelength=1.0)

    def move(now: float) -> None:
        frame = int(np.searchsorted(play.time, now + 1e-9) - 1)
        trace.set_data(*places[: frame + 1, -1].T)
        for line, stroke in zip(links, arm.strokes):
            line.set_data(*places[frame, list(stroke)].T)
        for line, force in arrows:
            end = arm.tip[frame] + 0.4 * reach / max(greatest, 1e-300) * force[frame]
            line.set_data(*np.array([places[frame, -1], _seen(arm, end)]).T)

    return move


def _patch(wall: Wall, tips: np.ndarray, size: float) -> np.ndarray:
    """Corners (4, 3) of a square of the wall's plane, in front of where the tips are on average."""
    normal = np.array(wall.normal) / np.linalg.norm(wall.normal)
    foot = tips.mean(axis=0)
    foot = foot - (foot @ np.array(wall.normal) - wall.offset) / np.linalg.norm(wall.normal) * normal
    along = np.linalg.svd(normal[None])[2][1:]
    return foot + size * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) @ along


def _lane(fig: MplFigure, play: Playback, number: int) -> Callable[[float], None]:
    """Samples on their way in a channel; what moves them to a time."""
    packets: PacketTrack = play.packets[number]
    there = packets.source == play.arms[0].name
    axes = fig.add_axes((0.42, 0.62 - 0.24 * number, 0.16, 0.12), xlim=(-0.05, 1.05), ylim=(-1, 1))
    axes.set_axis_off()
    axes.axhline(0.0, color=TONES[Colour.GREY], lw=0.8)
    axes.set_title(f"{packets.name} {'→' if there else '←'}", parse_math=False, fontsize=7)
    dots = axes.plot([], [], "o", ms=3, color=TONES[Colour.BLUE if there else Colour.ORANGE])[0]

    def move(now: float) -> None:
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (now - packets.sent) / packets.delay
        share = share[(share >= 0) & (share < 1)]
        dots.set_data(share if there else 1 - share, np.zeros(len(share)))

    return move
