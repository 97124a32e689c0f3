"""Files whose library may crash or never return on a damaged one, read in a process of its own.

HDF5 does both, so that a file that was damaged, or made to do harm, would end this process without a word. Whatever
lies on the disk is taken for such a file, our own results as well: what this process has just computed it does not read
again. The child tells plain data; arrays lie in memory that both processes share.
"""

from __future__ import annotations

import mmap
import os
import signal
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from cosim.child import Child, News, NoiseError, words
from cosim.errors import InputError, Problem

if TYPE_CHECKING:
    import numpy as np

LEAST = 20.0  # s of processor time for any file
SLOWEST = 5e6  # bytes of a file in a second of processor time; inflating deflated data takes 20 times less
WAITING = 10.0  # times as long by the clock: the machine may be busy, the disk slow
_ALIGNED = 64
_PLAIN = "biufcSUmM"  # kinds of numpy that are no objects


class UnreadableError(Exception):
    """A file that its library cannot read; says why."""


def read_apart(read: Callable[[], Any], path: Path) -> Any:
    """What `read()` makes of the file at `path`: numbers, text, lists, dictionaries with names, arrays of plain kinds.

    It is called in a child process where the system can fork, which may take a time that grows with the file. Raises
    InputError as `read` does, and UnreadableError where it raises another error, crashes, or does not end.
    """
    if not hasattr(os, "fork"):
        return _read_here(read)
    seconds = 1 + int(LEAST + path.stat().st_size / SLOWEST)
    with _shared_file() as shared:
        child = Child(lambda tell: _tell_content(tell, read, shared, seconds))
        try:
            for news in child.heard(WAITING * seconds):
                return _content(news, shared)
            child.ended()
        except (NoiseError, TimeoutError):
            raise UnreadableError(f"one on which its library hangs (ended after {WAITING * seconds:.0f} s)") from None
        finally:
            child.kill()
    if child.exitcode == -signal.SIGXCPU:
        raise UnreadableError(f"one on which its library does not end ({seconds} s of processor time)")
    raise UnreadableError(f"one on which its library crashes ({words(child.exitcode)})")


def _read_here(read: Callable[[], Any]) -> Any:
    try:
        return read()
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a library says of a damaged file
        raise UnreadableError(damaged(error)) from None


def damaged(error: Exception) -> str:
    """What came in place of a good file, by the error of who read it."""
    return f"one that is damaged ({type(error).__name__}: {str(error)[:300]})"


def _shared_file() -> BinaryIO:
    """A file without a name, in memory where the system has such."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("cosim", 0), "w+b", buffering=0)
    return tempfile.TemporaryFile(buffering=0)


# --- in the child -----------------------------------------------------------------------------------------------------


def _tell_content(tell: Callable[[News], None], read: Callable[[], Any], shared: BinaryIO, seconds: int) -> None:
    _limited(seconds)
    try:
        tell({"content": _written(read(), shared)})
    except InputError as error:
        tell({"problems": [[p.where, p.expected, p.got, p.advice] for p in error.problems]})
    except BrokenPipeError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a library says of a damaged file
        tell({"damaged": damaged(error)})


def _limited(seconds: int) -> None:
    """So much processor time, half of the memory (arrays lie there twice), no core file, and no last words of the C
    library on the terminal.
    """
    import resource

    limits = [(resource.RLIMIT_CPU, seconds), (resource.RLIMIT_CORE, 0)]
    with suppress(OSError, ValueError):  # of Linux
        pages = int(Path("/proc/self/statm").read_text().split()[0]) + os.sysconf("SC_PHYS_PAGES") // 2
        limits.append((resource.RLIMIT_AS, pages * os.sysconf("SC_PAGE_SIZE")))
    for what, most in limits:
        hard = resource.getrlimit(what)[1]
        soft = most if hard == resource.RLIM_INFINITY else min(most, hard)
        with suppress(ValueError, OSError):
            resource.setrlimit(what, (soft, hard))
    silent = os.open(os.devnull, os.O_WRONLY)
    for number in (1, 2):
        os.dup2(silent, number)


def _written(value: Any, shared: BinaryIO) -> Any:
    """The value with its arrays written to the shared file; in their place stands where they lie."""
    import numpy as np

    if isinstance(value, np.ndarray):
        return {"array": _stored(value, shared)}
    if isinstance(value, Mapping):
        return {"mapping": [[name, _written(part, shared)] for name, part in value.items()]}
    if isinstance(value, (list, tuple)):
        return [_written(part, shared) for part in value]
    return value.item() if isinstance(value, np.generic) else value


def _stored(array: np.ndarray, shared: BinaryIO) -> list[Any]:
    """[offset, type, shape] of an array that is written to the file."""
    import numpy as np

    if array.dtype.kind not in _PLAIN:
        raise TypeError(f"an array of {array.dtype}")
    if not array.nbytes:
        return [0, array.dtype.str, list(array.shape)]
    start = -(-shared.tell() // _ALIGNED) * _ALIGNED
    shared.seek(start)
    left = np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
    while left:
        left = left[shared.write(left) :]
    return [start, array.dtype.str, list(array.shape)]


# --- in the parent ----------------------------------------------------------------------------------------------------


def _content(news: News, shared: BinaryIO) -> Any:
    problems = news.get("problems")
    if isinstance(problems, list):
        raise InputError([Problem(*part) for part in problems])
    if "content" not in news:
        raise UnreadableError(str(news.get("damaged")))
    size = os.fstat(shared.fileno()).st_size
    try:
        return _restored(news["content"], mmap.mmap(shared.fileno(), size) if size else b"")
    except (LookupError, TypeError, ValueError):
        raise UnreadableError("one on which its library goes astray") from None


def _restored(value: Any, memory: mmap.mmap | bytes) -> Any:
    import numpy as np

    if isinstance(value, list):
        return [_restored(part, memory) for part in value]
    if not isinstance(value, dict):
        return value
    if "mapping" in value:
        return {name: _restored(part, memory) for name, part in value["mapping"]}
    start, kind, shape = value["array"]
    dtype = np.dtype(kind)
    count = int(np.prod(shape, dtype=np.int64))
    return np.frombuffer(memory, dtype, count, start).reshape(shape) if count else np.zeros(shape, dtype)
