"""How a thread computes: rounding, and whether the smallest numbers become zero. An FMU of others may change it for
itself, by `fesetround` or by having been compiled with -ffast-math; the next FMU must not meet that.
"""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

_SIZE = 64  # bytes: more than any C library's fenv_t


@cache
def _library() -> Any:
    """The C library, where it has fegetenv and fesetenv."""
    try:
        library = ctypes.CDLL(None)
        library.fesetenv(_present(library))
    except (OSError, TypeError, AttributeError):  # Windows has no library without a name
        return None
    return library


def _present(library: Any) -> Any:
    environment = (ctypes.c_char * _SIZE)()
    library.fegetenv(environment)
    return environment


@contextmanager
def kept() -> Iterator[None]:
    """What is called inside may change how this thread computes; afterwards it computes as before."""
    library = _library()
    before = _present(library) if library else None
    try:
        yield
    finally:
        if library:
            library.fesetenv(before)
