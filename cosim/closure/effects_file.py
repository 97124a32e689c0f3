"""effects.toml: the effects that were found, as start values of an FMU and for the next pass of the loop."""

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cosim.closure.data.motion import prepare
from cosim.closure.model.model import ChosenEffect
from cosim.closure.verdict import NamedEffect
from cosim.effects import Effect, Scene
from cosim.errors import InputError, Problem, did_you_mean
from cosim.measured import Recording
from cosim.scenario.reading import read_toml, unknown_keys

FORMAT = 1
KEYS = {"format", "model", "components", "parameters", "effects", "provenance"}
ENTRY = {"name", "joints", "theta", "indistinguishable_from", "parameters"}
WIDTHS = {
    "pi": 8,
    "coupling_viscous": 6,
    "coupling_coulomb": 6,
    "coupling_velocity": 6,
    "coupling_stiffness": 6,
    "base_tilt": 2,
}
_INDEXED = re.compile(r"(\w+)\[(\d+)\]$")
STEPS = 2, 1000  # internal steps of the drives: unless set, and at most
Values = dict[str, float | list[float]]


def start_values(parameters: Mapping[str, float], device: str) -> Values:
    """FMU start values of parameters such as "stribeck[2]": lists for PhantomArm, scalars for AxisDrive."""
    out: Values = {}
    for name, value in parameters.items():
        match = _INDEXED.match(name)
        if match is None:
            if name.isidentifier():
                out[name] = value
        elif device == "axis":
            out[match[1]] = value
        else:
            row = out.setdefault(match[1], [0.0] * WIDTHS.get(match[1], 3))
            row[int(match[2]) - 1] = value
    return _usable(out)


def _usable(values: Values) -> Values:
    """Widths of effects on other joints must not be zero: a joint without the effect keeps the width of the joint with
    it.
    """
    for name in ("stribeck_velocity", "hysteresis_length", "ripple_order"):
        row = values.get(name)
        if isinstance(row, list):
            values[name] = [v if v > 0 else max(row) for v in row]
    if isinstance(row := values.get("stribeck_exponent"), list):
        values["stribeck_exponent"] = [v or 2.0 for v in row]
    return values


def stepped(values: Values, step: float) -> Values:
    """The values with as many internal steps of a communication step [s] as `joint_check_step` (fmu_src/shared/joint.h)
    advises.
    """
    names = ("actuator_lag", "joint_compliance", "motor_inertia", "joint_damping")
    steps = STEPS[0]
    for lag, compliance, inertia, damping in zip(
        *np.broadcast_arrays(*(np.atleast_1d(values.get(n, 0.0)) for n in names)), strict=True
    ):
        if lag > 0:
            steps = max(steps, np.ceil(step / lag) + 1)
        if compliance > 0 and inertia > 0:
            steps = max(steps, np.ceil(step * (1 / np.sqrt(compliance * inertia) + damping / inertia)))
    return values | {"internal_steps": int(min(steps, STEPS[1]))} if steps > STEPS[0] else values


def text(findings: Sequence[NamedEffect], device: str, parameters: Values, source: str) -> str:
    """The file's text."""
    lines = [f"format = {FORMAT}", f'model = "{"AxisDrive" if device == "axis" else "PhantomArm"}"', "", "[parameters]"]
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
        lines += ["", "[effects.parameters]"] + [f"{_quoted(k)} = {v:.9g}" for k, v in found.parameters.items()]
    return "\n".join([*lines, "", "[provenance]", f"recording = {_quoted(source)}", ""])


def _value(value: float | list[float], whole: bool = False) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_value(v, whole) for v in value)}]"
    return str(int(value)) if whole or isinstance(value, int) else repr(float(f"{value:.9g}"))


def _quoted(word: str) -> str:
    return '"' + word.replace("\\", "\\\\").replace('"', '\\"') + '"'


def load(path: Path | str, effects: Sequence[Effect], recording: Recording | None = None) -> tuple[ChosenEffect, ...]:
    """The choices of an earlier pass, such as fit the recording where one is given. Raises InputError with every
    problem.
    """
    path, problems = Path(path), []
    table = _table(path, problems)
    entries, known = table.get("effects", []), {effect.name: effect for effect in effects}
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
    return tuple(choices)


def _table(path: Path, problems: list[Problem]) -> dict:
    if not path.is_file():
        raise InputError(Problem(str(path), "an effects file", "a folder" if path.is_dir() else "no such file"))
    table = read_toml(path)
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
    where: str, entry: object, known: Mapping[str, Effect], scene: Scene | None, problems: list[Problem]
) -> ChosenEffect | None:
    """The choice of an entry; what is wrong with it is appended."""
    if not isinstance(entry, dict):
        problems.append(Problem(where, "a table with name, joints and theta", repr(entry)))
        return None
    unknown_keys(entry, ENTRY, where, problems)
    name, joints, theta, values = (
        entry.get(key, default) for key, default in (("name", ""), ("joints", None), ("theta", []), ("parameters", {}))
    )
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
    choice = ChosenEffect(known[name], tuple(j - 1 for j in joints), tuple(map(float, theta)))
    problems += [] if scene is None else _unfit(where, choice, scene)
    return choice


def _scene(recording: Recording) -> Scene:
    """What joint sets and grids of effects look at: the motion, without a model of it."""
    motion = prepare(recording)
    none = np.zeros_like(motion.q)
    return Scene(
        motion, recording.device, none, none, none, none, none[0], none[0], units=recording.description.columns.other
    )


def _unfit(where: str, choice: ChosenEffect, scene: Scene) -> list[Problem]:
    """Why the recording cannot have the choice: joints that are no set of the effect, theta of another size or out of
    range.
    """
    effect, joints, theta = choice.effect, choice.joints, choice.theta
    sets = effect.joint_sets(scene)
    if joints not in sets:
        known = (
            " or ".join(str([j + 1 for j in each]) for each in sets) or f"an effect that device {scene.device} can have"
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
    """Positive where all of the grid is, nor below zero where none of it is and nothing bounds it; what is no
    continuous parameter is a whole number of the grid, the others stand under a step of zero.
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
