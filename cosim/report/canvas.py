"""Figures as inline SVG: the only module that imports matplotlib.

Figures are made without pyplot, so nothing is global and threads do not meet.
"""

import io
import re
from hashlib import sha256
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes as Axes
from matplotlib.contour import ContourSet as ContourSet
from matplotlib.figure import Figure as MplFigure
from matplotlib.figure import FigureBase as FigureBase
from matplotlib.rcsetup import cycler

# Okabe and Ito, "Color Universal Design" (2008): distinguishable with every kind of colour blindness.
BLUE, ORANGE, GREEN, RED, PURPLE, SKY, YELLOW, BLACK = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#F0E442",
    "#222222",
)
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, BLACK)
GREY = "#8a8f98"

_STYLE: dict[Any, object] = {
    "font.family": ["DejaVu Sans", "sans-serif"],
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.edgecolor": "#b8bcc4",
    "axes.linewidth": 0.8,
    "axes.labelcolor": "#333840",
    "text.color": "#22262c",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=COLOURS),
    "axes.formatter.useoffset": False,
    "grid.color": "#e6e8ec",
    "grid.linewidth": 0.7,
    "xtick.color": "#5a606a",
    "ytick.color": "#5a606a",
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}
_SVG: dict[Any, object] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cosim",
    "path.simplify": True,
    "path.simplify_threshold": 0.5,
}


def figure(rows: int = 1, cols: int = 1, width: float = 8.0, height: float = 4.5) -> tuple[MplFigure, np.ndarray]:
    """An empty figure of `width` x `height` inches and its axes, an array (rows, cols), in the style of the reports."""
    with matplotlib.rc_context(_STYLE):
        fig = MplFigure(figsize=(width, height), layout="constrained")
        axes = fig.subplots(rows, cols, squeeze=False)
    plain_texts(fig)
    return fig, axes


def plain_texts(fig: MplFigure) -> None:
    """Titles, labels, legends and notes as they are written: a `$` of a name begins no formula.

    Tick labels keep their formulas, and so does a text that is one (`set_parse_math` after this call).
    """
    for axes in fig.axes:
        titles = [
            getattr(axes, name) for name in ("title", "_left_title", "_right_title")
        ]  # matplotlib has no other way
        for text in (*titles, axes.xaxis.label, axes.yaxis.label):
            text.set_parse_math(False)
        legend = axes.get_legend()
        for text in (*axes.texts, *(legend.get_texts() if legend is not None else ())):
            text.set_parse_math(False)
    for text in fig.texts:
        text.set_parse_math(False)


def label_of(name: str) -> str:
    """A name in a legend; matplotlib leaves out what begins with an underscore."""
    return f"\u200b{name}" if name.startswith("_") else name


def to_svg(fig: MplFigure) -> str:
    """The figure as an `<svg>` element for a page: no outside references, ids unique per content; clears `fig`."""
    _tidy(fig)
    stream = io.StringIO()
    with matplotlib.rc_context(_STYLE | _SVG):
        fig.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    fig.clear()
    return _inline(stream.getvalue())


def _tidy(fig: MplFigure) -> None:
    """Titles left, legends without frames: matplotlib reads these settings when they are made, not when drawn."""
    for axes in fig.axes:
        title = axes.get_title("center")
        if title:
            axes.set_title("", loc="center")
            axes.set_title(title, loc="left", fontsize=9.5, fontweight="bold")
        legend = axes.get_legend()
        if legend is not None:
            legend.set_frame_on(False)
    plain_texts(fig)


def _inline(document: str) -> str:
    """The `<svg>` element of a document, its ids prefixed by a hash of the content so that figures do not collide."""
    svg = document[document.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    prefix = "f" + sha256(svg.encode()).hexdigest()[:8] + "-"
    svg = re.sub(r'\bid="', f'id="{prefix}', svg)
    svg = re.sub(r'href="#', f'href="#{prefix}', svg)
    svg = re.sub(r"url\(#", f"url(#{prefix}", svg)
    return _fluid(svg)


def _fluid(svg: str) -> str:
    """The same element without a fixed size in points: as wide as it was, narrower where the page is."""
    width = re.search(r'<svg [^>]*?width="([\d.]+)pt"', svg)
    svg = re.sub(r'(<svg [^>]*?) height="[\d.]+pt"', r"\1", svg, count=1)
    size = f'style="width:{width.group(1)}pt;max-width:100%;height:auto"' if width else ""
    return re.sub(r'(<svg [^>]*?) width="[\d.]+pt"', rf"\1 {size}", svg, count=1)
