"""Scenarios by name, by path, from text, and with other values."""

import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from cosim.errors import InputError, Problem, did_you_mean
from cosim.opening import named_file
from cosim.scenario.changing import with_effects, with_override
from cosim.scenario.checking import check
from cosim.scenario.parts import FORMAT, Component, Experiment, Teleoperation
from cosim.scenario.reading import connections_of, record_of, table_of, unknown_keys
from cosim.scenario.scenario import Scenario

_TOP = {
    "format",
    "name",
    "title",
    "description",
    "experiment",
    "components",
    "connections",
    "teleoperation",
    "warnings",
}


def structure(table: dict[str, Any], path: Path, problems: list[Problem]) -> Scenario | None:
    """The scenario of a TOML table; problems are appended, None where nothing useful is left."""
    where = path.name
    unknown_keys(table, _TOP, where, problems)
    if table.get("format", FORMAT) != FORMAT:
        problems.append(Problem(f"{where}: format", str(FORMAT), repr(table["format"]), "this cosim reads format 1"))
    for key in ("experiment", "components"):
        if not isinstance(table.get(key), dict):
            problems.append(
                Problem(f"{where}: [{key}]", "a table", "nothing" if key not in table else "something else")
            )
    if not all(isinstance(table.get(key), dict) for key in ("experiment", "components")):
        return None
    experiment = record_of(Experiment, table["experiment"], f"{where}: experiment", problems)
    components = {
        name: component
        for name, entry in table["components"].items()
        if (component := record_of(Component, entry, f"{where}: components.{name}", problems)) is not None
    }
    teleoperation = record_of(Teleoperation, table.get("teleoperation", {}), f"{where}: teleoperation", problems)
    connections = connections_of(table.get("connections", []), set(table["components"]), where, problems)
    return Scenario(
        str(table.get("name", path.stem)),
        experiment or Experiment(stop=1.0),
        components,
        connections,
        title=str(table.get("title", "")).strip(),
        description=str(table.get("description", "")).strip(),
        teleoperation=teleoperation or Teleoperation(),
        folder=path.parent,
        warnings=tuple(map(str, table.get("warnings", ()))),
    )


def load_scenario(
    name_or_path: str | Path,
    overrides: Sequence[str] = (),
    effects: Path | str | None = None,
    allow_outside: bool = False,
) -> Scenario:
    """A shipped scenario by name, or a TOML or SSP file by path, with `path=value` overrides and an effects file.

    Order of precedence: `parameter_set`, the file's parameters, the effects file, the overrides.
    allow_outside: whether an SSP may name files outside itself. Raises InputError with every problem found.
    """
    scenario, problems = draft(name_or_path, overrides, effects, allow_outside)
    if problems or scenario is None:
        raise InputError(problems)
    return scenario


def draft(
    name_or_path: str | Path,
    overrides: Sequence[str] = (),
    effects: Path | str | None = None,
    allow_outside: bool = False,
) -> tuple[Scenario | None, list[Problem]]:
    """As `load_scenario`, but returns the problems and, where it can be read at all, what is right of the scenario."""
    path = _find(name_or_path)
    table = table_of(path, allow_outside)
    problems: list[Problem] = []
    scenario = structure(table, path, problems)
    if scenario is None:
        return None, problems
    if effects is not None:
        scenario = with_effects(scenario, Path(effects), problems)
    for override in overrides:
        scenario = with_override(scenario, override, problems)
    return scenario, problems + check(scenario, path.name)


def load_text(text: str, folder: Path = Path()) -> Scenario:
    """The scenario of a TOML text, as `to_toml` writes it; files are not looked for. Raises InputError."""
    problems: list[Problem] = []
    scenario = structure(tomllib.loads(text), folder / "scenario.toml", problems)
    if problems or scenario is None:
        raise InputError(problems)
    return scenario


def shipped(room: str = "scenario") -> list[Path]:
    """The TOML files that come with a package of cosim, `scenario` or `sweep`, sorted by name."""
    folder = files("cosim").joinpath(room, "shipped")
    return sorted(Path(str(entry)) for entry in folder.iterdir() if entry.name.endswith(".toml"))


def _is_ssp_folder(path: Path) -> bool:
    if not path.is_dir():
        return False
    from cosim.scenario.ssp_grammar import STRUCTURE

    return (path / STRUCTURE).is_file()


def _find(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    if _is_ssp_folder(path):
        return path.resolve()
    known = {entry.stem: entry for entry in shipped()}
    if str(name_or_path) in known and not path.is_file():
        return known[str(name_or_path)]
    if path.suffix in (".toml", ".ssp", ".ssd") or path.exists():
        return named_file(path, "a scenario file").resolve()
    advice = did_you_mean(str(name_or_path), known) or "`cosim list` names them"
    raise InputError(
        Problem("scenario", "a shipped scenario or a path to a TOML file", repr(str(name_or_path)), advice)
    )
