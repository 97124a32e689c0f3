"""What the public functions are given, held against what they say that they take."""

import inspect
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from os import PathLike
from pathlib import Path
from types import UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin

import numpy as np

from cosim.errors import InputError, Problem

P = ParamSpec("P")
R = TypeVar("R")


def asked(function: Callable[P, R]) -> Callable[P, R]:
    """The function, which first looks at its arguments. It raises InputError for one whose type is not that of its
    annotation.
    """
    signature = inspect.signature(function)

    @wraps(function)
    def called(*args: P.args, **named: P.kwargs) -> R:
        given = signature.bind(*args, **named).arguments
        problems = [p for name, value in given.items() if (p := _problem(function, signature, name, value))]
        if problems:
            raise InputError(problems)
        return function(*args, **named)

    return called


def _problem(function: Callable[..., Any], signature: inspect.Signature, name: str, value: object) -> Problem | None:
    parameter = signature.parameters[name]
    kind = parameter.annotation
    if parameter.kind is parameter.VAR_POSITIONAL:
        kind = f"tuple[{kind}, ...]" if isinstance(kind, str) else tuple[kind, ...]
    if name == "self" or kind is inspect.Parameter.empty:
        return None
    if isinstance(kind, str):
        kind = eval(kind, inspect.unwrap(function).__globals__)
    if _plainly(value, kind):
        return None  # most calls, for which typeguard need not be imported
    from typeguard import CollectionCheckStrategy, TypeCheckError, check_type

    try:
        check_type(
            _plain(value),
            _listed(kind) if isinstance(value, list | tuple | bytes) else kind,
            collection_check_strategy=CollectionCheckStrategy.ALL_ITEMS,
        )
    except TypeCheckError:
        got = f"{value!r:.80} ({type(value).__name__})"
        return Problem(f"{function.__name__}(): {name}", _words(kind), got)
    return None


def _plainly(value: object, kind: Any) -> bool:
    """Whether the value is of a class, of one of several, or a list of such, and so surely of that type."""
    if get_origin(kind) in (Union, UnionType):
        return any(_plainly(value, part) for part in get_args(kind))
    if get_origin(kind) in (Iterable, Sequence) and isinstance(value, list):
        return all(_plainly(item, *get_args(kind)) for item in value)
    if get_origin(kind) is Callable and callable(value) and isinstance(get_args(kind)[0], list):
        return _takes(value, get_args(kind)[0])
    return isinstance(kind, type) and not get_args(kind) and isinstance(value, kind)


def _takes(function: Callable[..., Any], given: list[object]) -> bool:
    """Whether a function surely takes so many arguments."""
    try:
        inspect.signature(function).bind(*given)
    except (TypeError, ValueError):  # it does not, or does not say what it takes
        return False
    return True


def _plain(value: object) -> object:
    """Numbers and arrays of numpy as Python's, any path as `Path`: what is as good is not refused."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, PathLike) and not isinstance(value, Path):
        return Path(value)
    if isinstance(value, list | tuple):
        return (tuple if isinstance(value, tuple) else list)(map(_plain, value))
    return value


def _listed(kind: Any) -> Any:
    """The type with lists in the place of iterables: the items of a list can be looked at, those of an iterator not."""
    parts = tuple(_listed(part) for part in get_args(kind))
    if get_origin(kind) is Iterable:
        return Sequence[parts]
    return Union[parts] if get_origin(kind) in (Union, UnionType) else kind  # noqa: UP007 - of a tuple


def _words(kind: Any) -> str:
    """A type in words: `Scenario, str or Path`."""
    if kind is type(None):
        return "None"
    if isinstance(kind, type) and not get_args(kind):
        return kind.__name__
    parts = [_words(part) for part in get_args(kind)]
    if parts and not hasattr(kind, "__origin__"):  # str | Path
        return " or ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
    return str(kind).replace("collections.abc.", "").replace("typing.", "").replace("pathlib.", "")
