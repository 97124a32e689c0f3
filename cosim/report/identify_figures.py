"""Figures of an identification, like Taati's Figs. 4 to 9: torques over time, residual over velocity, friction's
parts.
"""

import numpy as np

from cosim.identification.identification import Identification
from cosim.report.plots import TIME, Colour, Figure, Mark, Plot, PlotAxis, Series, curves, shaded


def torques(found: Identification, rigid: np.ndarray, piecewise: np.ndarray | None) -> Figure:
    """Measured and predicted filtered torque per joint on held-out rows (Figs. 4 and 6).

    rigid (p,): parameters fitted without friction; piecewise (p',): the leading ones by another method, if there are.
    """
    rows, stack = _shown(found), found.stack
    lines = {"measured": stack.tau[rows], "no friction": (stack.y @ rigid)[rows]}
    if piecewise is not None:
        lines["piecewise"] = (stack.y[:, :, : len(piecewise)] @ piecewise)[rows]
    lines["identified"] = found.predicted[rows]
    tones = {"measured": Colour.INK, "no friction": Colour.GREEN, "piecewise": Colour.ORANGE}
    time, plots = stack.time[rows], []
    for j, joint in enumerate(found.recording.joints):
        colours = [tones.get(name, Colour.BLUE) for name in lines]
        series = curves(time, {name: values[:, j] for name, values in lines.items()}, colours, ["identified"])
        strips = shaded(time, ~stack.keep[rows, j])
        plots.append(Plot(series, TIME, PlotAxis(f"{joint} [{_unit(found)}]"), link="time", height=180, strips=strips))
    caption = "Held-out rows (Taati Figs. 4, 6 and 8); shaded: near a reversal, neither fitted nor judged."
    return Figure(plots, caption, name="torques")


def residuals(found: Identification, rigid: np.ndarray) -> Figure:
    """Residual over velocity without and with friction in the model (Figs. 5 and 7)."""
    rows, joints = _shown(found), found.recording.joints
    speed = PlotAxis(f"velocity [{'m/s' if found.recording.description.prismatic else 'rad/s'}]")
    plots = []
    models = (rigid, "no friction in the model", Colour.RED), (found.params, "friction in the model", Colour.BLUE)
    for params, title, colour in models:
        left = found.stack.tau[rows] - (found.stack.y @ params)[rows]
        for j, joint in enumerate(joints):
            dq, keep = found.stack.dq[rows, j], found.stack.keep[rows, j]
            series = [
                Series("near a reversal", dq[~keep], left[:, j][~keep], Colour.GREY, Mark.POINTS, size=2.5),
                Series("judged", dq[keep], left[:, j][keep], colour, Mark.POINTS, size=2.5),
            ]
            plots.append(Plot(series, speed, PlotAxis(f"residual [{_unit(found)}]"), f"{joint}, {title}", height=220))
    caption = "Residual over velocity (Taati Figs. 5 and 7)."
    return Figure(plots, caption, columns=min(len(joints), 3) if len(joints) > 1 else 2, name="residual")


def friction(found: Identification) -> Figure:
    """Viscous and Coulomb parts of the friction over time (Fig. 9)."""
    rows, labels, device = _shown(found), found.stack.labels, found.recording.device
    time, plots = found.stack.time[rows], []
    for j, joint in enumerate(found.recording.joints):
        parts = {}
        for family, name in (("viscous", "viscous"), ("coulomb", "Coulomb")):
            if (label := device.label(family, j)) in labels:
                k = labels.index(label)
                parts[name] = found.stack.y[rows, j, k] * found.params[k]
        series = curves(time, parts, (Colour.GREEN, Colour.RED))
        plots.append(Plot(series, TIME, PlotAxis(f"{joint} [{_unit(found)}]"), link="time"))
    return Figure(plots, "Parts of the identified friction (Taati Fig. 9).", name="friction")


def intervals(found: Identification) -> Figure:
    """Each parameter's 95 % interval, residual correlation counted, against the white-noise one; in white standard
    deviations.
    """
    shown = [p for p in found.parameters if np.isfinite(p.std) and p.std_white > 0]
    half = np.array([(p.interval[1] - p.interval[0]) / 2 / p.std_white for p in shown])
    white = np.full(len(shown), 1.96)
    series = [
        _across("white noise assumed", white, Colour.ORANGE, 6.0),
        _across("correlation counted", half, Colour.BLUE, 2.0),
    ]
    axes = (
        PlotAxis("half-width of the 95 % interval / white-noise standard deviation"),
        PlotAxis("", names=[str(p.label) for p in shown]),
    )
    plot = Plot(series, *axes, height=60 + 18 * len(shown))
    return Figure([plot], "What the residual's correlation costs.", name="intervals")


def _across(name: str, half: np.ndarray, colour: Colour, width: float) -> Series:
    """A line from -half to +half (n,) in each row of a plot."""
    ends = np.column_stack([-half, half, np.full(len(half), np.nan)]).ravel()
    return Series(name, ends, np.repeat(np.arange(len(half), dtype=float), 3), colour, size=width)


def _shown(found: Identification) -> np.ndarray:
    """The rows of the first run with held-out rows."""
    held = found.stack.test & found.stack.settled
    rows = np.flatnonzero(held if held.any() else found.stack.settled)
    return rows[found.stack.run[rows] == found.stack.run[rows[0]]]


def _unit(found: Identification) -> str:
    return found.recording.description.torque_unit.replace(".", " ")
