"""Evaluators for tests: theory instead of simulation, and ones that misbehave. A sweep names
them "sweep_models.py:function".
"""

import faulthandler
import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cosim.analysis.spectrum import DelaySystem, abscissa
from cosim.sweeps.points import Point, PointResult
from cosim.sweeps.pool import Task

MASS, DAMPING = 0.06, 0.09


def one_axis_rate(stiffness: float, delay: float, mass: float = MASS, damping: float = DAMPING) -> float:
    """Exact growth rate of the symmetric one-axis loop: its two modes x_l - x_r and x_l + x_r apart (2 states each)."""
    alone = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    other = np.array([[0.0, 0.0], [stiffness / mass, 0.0]])
    return max(abscissa(DelaySystem([alone, sign * other], [0.0, delay])) for sign in (-1.0, 1.0))


def _finding(rate: float) -> PointResult:
    return PointResult(
        "growing" if rate > 0 else "converged", rate, rate, rate, "constant delay" if rate < 0 else "falsified"
    )


def exact(task: Task, points: Sequence[Point]) -> list[PointResult]:
    """The one-axis loop at (stiffness, delay)."""
    return [_finding(one_axis_rate(*point.entries[:2])) for point in points]


def quick(task: Task, points: Sequence[Point]) -> list[PointResult]:
    """A made-up rate at next to no cost, slow enough to be killed: 4 ms a point, and a line for every call."""
    found = []
    for point in points:
        a, b = point.entries[:2]
        time.sleep(float(dict(task.set).get("pause", 0.004)))
        found.append(_finding(np.sin(3 * a) + b - 1.0))
        if log := dict(task.set).get("log"):
            with open(log, "a", encoding="utf-8") as stream:
                stream.write(point.key + "\n")
    return found


def fragile(task: Task, points: Sequence[Point]) -> list[PointResult]:
    """Dies at a < 0.2 (always), and at 0.2 <= a < 0.4 the first time; raises at a > 0.9; `mark` is a folder of the
    test.
    """
    found = []
    for point in points:
        a = point.entries[0]
        mark = Path(str(dict(task.set)["mark"])) / point.key
        if a < 0.2 or (a < 0.4 and not mark.exists()):
            mark.write_text("died")
            faulthandler.disable()  # which pytest enables; a worker inherits it
            os.kill(os.getpid(), signal.SIGSEGV)
        if a > 0.9:
            raise ValueError(f"no result at {a}")
        found.append(_finding(a - 0.5))
    return found
