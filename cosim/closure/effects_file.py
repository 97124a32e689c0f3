"""effects.toml: the effects that were found, as start values of an FMU and for the next pass of the loop."""

import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.closure.drive import StartValue, StartValues
from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.motion import prepare
from cosim.closure.verdict import NamedEffect
from cosim.effects import Effect, Scene
from cosim.effects.moving_arm import moving_arm
from cosim.errors import InputError, Problem, did_you_mean
from cosim.measured import Recording
from cosim.opening import read_toml
from cosim.scenario.reading import unknown_keys

FORMAT = 1
KEYS = {"format", "model", "components", "parameters", "effects", "provenance"}
ENTRY = {"name", "joints", "theta", "indistinguishable_from", "parameters"}


def text(findings: Sequence[NamedEffect], model: str, parameters: StartValues, source: str) -> str:
    """The file's text. parameters: start values of the FMU `model`; source: the recordings."""
    lines = [f"format = {FORMAT}", f"model = {_quoted(model)}", "", "[parameters]"]
    lines += [f"{name} = {_value(value)}" for name, value in parameters.items()]
    for found in findings:
        choice = found.choice
        lines += [
            "",
            "[[effects]]",
            f"name = {_quoted(found.name)}",
            f"joints = {_value([float(j) for j in found.joints], whole=True)}",
        ]
        lines += [f"theta = {_value(list(choice.theta))}"] if choice.theta else []
        lines += [f"indistinguishable_from = [{', '.join(_quoted(a) for a in found.aliases)}]"]
        lines += ["", "[effects.parameters]"] + [f"{_quoted(str(k))} = {v:.9g}" for k, v in found.parameters.items()]
    return "\n".join([*lines, "", "[provenance]", f"recording = {_quoted(source)}", ""])


def _value(value: StartValue, whole: bool = False) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_value(v, whole) for v in value)}]"
    return str(int(value)) if whole or isinstance(value, int) else repr(float(f"{value:.9g}"))


def _quoted(word: str) -> str:
    return '"' + word.replace("\\", "\\\\").replace('"', '\\"') + '"'


def load(path: Path | str, effects: Sequence[Effect], recording: Recording | None = None) -> tuple[ChosenEffect, ...]:
    """The choices of an earlier pass; with a recording, they are checked against it. Raises InputError with every
    problem.
    """
    path = Path(path)
    problems: list[Problem] = []
    table = _table(path, problems)
    entries, known = table.get("effects", []), defaultdict[str, list[Effect]](list)
    for effect in effects:
        known[effect.name].append(effect)
    if not isinstance(entries, list):
        raise InputError([*problems, Problem(f"{path}: effects", "tables [[effects]]", repr(entries))])
    scene = _scene(recording) if recording is not None and entries else None
    choices = [_choice(f"{path}: effects[{k}]", entry, known, scene, problems) for k, entry in enumerate(entries)]
    keys = [choice and choice.key for choice in choices]
    problems += [
        Problem(f"{path}: effects[{k}]", "every effect once on a joint", f"{choice.effect.name} again")
        for k, choice in enumerate(choices)
        if choice and choice.key in keys[:k]
    ]
    if problems:
        raise InputError(problems)
    return tuple(choice for choice in choices if choice is not None)


def _table(path: Path, problems: list[Problem]) -> dict[str, Any]:
    table = read_toml(path, "an effects file")
    if table.get("format", FORMAT) != FORMAT:
        raise InputError(Problem(f"{path}: format", str(FORMAT), repr(table.get("format"))))
    unknown_keys(table, KEYS, str(path), problems)
    values = table.get("parameters", {})
    lists = [v if isinstance(v, list) else [v] for v in values.values()] if isinstance(values, dict) else [[values]]
    if not all(_number(v) for row in lists for v in row):
        problems.append(Problem(f"{path}: parameters", "finite numbers", repr(values)))
    return table


def _number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _choice(
    where: str, entry: object, known: Mapping[str, list[Effect]], scene: Scene | None, problems: list[Problem]
) -> ChosenEffect | None:
    """The choice of an entry; what is wrong with it is appended."""
    if not isinstance(entry, dict):
        problems.append(Problem(where, "a table with name, joints and theta", repr(entry)))
        return None
    unknown_keys(entry, ENTRY, where, problems)
    name, joints = entry.get("name", ""), entry.get("joints")
    theta, values = entry.get("theta", []), entry.get("parameters", {})
    if not isinstance(name, str) or name not in known:
        problems.append(Problem(f"{where}.name", "a known effect", repr(name), did_you_mean(str(name), known)))
        return None
    wrong = []
    if not (isinstance(joints, list) and joints and all(type(j) is int and j > 0 for j in joints)):
        wrong.append(
            Problem(f"{where}.joints", "whole numbers from 1, such as [2]", "none" if joints is None else repr(joints))
        )
    if not (isinstance(theta, list) and all(map(_number, theta))):
        wrong.append(Problem(f"{where}.theta", "finite numbers in a list", repr(theta)))
    if not (isinstance(values, dict) and all(map(_number, values.values()))):
        wrong.append(Problem(f"{where}.parameters", "finite numbers", repr(values)))
    problems += wrong
    if wrong:
        return None
    places = tuple(j - 1 for j in joints or ())
    fitting = [e for e in known[name] if scene is not None and places in e.joint_sets(scene)]
    choice = ChosenEffect((*fitting, *known[name])[0], places, tuple(map(float, theta)))
    problems += [] if scene is None else _unfit(where, choice, scene)
    return choice


def _scene(recording: Recording) -> Scene:
    """The motion without a model of it, which joint sets and grids of effects look at."""
    motion = prepare(recording)
    none = np.zeros_like(motion.q)
    return Scene(
        motion,
        recording.device,
        none,
        none,
        none,
        none,
        none[0],
        none[0],
        arm=moving_arm(recording.device, motion),
        units=recording.description.columns.other,
    )


def _unfit(where: str, choice: ChosenEffect, scene: Scene) -> list[Problem]:
    """Why the choice does not fit the recording: joints that are no set of the effect, or a theta of another length or
    out of range.
    """
    effect, joints, theta = choice.effect, choice.joints, choice.theta
    sets = effect.joint_sets(scene)
    if joints not in sets:
        known = (
            " or ".join(str([j + 1 for j in each]) for each in sets)
            or f"an effect that device {scene.device.word} can have"
        )
        return [Problem(f"{where}.joints", known, str([j + 1 for j in joints]))]
    if any(scene.angle_range(j) == 0 for j in joints):
        return []  # close-loop refuses joints that do not move
    grid = effect.grid(scene, joints)
    if not grid:
        return [
            Problem(
                where, "an effect that the recording can show", f"{effect.name}: {effect.untestable(scene, joints)}"
            )
        ]
    if len(theta) == len(grid[0]) and _physical(effect, theta, grid):
        return []
    size, example = len(grid[0]), [float(f"{v:.3g}") for v in grid[0]]
    return [
        Problem(
            f"{where}.theta",
            f"{size} numbers in the range of the effect, such as {example}" if size else "none",
            str(list(theta)),
        )
    ]


def _physical(effect: Effect, theta: tuple[float, ...], grid: Sequence[tuple[float, ...]]) -> bool:
    """Whether theta could be a value of an effect with this grid.

    A parameter is positive where all values of the grid are, and not negative where none is and it is not continuous.
    Continuous ones do not change by a step of zero, others are one of the grid's whole numbers.
    """
    moving = effect.continuous(theta)
    for k, (value, column) in enumerate(zip(theta, zip(*grid, strict=True), strict=True)):
        if (min(column) > 0 and value <= 0) or (k not in moving and min(column) >= 0 > value):
            return False
        if k in moving and not np.allclose(effect.moved(theta, k, 0.0), theta, rtol=1e-6, atol=1e-6):
            return False
        if k not in moving and not effect.of_time and all(v == int(v) for v in column) and value not in column:
            return False
    return True
