"""`cosim verify`."""

import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    certificate: Annotated[Path, typer.Argument(help="certificate.json of `cosim stability --any-delay`")],
    scenario: Annotated[
        str | None, typer.Option(help="name or TOML file of a scenario whose loop it has to be of: linearised again")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change a value of it; may be repeated")
    ] = None,
    effects: Annotated[Path | None, typer.Option(help="effects file of close-loop for the scenario")] = None,
) -> None:
    """A certificate checked in exact and interval arithmetic, without optimising; exit code 1 if it is not proven."""
    import cosim
    from cosim.cli.run import prepare
    from cosim.cli.stability import say

    chosen = None if scenario is None else prepare(scenario, set_ or [], effects).scenario
    found = cosim.verify(certificate, chosen, say=say)
    print(found)
    if not found.holds:
        sys.exit(1)
