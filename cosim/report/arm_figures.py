"""Figures of the arm itself: reachable section, definiteness maps, dissection, counterbalance."""

from collections.abc import Sequence

import numpy as np

from cosim.arm.dissection import TERMS, Dissection
from cosim.arm.dynamics import gravity_torque, heaviest_direction, yaw_inertia
from cosim.arm.kinematics import L1, L2, forward, radius
from cosim.arm.parameters import ParameterSet
from cosim.arm.workspace import BOX, Definiteness, Workspace, block_eigenvalue, mesh, outline
from cosim.report.canvas import (
    BLACK,
    BLUE,
    COLOURS,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    Axes,
    ContourSet,
    MplFigure,
    figure,
    to_svg,
)

NOT_DEFINITE = "#f3c9b5"
TERM_COLOURS = dict(zip(TERMS, COLOURS[:5], strict=True))


def _section(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance from the vertical axis and height of the tips, each (...) [mm]."""
    return 1e3 * radius(q), 1e3 * forward(q)[..., 1]


def section_figure(params: ParameterSet, workspace: Workspace, levels: Sequence[float]) -> str:
    """The reachable section of the arm, coloured by the tip's mass in its heaviest direction; `levels` in kg.

    Where M is not positive definite there is no such mass: those poses are drawn in one pale red.
    """
    fig, axes = figure(width=6.2, height=6.6)
    axis = axes[0, 0]
    q = mesh(workspace, 161)
    mass = np.clip(heaviest_direction(params.pi, q)[0], levels[0], levels[-1])
    definite = (yaw_inertia(params.pi, q) > 0) & (block_eigenvalue(params.pi, q[..., 1] - q[..., 2]) > 0)
    axis.contourf(*_section(q), np.where(definite, 0.0, 1.0), levels=[0.5, 1.5], colors=[NOT_DEFINITE])
    drawn = axis.contourf(
        *_section(q), np.where(definite, np.log(mass), np.nan), levels=np.log(levels), cmap="viridis_r"
    )
    bar = fig.colorbar(drawn, ax=axis, label="tip mass in its heaviest direction [kg]", ticks=np.log(levels))
    bar.set_ticklabels([f"{level:g}" for level in levels])
    axis.plot(*_section(outline(BOX)), color=GREY, lw=0.9, ls="--", label="edges of Sallam's box alone")
    axis.plot(*_section(outline(workspace)), color=BLACK, lw=1.2, label="box and linkage")
    axis.axvline(0, color=RED, lw=1.2, label="r = 0: joint 1 cannot move the tip")
    _draw_arm(axis)
    axis.set(xlabel="distance from the vertical axis r [mm]", ylabel="height y [mm]", aspect="equal")
    fig.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return to_svg(fig)


def _draw_arm(axis: Axes) -> None:
    """Upper arm and forearm at q = 0."""
    points = 1e3 * np.array([(0, L2), (L1, L2), (L1, 0)])
    axis.plot(*points.T, color=ORANGE, lw=2.5, marker="o", ms=4, label="arm at q = 0")


def definite_figure(params: ParameterSet, workspace: Workspace, found: Definiteness) -> str:
    """M11 and the smaller eigenvalue of the (q2, q3) block of one set over the polygon, each with its zero line and
    least pose.
    """
    q = mesh(workspace)
    fig, axes = figure(1, 2, width=9.6, height=4.2)
    values = (yaw_inertia(params.pi, q), block_eigenvalue(params.pi, q[..., 1] - q[..., 2]))
    names = ("M11", "smaller eigenvalue of the (q2, q3) block")
    for axis, value, name in zip(axes[0], values, names, strict=True):
        drawn = _map(axis, q, 1e3 * value, np.linspace(1e3 * value.min(), 1e3 * value.max(), 13), "viridis")
        axis.set(xlabel="q2 [deg]", ylabel="q3 [deg]", title=f"{params.name}: {name}")
        fig.colorbar(drawn, ax=axis, label="[1e-3 kg m²]", format="%.2f")
    axes[0, 0].plot(*np.rad2deg(found.pose), "o", color=RED, ms=7, label=f"least: {1e3 * found.least_yaw:.3f}e-3")
    axes[0, 0].legend(loc="upper left")
    return to_svg(fig)


def definite_maps_figure(sets: Sequence[ParameterSet], workspace: Workspace) -> str:
    """The same map for several sets side by side, with one scale."""
    columns = 4
    rows = -(-len(sets) // columns)
    fig, axes = figure(rows, columns, width=10.0, height=2.6 * rows)
    maps = [_definite_axes(axis, params, workspace) for axis, params in zip(axes.flat, sets, strict=False)]
    for axis, params in zip(axes.flat, sets, strict=False):
        axis.set(title=params.name, xticks=(-50, 0, 50, 100), yticks=(0, 50, 100, 150))
    for axis in axes.flat[len(sets) :]:
        axis.set_axis_off()
    for axis in axes[:, 0]:
        axis.set_ylabel("q3 [deg]")
    for axis in axes[-1]:
        axis.set_xlabel("q2 [deg]")
    fig.colorbar(maps[-1], ax=axes, label="smallest eigenvalue of M [1e-3 kg m²]", shrink=0.8)
    return to_svg(fig)


def _definite_axes(axis: Axes, params: ParameterSet, workspace: Workspace) -> ContourSet:
    q = mesh(workspace)
    least = np.minimum(yaw_inertia(params.pi, q), block_eigenvalue(params.pi, q[..., 1] - q[..., 2]))
    return _map(axis, q, 1e3 * np.clip(least, -2.4e-3, 2.4e-3), np.linspace(-2.4, 2.4, 13), "RdBu")


def _map(axis: Axes, q: np.ndarray, value: np.ndarray, levels: np.ndarray, colours: str) -> ContourSet:
    """Filled contours of a value (n, n) over the poses of `mesh`, the zero line in black."""
    grid = np.rad2deg(q[..., 1]), np.rad2deg(q[..., 2])
    drawn = axis.contourf(*grid, value, levels=levels, cmap=colours)
    if value.min() < 0:
        axis.contour(*grid, value, levels=[0.0], colors=BLACK, linewidths=1.2)
    return drawn


def dissection_figure(found: Dissection, until: float) -> str:
    """The five torque terms of each joint over time, like Taati Fig. 10, up to `until` [s]."""
    fig, axes = figure(3, 1, width=8.6, height=6.6)
    for joint, axis in enumerate(axes[:, 0]):
        _term_lines(axis, found, joint, until)
        axis.set(ylabel=f"joint {joint + 1} [mN m]")
    axes[0, 0].set_title(found.name)
    _finish_terms(fig, axes)
    return to_svg(fig)


def joint_dissections_figure(found: Sequence[Dissection], joint: int, until: float) -> str:
    """The five terms of one joint (0, 1, 2) for several sets, like Taati Fig. 11."""
    fig, axes = figure(len(found), 1, width=8.6, height=1.7 * len(found) + 0.6)
    for axis, dissection in zip(axes[:, 0], found, strict=True):
        _term_lines(axis, dissection, joint, until)
        axis.set(title=dissection.name, ylabel="[mN m]")
    _finish_terms(fig, axes)
    return to_svg(fig)


def _term_lines(axis: Axes, found: Dissection, joint: int, until: float) -> None:
    shown = found.time <= until
    for name, torque in zip(TERMS, found.torque, strict=True):
        axis.plot(found.time[shown], 1e3 * torque[shown, joint], color=TERM_COLOURS[name], lw=1.1, label=name)
    axis.set_xlim(0, until)


def _finish_terms(fig: MplFigure, axes: np.ndarray) -> None:
    axes[-1, 0].set_xlabel("time [s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False)


def shares_figure(found: Sequence[Dissection]) -> str:
    """Share of each term in each joint's torque, one bar a parameter set."""
    fig, axes = figure(1, 3, width=9.6, height=3.6)
    names = [dissection.name for dissection in found]
    for joint, axis in enumerate(axes[0]):
        left = np.zeros(len(found))
        for index, name in enumerate(TERMS):
            share = np.array([100 * dissection.share[index, joint] for dissection in found])
            axis.barh(names, share, left=left, color=TERM_COLOURS[name], label=name, height=0.7)
            left += share
        axis.set(title=f"joint {joint + 1}", xlabel="share of the torque [%]", xlim=(0, 100))
        axis.invert_yaxis()
        if joint:
            axis.set_yticklabels([])
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)
    return to_svg(fig)


def gravity_figure(arms: Sequence[tuple[str, ParameterSet]], workspace: Workspace) -> str:
    """Gravity torque of joints 2 and 3 over their angle, one line an arm."""
    fig, axes = figure(1, 2, width=9.0, height=3.8)
    for joint, axis in zip((1, 2), axes[0], strict=True):
        angle = np.linspace(workspace.low[joint], workspace.high[joint], 200)
        q = np.zeros((200, 3))
        q[:, joint] = angle
        for (name, arm), colour, dash in zip(arms, (BLUE, ORANGE, PURPLE, GREEN), ("-", "-", "--", "-"), strict=False):
            axis.plot(np.rad2deg(angle), 1e3 * gravity_torque(arm.pi, q)[:, joint], color=colour, ls=dash, label=name)
        axis.axhline(0, color=GREY, lw=0.8)
        axis.set(xlabel=f"q{joint + 1} [deg]", ylabel="gravity torque [mN m]", title=f"joint {joint + 1}")
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return to_svg(fig)
