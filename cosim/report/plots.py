"""Figures described as data: what is drawn, not how.

One description is drawn twice: by the script of a page, where it can be zoomed, and by `cosim.report.canvas` for
papers.
"""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from itertools import cycle

import numpy as np
from attrs import field, frozen


class Colour(StrEnum):
    """Okabe and Ito, "Color Universal Design" (2008): told apart with every kind of colour vision. Pages have a lighter
    set of them for a dark background.
    """

    BLUE = "blue"
    ORANGE = "orange"
    GREEN = "green"
    RED = "red"
    PURPLE = "purple"
    SKY = "sky"
    INK = "ink"
    GREY = "grey"


COLOURS = (Colour.BLUE, Colour.ORANGE, Colour.GREEN, Colour.RED, Colour.PURPLE, Colour.SKY, Colour.INK)


class Mark(StrEnum):
    """How the values of a series are drawn. `BARS` stand on `Series.base`."""

    LINE = "line"
    POINTS = "points"
    BARS = "bars"


@frozen(eq=False)
class Series:
    """One curve, cloud of points or row of bars: x and y (n,); a NaN is a gap.

    dash: lengths drawn and left out [pixels]; symbol: matplotlib's letter of a marker; size: width of a line or of a
    point [pixels], of a bar [units of x]; error: half lengths of vertical intervals (n,); base: where bars stand (n,).
    notes, commands: one a point, shown where the cursor is; a click copies the command.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    colour: Colour = Colour.BLUE
    mark: Mark = Mark.LINE
    dash: tuple[float, ...] = ()
    symbol: str = "o"
    size: float = 1.5
    error: np.ndarray | None = None
    base: np.ndarray | None = None
    notes: tuple[str, ...] = field(default=(), converter=tuple)
    commands: tuple[str, ...] = field(default=(), converter=tuple)


@frozen(eq=False)
class HeatMap:
    """Values (n, m) over places x and y (n, m) of a mesh, as colours; NaN is left out and drawn in one pale red.

    Diverging colours have their middle at zero. `log`: colours follow the logarithm of the values.
    """

    x: np.ndarray
    y: np.ndarray
    values: np.ndarray
    label: str = ""
    low: float | None = None
    high: float | None = None
    diverging: bool = False
    log: bool = False

    @property
    def limits(self) -> tuple[float, float]:
        """The values at both ends of the colours."""
        low = float(np.nanmin(self.values)) if self.low is None else self.low
        high = float(np.nanmax(self.values)) if self.high is None else self.high
        return low, high


@frozen
class PlotAxis:
    """One direction of a plot. `limits`: what is shown at first (default: all); `names`: categories at 0, 1, 2, ..."""

    label: str = ""
    limits: tuple[float, float] | None = None
    log: bool = False
    names: tuple[str, ...] = field(default=(), converter=tuple)


TIME = PlotAxis("time [s]")


@frozen
class Guide:
    """A straight line across the plot: at a value of y, or of x where `upright`."""

    value: float
    colour: Colour = Colour.GREY
    dash: tuple[float, ...] = ()
    upright: bool = False
    name: str = ""


@frozen
class Strip:
    """A shaded strip from `low` to `high`: along y over the whole width, or along x where `upright`."""

    low: float
    high: float
    upright: bool = False


@frozen(eq=False)
class Plot:
    """One frame with axes. Plots of a page with the same `link` are zoomed and read together: their x is one quantity.

    height: of the frame [pixels]; equal: a unit is as long in both directions.
    """

    series: tuple[Series, ...] = field(default=(), converter=tuple)
    x: PlotAxis = PlotAxis()
    y: PlotAxis = PlotAxis()
    title: str = ""
    link: str = ""
    height: int = 150
    equal: bool = False
    guides: tuple[Guide, ...] = field(default=(), converter=tuple)
    strips: tuple[Strip, ...] = field(default=(), converter=tuple)
    heat: HeatMap | None = None

    @property
    def shared(self) -> bool:
        """Whether all series are lines over one rising x, so that one cursor reads all of them."""
        if not self.series or self.heat is not None:
            return False
        x = self.series[0].x
        alike = all(s.x is x and s.mark is Mark.LINE and s.error is None for s in self.series)
        return alike and len(x) > 1 and bool(np.all(np.diff(x) > 0))


@frozen(eq=False)
class Figure:
    """Plots side by side, `columns` of them in a row, and what they show. `name` names the files of its data."""

    plots: tuple[Plot, ...] = field(converter=tuple)
    caption: str = ""
    columns: int = 1
    name: str = ""


def curves(
    x: np.ndarray, values: Mapping[str, np.ndarray], colours: Sequence[Colour] = COLOURS, dashed: Sequence[str] = ()
) -> list[Series]:
    """A line a name over one x (n,), in the order of the colours; `dashed` names those that are dashed."""
    return [
        Series(name, x, y, colour, dash=(6, 3) if name in dashed else ())
        for (name, y), colour in zip(values.items(), cycle(colours), strict=False)
    ]


def shaded(x: np.ndarray, where: np.ndarray) -> list[Strip]:
    """Upright strips over the stretches of x (n,) at which `where` (n,) holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], where, [False]]).astype(int)))
    return [Strip(float(x[a]), float(x[min(b, len(x) - 1)]), upright=True) for a, b in edges.reshape(-1, 2)]
