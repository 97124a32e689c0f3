"""A measured file as named columns that are read when they are asked for."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
from attrs import field, frozen

from cosim.errors import InputError, Problem, did_you_mean

WIDEST = 64  # elements of a vector that become columns of their own; wider ones are images and clouds


class LazyColumns(Mapping[str, np.ndarray]):
    """Columns by name; each is read at its first use and kept."""

    def __init__(self, readers: Mapping[str, Callable[[], np.ndarray]]) -> None:
        self._readers, self._read = dict(readers), {}

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._read:
            self._read[name] = self._readers[name]()
        return self._read[name]

    def __contains__(self, name: object) -> bool:
        return name in self._readers

    def __iter__(self) -> Iterator[str]:
        return iter(self._readers)

    def __len__(self) -> int:
        return len(self._readers)


@frozen(eq=False)
class RawTable:
    """Columns of one file as they stand: numbers (n,), labels (n,) str, or stamps (n,) datetime64.

    Columns of one file may differ in length; `clocks` names for a column the column of its own stamps.
    """

    path: Path
    columns: Mapping[str, np.ndarray]
    warnings: tuple[str, ...] = ()
    units: Mapping[str, str] = field(factory=dict)  # column -> unit, as the file writes it
    short: Mapping[str, tuple[str, ...]] = field(factory=dict)  # another writing -> the columns that it may mean
    clocks: Mapping[str, str] = field(factory=dict)  # column -> column of its stamps
    unread: Mapping[str, str] = field(factory=dict)  # what the file also holds -> why it is not read, what to do

    def find(self, name: str) -> str:
        """The column that a name means. Raises InputError where there is none or more than one."""
        if name in self.columns:
            return name
        meant = self.short.get(name, ())
        if len(meant) == 1:
            return meant[0]
        if meant:
            got = f"{len(meant)} that it may mean: {', '.join(meant[:6])}"
            advice = f"write the whole name, {meant[0]!r} say"
            if all(column.startswith(f"{name} (column ") for column in meant):
                got, advice = f"twice: {name}", f"name one of {', '.join(map(repr, meant))}"
                raise InputError(Problem(str(self.path), "each column once", got, advice))
            raise InputError(Problem(str(self.path), f"one column {name!r}", got, advice))
        raise InputError(self.missing([name]))

    def missing(self, names: list[str]) -> Problem:
        """The problem that columns are not in the file, with what is there instead."""
        near = [text for name in names if (text := did_you_mean(name, self.columns))]
        listed = ", ".join(list(self.columns)[:24]) or "no columns"
        advice = f"the file has: {listed}" if len(near) < len(names) else "; ".join(near)
        for thing, why in list(self.unread.items())[:4]:
            advice += f"; it also has {thing}: {why}"
        beside = sorted(p.name for p in self.path.parent.glob("*.toml") if p.stem != self.path.stem)
        if beside and not self.path.with_suffix(".toml").exists():
            advice += f"; is its description one of {', '.join(beside[:4])}? (--description)"
        advice += "; cosim data writes a description of a file (format: `cosim docs description-format`)"
        return Problem(f"{self.path}", f"the columns {', '.join(names)}", "a file without them", advice)


def short_names(names: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Shorter writings of qualified names: `/robot/q[1]` is also `robot/q[1]`, `q[1]` and `q1`.

    The name of a vector means all its elements. A name that is whole but for its first slash means that column alone.
    """
    names = list(names)
    found: dict[str, dict[str, None]] = defaultdict(dict)
    for name in names:
        for writing in _writings(name):
            found[writing][name] = None
            found[re.sub(r"\[[^\]]*\]$", "", writing)][name] = None
    whole = {name.lstrip("/"): (name,) for name in names}
    return {writing: tuple(meant) for writing, meant in found.items()} | whole


def _writings(name: str) -> Iterator[str]:
    """The endings of a path that begin after a slash or a dot, each also with its index as a plain number."""
    plain = re.sub(r"\[(\d+)\]$", r"\1", name)
    for text in (name, plain):
        yield text
        for mark in re.finditer(r"[/.](?=[^/.\d])", re.sub(r"\[[^\]]*\]$", lambda m: "_" * len(m.group()), text)):
            yield text[mark.end() :]


def elements(name: str, width: int) -> list[str]:
    """Names of the elements of a vector that stands in every row."""
    return [f"{name}[{k + 1}]" for k in range(width)]
