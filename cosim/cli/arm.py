"""`cosim arm workspace | dissect | counterbalance`: what the model says of the arm."""

from math import inf
from pathlib import Path
from typing import Annotated

import typer

from cosim.arm.counterbalance import GIMBAL, LEVER, Attachment, Counterweights, balancing_weights
from cosim.arm.dissection import TERMS, ArmMotion, Dissection, dissect, random_motion, sampled_motion
from cosim.arm.parameters import SET_NAMES, Mounting, ParameterSet, mounted, parameter_set, with_payload
from cosim.arm.workspace import LINKED, Definiteness, definiteness
from cosim.errors import InputError, Problem, did_you_mean
from cosim.report import arm as sections
from cosim.report.html import Report, write_report

app: typer.Typer = typer.Typer(add_completion=False, no_args_is_help=True, rich_markup_mode=None)

SetOption = Annotated[str, typer.Option("--parameters", help=f"parameter set: {', '.join(SET_NAMES)}")]
MountingOption = Annotated[
    Mounting | None, typer.Option("--mounting", help="turns gravity of segment and piecewise (default: as the set is)")
]
PayloadOption = Annotated[float, typer.Option("--payload", help="mass on the tip [kg]")]
OutOption = Annotated[Path, typer.Option("--out", help="folder for report.html")]
SeedOption = Annotated[int, typer.Option("--seed", help="of the random motion")]
ResultOption = Annotated[
    Path | None, typer.Option("--result", help="result.h5 of `cosim run` whose motion is taken instead of a random one")
]
ComponentOption = Annotated[str, typer.Option("--component", help="the arm in that result")]
ToolOption = Annotated[float, typer.Option("--tool", help="mass of the tool [kg]")]
DistanceOption = Annotated[float, typer.Option("--tool-distance", help="from the elbow to the tool's centre [m]")]
LeverOption = Annotated[float, typer.Option("--lever", help="L_cb, from the axis to a counterweight's centre [m]")]

CONFIGURATIONS = ("UR", "GCW", "FS", "USD", "USD+GCW")


@app.command()
def workspace(
    parameters: SetOption = "segment",
    mounting: MountingOption = None,
    payload: PayloadOption = 0.0,
    out: OutOption = Path("results/arm-workspace"),
) -> None:
    """Where the tip can be, how heavy it feels there, where J is singular, and whether M is positive definite."""
    arm = _arm(parameters, mounting, payload)
    found = definiteness(arm.pi, LINKED)
    verdict = _definite_verdict(arm, found)
    parts = [sections.limits(arm), sections.tip_masses(arm), sections.definite(arm, found)]
    mood = "good" if found.positive else "bad"
    _finish(Report(f"Workspace of the arm: {arm.name}", verdict, parts, _provenance(arm), mood), out)


@app.command("dissect")
def dissect_motion(
    parameters: SetOption = "UR",
    mounting: MountingOption = None,
    payload: PayloadOption = 0.0,
    seed: SeedOption = 1,
    result: ResultOption = None,
    component: ComponentOption = "arm",
    out: OutOption = Path("results/arm-dissect"),
) -> None:
    """Which share of each joint's torque is inertia, Coriolis, gravity and friction (Taati 4.1, Figs. 10 and 11)."""
    arm = _arm(parameters, mounting, payload)
    motion = random_motion(seed) if result is None else _motion_of(result, component)
    made = f"random_motion(seed={seed}): ten sinusoids a joint, 0.11 to 5 rad/s, 40 s"
    made = made if result is None else f"{component} in {result}, taken as free motion"
    own = dissect(arm, motion)
    others = [dissect(parameter_set(name), motion) for name in CONFIGURATIONS]
    first = sections.own_dissection(own, motion, made)
    parts = [first, sections.all_dissections(others), sections.observations(others)]
    origin = _provenance(arm) | {"motion": made}
    report = Report(f"Dynamic dissection: {arm.name}", _dissect_verdict(own), parts, origin)
    _finish(report, out, _share_lines(own))


@app.command()
def counterbalance(
    parameters: SetOption = "UR",
    mounting: MountingOption = None,
    tool: ToolOption = GIMBAL.mass,
    tool_distance: DistanceOption = GIMBAL.distance,
    lever: LeverOption = LEVER,
    out: OutOption = Path("results/arm-counterbalance"),
) -> None:
    """The counterweights that cancel gravity with a tool on the tip, and what they cost in inertia (Taati 4.2)."""
    _check_lengths(tool, tool_distance, lever)
    arm, attachment = _arm(parameters, mounting, 0.0), Attachment(tool, tool_distance)
    weights = balancing_weights(arm, attachment, lever)
    parts = [sections.balance(arm, attachment, weights), sections.printed(), sections.gimbal()]
    verdict = _balance_verdict(arm, attachment, weights)
    _finish(Report(f"Counterbalance: {arm.name}", verdict, parts, _provenance(arm)), out)


def _finish(report: Report, out: Path, details: str = "") -> None:
    """Write the page and print the summary."""
    from cosim.cli.folder import made

    path = write_report(report, made(out) / "report.html")
    print("\n".join(part for part in (report.verdict, details, f"report: {path}") if part))


def _arm(name: str, mounting: Mounting | None, payload: float) -> ParameterSet:
    params = parameter_set(name)
    params = params if mounting is None else mounted(params, mounting)
    if not 0 <= payload < inf:
        raise InputError(Problem("--payload", "a mass in kg, zero or more", repr(payload)))
    return with_payload(params, payload) if payload else params


def _motion_of(path: Path, component: str) -> ArmMotion:
    """The motion of one arm in a result file. Raises InputError where it is not in there."""
    from cosim.results.files import read_h5

    result = read_h5(path)
    arms = sorted(name.removesuffix(".dq[3]") for name in result.signals if name.endswith(".dq[3]"))
    if component not in arms or f"{component}.q[3]" not in result.signals:
        advice = f"--component NAME; {did_you_mean(component, arms)}".rstrip("; ")
        wanted = f"q and dq of an arm named {component!r}"
        raise InputError(Problem(str(path), wanted, ", ".join(arms) or "no arm", advice))
    return sampled_motion(result.time, result.vector(f"{component}.q"), result.vector(f"{component}.dq"))


def _check_lengths(tool: float, distance: float, lever: float) -> None:
    checks = (
        ("--tool", tool, 0 <= tool < inf, "a mass in kg, zero or more"),
        ("--tool-distance", distance, 0 <= distance < inf, "a length in m, zero or more"),
        ("--lever", lever, 0 < lever < inf, "a length in m above zero"),
    )
    problems = [Problem(where, expected, repr(value)) for where, value, good, expected in checks if not good]
    if problems:
        raise InputError(problems)


def _provenance(arm: ParameterSet) -> dict[str, object]:
    pi = ", ".join(f"{value:.6g}" for value in arm.pi)
    return {"parameter set": arm.name, "source": arm.source, "mounting": arm.mounting.value, "pi": pi}


def _definite_verdict(arm: ParameterSet, found: Definiteness) -> str:
    q2, q3 = sections.degrees(found.pose)
    least = f"least M11 {1e3 * found.least_yaw:.3f}e-3 kg m^2 at q2 = {q2:.1f} deg, q3 = {q3:.1f} deg"
    block = f"least eigenvalue of the (q2, q3) block {1e3 * found.least_block:.3f}e-3"
    if found.positive:
        return f"{arm.name}: the mass matrix is positive definite in the whole workspace ({least}; {block})."
    share = f"{100 * found.negative_share:.0f} % of the (q2, q3) plane"
    ending = "A run that gets there ends as domain_exit."
    return f"{arm.name}: the mass matrix is NOT positive definite in {share} ({least}; {block}). {ending}"


def _dissect_verdict(found: Dissection) -> str:
    share, leading = found.share.max(axis=0), found.share.argmax(axis=0)
    leaders = (f"joint {j + 1}: {TERMS[leading[j]]} ({100 * share[j]:.0f} %)" for j in range(3))
    return f"{found.name}, largest share of the torque: {'; '.join(leaders)}."


def _share_lines(found: Dissection) -> str:
    lines = [f"{'share [%]':26s}" + "".join(f"joint {joint + 1:<4d}" for joint in range(3))]
    for name, row in zip(TERMS, found.share, strict=True):
        lines.append(f"{name:26s}" + "".join(f"{100 * value:<10.1f}" for value in row))
    return "\n".join(lines)


def _balance_verdict(arm: ParameterSet, tool: Attachment, weights: Counterweights) -> str:
    masses = f"{weights.upper:.3f} kg on motor two and {weights.fore:.3f} kg on motor three"
    text = (
        f"{arm.name} with a tool of {tool.mass:g} kg: {masses}, {1e3 * weights.lever:g} mm from the axis, "
        "cancel gravity in every pose."
    )
    negative = [name for name, mass in (("two", weights.upper), ("three", weights.fore)) if mass < 0]
    if not negative:
        return text
    motors = " and ".join(negative)
    return f"{text} A negative mass means that motor {motors} needs its weight on the other side of the axis."
