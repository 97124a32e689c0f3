"""Compilers at work: none outlives the process that started it, however that one ends."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

_GUARD = """
import os, signal, subprocess, sys
parent = int(sys.argv[1])
told = sys.platform == "linux"
if told:
    import ctypes
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG

def end(*_):
    os.killpg(0, signal.SIGKILL)  # the compiler and what it started: they are in the group of this process

signal.signal(signal.SIGTERM, end)
signal.signal(signal.SIGINT, signal.SIG_IGN)
try:
    program = subprocess.Popen(sys.argv[2:])
except OSError as error:
    sys.exit(str(error))
while True:
    if os.getppid() != parent:
        end()
    try:
        sys.exit(program.wait(None if told else 0.5) & 255)
    except subprocess.TimeoutExpired:
        pass
"""


class RunningCompilers:
    """Programs that were started and have not ended."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.processes: set[subprocess.Popen[str]] = set()
        self.stopped = False

    def run(
        self, command: Sequence[str], folder: Path, environment: Mapping[str, str]
    ) -> subprocess.CompletedProcess[str]:
        """As subprocess.run, output captured. Raises OSError where the program does not start."""
        with self.lock:
            if self.stopped:
                raise OSError("interrupted")
            process = _started(command, folder, environment)
            self.processes.add(process)
        try:
            out, err = process.communicate()
        except BaseException:
            _end(process)
            raise
        finally:
            self.processes.discard(process)
        return subprocess.CompletedProcess(command, process.returncode, out, err)

    def stop(self) -> None:
        """End them all, and let none start until `resume`: threads that build side by side end too."""
        with self.lock:
            self.stopped = True
            for process in list(self.processes):
                _end(process)

    def resume(self) -> None:
        """Let programs start again, when the build that was stopped is over."""
        with self.lock:
            self.stopped = False


RUNNING = RunningCompilers()
"""Those of this process."""


def _started(command: Sequence[str], folder: Path, environment: Mapping[str, str]) -> subprocess.Popen[str]:
    """A guard that runs the program in a group of its own, and ends the group when this process is gone."""
    guarded = [sys.executable, "-I", "-S", "-c", _GUARD, str(os.getpid()), *command] if os.name == "posix" else command
    return subprocess.Popen(
        guarded,
        cwd=folder,
        env=dict(environment),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def _end(process: subprocess.Popen[str]) -> None:
    with suppress(OSError):
        if os.name == "posix":
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
