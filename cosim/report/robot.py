"""The page of `cosim robot`: the chain, what was locked and doubted, where the tip gets, how heavy the arm is."""

import numpy as np

from cosim.analysis.survival import Survival
from cosim.arm.robot import Robot, finite
from cosim.arm.serial_kinematics import frames, tip_position
from cosim.arm.serial_table import home
from cosim.report.html import Code, Report, Section, Table
from cosim.report.plots import Colour, Figure, Mark, Plot, PlotAxis, Series
from cosim.report.robot_survival import survival_section, survival_sentences
from cosim.report.stability import any_delay_sections

SHOWN = 6000
"""Points of the workspace that are drawn."""


def robot_report(robot: Robot, command: str = "", survival: Survival | None = None) -> Report:
    """The whole page; survival: what two of them bear, where that was asked."""
    model, arm = robot.arm.model, robot.arm
    parts = [] if survival is None else [survival_section(survival), *any_delay_sections(survival.any_delay)]
    parts += [_chain(robot), _bodies(robot), _workspace(robot), _masses(robot)]
    if arm.locked or arm.doubts:
        parts.insert(len(parts) - 2, _doubts(robot))
    origin: dict[str, object] = {"URDF": str(robot.source), "robot": model.name, "base": arm.chain.base}
    origin |= {"tip": f"{arm.chain.tip} ({arm.chain.why})"}
    if command:
        origin["command"] = command
    mood = "neutral" if arm.doubts else "good"
    said = robot_sentences(robot) + ([] if survival is None else survival_sentences(survival))
    return Report(f"Robot: {robot.name}", "\n".join(said), parts, origin, mood)


def robot_sentences(robot: Robot) -> list[str]:
    """What was found, in a few sentences: what the command prints."""
    arm, model = robot.arm, robot.arm.model
    kinds = [kind.value for kind in model.kinds]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
    lines = [
        f"{robot.name}: {counted(model.count, 'moving joint')} ({counts}) from {arm.chain.base} to {arm.chain.tip}; "
        f"the tip is {arm.chain.why}. What moves weighs {model.mass.sum():.4g} kg."
    ]
    if arm.locked:
        places = ", ".join(f"{j.name} {j.why}" if j.position else j.name for j in arm.locked[:6])
        more = f" and {len(arm.locked) - 6} more" if len(arm.locked) > 6 else ""
        lines.append(f"Locked, at zero where nothing else is said, and their links added to the arm's: {places}{more}.")
    if arm.doubts:
        lines.append(
            f"{len(arm.doubts)} doubtful: {'; '.join(arm.doubts[:3])}{'; ...' if len(arm.doubts) > 3 else ''}."
        )
    return lines


def counted(count: int, thing: str) -> str:
    """1 joint, 7 joints."""
    return f"{count} {thing}{'' if count == 1 else 's'}"


def _chain(robot: Robot) -> Section:
    model = robot.arm.model
    rows = [
        (
            i + 1,
            model.joints[i],
            model.kinds[i].value,
            finite(model.lower[i]),
            finite(model.upper[i]),
            finite(model.effort[i]),
            finite(model.speed[i]),
            float(model.viscous[i]),
            float(model.coulomb[i]),
        )
        for i in range(model.count)
    ]
    header = ("", "joint", "type", "lower", "upper", "effort", "speed", "viscous", "Coulomb")
    caption = "SI: rad, N m, rad/s, N m s/rad at joints that turn, m, N, m/s, N s/m at those that slide. A dash: none."
    text = (
        "The FMU holds these numbers: effort is the motor's limit, and the domain ends where a joint passes its "
        "limits. What a URDF does not know (rotors, gears, further friction) is zero and can be set: "
    )
    table = Table(header, rows, caption, digits=4)
    example = Table(
        ("in a scenario",), [(Code(f'fmu = "{robot.name}.fmu"'),), (Code("parameters = { rotor_inertia = 1e-4 }"),)]
    )
    return Section("Chain", text, [table, example])


def _bodies(robot: Robot) -> Section:
    arm, model = robot.arm, robot.arm.model
    rows = [
        (
            i + 1,
            ", ".join(arm.carried[i]),
            float(model.mass[i]),
            _listed(model.centre[i]),
            _listed(np.linalg.eigvalsh(model.inertia[i])),
        )
        for i in range(model.count)
    ]
    header = ("", "links that it moves as one", "mass [kg]", "centre [m]", "principal moments [kg m^2]")
    return Section("Links", "", [Table(header, rows, digits=4)])


def _doubts(robot: Robot) -> Section:
    arm = robot.arm
    tables = []
    if arm.doubts:
        tables.append(Table(("doubtful",), [(doubt,) for doubt in arm.doubts]))
    if arm.locked:
        rows = [(joint.name, joint.position, joint.why) for joint in arm.locked]
        tables.append(Table(("locked joint", "position", "why there"), rows, digits=4))
    text = "Doubtful values are used as they stand: the mass matrix is positive definite with them."
    return Section("Locked joints and doubts", text if arm.doubts else "", tables)


def _workspace(robot: Robot) -> Section:
    seen = robot.survey
    low, high = seen.tips.min(axis=0), seen.tips.max(axis=0)
    rows = [(axis, float(low[i]), float(high[i])) for i, axis in enumerate("xyz")]
    still = 100 * float((seen.dexterity < 0.05).mean())
    text = (
        f"{seen.poses} random poses inside the joint limits (a whole turn where there are none; collisions are "
        f"not looked at). In {still:.0f} % of them the tip moves in one direction 20 times less than in another: near "
        "a singular pose."
    )
    table = Table(("axis", "from [m]", "to [m]"), rows, digits=4)
    return Section("Workspace", text, [table], [_tips(robot)])


def _tips(robot: Robot) -> Figure:
    seen = robot.survey
    tips, singular = seen.tips[:SHOWN], seen.dexterity[:SHOWN] < 0.05
    bones = _bones(robot)
    plots = []
    for i, j in ((0, 1), (0, 2)):
        clouds = [
            Series(name, tips[chosen, i], tips[chosen, j], colour, Mark.POINTS, size=2.5)
            for name, chosen, colour in (
                ("tips", ~singular, Colour.BLUE),
                ("near a singular pose", singular, Colour.ORANGE),
            )
        ]
        arm = Series("arm at its start", bones[:, i], bones[:, j], Colour.INK, size=2.5)
        joints = Series("", bones[:, i], bones[:, j], Colour.INK, Mark.POINTS, size=6.0)
        axes = PlotAxis(f"{'xyz'[i]} [m]"), PlotAxis(f"{'xyz'[j]} [m]")
        plots.append(Plot([*clouds, arm, joints], *axes, height=380, equal=True))
    return Figure(plots, "Tips seen from above and from the side.", columns=2, name="workspace")


def _bones(robot: Robot) -> np.ndarray:
    """Base, joints and tip of the arm where it starts (n + 2, 3) [m]."""
    model = robot.arm.model
    start = home(model)
    return np.vstack([np.zeros(3), frames(model, start).origin, tip_position(model, start)])


def _masses(robot: Robot) -> Section:
    model, seen = robot.arm.model, robot.survey
    rows = []
    for i, name in enumerate(model.joints):
        share = seen.gravity[i] / model.effort[i] if np.isfinite(model.effort[i]) else None
        share = None if share is None else round(100 * float(share), 1)
        rows.append((name, float(seen.lightest[i]), float(seen.heaviest[i]), float(seen.gravity[i]), share))
    header = ("joint", "least M_ii", "greatest M_ii", "greatest gravity torque", "share of effort [%]")
    least, most = seen.unevenness
    text = (
        f"M(q) is positive definite in every pose that was tried. Scaled to a diagonal of ones its condition number "
        f"goes from {least:.3g} to {most:.3g}: how strongly joints move one another."
    )
    weak = [name for name, *_, share in rows if share is not None and share > 100]
    if weak:
        text += f" The motors of {', '.join(weak)} cannot hold the arm in every pose."
    return Section(
        "Mass matrix and gravity", text, [Table(header, rows, "kg m^2 and N m (kg and N at slides).", digits=4)]
    )


def _listed(values) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
