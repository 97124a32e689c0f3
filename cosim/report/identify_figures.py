"""Figures of an identification, like Taati's Figs. 4 to 9: torques over time, residual over velocity, friction's
parts.
"""

import numpy as np

from cosim.identification.identification import Identification
from cosim.report.canvas import BLACK, BLUE, GREEN, GREY, ORANGE, RED, Axes, MplFigure, figure, to_svg

POINTS = 1500


def torques(found: Identification, rigid: np.ndarray, piecewise: np.ndarray | None) -> MplFigure:
    """Measured and predicted filtered torque per joint on held-out rows (Figs. 4 and 6).

    rigid (p,): parameters fitted without friction; piecewise (p',): the leading ones by another method, if there are.
    """
    rows = _shown(found)
    time, predicted = found.stack.time[rows], found.predicted[rows]
    without = (found.stack.y @ rigid)[rows]
    fig, axes = figure(len(found.recording.joints), 1, height=1.0 + 1.9 * len(found.recording.joints))
    for j, ax in enumerate(axes[:, 0]):
        _line(ax, time, found.stack.tau[rows, j], BLACK, "measured")
        _line(ax, time, without[:, j], GREEN, "no friction", width=0.9)
        if piecewise is not None:
            _line(
                ax, time, (found.stack.y[:, :, : len(piecewise)] @ piecewise)[rows, j], ORANGE, "piecewise", width=0.9
            )
        _line(ax, time, predicted[:, j], BLUE, "identified", style="--")
        _left_out(ax, time, found.stack.keep[rows, j])
        ax.set_ylabel(f"{found.recording.joints[j]} [{_unit(found)}]")
    axes[-1, 0].set_xlabel("time [s]; shaded: near a reversal, neither fitted nor judged")
    axes[0, 0].legend(ncols=4, loc="lower left", bbox_to_anchor=(0, 1))
    return fig


def residuals(found: Identification, rigid: np.ndarray) -> str:
    """Residual over velocity without and with friction in the model (Figs. 5 and 7)."""
    rows = _shown(found)
    joints = len(found.recording.joints)
    fig, axes = figure(2, joints, height=4.6, width=min(8.0, 3.4 + 2.4 * (joints - 1)))
    for line, (params, title) in enumerate(
        ((rigid, "no friction in the model"), (found.params, "friction in the model"))
    ):
        left = found.stack.tau[rows] - (found.stack.y @ params)[rows]
        for j in range(joints):
            ax, keep = axes[line, j], found.stack.keep[rows, j]
            ax.plot(found.stack.dq[rows, j][~keep], left[:, j][~keep], ".", ms=1.5, color=GREY)
            ax.plot(found.stack.dq[rows, j][keep], left[:, j][keep], ".", ms=1.5, color=RED if line == 0 else BLUE)
            ax.set_title(f"{found.recording.joints[j]}, {title}" if j == 0 else found.recording.joints[j])
            ax.set_xlabel(f"velocity [{'m/s' if found.recording.description.prismatic else 'rad/s'}]" if line else "")
        axes[line, 0].set_ylabel(f"residual [{_unit(found)}]")
    return to_svg(fig)


def friction(found: Identification) -> str:
    """Viscous and Coulomb parts of the friction over time (Fig. 9)."""
    rows = _shown(found)
    labels, joints, device = found.stack.labels, found.recording.joints, found.recording.device
    fig, axes = figure(len(joints), 1, height=1.0 + 1.6 * len(joints))
    for j, ax in enumerate(axes[:, 0]):
        for family, colour in (("viscous", GREEN), ("coulomb", RED)):
            if (label := device.label(family, j)) in labels:
                k = labels.index(label)
                part = found.stack.y[rows, j, k] * found.params[k]
                _line(ax, found.stack.time[rows], part, colour, {"viscous": "viscous", "coulomb": "Coulomb"}[family])
        ax.set_ylabel(f"{joints[j]} [{_unit(found)}]")
    axes[-1, 0].set_xlabel("time [s]")
    axes[0, 0].legend(ncols=2, loc="lower left", bbox_to_anchor=(0, 1))
    return to_svg(fig)


def intervals(found: Identification) -> str:
    """Each parameter's 95 % interval, residual correlation counted, against the white-noise one; in white standard
    deviations.
    """
    shown = [p for p in found.parameters if np.isfinite(p.std) and p.std_white > 0]
    fig, axes = figure(1, 1, height=1.0 + 0.2 * len(shown))
    ax = axes[0, 0]
    for line, p in enumerate(shown):
        half = (p.interval[1] - p.interval[0]) / 2 / p.std_white
        ax.plot(
            [-1.96, 1.96],
            [line, line],
            color=ORANGE,
            lw=5,
            alpha=0.8,
            label="white noise assumed" if line == 0 else None,
        )
        ax.plot([-half, half], [line, line], color=BLUE, lw=1.8, label="correlation counted" if line == 0 else None)
    ax.set_yticks(range(len(shown)), [str(p.label) for p in shown])
    ax.invert_yaxis()
    ax.set_xlabel("half-width of the 95 % interval / white-noise standard deviation")
    ax.legend(ncols=2, loc="lower left", bbox_to_anchor=(0, 1))
    return to_svg(fig)


def _shown(found: Identification) -> np.ndarray:
    """Up to POINTS neighbouring rows of the first run with held-out rows, thinned to about POINTS."""
    held = found.stack.test & found.stack.settled
    rows = np.flatnonzero(held if held.any() else found.stack.settled)
    rows = rows[found.stack.run[rows] == found.stack.run[rows[0]]]
    return rows[:: max(len(rows) // POINTS, 1)]


def _line(
    ax: Axes, time: np.ndarray, values: np.ndarray, colour: str, label: str, style: str = "-", width: float = 1.3
) -> None:
    ax.plot(time, values, style, color=colour, lw=width, label=label)


def _left_out(ax: Axes, time: np.ndarray, keep: np.ndarray) -> None:
    if not keep.all():
        ax.fill_between(time, 0, 1, where=~keep, transform=ax.get_xaxis_transform(), color=GREY, alpha=0.15, lw=0)


def _unit(found: Identification) -> str:
    return "N" if found.recording.description.prismatic else "N m"
