"""`cosim arm workspace | dissect | counterbalance`: what the model says of the arm."""

from pathlib import Path
from typing import Annotated

import typer
from attrs import evolve

from cosim.arm.counterbalance import (
    GCW_WEIGHT, GIMBAL, LEVER, TEXT_LEVER, TEXT_UPPER_ARM, Attachment, Counterweights, balancing_weights, fitted, printed_figures,
)  # fmt: skip
from cosim.arm.dissection import TERMS, Dissection, dissect, random_motion
from cosim.arm.dynamics import heaviest_direction, tip_mass
from cosim.arm.kinematics import radius
from cosim.arm.parameters import SET_NAMES, Mounting, ParameterSet, mounted, parameter_set, with_payload
from cosim.arm.workspace import BOX, LINKED, Definiteness, definiteness
from cosim.errors import InputError, Problem
from cosim.report import Figure, Report, Section, Table, write_report

app = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)

Set = Annotated[str, typer.Option("--parameters", help=f"parameter set: {', '.join(SET_NAMES)}")]
Mount = Annotated[Mounting | None, typer.Option("--mounting", help="turns gravity of segment and piecewise (default: as the set is)")]
Payload = Annotated[float, typer.Option(help="mass on the tip [kg]")]
Out = Annotated[Path, typer.Option("--out", help="folder for report.html")]

CONFIGURATIONS = ("UR", "GCW", "FS", "USD", "USD+GCW")
PARAMETER_NAMES = ("d1", "d2", "d3", "d4", "d5", "d6", "g7", "g8")
MASS_LEVELS = (0.03, 0.05, 0.075, 0.1, 0.15, 0.25, 0.5, 1.0, 3.0)


@app.command()
def workspace(parameters: Set = "segment", mounting: Mount = None, payload: Payload = 0.0, out: Out = Path("arm-workspace")) -> None:
    """Where the tip can be, how heavy it feels there, where J is singular, and whether M is positive definite."""
    arm = _arm(parameters, mounting, payload)
    found = definiteness(arm.pi, LINKED)
    report = Report(f"Workspace of the arm: {arm.name}", _definite_verdict(arm, found),
                    [_limits_section(arm), _tip_section(arm), _definite_section(arm, found)], _provenance(arm),
                    "good" if found.positive else "bad")
    path = write_report(report, out / "report.html")
    print(f"{_definite_verdict(arm, found)}\nreport: {path}")


@app.command("dissect")
def dissect_motion(parameters: Set = "UR", mounting: Mount = None, payload: Payload = 0.0,
                   seed: Annotated[int, typer.Option(help="of the random motion")] = 1,
                   out: Out = Path("arm-dissect")) -> None:
    """Which share of each joint's torque is inertia, Coriolis, gravity and friction (Taati 4.1, Figs. 10 and 11)."""
    arm, motion = _arm(parameters, mounting, payload), random_motion(seed)
    own = dissect(arm, motion)
    others = [dissect(parameter_set(name), motion) for name in CONFIGURATIONS]
    verdict = _dissect_verdict(own)
    report = Report(f"Dynamic dissection: {arm.name}", verdict,
                    [_own_dissection(own, motion), _all_dissections(others), _observations(others)],
                    _provenance(arm) | {"motion": f"random_motion(seed={seed}), ten sinusoids a joint, 0.11 to 5 rad/s, 40 s"})
    path = write_report(report, out / "report.html")
    print(f"{verdict}\n{_share_lines(own)}\nreport: {path}")


@app.command()
def counterbalance(parameters: Set = "UR", mounting: Mount = None,
                   tool: Annotated[float, typer.Option(help="mass of the tool [kg]")] = GIMBAL.mass,
                   tool_distance: Annotated[float, typer.Option(help="from the elbow to the tool's centre [m]")] = GIMBAL.distance,
                   lever: Annotated[float, typer.Option(help="L_cb, from the axis to a counterweight's centre [m]")] = LEVER,
                   out: Out = Path("arm-counterbalance")) -> None:
    """The counterweights that cancel gravity with a tool on the tip, and what they cost in inertia (Taati 4.2, Eqs. 16-19)."""
    _check_lengths(tool, tool_distance, lever)
    arm, attachment = _arm(parameters, mounting, 0.0), Attachment(tool, tool_distance)
    weights = balancing_weights(arm, attachment, lever)
    verdict = _balance_verdict(arm, attachment, weights)
    sections = [_balance_section(arm, attachment, weights), _printed_section(), _gimbal_section()]
    report = Report(f"Counterbalance: {arm.name}", verdict, sections, _provenance(arm))
    path = write_report(report, out / "report.html")
    print(f"{verdict}\nreport: {path}")


def _arm(name: str, mounting: Mounting | None, payload: float) -> ParameterSet:
    params = parameter_set(name)
    params = params if mounting is None else mounted(params, mounting)
    if not 0 <= payload < float("inf"):
        raise InputError(Problem("--payload", "a mass in kg, zero or more", repr(payload)))
    return with_payload(params, payload) if payload else params


def _check_lengths(tool: float, distance: float, lever: float) -> None:
    checks = (("--tool", tool, tool >= 0, "a mass in kg, zero or more"),
              ("--tool-distance", distance, distance >= 0, "a length in m, zero or more"),
              ("--lever", lever, lever > 0, "a length in m above zero"))
    problems = [Problem(where, expected, repr(value)) for where, value, good, expected in checks if not good]
    if problems:
        raise InputError(problems)


def _provenance(arm: ParameterSet) -> dict[str, object]:
    return {"parameter set": arm.name, "source": arm.source, "mounting": arm.mounting.value,
            "pi": ", ".join(f"{value:.6g}" for value in arm.pi)}


def _rounded(values, digits: int = 1) -> list[float]:
    """Numbers as a table shows them; rounding leaves no negative zero."""
    return [round(float(value), digits) + 0.0 for value in values]


def _definite_verdict(arm: ParameterSet, found: Definiteness) -> str:
    q2, q3 = (angle * 57.29577951308232 for angle in found.pose)
    least = f"least M11 {1e3 * found.least_yaw:.3f}e-3 kg m^2 at q2 = {q2:.1f} deg, q3 = {q3:.1f} deg"
    block = f"least eigenvalue of the (q2, q3) block {1e3 * found.least_block:.3f}e-3"
    if found.positive:
        return f"{arm.name}: the mass matrix is positive definite in the whole workspace ({least}; {block})."
    share = 100 * found.negative_share
    return (f"{arm.name}: the mass matrix is NOT positive definite in {share:.0f} % of the (q2, q3) plane ({least}; {block}). "
            "A run that gets there ends as domain_exit.")


def _limits_section(arm: ParameterSet) -> Section:
    from cosim.plots.arm import section_figure

    degrees = 57.29577951308232
    rows = [(f"q{i + 1}", degrees * LINKED.low[i], degrees * LINKED.high[i], "Sallam Table I") for i in range(3)]
    rows.append(("q2 - q3", degrees * LINKED.linkage_low, degrees * LINKED.linkage_high, "linkage, a public PHANToM model"))
    share = float((radius(LINKED.sample(20000, 1)) < 0).mean())
    text = (f"The section is turned by q1. Behind the axis (r < 0) lie {100 * share:.2f} % of the poses. det J = l1 l2 r cos(q2 - q3): "
            "J is singular on the axis (r = 0), which lies inside the workspace, and with the arm in line (|q3 - q2| = 90 deg), "
            "which the linkage does not allow. On the axis the tip cannot be moved sideways at all: its mass grows without bound.")
    caption = "Section of the workspace. Colour: effective tip mass 1 / (n' J M^-1 J' n) in the heaviest direction n; pale red: M is not positive definite there."
    table = Table(("angle", "from [deg]", "to [deg]", "source"), rows)
    return Section("Limits and singularities", text, [table], [Figure(section_figure(arm, LINKED, MASS_LEVELS), caption)])


def _tip_section(arm: ParameterSet) -> Section:
    import numpy as np

    rows = []
    for pose in ((0.0, 0.0, 0.0), (0.0, 0.3, 0.4), (0.0, 0.8, 0.9), (0.0, -0.4, 0.2)):
        mass, direction = heaviest_direction(arm.pi, np.array(pose))
        along = [float(tip_mass(arm.pi, np.array(pose), axis)) for axis in np.eye(3)]
        rows.append((", ".join(f"{angle:g}" for angle in pose), *_rounded((*along, mass), 4),
                     ", ".join(f"{value + 0.0:.2f}" for value in direction)))
    header = ("q [rad]", "along x [kg]", "along y [kg]", "along z [kg]", "heaviest [kg]", "its direction (x, y, z)")
    return Section("Effective tip mass", "What a hand feels when it pushes the tip along one direction and the others stay free.",
                   [Table(header, rows)])


def _definite_section(arm: ParameterSet, found: Definiteness) -> Section:
    from cosim.plots.arm import definite_figure, definite_maps_figure

    sets = [parameter_set(name) for name in SET_NAMES]
    rows = [(params.name, *_definite_cells(params)) for params in (*sets, *([arm] if arm.name not in SET_NAMES else []))]
    header = ("set", "least M11", "at q2, q3 [deg]", "least block eigenvalue", "M > 0", "share not > 0 [%]", "box alone: least M11")
    text = ("M11 is minimised over box and linkage by branch and bound: the value is the global minimum to nine digits, not "
            "the best of a grid. The smaller eigenvalue of the (q2, q3) block depends on |sin(q2 - q3)| only. Taati 3.2 reports M > 0 with a "
            "smallest eigenvalue of 1.8e-3 for all configurations, which the table does not bear out (MISPRINTS.md).")
    figures = [Figure(definite_figure(arm, LINKED, found), "M11 and the block's smaller eigenvalue over the linked workspace; black: where they are zero."),
               Figure(definite_maps_figure(sets, LINKED), "Smallest eigenvalue of M for every parameter set; red: not positive definite.")]
    return Section("Positive definiteness", text, [Table(header, rows, "Inertias in 1e-3 kg m^2.")], figures)


def _definite_cells(params: ParameterSet) -> tuple[object, ...]:
    linked, box = definiteness(params.pi, LINKED), definiteness(params.pi, BOX)
    pose = ", ".join(f"{angle * 57.29577951308232:.1f}" for angle in linked.pose)
    return (round(1e3 * linked.least_yaw, 4), pose, round(1e3 * linked.least_block, 4), linked.positive,
            round(100 * linked.negative_share, 1), round(1e3 * box.least_yaw, 4))


def _dissect_verdict(found: Dissection) -> str:
    leaders = (f"joint {joint + 1}: {TERMS[found.share[:, joint].argmax()]} ({100 * found.share[:, joint].max():.0f} %)"
               for joint in range(3))
    return f"{found.name}, largest share of the torque: {'; '.join(leaders)}."


def _share_lines(found: Dissection) -> str:
    lines = [f"{'share [%]':26s}" + "".join(f"joint {joint + 1:<4d}" for joint in range(3))]
    lines += [f"{name:26s}" + "".join(f"{100 * value:<10.1f}" for value in row) for name, row in zip(TERMS, found.share, strict=True)]
    return "\n".join(lines)


def _own_dissection(found: Dissection, motion) -> Section:
    from cosim.plots.arm import dissection_figure

    rows = [(name, *_rounded(100 * found.share[i]), *_rounded(1e3 * found.rms[i])) for i, name in enumerate(TERMS)]
    header = ("term", *(f"joint {j} [%]" for j in (1, 2, 3)), *(f"joint {j} RMS [mN m]" for j in (1, 2, 3)))
    fastest = ", ".join(f"{value:.2f}" for value in abs(motion.dq).max(axis=0))
    text = (f"Free random motion inside box and linkage; fastest joint rates {fastest} rad/s (Taati: 3.5 rad/s). Share: mean absolute "
            "value of a term over the sum of the five. The shares of gravity and inertia depend on pose and speed of the motion.")
    figure = Figure(dissection_figure(found, 20.0), "The five terms over the first 20 s, like Taati Fig. 10.")
    return Section("This arm", text, [Table(header, rows)], [figure])


def _all_dissections(found: list[Dissection]) -> Section:
    from cosim.plots.arm import joint_dissections_figure, shares_figure

    rows = [(d.name, joint + 1, *_rounded(100 * d.share[:, joint])) for joint in range(3) for d in found]
    figures = [Figure(shares_figure(found), "Shares of the five identified configurations, same motion."),
               Figure(joint_dissections_figure(found, 2, 20.0), "Joint 3 of the five configurations, like Taati Fig. 11.")]
    return Section("All configurations", "", [Table(("set", "joint", *(f"{name} [%]" for name in TERMS)), rows)], figures)


def _observations(found: list[Dissection]) -> Section:
    """Taati's three observations of 4.1 beside what Table 1's parameters give on this motion."""
    by_name = {d.name: d for d in found}
    friction = {d.name: d.share[3, 0] + d.share[4, 0] for d in found}
    most = [name for name, d in by_name.items() if friction[name] > max(d.share[:3, 0])]
    inertial = [name for name, d in by_name.items() if d.share[0, 0] > d.share[1, 0]]
    second = [name for name, d in by_name.items() if d.share[0, 1] >= max(d.share[1:, 1])]
    third = [name for name, d in by_name.items() if d.rms[2, 2] > d.rms[2, :2].max()]
    g8 = {name: abs(parameter_set(name).pi[7]) for name in CONFIGURATIONS}
    rows = [
        ("joint 1: friction is largest in every configuration", f"largest in {', '.join(most) or 'none'}"),
        ("joint 1: then Coriolis and centrifugal", f"inertia is larger than Coriolis in {', '.join(inertial) or 'none'}"),
        ("joint 2: inertia is largest", f"largest in {', '.join(second) or 'none'} on this motion"),
        ("gravity matters most in joint 3", f"its torque is largest there in {', '.join(third) or 'none'}"),
        ("the force sensor cuts joint 3's gravity by half", f"|g8| falls by {100 * (1 - g8['FS'] / g8['UR']):.0f} %"),
        ("the gimbal practically nullifies it", f"|g8| falls by {100 * (1 - g8['GCW'] / g8['UR']):.0f} % upright, "
         f"upside down it changes by {100 * (g8['USD+GCW'] / g8['USD'] - 1):+.0f} %"),
    ]
    return Section("Taati's observations, checked", "The paper's motion is not published, so shares can differ; g8 does not depend on it.",
                   [Table(("printed in 4.1", "with Table 1's parameters here"), rows)])


def _balance_verdict(arm: ParameterSet, tool: Attachment, weights: Counterweights) -> str:
    text = (f"{arm.name} with a tool of {tool.mass:g} kg: {weights.upper:.3f} kg on motor two and {weights.fore:.3f} kg on motor three, "
            f"{1e3 * weights.lever:g} mm from the axis, cancel gravity in every pose.")
    negative = [name for name, mass in (("two", weights.upper), ("three", weights.fore)) if mass < 0]
    side = f" A negative mass means that motor {' and '.join(negative)} needs its weight on the other side of the axis." if negative else ""
    return text + side


def _balance_section(arm: ParameterSet, tool: Attachment, weights: Counterweights) -> Section:
    from cosim.plots.arm import gravity_figure

    bare, none = arm, Counterweights(0.0, 0.0, weights.lever)
    arms = [(arm.name, bare), ("with tool", fitted(arm, tool, none)),
            (f"with tool and {GCW_WEIGHT.upper:g} kg on motor two", fitted(arm, tool, evolve(GCW_WEIGHT, lever=weights.lever))),
            ("with tool and both counterweights", fitted(arm, tool, weights))]
    rows = [(name, *_rounded(1e3 * params.pi, 2)) for name, params in arms]
    text = ("Eqs. 16-17 move g7 and g8; the same masses move the inertial parameters as well, which is the price of balance: the table "
            "has all eight. A weight on motor two cannot change g8, so balance needs two weights.")
    caption = "Parameters in 1e-3 (kg m^2, N m)."
    return Section("Balance", text, [Table(("arm", *PARAMETER_NAMES), rows, caption)],
                   [Figure(gravity_figure(arms, LINKED), "Torque that holds the arm against gravity.")])


def _printed_section() -> Section:
    figures = printed_figures(parameter_set("UR"))
    rows = [(f.name, f.unit, f"{f.printed:.{f.decimals}f}", f"{f.from_text:.{f.decimals}f}", f"{f.put_right:.{f.decimals}f}") for f in figures]
    header = ("figure of Taati 4.2", "unit", "printed", f"with L_cb = {TEXT_LEVER} m, L1 = {TEXT_UPPER_ARM} m (text)",
              "with L_cb = 0.070 m, L1 = 0.215 m")
    text = ("UR, gimbal 0.09 kg at 0.195 m from the elbow, manufacturer's weight 0.216 kg on motor two. The lengths in the paper's text do not "
            "give three of its four figures; 0.070 m and 0.215 m give all four to the last digit.")
    return Section("The paper's figures", text, [Table(header, rows)])


def _gimbal_section() -> Section:
    predicted, identified = fitted(parameter_set("UR"), GIMBAL, GCW_WEIGHT).pi, parameter_set("GCW").pi
    bare = parameter_set("UR").pi
    rows = [(name, *_rounded((1e3 * a, 1e3 * b, 1e3 * c), 2)) for name, a, b, c in
            zip(PARAMETER_NAMES, bare, predicted, identified, strict=True)]
    text = ("The paper checks g7 and g8 only. As point masses gimbal and weight also predict the inertial parameters: d2, d4 and d5 come within "
            "12 % of the identified ones, d1, d3 and d6 do not, and d1 is the one that makes the identified M indefinite.")
    return Section("UR to GCW by physics", text, [Table(("parameter", "UR [1e-3]", "UR + gimbal + weight [1e-3]", "GCW identified [1e-3]"), rows)])
