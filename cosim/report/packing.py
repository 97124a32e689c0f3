"""What a page holds of its figures: rows thinned to a budget, numbers packed into one text.

A packed page is base64 of the deflated bytes: length of the description (4 bytes), description (JSON), arrays one after
the other, each with its bytes in planes (all first bytes, all second bytes, ...), which deflates better.
"""

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import field, frozen

from cosim.report.plots import Figure, HeatMap, Mark, Plot, Series

LIMIT = 1_150_000
"""Characters of the text: a page stays below 1.5 MB with its script, tables and drawings."""
NUMBERS = 180_000, 700_000
"""Numbers of all series of a page: as many as keep the limit where nothing can be deflated (4 bytes, base64), and the
most that a browser unpacks and draws in a moment.
"""
CLOUD = 20_000
"""Points of a cloud that can still be told apart on a screen."""


def packed(figures: Sequence[Figure], **more: Any) -> str:
    """The figures, and further entries that JSON can hold (arrays in them too), as the text that a page carries.

    Where the text stays short the page gets more rows.
    """
    budget = NUMBERS[0]
    text, whole = _packed(figures, budget, more)
    if whole or len(text) > LIMIT / 2:
        return text
    more_rows, _ = _packed(figures, min(int(0.9 * budget * LIMIT / len(text)), NUMBERS[1]), more)
    return more_rows if len(more_rows) <= LIMIT else text


def _packed(figures: Sequence[Figure], budget: int, more: Mapping[str, Any]) -> tuple[str, bool]:
    """The text, and whether it holds every row."""
    arrays = _Arrays()
    most = _rows(figures, budget)
    described = {"figures": [_figure(figure, most, arrays) for figure in figures], **_deep(dict(more), arrays)}
    whole = all(plot["rows"][0] == plot["rows"][1] for figure in described["figures"] for plot in figure["plots"])
    head = json.dumps(described | {"arrays": arrays.described}, separators=(",", ":"), allow_nan=False).encode()
    content = len(head).to_bytes(4, "little") + head + b"".join(arrays.parts)
    return base64.b64encode(zlib.compress(content, 6)).decode("ascii"), whole


# --- thinning ---------------------------------------------------------------------------------------------------------


def extremes(columns: Sequence[np.ndarray], rows: int) -> np.ndarray:
    """At most about `rows` indices of columns (n,): first, last, and the least and greatest of each column in even
    stretches, so that no peak is lost.
    """
    n = len(columns[0])
    if n <= rows:
        return np.arange(n)
    width = -(-n // max(rows // (2 * len(columns)), 1))
    starts = np.arange(0, n - n % width, width)
    found = [np.array([0, n - 1])]
    for column in columns:
        for part, at in (
            (column[: n - n % width].reshape(-1, width), starts),
            (column[None, n - n % width :], [n - n % width]),
        ):
            if part.size:
                plain = np.where(np.isfinite(part), part, 0.0)
                found += [plain.argmin(axis=1) + at, plain.argmax(axis=1) + at]
    return np.unique(np.concatenate(found))


def _groups(plot: Plot) -> list[list[Series]]:
    """Series that share their x, and so their rows."""
    groups: dict[int, list[Series]] = {}
    for series in plot.series:
        groups.setdefault(id(series.x), []).append(series)
    return list(groups.values())


def _rows(figures: Sequence[Figure], budget: int) -> int:
    """The most rows that a group of series may have so that all of them together stay within the budget."""
    sizes = [(len(g[0].x), len(g) + 1) for f in figures for p in f.plots for g in _groups(p)]
    low, high = 0, max((n for n, _ in sizes), default=0)
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if sum(min(n, middle) * s for n, s in sizes) <= budget else (low, middle - 1)
    return low


def _kept(group: Sequence[Series], most: int) -> np.ndarray:
    """Rows of a group that the page holds: all, the extremes of lines, every so many of a cloud."""
    n = len(group[0].x)
    cloud = any(s.mark is Mark.POINTS for s in group)
    if n <= min(most, CLOUD if cloud else most) or any(s.notes or s.commands for s in group):
        return np.arange(n)
    if cloud:
        return np.arange(0, n, -(-n // min(most, CLOUD)))
    x = group[0].x
    rising = bool(np.all(np.diff(x) >= 0))
    return extremes([s.y for s in group] if rising else [x, *(s.y for s in group)], most)


# --- description ------------------------------------------------------------------------------------------------------


def _figure(figure: Figure, most: int, arrays: "_Arrays") -> dict[str, Any]:
    return {
        "caption": figure.caption,
        "columns": figure.columns,
        "name": figure.name,
        "plots": [_plot(plot, most, arrays) for plot in figure.plots],
    }


def _plot(plot: Plot, most: int, arrays: "_Arrays") -> dict[str, Any]:
    series: dict[int, dict[str, Any]] = {}
    held, of = 0, 0
    for group in _groups(plot):
        rows = _kept(group, most)
        held, of = max(held, len(rows)), max(of, len(group[0].x))
        x = arrays.rows(group[0].x, rows)
        series |= {id(s): _series(s, x, rows, arrays) for s in group}
    return {
        "title": plot.title,
        "link": plot.link,
        "height": plot.height,
        "equal": plot.equal,
        "shared": plot.shared,
        "rows": [held, of],
        **{
            name: {"label": axis.label, "limits": axis.limits, "log": axis.log, "names": axis.names}
            for name, axis in (("x", plot.x), ("y", plot.y))
        },
        "series": [series[id(s)] for s in plot.series],
        "guides": [[g.value, g.colour, g.dash, g.upright, g.name] for g in plot.guides],
        "strips": [[s.low, s.high, s.upright] for s in plot.strips],
        "heat": None if plot.heat is None else _heat(plot.heat, arrays),
    }


def _series(s: Series, x: int, rows: np.ndarray, arrays: "_Arrays") -> dict[str, Any]:
    optional = {
        name: arrays.add(values[rows]) for name in ("error", "base") if (values := getattr(s, name)) is not None
    }
    return {
        "name": s.name,
        "x": x,
        "y": arrays.add(s.y[rows]),
        "mark": s.mark,
        "colour": s.colour,
        "dash": s.dash,
        "symbol": s.symbol,
        "size": s.size,
        "notes": s.notes,
        "commands": s.commands,
        **optional,
    }


def _heat(heat: HeatMap, arrays: "_Arrays") -> dict[str, Any]:
    parts = {name: arrays.add(getattr(heat, name).ravel()) for name in ("x", "y", "values")}
    rows, columns = heat.values.shape
    return {
        "shape": [rows, columns],
        "label": heat.label,
        "limits": heat.limits,
        "diverging": heat.diverging,
        "log": heat.log,
        **parts,
    }


def _deep(value: Any, arrays: "_Arrays") -> Any:
    """The same with every array replaced by its number."""
    if isinstance(value, np.ndarray):
        return {"array": arrays.add(value.ravel()), "shape": value.shape}
    if isinstance(value, dict):
        return {name: _deep(item, arrays) for name, item in value.items()}
    return [_deep(item, arrays) for item in value] if isinstance(value, (list, tuple)) else value


# --- numbers ----------------------------------------------------------------------------------------------------------


@frozen
class _Arrays:
    """Arrays of a page: how each is written, and its bytes. An array that comes again is written once."""

    described: list[list[Any]] = field(factory=list)
    parts: list[bytes] = field(factory=list)
    known: dict[bytes, int] = field(factory=dict)

    def add(self, values: np.ndarray) -> int:
        """The number of an array in the page."""
        return self._add(*written(np.asarray(values, dtype=float)))

    def rows(self, values: np.ndarray, rows: np.ndarray) -> int:
        """The number of some rows of a rising array (n,): as row numbers where it is an even grid."""
        n, span = len(values), float(values[-1] - values[0]) if len(values) else 0.0
        if n > 15 and span > 0 and np.isfinite(values).all():
            step = span / (n - 1)
            if np.abs(values[0] + step * np.arange(n) - values).max() <= 1e-9 * span:
                jumps = np.diff(rows, prepend=0).astype("<u4")
                return self._add(["steps", len(rows), float(values[0]), step], _planes(jumps))
        return self.add(values[rows])

    def _add(self, kind: list[Any], content: bytes) -> int:
        key = repr(kind).encode() + content
        if key not in self.known:
            self.known[key] = len(self.parts)
            self.described.append(kind)
            self.parts.append(content)
        return self.known[key]


def written(values: np.ndarray) -> tuple[list[Any], bytes]:
    """How an array (n,) is written, and its bytes: 4 bytes a number where that keeps a hundred-thousandth of its range,
    else 8.
    """
    seen = np.isfinite(values)
    with np.errstate(over="ignore"):
        single = values.astype("<f4")
    if seen.any() and np.abs(single[seen] - values[seen]).max() > 1e-5 * np.ptp(values[seen]):
        return ["f8", len(values)], _planes(values.astype("<f8"))
    return ["f4", len(values)], _planes(single)


def _planes(values: np.ndarray) -> bytes:
    return np.ascontiguousarray(values.view(np.uint8).reshape(len(values), values.itemsize).T).tobytes()
