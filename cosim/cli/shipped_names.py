"""Arguments that name a scenario or a sweep, with the shipped names that a shell completes them to."""

from typing import Annotated

import typer


def _named(room: str, incomplete: str) -> list[str]:
    from cosim.scenario import shipped

    return [path.stem for path in shipped(room) if path.stem.startswith(incomplete)]


def _scenarios(incomplete: str) -> list[str]:
    return _named("scenario", incomplete)


def _sweeps(incomplete: str) -> list[str]:
    return _named("sweeps", incomplete)


ScenarioArgument = Annotated[
    str, typer.Argument(help="name of a shipped scenario, or a TOML file", autocompletion=_scenarios)
]
SweepArgument = Annotated[str, typer.Argument(help="name of a shipped sweep, or a TOML file", autocompletion=_sweeps)]
