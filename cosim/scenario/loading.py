"""Scenarios by name, by path, from text, and with other values."""

import tomllib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path

from cosim.errors import InputError, Problem, did_you_mean
from cosim.scenario.changing import assign, with_effects, with_override
from cosim.scenario.checking import check
from cosim.scenario.reading import structure, table_of
from cosim.scenario.scenario import Scenario


def load_scenario(
    name_or_path: str | Path, overrides: Sequence[str] = (), effects: Path | str | None = None
) -> Scenario:
    """A shipped scenario by name or a TOML file by path, with `path=value` overrides and an effects file applied.

    Order of precedence: `parameter_set`, the file's parameters, the effects file, the overrides.
    Raises InputError with every problem found.
    """
    scenario, problems = draft(name_or_path, overrides, effects)
    if problems or scenario is None:
        raise InputError(problems)
    return scenario


def draft(
    name_or_path: str | Path, overrides: Sequence[str] = (), effects: Path | str | None = None
) -> tuple[Scenario | None, list[Problem]]:
    """As `load_scenario`, but returns the problems and, where it can be read at all, what is right of the scenario."""
    path = _find(name_or_path)
    table = table_of(path)
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


def with_parameters(scenario: Scenario, values: Mapping[str, object]) -> Scenario:
    """The scenario with values at paths: `arm_l.q_start[1]`, `controller_*.stiffness`, `experiment.stop`.

    The paths are those of `--set` and of sweep axes. Raises InputError with every problem found.
    """
    problems: list[Problem] = []
    for path, value in values.items():
        scenario = assign(scenario, path, value, problems)
    problems += check(scenario, scenario.name)
    if problems:
        raise InputError(problems)
    return scenario


def _find(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    if path.suffix in (".toml", ".ssp") or path.is_file():
        if path.is_file():
            return path.resolve()
        raise InputError(Problem(str(path), "a scenario file", "no such file"))
    known = {entry.stem: entry for entry in shipped()}
    if str(name_or_path) in known:
        return known[str(name_or_path)]
    advice = did_you_mean(str(name_or_path), known) or "`cosim list` names them"
    raise InputError(
        Problem("scenario", "a shipped scenario or a path to a TOML file", repr(str(name_or_path)), advice)
    )
