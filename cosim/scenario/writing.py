"""A scenario as the text of a TOML file."""

import re
from enum import Enum
from typing import Any

from attrs import asdict

from cosim.scenario.parts import FORMAT, ScenarioParts


def to_toml(scenario: ScenarioParts) -> str:
    """The scenario as the text of a TOML file that loads to the same scenario."""
    lines = [f"format = {FORMAT}", f"name = {toml_value(scenario.name)}"]
    lines += [f"{key} = {toml_value(text)}" for key in ("title", "description") if (text := getattr(scenario, key))]
    lines += [f"warnings = {toml_value(scenario.warnings)}"] if scenario.warnings else []
    lines += ["connections = ["] + [f"    {toml_value(str(c))}," for c in scenario.connections] + ["]"]
    lines += ["", "[experiment]", *_entries(scenario.experiment)]
    lines += ["", "[teleoperation]", *_entries(scenario.teleoperation)]
    for name, component in scenario.components.items():
        lines += ["", f"[components.{toml_key(name)}]", *_entries(component)]
        if component.parameters:
            lines += [f"[components.{toml_key(name)}.parameters]"]
            lines += [f"{toml_key(key)} = {toml_value(value)}" for key, value in component.parameters.items()]
    return "\n".join(lines) + "\n"


def _entries(record: object) -> list[str]:
    return [f"{key} = {toml_value(value)}" for key, value in plain(record).items() if key != "parameters"]


def plain(record: Any) -> dict[str, Any]:
    """Fields of a frozen class as TOML values, empty optional ones left out."""
    table = asdict(record, value_serializer=lambda _, __, value: value.value if isinstance(value, Enum) else value)
    return {
        key: list(value) if isinstance(value, tuple) else value for key, value in table.items() if value is not None
    }


def toml_key(key: str) -> str:
    """A key, in quotes where it needs them."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else toml_value(key)


def toml_value(value: object) -> str:
    """A value as TOML: numbers, truth values, lists, else text."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(float(value)) if isinstance(value, float) else repr(value)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    if callable(tolist := getattr(value, "tolist", None)):  # numbers and arrays of numpy
        return toml_value(tolist())
    return '"' + "".join(map(_escaped, str(value))) + '"'


_ESCAPES = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}


def _escaped(character: str) -> str:
    control = ord(character) < 32 or ord(character) == 127
    return _ESCAPES.get(character) or (f"\\u{ord(character):04x}" if control else character)
