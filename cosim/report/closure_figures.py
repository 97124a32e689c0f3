"""Figures of the closed loop: measured against model, residual against the signal that explains it, whiteness,
replay.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from cosim.report.plots import Colour, Figure, Guide, Mark, Plot, PlotAxis, Series, Strip, curves

BINS = 16


def torque_before_after(
    time: np.ndarray, measured: np.ndarray, before: np.ndarray, after: np.ndarray, labels: Sequence[str], unit: str
) -> Figure:
    """Measured torque and both residuals over held-out rows; arrays (J, m)."""
    axis, rise = _ordered(time)
    plots = []
    for j, label in enumerate(labels):
        parts = (
            {"measured": measured[j], "model before": (measured - before)[j], "model after": (measured - after)[j]},
            {"residual before": before[j], "residual after": after[j]},
        )
        colours = (Colour.GREY, Colour.ORANGE, Colour.BLUE), (Colour.ORANGE, Colour.BLUE)
        for values, tones in zip(parts, colours):
            plots.append(Plot(curves(rise, values, tones), axis, PlotAxis(f"{label} [{unit}]"), link="held-out"))
    caption = "Filtered torque and residual (measured - predicted), held-out rows."
    return Figure(plots, caption, columns=2, name="torque")


def _ordered(time: np.ndarray) -> tuple[PlotAxis, np.ndarray]:
    """The axis of time, and times that rise: recordings that each begin at zero follow one another."""
    jumps = np.diff(time, prepend=time[:1])
    if np.all(jumps[1:] > 0):
        return PlotAxis("time [s], held-out rows"), time
    step = float(np.median(jumps[jumps > 0])) if np.any(jumps > 0) else 1.0
    return PlotAxis("time [s], held-out rows of all recordings"), np.cumsum(np.where(jumps > 0, jumps, step))


def against_signal(
    signal: np.ndarray, before: np.ndarray, after: np.ndarray, name: str, unit: str, caption: str
) -> Figure:
    """Residual before and after against a signal: points, and means in bins with 95 % intervals. Arrays (m,)."""
    limit = 1.2 * float(np.percentile(np.abs(before), 99.5))
    plots = []
    for residual, colour, title in ((before, Colour.ORANGE, "before"), (after, Colour.BLUE, "after")):
        pick = slice(None, None, max(len(signal) // 3000, 1))
        centre, mean, half = binned(signal, residual)
        series = [
            Series("rows", signal[pick], residual[pick], Colour.GREY, Mark.POINTS, size=2.0),
            Series("", centre, mean, colour),
            Series("mean of a bin", centre, mean, colour, Mark.POINTS, size=6.0, error=half),
        ]
        axes = PlotAxis(name), PlotAxis(f"residual [{unit}]", (-limit, limit))
        plots.append(Plot(series, *axes, f"residual {title}", height=220, guides=[Guide(0.0)]))
    return Figure(plots, caption, columns=2, name="residual")


def binned(signal: np.ndarray, residual: np.ndarray, bins: int = BINS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres, means and half 95 % intervals of a residual in bins of equal count of a signal; correlated neighbours
    counted once.
    """
    edges = np.unique(np.quantile(signal, np.linspace(0, 1, bins + 1)))
    place = np.clip(np.searchsorted(edges, signal, side="right") - 1, 0, len(edges) - 2)
    out = []
    for k in range(len(edges) - 1):
        part = residual[place == k]
        visits = max(int((np.diff(np.flatnonzero(place == k)) > 1).sum()) + 1, 2)
        if len(part):
            out.append((signal[place == k].mean(), part.mean(), 1.96 * part.std() / np.sqrt(visits)))
    centre, mean, half = np.array(out).T
    return centre, mean, half


def whiteness(before: np.ndarray, after: np.ndarray, step: float, labels: Sequence[str]) -> Figure:
    """Autocorrelation of the residual (J, m) up to one second, before and after, with the band of white noise."""
    lags = min(max(int(1.0 / step), 5), before.shape[1] - 1)
    time, band = np.arange(lags) * step, 1.96 / np.sqrt(max(before.shape[1], 1))
    plots = []
    for j, label in enumerate(labels):
        both = {"before": _autocorrelation(before[j], lags), "after": _autocorrelation(after[j], lags)}
        series = curves(time, both, (Colour.ORANGE, Colour.BLUE))
        axes, strip = (PlotAxis("lag [s]"), PlotAxis("autocorrelation [1]")), Strip(-band, band)
        plots.append(Plot(series, *axes, label, link="lag", height=170, strips=[strip]))
    caption = "Autocorrelation of the residual; the band holds white noise."
    return Figure(plots, caption, columns=min(len(labels), 3), name="whiteness")


def _autocorrelation(residual: np.ndarray, lags: int) -> np.ndarray:
    x = residual - residual.mean()
    return np.array([x[: len(x) - k] @ x[k:] for k in range(lags)]) / max(x @ x, 1e-300)


def cross_correlation(residual: np.ndarray, signals: Mapping[str, np.ndarray], step: float, label: str) -> Plot:
    """Correlation of a residual (m,) with signals, shifted up to half a second either way."""
    lags = max(int(0.5 / step), 3)
    x = residual - residual.mean()
    found = {}
    for name, values in signals.items():
        y = values - values.mean()
        scale = max(np.sqrt((x @ x) * (y @ y)), 1e-300)
        shifts = range(-lags, lags + 1)
        found[name] = np.array([x[max(k, 0) : len(x) + min(k, 0)] @ y[max(-k, 0) : len(y) - max(k, 0)] for k in shifts])
        found[name] = found[name] / scale
    axes = PlotAxis("shift [s] (positive: the residual follows)"), PlotAxis("correlation [1]")
    return Plot(curves(np.arange(-lags, lags + 1) * step, found), *axes, f"residual of {label}", link="shift")


def replayed(
    time: np.ndarray, measured: np.ndarray, before: np.ndarray, after: np.ndarray, labels: Sequence[str], unit: str
) -> Figure:
    """Torque of the replay with the old and the new FMU against the recorded one; arrays (n, J). A replay that failed
    is left out.
    """
    axis, rise = _ordered(time)
    every = {"recorded": measured, "old FMU": before, "new FMU": after}
    tones = dict(zip(every, (Colour.GREY, Colour.ORANGE, Colour.BLUE)))
    shown = {name: values for name, values in every.items() if np.isfinite(values).any()}
    plots = []
    for j, label in enumerate(labels):
        series = curves(rise, {name: values[:, j] for name, values in shown.items()}, [tones[name] for name in shown])
        plots.append(Plot(series, axis, PlotAxis(f"{label} [{unit}]"), link="replay"))
    return Figure(plots, "", name="replay")


def error_bars(
    before: Sequence[float],
    after: Sequence[float],
    interval: Sequence[tuple[float, float]],
    floor: Sequence[float | None],
    labels: Sequence[str],
) -> Figure:
    """Held-out RMS% per joint before and after, with the interval of after and the floor where it is known."""
    place = np.arange(len(labels), dtype=float)
    middle, half = np.array([((lo + hi) / 2, (hi - lo) / 2) for lo, hi in interval]).T
    series = [
        Series("before", place - 0.18, np.asarray(before), Colour.ORANGE, Mark.BARS, size=0.34),
        Series("after", place + 0.18, np.asarray(after), Colour.BLUE, Mark.BARS, size=0.34),
        Series("95 % interval of after", place + 0.18, middle, Colour.INK, Mark.POINTS, size=2.0, error=half),
    ]
    known = [(x, value) for x, value in zip(place, floor, strict=True) if value is not None]
    if known:
        x = np.ravel([(x - 0.4, x + 0.4, np.nan) for x, _ in known])
        y = np.ravel([(value, value, np.nan) for _, value in known])
        series.append(Series("floor", x, y, Colour.RED, size=2.0))
    axes = PlotAxis("", names=labels), PlotAxis("RMS error of the torque [%]")
    return Figure([Plot(series, *axes, height=240)], "Held-out error of the torque.", name="errors")
