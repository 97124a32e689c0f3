"""The sections of the reports of `cosim arm`: text, tables and figures about one arm."""

from collections.abc import Sequence

import numpy as np
from attrs import evolve

from cosim.arm.counterbalance import (
    GCW_WEIGHT,
    GIMBAL,
    TEXT_LEVER,
    TEXT_UPPER_ARM,
    Attachment,
    Counterweights,
    fitted,
    printed_figures,
)
from cosim.arm.dissection import TERMS, ArmMotion, Dissection
from cosim.arm.dynamics import heaviest_direction, tip_mass
from cosim.arm.kinematics import radius
from cosim.arm.parameters import SET_NAMES, ParameterSet, parameter_set
from cosim.arm.workspace import BOX, LINKED, Definiteness, definiteness
from cosim.report.arm_figures import (
    definite_figure,
    definite_maps_figure,
    dissection_figure,
    gravity_figure,
    joint_dissections_figure,
    section_figure,
    shares_figure,
)
from cosim.report.html import Section, Table

MASSES = 0.03, 3.0
"""Ends of the colours of the tip's mass [kg]."""
POSES = ((0.0, 0.0, 0.0), (0.0, 0.3, 0.4), (0.0, 0.8, 0.9), (0.0, -0.4, 0.2))
PARAMETER_NAMES = ("d1", "d2", "d3", "d4", "d5", "d6", "g7", "g8")


def degrees(angles: Sequence[float] | np.ndarray) -> list[float]:
    """Angles [rad] in degrees, as plain floats."""
    return np.rad2deg(np.asarray(angles, dtype=float)).tolist()


def _rounded(values, digits: int = 1) -> list[float]:
    """Numbers as a table shows them; no negative zero is left."""
    return [round(float(value), digits) + 0.0 for value in values]


def limits(arm: ParameterSet) -> Section:
    """Limits of the joints and the linkage, the reachable section, where J is singular."""
    low, high = degrees(LINKED.low), degrees(LINKED.high)
    rows = [(f"q{i + 1}", *_rounded((low[i], high[i])), "Sallam Table I") for i in range(3)]
    strip = degrees((LINKED.linkage_low, LINKED.linkage_high))
    rows.append(("q2 - q3", *_rounded(strip), "linkage, a public PHANToM model"))
    behind = 100 * float((radius(LINKED.sample(20000, 1)) < 0).mean())
    text = (
        f"The section is turned by q1. Behind the axis (r < 0) lie {behind:.2f} % of the poses. "
        "det J = l1 l2 r cos(q2 - q3): J is singular on the axis (r = 0), which lies inside the workspace, and with "
        "the arm in line (|q3 - q2| = 90 deg), which the linkage does not allow. On the axis the tip cannot be moved "
        "sideways at all: its mass grows without bound."
    )
    table = Table(("angle", "from [deg]", "to [deg]", "source"), rows)
    return Section("Limits and singularities", text, [table], [section_figure(arm, LINKED, MASSES)])


def tip_masses(arm: ParameterSet) -> Section:
    """Effective tip mass along the axes and in the heaviest direction, at a few poses."""
    rows = []
    for pose in map(np.array, POSES):
        mass, direction = heaviest_direction(arm.pi, pose)
        along = [tip_mass(arm.pi, pose, axis) for axis in np.eye(3)]
        name = ", ".join(f"{angle:g}" for angle in pose)
        rows.append((name, *_rounded((*along, mass), 4), ", ".join(f"{value + 0.0:.2f}" for value in direction)))
    header = ("q [rad]", "along x [kg]", "along y [kg]", "along z [kg]", "heaviest [kg]", "its direction (x, y, z)")
    text = "What a hand feels when it pushes the tip along one direction and the others stay free."
    return Section("Effective tip mass", text, [Table(header, rows)])


def definite(arm: ParameterSet, found: Definiteness) -> Section:
    """Whether M is positive definite over the workspace, for this arm and for every set."""
    sets = [parameter_set(name) for name in SET_NAMES]
    shown = sets if arm.name in SET_NAMES else [*sets, arm]
    header = (
        "set",
        "least M11",
        "at q2, q3 [deg]",
        "least block eigenvalue",
        "M > 0",
        "share not > 0 [%]",
        "box alone",
    )
    text = (
        "M11 is minimised over box and linkage by branch and bound: the value is the proven global minimum, not the "
        "best of a grid. The smaller eigenvalue of the (q2, q3) block depends on |sin(q2 - q3)| only. Taati 3.2 "
        "reports M > 0 with a smallest eigenvalue of 1.8e-3 for all configurations, which the table does not bear out "
        "(`cosim docs misprints`)."
    )
    table = Table(
        header,
        [(params.name, *_definite_cells(params)) for params in shown],
        "Inertias in 1e-3 kg m^2; box alone: least M11 without the linkage's limits.",
    )
    figures = [definite_figure(arm, LINKED, found), definite_maps_figure(sets, LINKED)]
    return Section("Positive definiteness", text, [table], figures)


def _definite_cells(params: ParameterSet) -> tuple[object, ...]:
    linked, box = definiteness(params.pi, LINKED), definiteness(params.pi, BOX)
    yaw, block, without = _rounded((1e3 * linked.least_yaw, 1e3 * linked.least_block, 1e3 * box.least_yaw), 4)
    pose = ", ".join(f"{angle:.1f}" for angle in degrees(linked.pose))
    return yaw, pose, block, linked.positive, round(100 * linked.negative_share, 1), without


def own_dissection(found: Dissection, motion: ArmMotion, made: str) -> Section:
    """Shares and sizes of the five terms of one arm, and their course."""
    rows = [(name, *_rounded(100 * found.share[i]), *_rounded(1e3 * found.rms[i])) for i, name in enumerate(TERMS)]
    header = ("term", *(f"joint {j} [%]" for j in (1, 2, 3)), *(f"joint {j} RMS [mN m]" for j in (1, 2, 3)))
    fastest = ", ".join(f"{value:.2f}" for value in np.abs(motion.dq).max(axis=0))
    text = (
        f"Motion: {made}. Fastest joint rates {fastest} rad/s (Taati: 3.5 rad/s). Share: mean absolute value of a "
        "term over the sum of the five. The shares of gravity and inertia depend on pose and speed."
    )
    return Section("This arm", text, [Table(header, rows)], [dissection_figure(found)])


def all_dissections(found: list[Dissection]) -> Section:
    """The five identified configurations side by side."""
    rows = [(d.name, joint + 1, *_rounded(100 * d.share[:, joint])) for joint in range(3) for d in found]
    figures = [shares_figure(found), joint_dissections_figure(found, 2)]
    table = Table(("set", "joint", *(f"{name} [%]" for name in TERMS)), rows)
    return Section("All configurations", "", [table], figures)


def observations(found: list[Dissection]) -> Section:
    """Taati's observations of 4.1 beside what Table 1's parameters give on this motion."""
    friction = [d.name for d in found if d.share[3:, 0].sum() > d.share[:3, 0].max()]
    inertial = [d.name for d in found if d.share[0, 0] > d.share[1, 0]]
    second = [d.name for d in found if d.share[0, 1] >= d.share[1:, 1].max()]
    third = [d.name for d in found if d.rms[2, 2] > d.rms[2, :2].max()]
    g8 = {d.name: abs(parameter_set(d.name).pi[7]) for d in found}
    sensor, gimbal_up = 100 * (1 - g8["FS"] / g8["UR"]), 100 * (1 - g8["GCW"] / g8["UR"])
    gimbal_down = 100 * (g8["USD+GCW"] / g8["USD"] - 1)
    rows = [
        ("joint 1: friction is largest in every configuration", f"largest in {_names(friction)}"),
        ("joint 1: then Coriolis and centrifugal", f"inertia is larger than Coriolis in {_names(inertial)}"),
        ("joint 2: inertia is largest", f"largest in {_names(second)}"),
        ("gravity matters most in joint 3", f"its torque is largest there in {_names(third)}"),
        ("the force sensor cuts joint 3's gravity by half", f"|g8| falls by {sensor:.0f} %"),
        (
            "the gimbal practically nullifies it",
            f"|g8| falls by {gimbal_up:.0f} % upright; upside down it changes by {gimbal_down:+.0f} %",
        ),
    ]
    text = "The paper's motion is not published, so shares can differ; g8 does not depend on it."
    table = Table(("printed in 4.1", "with Table 1's parameters, on this motion"), rows)
    return Section("Taati's observations, checked", text, [table])


def _names(names: list[str]) -> str:
    return ", ".join(names) or "none"


def balance(arm: ParameterSet, tool: Attachment, weights: Counterweights) -> Section:
    """Gravity torque and all eight parameters without and with tool and counterweights."""
    arms = [
        (arm.name, arm),
        ("with tool", fitted(arm, tool, Counterweights(0.0, 0.0, weights.lever))),
        (
            f"with tool and {GCW_WEIGHT.upper:g} kg on motor two",
            fitted(arm, tool, evolve(GCW_WEIGHT, lever=weights.lever)),
        ),
        ("with tool and both counterweights", fitted(arm, tool, weights)),
    ]
    rows = [(name, *_rounded(1e3 * params.pi, 2)) for name, params in arms]
    text = (
        "Eqs. 16-17 move g7 and g8; the same masses move the inertial parameters as well, which is the price of "
        "balance: the table has all eight. A weight on motor two cannot change g8, so balance needs two weights."
    )
    table = Table(("arm", *PARAMETER_NAMES), rows, "Parameters in 1e-3 (kg m^2, N m).")
    return Section("Balance", text, [table], [gravity_figure(arms, LINKED)])


def printed() -> Section:
    """The four figures of Taati 4.2 with the lengths of the text and with those that give them."""
    rows = [
        (f.name, f.unit, *(f"{value:.{f.decimals}f}" for value in (f.printed, f.from_text, f.put_right)))
        for f in printed_figures(parameter_set("UR"))
    ]
    text_lengths = f"with L_cb = {TEXT_LEVER} m, L1 = {TEXT_UPPER_ARM} m (text)"
    header = ("figure of Taati 4.2", "unit", "printed", text_lengths, "with L_cb = 0.070 m, L1 = 0.215 m")
    text = (
        "UR, gimbal 0.09 kg at 0.195 m from the elbow, manufacturer's weight 0.216 kg on motor two. The lengths in the "
        "paper's text do not give three of its four figures; 0.070 m and 0.215 m give all four to the last digit."
    )
    return Section("The paper's figures", text, [Table(header, rows)])


def gimbal() -> Section:
    """Gimbal and weight as point masses against the identified GCW column, all eight parameters."""
    bare, found = parameter_set("UR").pi, parameter_set("GCW").pi
    predicted = fitted(parameter_set("UR"), GIMBAL, GCW_WEIGHT).pi
    columns = zip(PARAMETER_NAMES, bare, predicted, found, strict=True)
    rows = [(name, *_rounded(1e3 * np.array(values), 2)) for name, *values in columns]
    text = (
        "The paper checks g7 and g8 only. As point masses gimbal and weight also predict the inertial parameters: d2, "
        "d4 and d5 come within 12 % of the identified ones, d1, d3 and d6 do not; d1 is the one that makes the "
        "identified M indefinite."
    )
    header = ("parameter", "UR [1e-3]", "UR + gimbal + weight [1e-3]", "GCW identified [1e-3]")
    return Section("UR to GCW by physics", text, [Table(header, rows)])
