"""`cosim live`."""

from pathlib import Path
from typing import Annotated

import typer

from cosim.cli.run import DEMONSTRATION, OUTSIDE
from cosim.cli.shipped_names import ScenarioArgument


def command(
    scenario: ScenarioArgument = DEMONSTRATION,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change a value; may be repeated")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder for the page (default: results/SCENARIO)")] = None,
    effects: Annotated[Path | None, typer.Option(help="effects file of close-loop")] = None,
    stability_map: Annotated[
        bool, typer.Option("--map/--no-map", help="show where the loop is among stiffness, damping and delay")
    ] = True,
    allow_outside: Annotated[bool, typer.Option("--allow-outside", help=OUTSIDE)] = False,
) -> None:
    """The loop to touch, in one offline page: live.html."""
    import cosim
    from cosim.cli.folder import made, named
    from cosim.cli.run import prepare, say

    chosen = prepare(scenario, set_ or [], effects, allow_outside).scenario
    folder = made(out or named(chosen.name))
    page = cosim.live(chosen, folder, stability_map=stability_map, progress=say)
    print(f"{page}: open it in a browser; the co-simulation runs there ({page.stat().st_size / 1e3:.0f} kB)")
