"""`cosim fmu`."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    file: Annotated[Path, typer.Argument(help="an FMU file, of FMI 1.0, 2.0 or 3.0")],
    json: Annotated[bool, typer.Option("--json", help="everything, as JSON")] = False,
) -> None:
    """What an FMU holds and needs: variables, capabilities, platforms, a scenario to begin with."""
    from json import dumps

    import cosim

    found = cosim.inspect(file)
    print(dumps(found.to_dict(), indent=2, ensure_ascii=False) if json else found)
