"""A scenario as the text of a TOML file."""

import re
from enum import Enum

from attrs import asdict

from cosim.scenario.parts import FORMAT, ScenarioParts


def to_toml(scenario: ScenarioParts) -> str:
    """The scenario as the text of a TOML file that loads to the same scenario."""
    lines = [f"format = {FORMAT}", f"name = {_value(scenario.name)}"]
    lines += [f"{key} = {_value(text)}" for key in ("title", "description") if (text := getattr(scenario, key))]
    lines += [f"warnings = {_value(scenario.warnings)}"] if scenario.warnings else []
    lines += ["connections = ["] + [f"    {_value(str(c))}," for c in scenario.connections] + ["]"]
    lines += ["", "[experiment]", *_entries(scenario.experiment)]
    lines += ["", "[teleoperation]", *_entries(scenario.teleoperation)]
    for name, component in scenario.components.items():
        lines += ["", f"[components.{name}]", *_entries(component)]
        if component.parameters:
            lines += [f"[components.{name}.parameters]"]
            lines += [f"{_bare(key)} = {_value(value)}" for key, value in component.parameters.items()]
    return "\n".join(lines) + "\n"


def _entries(record: object) -> list[str]:
    return [f"{key} = {_value(value)}" for key, value in plain(record).items() if key != "parameters"]


def plain(record: object) -> dict:
    """Fields of a frozen class as TOML values, empty optional ones left out."""
    table = asdict(record, value_serializer=lambda _, __, value: value.value if isinstance(value, Enum) else value)
    return {
        key: list(value) if isinstance(value, tuple) else value for key, value in table.items() if value is not None
    }


def _bare(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(float(value)) if isinstance(value, float) else repr(value)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if callable(tolist := getattr(value, "tolist", None)):  # numbers and arrays of numpy
        return _value(tolist())
    return '"' + "".join(_ESCAPES.get(c, c) for c in str(value)) + '"'


_ESCAPES = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
