"""`cosim new`."""

from typing import Annotated

import typer


def command(
    kind: Annotated[str, typer.Argument(help="controller, model, effect, scenario, sweep or description")],
    name: Annotated[str, typer.Argument(help="its name; a folder or a file of that name is written")],
    language: Annotated[str, typer.Option(help="of a controller: c, or python (pythonfmu)")] = "c",
) -> None:
    """A small working start: commented files that run at once; nothing is overwritten."""
    import cosim

    made = cosim.new(kind, name, language)
    width = max(len(str(path)) for path in made.files)
    print("\n".join(["written:", *(f"  {path!s:<{width}}" for path in made.files)]))
    print("\n".join(["next:", *(f"  {line}" for line in made.commands)]))
