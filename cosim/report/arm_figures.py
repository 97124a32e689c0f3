"""Figures of the arm itself: reachable section, definiteness maps, dissection, counterbalance."""

from collections.abc import Sequence

import numpy as np

from cosim.arm.dissection import TERMS, Dissection
from cosim.arm.dynamics import gravity_torque, heaviest_direction, yaw_inertia
from cosim.arm.kinematics import L1, L2, forward, radius
from cosim.arm.parameters import ParameterSet
from cosim.arm.workspace import BOX, Definiteness, Workspace, block_eigenvalue, mesh, outline
from cosim.report.plots import COLOURS, TIME, Colour, Figure, Guide, HeatMap, Mark, Plot, PlotAxis, Series, curves

TERM_COLOURS = COLOURS[:5]
INERTIA = "1e-3 kg m²"
Q2, Q3 = PlotAxis("q2 [deg]"), PlotAxis("q3 [deg]")


def _section(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance from the vertical axis and height of the tips, each (...) [mm]."""
    return 1e3 * radius(q), 1e3 * forward(q)[..., 1]


def section_figure(params: ParameterSet, workspace: Workspace, limits: tuple[float, float]) -> Figure:
    """The reachable section of the arm, coloured by the tip's mass in its heaviest direction between `limits` [kg].

    Where M is not positive definite there is no such mass: those poses are drawn in one pale red.
    """
    q = mesh(workspace, 91)
    definite = (yaw_inertia(params.pi, q) > 0) & (block_eigenvalue(params.pi, q[..., 1] - q[..., 2]) > 0)
    r, height = _section(q)
    mass = np.where(definite, heaviest_direction(params.pi, q)[0], np.nan)
    heat = HeatMap(r, height, mass, "tip mass in its heaviest direction [kg]", limits[0], limits[1], log=True)
    arm = 1e3 * np.array([(0, L2), (L1, L2), (L1, 0)])
    series = [
        Series("edges of Sallam's box alone", *_section(outline(BOX)), Colour.GREY, dash=(5, 3)),
        Series("box and linkage", *_section(outline(workspace)), Colour.INK),
        Series("arm at q = 0", arm[:, 0], arm[:, 1], Colour.ORANGE, size=3.0),
    ]
    axes = PlotAxis("distance from the vertical axis r [mm]"), PlotAxis("height y [mm]")
    axis = Guide(0.0, Colour.RED, upright=True, name="r = 0: joint 1 cannot move the tip")
    caption = (
        "Section of the workspace. Colour: effective tip mass 1 / (n' J M^-1 J' n) in the heaviest direction n; "
        "pale red: M is not positive definite there."
    )
    return Figure([Plot(series, *axes, heat=heat, height=560, equal=True, guides=[axis])], caption, name="section")


def definite_figure(params: ParameterSet, workspace: Workspace, found: Definiteness) -> Figure:
    """M11 and the smaller eigenvalue of the (q2, q3) block of one set over the polygon, each with its zero line and
    least pose.
    """
    q = mesh(workspace, 71)
    values = yaw_inertia(params.pi, q), block_eigenvalue(params.pi, q[..., 1] - q[..., 2])
    least = np.rad2deg(found.pose)
    label = f"least: {1e3 * found.least_yaw:.3f}e-3"
    mark = Series(label, least[:1], least[1:], Colour.RED, Mark.POINTS, size=9.0)
    plots = [
        Plot([mark], Q2, Q3, f"{params.name}: M11", heat=_over(q, 1e3 * values[0]), height=330),
        Plot([], Q2, Q3, f"{params.name}: (q2, q3) block", heat=_over(q, 1e3 * values[1]), height=330),
    ]
    caption = "M11 and the block's smaller eigenvalue over the linked workspace; pale red: not above zero."
    return Figure(plots, caption, columns=2, name="definite")


def _over(q: np.ndarray, values: np.ndarray) -> HeatMap:
    """Positive values (n, n) over the poses of `mesh`."""
    places = np.rad2deg(q[..., 1]), np.rad2deg(q[..., 2])
    return HeatMap(*places, np.where(values > 0, values, np.nan), f"[{INERTIA}]")


def definite_maps_figure(sets: Sequence[ParameterSet], workspace: Workspace) -> Figure:
    """The smallest eigenvalue of M for several sets side by side, with one scale."""
    q, plots = mesh(workspace, 41), []
    for params in sets:
        least = np.minimum(yaw_inertia(params.pi, q), block_eigenvalue(params.pi, q[..., 1] - q[..., 2]))
        places = np.rad2deg(q[..., 1]), np.rad2deg(q[..., 2])
        heat = HeatMap(*places, 1e3 * least, f"[{INERTIA}]", -2.4, 2.4, diverging=True)
        plots.append(Plot([], Q2, Q3, params.name, heat=heat, height=200))
    caption = "Smallest eigenvalue of M for every parameter set; red: not positive definite."
    return Figure(plots, caption, columns=3, name="definite-sets")


def dissection_figure(found: Dissection) -> Figure:
    """The five torque terms of each joint over time, like Taati Fig. 10."""
    plots = [_terms(found, joint, f"{found.name}, joint {joint + 1}") for joint in range(3)]
    return Figure(plots, "The five terms over time, like Taati Fig. 10.", name="terms")


def joint_dissections_figure(found: Sequence[Dissection], joint: int) -> Figure:
    """The five terms of one joint (0, 1, 2) for several sets, like Taati Fig. 11."""
    plots = [_terms(dissection, joint, dissection.name) for dissection in found]
    return Figure(plots, f"Joint {joint + 1} of the five configurations, like Taati Fig. 11.", name="joint")


def _terms(found: Dissection, joint: int, title: str) -> Plot:
    values = {name: 1e3 * torque[:, joint] for name, torque in zip(TERMS, found.torque, strict=True)}
    series = curves(found.time, values, TERM_COLOURS)
    return Plot(series, TIME, PlotAxis("[mN m]"), title, link="time")


def shares_figure(found: Sequence[Dissection]) -> Figure:
    """Share of each term in each joint's torque, one bar a parameter set."""
    place, plots = np.arange(len(found), dtype=float), []
    for joint in range(3):
        base, series = np.zeros(len(found)), []
        for index, (name, colour) in enumerate(zip(TERMS, TERM_COLOURS, strict=True)):
            share = np.array([100 * dissection.share[index, joint] for dissection in found])
            series.append(Series(name, place, share, colour, Mark.BARS, size=0.7, base=base))
            base = base + share
        axes = PlotAxis("", names=[d.name for d in found]), PlotAxis("share of the torque [%]", (0, 100))
        plots.append(Plot(series, *axes, f"joint {joint + 1}", height=220))
    caption = "Shares of the five identified configurations, same motion."
    return Figure(plots, caption, columns=3, name="shares")


def gravity_figure(arms: Sequence[tuple[str, ParameterSet]], workspace: Workspace) -> Figure:
    """Gravity torque of joints 2 and 3 over their angle, one line an arm."""
    plots = []
    for joint in (1, 2):
        angle = np.linspace(workspace.low[joint], workspace.high[joint], 200)
        q = np.zeros((200, 3))
        q[:, joint] = angle
        values = {name: 1e3 * gravity_torque(arm.pi, q)[:, joint] for name, arm in arms}
        axes = PlotAxis(f"q{joint + 1} [deg]"), PlotAxis("gravity torque [mN m]")
        series = curves(np.rad2deg(angle), values)
        plots.append(Plot(series, *axes, f"joint {joint + 1}", height=260, guides=[Guide(0.0)]))
    return Figure(plots, "Torque that holds the arm up.", columns=2, name="gravity")
