"""The shared library of an FMU: functions that it may lack, platforms that it is there for."""

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

_NEEDED = ("FreeInstance", "EnterInitializationMode", "ExitInitializationMode", "DoStep")
"""Functions without which no run is possible; each of the others is missed where something needs it."""


@cache
def tolerant(kind: type) -> type:
    """fmpy's class of an FMU with the difference that functions may be absent from the library.

    What is absent is absent from `_functions` too. Loading raises an exception that names what no run can do without.
    """
    typed: dict[str, tuple[Any, Any, Any]] = {}

    def load(self: Any) -> None:
        if typed:
            found = ((name, getattr(self.dll, name, None), types) for name, types in typed.items())
            self._functions.update((name, _typed(function, *types)) for name, function, types in found)
        else:
            self._functions.update(_from_fmpy(kind, self))
            typed.update((n, (f.argnames, f.argtypes, f.restype)) for n, f in self._functions.items())
        _drop_absent(self._functions)

    return type(kind.__name__, (kind,), {"_loadFunctions": load})


def _from_fmpy(kind: type, one: Any) -> dict[str, Any]:
    """The functions of an FMU's library as fmpy's class finds and types them, which takes it a millisecond."""
    whole, one.dll = one.dll, _Filled(one.dll)
    try:
        kind._loadFunctions(one)  # type: ignore[attr-defined] - the class comes from fmpy
    finally:
        one.dll = whole
    return one._functions


def _typed(function: Any, argnames: Any, argtypes: Any, restype: Any) -> Any:
    """A function of a library with the types that fmpy found for another FMU of the same kind."""
    function = function or _Absent()
    function.argnames, function.argtypes, function.restype = argnames, argtypes, restype
    return function


def _drop_absent(functions: dict[str, Any]) -> None:
    absent = [name for name, function in functions.items() if isinstance(function, _Absent)]
    needed = [name for name in absent if name[4:] in _NEEDED]
    if needed:
        raise Exception(f"its library lacks {', '.join(needed)}, without which no co-simulation runs")
    for name in absent:
        del functions[name]


class _Absent:
    """In place of a function that the library lacks; takes the attributes that fmpy gives it."""


class _Filled:
    """A library that has every function that it is asked for."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self.library = library

    def __getattr__(self, name: str) -> Callable[..., int] | _Absent:
        return getattr(self.library, name, None) or _Absent()


def here() -> tuple[str, ...]:
    """This platform in the words of FMI 2.0 and FMI 3.0: linux64, x86_64-linux."""
    from fmpy import platform, platform_tuple

    return platform, platform_tuple
