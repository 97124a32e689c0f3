"""`cosim robot`: an arm from its URDF."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    urdf: Annotated[Path, typer.Argument(help="URDF file (a .xacro file must be expanded first)")],
    base: Annotated[str | None, typer.Option(help="link that stands still; default: the root")] = None,
    tip: Annotated[
        str | None, typer.Option(help="link at the end; default: where the chains with most joints end or part")
    ] = None,
    survives: Annotated[
        str | None,
        typer.Option(metavar="SCENARIO", help="which delays two of these arms bear under its gains and delays"),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="change a value of that scenario; may be repeated"),
    ] = None,
    poses: Annotated[int, typer.Option(help="how many poses are looked at with --survives")] = 5,
    any_delay: Annotated[
        bool,
        typer.Option(
            "--any-delay", help="with --survives: proven for every delay law up to T, a law that destroys (minutes)"
        ),
    ] = False,
    fmi: Annotated[int, typer.Option(help="FMI version of the FMU, 2 or 3")] = 3,
    platform: Annotated[
        list[str] | None, typer.Option(help="platform of the binaries, FMI 3 name; may be repeated")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder to write to; default: results/NAME")] = None,
) -> None:
    """An arm from its URDF: NAME.fmu that holds it, robot.json, report.html.

    With --any-delay also certificate.json (check it with `cosim verify`), destroying.csv, destroying.toml (a scenario).
    """
    import cosim
    from cosim.cli.folder import made
    from cosim.cli.run import say
    from cosim.errors import InputError, Problem
    from cosim.scenario import parse_override

    found = cosim.robot(urdf, base=base, tip=tip)
    if survives is not None:
        values = dict(map(parse_override, set_ or ()))
        found = found.survives(survives, values=values, poses=poses, any_delay=any_delay, say=say)
    elif set_:
        raise InputError(Problem("--set", "--survives SCENARIO, whose values it changes", "none"))
    elif any_delay:
        raise InputError(Problem("--any-delay", "--survives SCENARIO, whose loop it judges", "none"))
    folder = made(out or Path("results") / urdf.stem)
    fmu = found.save(folder, fmi=fmi, platforms=platform, progress=say)
    for doubt in found.doubts:
        say(f"doubtful: {doubt}")
    print(f"{found}\nwritten: {fmu}, {folder / 'robot.json'}, {folder / 'report.html'}")
