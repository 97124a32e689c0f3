"""`cosim export`."""

from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.run import DEMONSTRATION, OUTSIDE
from cosim.cli.shipped_names import ScenarioArgument


def command(
    scenario: ScenarioArgument = DEMONSTRATION,
    platform: Annotated[
        list[str] | None, typer.Option(help="platform of the binaries, FMI 3 name; may be repeated; `all`")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change a value; may be repeated")
    ] = None,
    effects: Annotated[Path | None, typer.Option(help="effects file of close-loop")] = None,
    out: Annotated[Path | None, typer.Option(help="folder (default: results/SCENARIO-export)")] = None,
    enumerations: Annotated[
        bool, typer.Option("--enumerations/--no-enumerations", help="whole numbers in place of enumerations (Maestro)")
    ] = True,
    allow_outside: Annotated[bool, typer.Option("--allow-outside", help=OUTSIDE)] = False,
) -> None:
    """FMUs and the wired system for other tools: fmi2/, fmi3/, SCENARIO.ssp."""
    import cosim
    from cosim.cli.folder import made, named
    from cosim.cli.run import prepare, say

    chosen = prepare(scenario, set_ or [], effects, allow_outside).scenario
    folder = made(out or named(f"{chosen.name}-export"))
    written = cosim.export(chosen, folder, platforms=platform, progress=say, enumerations=enumerations)
    print(f"{len(written.fmus)} FMUs of {len(written.fmus) // 2} models in {folder / 'fmi2'} and {folder / 'fmi3'}")
    print(f"{written.ssp}: the wired system (SSP 1.0)")
    print("\n".join(f"{path}: the wired system as one FMU" for path in written.containers))
