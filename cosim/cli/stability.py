"""`cosim stability`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.run import OUTSIDE
from cosim.cli.shipped_names import ScenarioArgument


def command(
    scenario: ScenarioArgument,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change a value; may be repeated")
    ] = None,
    pose: Annotated[
        str | None, typer.Option(help="joint angles q1,q2,... [rad] of both arms (default: the scenario's start)")
    ] = None,
    any_delay: Annotated[
        bool,
        typer.Option("--any-delay", help="also: proven for every delay law up to T, and a law that destroys (minutes)"),
    ] = False,
    delay_slope: Annotated[
        float | None,
        typer.Option(metavar="RATE", min=0.0, help="with --any-delay: laws that change by so many s a second at most"),
    ] = None,
    falsify: Annotated[
        int, typer.Option(metavar="N", min=0, help="search the worst delays, hand and losses within bounds in N runs")
    ] = 0,
    harm: Annotated[str, typer.Option(help="what --falsify makes large: growth, error or force")] = "growth",
    out: Annotated[
        Path | None, typer.Option(help="folder for the results (default: results/SCENARIO-stability)")
    ] = None,
    effects: Annotated[Path | None, typer.Option(help="effects file of close-loop")] = None,
    report: Annotated[bool, typer.Option("--report/--no-report", help="write report.html")] = True,
    allow_outside: Annotated[bool, typer.Option("--allow-outside", help=OUTSIDE)] = False,
) -> None:
    """Criteria, exact spectrum, margins and twin simulation side by side: stability.json, report.html.

    With --any-delay also certificate.json (check it with `cosim verify`), destroying.csv and
    destroying.toml; with --falsify worst.toml, a scenario.
    """
    import cosim
    from cosim.cli.folder import made, named
    from cosim.cli.run import RunMeter, prepare

    chosen, angles = prepare(scenario, set_ or [], effects, allow_outside).scenario, _pose(pose)
    folder = made(out or named(f"{chosen.name}-stability"))
    with RunMeter(chosen.name) as progress:
        found = cosim.stability(
            chosen,
            pose=angles,
            any_delay=any_delay,
            delay_slope=delay_slope,
            falsify=falsify,
            harm=harm,
            progress=progress,
            say=say,
        )
    found.save(folder, report=report)
    print(f"{found}\nwritten to {folder}")
    if found.failure is not None:
        raise found.failure
    if found.interrupted:
        sys.exit(130)


def say(text: str) -> None:
    """Tell on stderr what is being done."""
    print(f"{text} ...", file=sys.stderr, flush=True)


def _pose(text: str | None) -> list[float] | None:
    from cosim.errors import InputError, Problem

    if text is None:
        return None
    try:
        angles = [float(word) for word in text.split(",")]
    except ValueError:
        angles = []
    if not angles:
        raise InputError(Problem("--pose", "angles q1,q2,... in rad", repr(text), "for example --pose 0,0,0"))
    return angles
