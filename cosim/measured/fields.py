"""Single keys of a description file, read and checked: a value that is wrong becomes a problem and a default."""

from collections.abc import Iterable, Mapping
from typing import Any, TypeGuard

from attrs import frozen

from cosim.errors import Problem, did_you_mean


@frozen
class FieldReader:
    """Reads the keys of one TOML table. What is wrong is appended to `problems`, so that all of it is reported."""

    table: Mapping[str, Any]
    source: str
    problems: list[Problem]

    def choice(self, key: str, allowed: tuple[str, ...], default: str) -> str:
        """One of some words."""
        value = self.table.get(key, default)
        if value in allowed:
            return value
        advice = did_you_mean(str(value), allowed)
        self._wrong(key, f"one of {', '.join(allowed)}", value, advice)
        return default

    def boolean(self, key: str) -> bool:
        """True or false; false where the key is missing."""
        value = self.table.get(key, False)
        if not isinstance(value, bool):
            self._wrong(key, "true or false", value)
        return bool(value)

    def speed(self, key: str) -> float:
        """A number that is not negative; 0 where the key is missing."""
        value = self.table.get(key, 0.0)
        if not is_number(value) or value < 0:
            self._wrong(key, "a speed, 0 or more", value)
            return 0.0
        return float(value)

    def numbers(self, key: str) -> tuple[float, ...]:
        """A list of finite numbers; empty where the key is missing."""
        values = self.table.get(key, ())
        if not isinstance(values, list | tuple) or not all(is_number(value) for value in values):
            self._wrong(key, "a list of numbers", values)
            return ()
        return tuple(float(value) for value in values)

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts; empty where the key is missing."""
        values = self.table.get(key, ())
        if not isinstance(values, list | tuple) or not all(isinstance(value, str) for value in values):
            self._wrong(key, "a list of names", values)
            return ()
        return tuple(values)

    def text(self, key: str) -> str:
        """A text; empty where the key is missing."""
        return str(self.table.get(key, ""))

    def _wrong(self, key: str, expected: str, value: object, advice: str = "") -> None:
        self.problems.append(Problem(f"{self.source}: {key}", expected, repr(value), advice))


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value of a TOML file is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and value == value and abs(value) < 1e300


def unknown_names(table: Iterable[str], known: tuple[str, ...], where: str, noun: str, problems: list[Problem]) -> None:
    """Append a problem for every name of a table that is not a known one."""
    for key in table:
        if key not in known:
            advice = did_you_mean(key, known) or f"known: {', '.join(known)}"
            problems.append(Problem(f"{where}: {key}", f"a known {noun}", repr(key), advice))
