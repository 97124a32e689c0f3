"""The shared library of an FMU: functions that it may lack, platforms that it is there for."""

import ctypes
import inspect
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

    def load(self: Any) -> None:
        whole, self.dll = self.dll, _Filled(self.dll)
        try:
            kind._loadFunctions(self)  # type: ignore[attr-defined] - the class comes from fmpy
        finally:
            self.dll = whole
        _drop_absent(self._functions)

    for name, function in inspect.getmembers(kind, inspect.isfunction):
        if name.startswith("fmi"):  # fmpy asks for the signature of each with every instance: Python keeps this one
            vars(function).setdefault("__signature__", inspect.signature(function))
    return type(kind.__name__, (kind,), {"_loadFunctions": load})


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
