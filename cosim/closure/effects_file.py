"""effects.toml: the effects that were found, as start values of an FMU and for the next pass of the loop."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cosim.closure.model import Choice
from cosim.closure.verdict import Finding
from cosim.effects import Effect
from cosim.errors import InputError, Problem, did_you_mean

FORMAT = 1
WIDTHS = {"pi": 8, "coupling_viscous": 6, "coupling_coulomb": 6, "coupling_stiffness": 6, "base_tilt": 2}
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
    """Widths of effects on other joints must not be zero: a joint without the effect keeps the width of the joint with it."""
    for name in ("stribeck_velocity", "hysteresis_length", "ripple_order"):
        row = values.get(name)
        if isinstance(row, list):
            values[name] = [v if v > 0 else max(row) for v in row]
    if isinstance(row := values.get("stribeck_exponent"), list):
        values["stribeck_exponent"] = [v or 2.0 for v in row]
    return values


def stepped(values: Values, step: float) -> Values:
    """The values with as many internal steps of a communication step [s] as `joint_check_step` (fmu_src/shared/joint.h) advises."""
    names = ("actuator_lag", "joint_compliance", "motor_inertia", "joint_damping")
    steps = STEPS[0]
    for lag, compliance, inertia, damping in zip(*np.broadcast_arrays(*(np.atleast_1d(values.get(n, 0.0)) for n in names)), strict=True):
        if lag > 0:
            steps = max(steps, np.ceil(step / lag) + 1)
        if compliance > 0 and inertia > 0:
            steps = max(steps, np.ceil(step * (1 / np.sqrt(compliance * inertia) + damping / inertia)))
    return values | {"internal_steps": int(min(steps, STEPS[1]))} if steps > STEPS[0] else values


def text(findings: Sequence[Finding], device: str, parameters: Values, source: str) -> str:
    """The file's text."""
    lines = [f"format = {FORMAT}", f'model = "{"AxisDrive" if device == "axis" else "PhantomArm"}"', "", "[parameters]"]
    lines += [f"{name} = {_value(value)}" for name, value in parameters.items()]
    for found in findings:
        choice = found.evidence.candidate.choice
        lines += ["", "[[effects]]", f'name = "{found.name}"', f"joints = {_value([float(j) for j in found.joints], whole=True)}"]
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


def load(path: Path | str, effects: Sequence[Effect]) -> tuple[Choice, ...]:
    """The choices of an earlier pass. Raises InputError."""
    path = Path(path)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(Problem(str(path), "an effects file", "no such file")) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(Problem(str(path), "a TOML file", f"text that does not parse: {error}")) from None
    if table.get("format", FORMAT) != FORMAT:
        raise InputError(Problem(f"{path}: format", str(FORMAT), repr(table.get("format"))))
    known = {effect.name: effect for effect in effects}
    problems, out = [], []
    for k, entry in enumerate(table.get("effects", ())):
        name = entry.get("name", "")
        if name not in known:
            problems.append(Problem(f"{path}: effects[{k}].name", "a known effect", repr(name), did_you_mean(name, known)))
            continue
        joints = tuple(int(j) - 1 for j in entry.get("joints", ()))
        out.append(Choice(known[name], joints, tuple(float(v) for v in entry.get("theta", ()))))
    if problems:
        raise InputError(problems)
    return tuple(out)
