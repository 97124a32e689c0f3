"""Beginnings for a user's own controller, model, effect, scenario, sweep or description of data."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterator
from enum import StrEnum
from importlib.resources import files
from pathlib import Path

from attrs import frozen

from cosim.errors import InputError, Problem, did_you_mean
from cosim.results.saving import write_text


class Language(StrEnum):
    """What a controller is written in."""

    C = "c"
    PYTHON = "python"


@frozen
class Kind:
    """A kind of beginning: its template (a folder, or a file), the name in it that is replaced, what to do next."""

    template: str
    placeholder: str
    next: str
    ending: str = ""


KINDS = {
    "controller": Kind("controller", "NewController", "cosim run {0}/scenario.toml\ncosim sweep {0}/sweep.toml"),
    "model": Kind("model", "NewModel", "cosim run {0}/scenario.toml"),
    "effect": Kind("effect.py.template", "NewEffect", "cosim close-loop DATA.csv --effect-file {0}", ".py"),
    "scenario": Kind("scenario.toml", "NewScenario", "cosim run {0}", ".toml"),
    "sweep": Kind("sweep.toml", "NewSweep", "cosim sweep {0}", ".toml"),
    "description": Kind("description.toml", "NAME", "cosim data DATA.csv --description {0}", ".toml"),
}
_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_C_WORDS = """auto break case char const continue default do double else enum extern float for goto if inline int long
    register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while"""
_TAKEN = {word.lower() for word in (*keyword.kwlist, *keyword.softkwlist, *_C_WORDS.split())}
_FILE = re.compile(r"[\w][\w .+-]*")


@frozen
class Beginning:
    """What was written: the folder or file, every file of it, commands to go on with."""

    path: Path
    files: tuple[Path, ...]
    commands: tuple[str, ...]


def new(kind: str, name: str | Path, language: str = "c") -> Beginning:
    """Write a small working start in the folder `name` (or the file, for one that is a single file).

    kind: "controller", "model", "effect", "scenario", "sweep" or "description"; language: of a controller, "c" or
    "python" (pythonfmu). Nothing is overwritten. Raises InputError where something is there already, or for a name that
    cannot be one.
    """
    chosen, target = _kind(kind, language), Path(name)
    if chosen.ending and target.suffix != chosen.ending:
        target = target.with_name(target.name + chosen.ending)
    called = target.stem if chosen.ending else target.name
    _check(kind, called, target)
    texts = {(target / inside if inside else target): text for inside, text in _texts(chosen, called, target.name)}
    for path, text in texts.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(text, path)
    return Beginning(target, tuple(texts), tuple(chosen.next.format(target).splitlines()))


def _kind(kind: str, language: str) -> Kind:
    if kind not in KINDS:
        raise InputError(Problem("new", " or ".join(KINDS), repr(kind), did_you_mean(kind, KINDS)))
    if language not in list(Language):
        raise InputError(Problem("--language", " or ".join(Language), repr(language)))
    if language == Language.PYTHON and kind != "controller":
        raise InputError(Problem("--language python", "a controller", f"a {kind}"))
    if language == Language.PYTHON:
        return Kind("controller-python", "NewController", KINDS[kind].next)
    return KINDS[kind]


def _check(kind: str, called: str, target: Path) -> None:
    """Raises InputError for a name that cannot be one, and where something is there already."""
    code = kind in ("controller", "model", "effect")
    if not (_IDENTIFIER if code else _FILE).fullmatch(called) or (code and called.lower() in _TAKEN):
        wanted = (
            "letters, digits and _, a letter first, no word of C or Python"
            if code
            else "letters, digits, blanks and . + - _"
        )
        raise InputError(Problem("name", wanted, repr(called), "it names a file and, in code, a class or a struct"))
    if target.exists():
        raise InputError(
            Problem("name", "a name that is free", f"{target} is there", "choose another; nothing is overwritten")
        )


def _texts(kind: Kind, called: str, file: str) -> Iterator[tuple[str, str]]:
    """{place inside the folder, "" for a single file: text} with the user's name in it."""
    template = files("cosim").joinpath("api", "beginnings", kind.template)
    entries = sorted(template.iterdir(), key=lambda entry: entry.name) if template.is_dir() else [template]
    for entry in entries:
        inside = entry.name.removesuffix(".template").replace(kind.placeholder, called) if template.is_dir() else ""
        yield inside, _named(entry.read_text(encoding="utf-8"), kind.placeholder, called)


def _named(text: str, placeholder: str, called: str) -> str:
    """The text with the placeholder replaced, in its three spellings: NewEffect, NEW_EFFECT, new_effect."""
    apart = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", placeholder)
    own = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", called)
    spellings = {placeholder: called, apart.upper(): own.upper(), apart.lower(): own.lower()}
    return re.sub("|".join(map(re.escape, spellings)), lambda m: spellings[m[0]], text)
