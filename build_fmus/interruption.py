"""A program that is told to stop: Ctrl-C, SIGTERM and SIGHUP (a terminal that closes) are one and the same."""

import atexit
import os
import signal
import sys
import threading
from contextlib import suppress
from types import FrameType
from typing import NoReturn

_TOLD = ("SIGINT", "SIGTERM", "SIGHUP")
INTERRUPTED = 130
"""The exit code, as of a shell."""


class Interrupted(KeyboardInterrupt):
    """Raised where the program is when a signal tells it to stop.

    A class of its own, because Python remembers a KeyboardInterrupt that left a text given to `exec` (dataclasses are
    made so while modules are imported), and at its end kills itself by SIGINT, although it was caught.
    """


def stop_when_told() -> None:
    """From now on a signal raises Interrupted: what was computed is kept. One that is ignored (nohup) stays so."""
    _answer(_interrupt)


def leave_when_told() -> None:
    """From now on a signal ends the process at once: all is said and written, and only freeing goes on."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    _answer(_leave)


def leave(code: int) -> NoReturn:
    """End the program with its exit code, as processes of multiprocessing end: what waits for the end is called, what
    was written is flushed, and nothing is freed object by object, which takes longer than many a command.
    """
    threading._shutdown()  # type: ignore[attr-defined] - private, but what multiprocessing ends its processes with
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
    if "ctypes" in sys.modules:
        with suppress(OSError, AttributeError):
            sys.modules["ctypes"].CDLL(None).fflush(None)  # what FMUs printed
    os._exit(code)


def _answer(handler: "signal._HANDLER") -> None:
    if threading.current_thread() is not threading.main_thread():
        return
    for number in (getattr(signal, name) for name in _TOLD if hasattr(signal, name)):
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler, _interrupt):
            signal.signal(number, handler)


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise Interrupted


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    os._exit(INTERRUPTED)
