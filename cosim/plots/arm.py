"""Figures of the arm itself: reachable section, definiteness maps, dissection, counterbalance."""

from collections.abc import Sequence

import numpy as np

from cosim.arm.dissection import TERMS, Dissection
from cosim.arm.dynamics import gravity_torque, heaviest_direction
from cosim.arm.kinematics import L1, L2, forward, radius
from cosim.arm.parameters import ParameterSet
from cosim.arm.workspace import BOX, Definiteness, Workspace, definite_map, outline
from cosim.plots.canvas import BLACK, BLUE, COLOURS, GREEN, GREY, ORANGE, RED, figure, to_svg

TERM_COLOURS = dict(zip(TERMS, COLOURS[:5], strict=True))


def _section(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance from the vertical axis and height of the tips, each (...) [mm]."""
    return 1e3 * radius(q), 1e3 * forward(q)[..., 1]


def section_figure(params: ParameterSet, workspace: Workspace, levels: Sequence[float]) -> str:
    """The reachable section of the arm, coloured by the tip's mass in its heaviest direction [kg]; `levels` in kg."""
    fig, axes = figure(width=7.6, height=5.4)
    axis = axes[0, 0]
    q2, q3 = (np.linspace(workspace.low[i], workspace.high[i], 201) for i in (1, 2))
    q = np.stack([np.zeros((201, 201)), *np.meshgrid(q2, q3, indexing="ij")], axis=-1)
    mass = np.full(q.shape[:-1], np.nan)
    inside = workspace.contains(q)
    mass[inside] = np.abs(heaviest_direction(params.pi, q[inside])[0])
    drawn = axis.contourf(*_section(q), np.clip(mass, levels[0], levels[-1]), levels=levels, cmap="viridis_r")
    fig.colorbar(drawn, ax=axis, label="tip mass in its heaviest direction [kg]", ticks=levels)
    axis.plot(*_section(outline(BOX)), color=GREY, lw=0.9, ls="--", label="box of Sallam Table I alone")
    axis.plot(*_section(outline(workspace)), color=BLACK, lw=1.2, label="box and linkage")
    axis.axvline(0, color=RED, lw=1.2, label="r = 0: joint 1 cannot move the tip")
    _draw_arm(axis)
    axis.set(xlabel="distance from the vertical axis r [mm]", ylabel="height y [mm]", aspect="equal")
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=3)
    return to_svg(fig)


def _draw_arm(axis) -> None:
    """Upper arm and forearm at q = 0."""
    points = 1e3 * np.array([(0, L2), (L1, L2), (L1, 0)])
    axis.plot(*points.T, color=ORANGE, lw=2.5, marker="o", ms=4, label="arm at q = 0")


def definite_figure(params: ParameterSet, workspace: Workspace, found: Definiteness) -> str:
    """Smallest eigenvalue of M over the (q2, q3) plane of one set, its zero line and the pose where M11 is smallest."""
    fig, axes = figure(width=7.0, height=4.6)
    drawn = _definite_axes(axes[0, 0], params, workspace)
    axes[0, 0].plot(*np.rad2deg(found.pose), "o", color=BLACK, ms=6, mfc="none", label=f"M11 least: {1e3 * found.least_yaw:.3g}e-3")
    axes[0, 0].set(xlabel="q2 [deg]", ylabel="q3 [deg]", title=params.name)
    axes[0, 0].legend(loc="upper left")
    fig.colorbar(drawn, ax=axes[0, 0], label="smallest eigenvalue of M [1e-3 kg m$^2$]")
    return to_svg(fig)


def definite_maps_figure(sets: Sequence[ParameterSet], workspace: Workspace) -> str:
    """The same map for several sets side by side, with one scale."""
    columns = 4
    rows = -(-len(sets) // columns)
    fig, axes = figure(rows, columns, width=10.0, height=2.6 * rows)
    for axis, params in zip(axes.flat, sets, strict=False):
        drawn = _definite_axes(axis, params, workspace)
        axis.set(title=params.name, xticks=(-50, 0, 50, 100), yticks=(0, 50, 100, 150))
    for axis in axes.flat[len(sets):]:
        axis.set_axis_off()
    for axis in axes[:, 0]:
        axis.set_ylabel("q3 [deg]")
    for axis in axes[-1]:
        axis.set_xlabel("q2 [deg]")
    fig.colorbar(drawn, ax=axes, label="smallest eigenvalue of M [1e-3 kg m$^2$]", shrink=0.8)
    return to_svg(fig)


def _definite_axes(axis, params: ParameterSet, workspace: Workspace):
    q2, q3, least = definite_map(params.pi, workspace, 121)
    grid, scaled = (np.rad2deg(q2), np.rad2deg(q3)), 1e3 * np.clip(least.T, -2.4e-3, 2.4e-3)
    drawn = axis.contourf(*grid, scaled, levels=np.linspace(-2.4, 2.4, 13), cmap="RdBu")
    if np.nanmin(least) < 0:
        axis.contour(*grid, scaled, levels=[0.0], colors=BLACK, linewidths=1.2)
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


def _term_lines(axis, found: Dissection, joint: int, until: float) -> None:
    shown = found.time <= until
    for name, torque in zip(TERMS, found.torque, strict=True):
        axis.plot(found.time[shown], 1e3 * torque[shown, joint], color=TERM_COLOURS[name], lw=1.1, label=name)
    axis.set_xlim(0, until)


def _finish_terms(fig, axes) -> None:
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
        for (name, arm), colour in zip(arms, (BLUE, ORANGE, RED, GREEN), strict=False):
            axis.plot(np.rad2deg(angle), 1e3 * gravity_torque(arm.pi, q)[:, joint], color=colour, label=name)
        axis.axhline(0, color=GREY, lw=0.8)
        axis.set(xlabel=f"q{joint + 1} [deg]", ylabel="gravity torque [mN m]", title=f"joint {joint + 1}")
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return to_svg(fig)
