"""Figures of the closed loop: measured against model, residual against the signal that explains it, whiteness,
replay.
"""

from collections.abc import Sequence

import numpy as np

from cosim.report.canvas import BLUE, GREY, ORANGE, RED, MplFigure, figure, to_svg

SHOWN = 8.0  # s of a record that a time plot shows
BINS = 16


def torque_before_after(
    time: np.ndarray, measured: np.ndarray, before: np.ndarray, after: np.ndarray, labels: Sequence[str], unit: str
) -> str:
    """Measured torque and both residuals over the first seconds of held-out rows; arrays (J, m)."""
    fig, axes = figure(len(labels), 2, 10.0, 2.1 * len(labels) + 0.4)
    keep = time <= time[0] + SHOWN
    for j, label in enumerate(labels):
        left, right = axes[j]
        left.plot(time[keep], measured[j, keep], color=GREY, lw=2.2, label="measured")
        left.plot(time[keep], (measured - before)[j, keep], color=ORANGE, lw=1.0, label="model before")
        left.plot(time[keep], (measured - after)[j, keep], color=BLUE, lw=1.0, label="model after")
        right.plot(time[keep], before[j, keep], color=ORANGE, lw=1.0, label="residual before")
        right.plot(time[keep], after[j, keep], color=BLUE, lw=1.0, label="residual after")
        left.set_ylabel(f"{label} [{unit}]")
        if j == 0:
            left.legend(ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
            right.legend(ncols=2, loc="lower left", bbox_to_anchor=(0, 1))
    for ax in axes[-1]:
        ax.set_xlabel("time [s], held-out rows")
    return to_svg(fig)


def against_signal(signal: np.ndarray, before: np.ndarray, after: np.ndarray, name: str, unit: str) -> str:
    """Residual before and after against a signal: points, and means in bins with 95 % intervals. Arrays (m,)."""
    fig, axes = figure(1, 2, 10.0, 3.0)
    for ax, residual, colour, title in ((axes[0, 0], before, ORANGE, "before"), (axes[0, 1], after, BLUE, "after")):
        pick = slice(None, None, max(len(signal) // 3000, 1))
        ax.plot(signal[pick], residual[pick], ".", ms=2, color=GREY, alpha=0.5)
        centre, mean, half = binned(signal, residual)
        ax.errorbar(centre, mean, half, color=colour, marker="o", ms=3, lw=1.2, capsize=2)
        ax.axhline(0, color=GREY, lw=0.6)
        ax.set_title(f"residual {title}")
        ax.set_xlabel(name)
        ax.set_ylabel(f"residual [{unit}]")
    limit = np.percentile(np.abs(before), 99.5)
    for ax in axes[0]:
        ax.set_ylim(-1.2 * limit, 1.2 * limit)
    return to_svg(fig)


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


def whiteness(before: np.ndarray, after: np.ndarray, step: float, labels: Sequence[str]) -> str:
    """Autocorrelation of the residual (J, m) up to one second, before and after, with the band of white noise."""
    fig, axes = figure(1, len(labels), 10.0, 2.6)
    count = max(int(1.0 / step), 5)
    for j, label in enumerate(labels):
        ax = axes[0, j]
        for residual, colour, name in ((before[j], ORANGE, "before"), (after[j], BLUE, "after")):
            x = residual - residual.mean()
            lags = min(count, len(x) - 1)
            r = np.array([x[: len(x) - k] @ x[k:] for k in range(lags)]) / max(x @ x, 1e-300)
            ax.plot(np.arange(lags) * step, r, color=colour, lw=1.2, label=name)
        band = 1.96 / np.sqrt(max(before.shape[1], 1))
        ax.axhspan(-band, band, color=GREY, alpha=0.25, lw=0)
        ax.set_title(label)
        ax.set_xlabel("lag [s]")
        if j == 0:
            ax.set_ylabel("autocorrelation")
            ax.legend()
    return to_svg(fig)


def cross_correlation(residual: np.ndarray, signals: dict[str, np.ndarray], step: float, label: str) -> str:
    """Correlation of a residual (m,) with signals, shifted up to half a second either way."""
    fig, axes = figure(1, 1, 8.0, 2.8)
    ax, lags = axes[0, 0], max(int(0.5 / step), 3)
    x = residual - residual.mean()
    for name, values in signals.items():
        y = values - values.mean()
        scale = max(np.sqrt((x @ x) * (y @ y)), 1e-300)
        r = [
            x[max(k, 0) : len(x) + min(k, 0)] @ y[max(-k, 0) : len(y) - max(k, 0)] / scale
            for k in range(-lags, lags + 1)
        ]
        ax.plot(np.arange(-lags, lags + 1) * step, r, lw=1.2, label=name)
    ax.set_xlabel("shift [s] (positive: the residual follows)")
    ax.set_ylabel("correlation")
    ax.set_title(f"residual of {label} with other signals")
    ax.legend(ncols=2)
    return to_svg(fig)


def replayed(
    time: np.ndarray, measured: np.ndarray, before: np.ndarray, after: np.ndarray, labels: Sequence[str], unit: str
) -> str:
    """Torque of the replay with the old and the new FMU against the recorded one; arrays (n, J), the last seconds."""
    fig, axes = figure(len(labels), 1, 10.0, 2.1 * len(labels) + 0.4)
    keep = time >= time[-1] - SHOWN
    for j, label in enumerate(labels):
        ax = axes[j, 0]
        ax.plot(time[keep], measured[keep, j], color=GREY, lw=2.0, label="recorded")
        ax.plot(time[keep], before[keep, j], color=ORANGE, lw=0.9, label="old FMU")
        ax.plot(time[keep], after[keep, j], color=BLUE, lw=0.9, label="new FMU")
        ax.set_ylabel(f"{label} [{unit}]")
        if j == 0:
            ax.legend(ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    axes[-1, 0].set_xlabel("time [s]")
    return to_svg(fig)


def error_bars(
    before: Sequence[float],
    after: Sequence[float],
    interval: Sequence[tuple[float, float]],
    floor: Sequence[float | None],
    labels: Sequence[str],
) -> MplFigure:
    """Held-out RMS% per joint before and after, with the interval of after and the floor where it is known."""
    fig, axes = figure(1, 1, 6.0, 2.8)
    ax, place = axes[0, 0], np.arange(len(labels))
    ax.bar(place - 0.18, before, 0.34, color=ORANGE, label="before")
    low, high = np.array([[a - lo, hi - a] for a, (lo, hi) in zip(after, interval, strict=True)]).T
    ax.bar(
        place + 0.18, after, 0.34, color=BLUE, label="after", yerr=np.maximum(np.nan_to_num((low, high)), 0), capsize=3
    )
    for x, value in zip(place, floor, strict=True):
        if value is not None:
            ax.hlines(value, x - 0.4, x + 0.4, color=RED, lw=1.4, label="floor" if x == 0 else None)
    ax.set_xticks(place, labels)
    ax.set_ylabel("RMS error of the torque [%]")
    ax.legend()
    return fig
