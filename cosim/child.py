"""A forked process that ends with the one that began it, and tells it plain data.

What it tells goes over a pipe as lines of JSON, so that whatever else arrives there (an FMU may write to descriptors
that are not its own) is seen to be none, and is never more than text.
"""

from __future__ import annotations

import atexit
import ctypes
import json
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import NoReturn

News = Mapping[str, object]
"""What a child tells at once."""
FAREWELL = 10.0
"""Seconds that a child may take to free its FMUs; then it is ended."""
_AT_ONCE = 0.2  # s: most children are gone within this time
_LONGEST = 1 << 28  # bytes of a message
_PR_SET_PDEATHSIG = 1
_LOST_PIPE = 81  # exit code of a child that can tell nothing any more


class NoiseError(Exception):
    """The pipe of a child brought what the child did not tell."""


class Child:
    """A forked process that does `work(tell)`, where `tell` sends news to this process, and then `leave()`.

    doing: says, when the process has to be ended while it leaves, what it was doing.
    """

    def __init__(
        self,
        work: Callable[[Callable[[News], None]], None],
        leave: Callable[[], None] = lambda: None,
        doing: Callable[[], str] = lambda: "",
    ) -> None:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()  # what is still in there would be written by both
        self.doing: Callable[[], str] = doing
        self.exitcode = None
        self.leaving: float = 0.0  # when it began to, by the monotonic clock
        near, far = os.pipe()
        self.pipe: int = near
        parent = os.getpid()
        self.pid: int = os.fork()
        if self.pid == 0:
            _live(work, leave, far, parent)
        os.close(far)

    exitcode: int | None
    """As that of subprocess: the negative signal where one ended it; None while it lives."""

    def heard(self, limit: float | None = None) -> Iterator[News]:
        """What the child tells, until it ends. Raises NoiseError where the pipe brings anything else, and TimeoutError
        where it brings nothing for `limit` seconds.
        """
        rest = b""
        while True:
            if limit is not None and not select.select([self.pipe], [], [], limit)[0]:
                raise TimeoutError
            more = os.read(self.pipe, 1 << 16)
            if not more:
                break
            *lines, rest = (rest + more).split(b"\n")
            yield from map(_news, lines)
            if len(rest) > _LONGEST:
                raise NoiseError
        if rest:
            raise NoiseError

    def ended(self, limit: float | None = None) -> bool:
        """Whether the child has ended, within so many seconds (None: however long it takes)."""
        until = None if limit is None else time.monotonic() + limit
        pause = 0.001
        while self.exitcode is None:
            pid, status = os.waitpid(self.pid, 0 if until is None else os.WNOHANG)
            if pid:
                self.exitcode = os.waitstatus_to_exitcode(status)
                os.close(self.pipe)
            elif until is not None and time.monotonic() >= until:
                return False
            else:
                time.sleep(pause)
                pause = min(0.02, 2 * pause)
        return True

    @property
    def lost_its_pipe(self) -> bool:
        """Whether it ended because it could not tell anything any more."""
        return self.exitcode == _LOST_PIPE

    def kill(self) -> None:
        """End it now."""
        if self.exitcode is None:
            os.kill(self.pid, signal.SIGKILL)
            self.ended()

    def dismiss(self) -> None:
        """Let it free what it holds, which is no longer waited for here: it has told everything."""
        self.leaving = time.monotonic()
        _dismissed()
        if self.ended(_AT_ONCE):
            self._complain()
        else:
            _LEAVING.append(self)

    def _complain(self) -> None:
        if self.exitcode:
            _say(f"{self.doing()} ({words(self.exitcode)}); the results are not touched by that")

    def gone(self, wait: bool) -> bool:
        """Whether a dismissed child has ended; one that takes too long is ended."""
        until = self.leaving + FAREWELL
        if self.ended(max(0.0, until - time.monotonic()) if wait else 0.0):
            self._complain()
        elif time.monotonic() >= until:
            self.kill()
            _say(f"{self.doing()} for {FAREWELL:g} s and was ended; the results are not touched by that")
        return self.exitcode is not None


_LEAVING: list[Child] = []  # dismissed, not known to have ended


def _dismissed(wait: bool = False) -> None:
    """Forget the dismissed children that have ended."""
    _LEAVING[:] = [child for child in _LEAVING if not child.gone(wait)]


@atexit.register
def _farewell() -> None:
    try:
        _dismissed(wait=True)
    finally:  # Ctrl-C while waiting
        for child in _LEAVING:
            child.kill()


def _say(text: str) -> None:
    with suppress(OSError, ValueError, AttributeError):
        print(f"warning: {text}", file=sys.stderr)


def _news(line: bytes) -> News:
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        raise NoiseError from None
    if not isinstance(found, dict):
        raise NoiseError
    return found


def words(code: int | None) -> str:
    """How a process ended, by its exit code."""
    if code is None or code >= 0:
        return f"it ended the process, exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}, a real-time signal"
    return f"signal {name}, {signal.strsignal(-code)}"


# --- in the child -----------------------------------------------------------------------------------------------------


def _live(
    work: Callable[[Callable[[News], None]], None], leave: Callable[[], None], pipe: int, parent: int
) -> NoReturn:
    """What the child does from its first moment to its last; nothing of the parent's runs on in it."""
    code = 1
    try:
        _LEAVING.clear()  # they are the parent's
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's business
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        end_with(parent)
        work(lambda news: _tell(pipe, news))
        leave()
        code = 0
    except BrokenPipeError:
        pass  # the parent has heard enough
    finally:
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).fflush(None)  # what FMUs printed
        os._exit(code)


def _tell(pipe: int, news: News) -> None:
    text = json.dumps(news).encode() + b"\n"
    try:
        while text:
            text = text[os.write(pipe, text) :]
    except BrokenPipeError:
        raise
    except OSError:
        os._exit(_LOST_PIPE)


def end_with(parent: int) -> None:
    """Let this process, begun by `parent`, end when that one does, however either of them is busy."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    else:
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    if os.getppid() != parent:
        os._exit(1)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        select.select([], [], [], 0.5)
    os._exit(1)
