"""Co-simulation of haptic teleoperation, from Python.

    scenario = cosim.load("sallam-stable").with_values({"channel_*.delay_mean": 0.3})
    result = cosim.run(scenario)
    result["arm_l.x"], result.outcome, result.growth_rate, result.to_dataframe(), result.plot()

Every main command of the program is a function here; what a command prints and writes is what the call returns.
Nothing is imported before it is asked for.
"""

from types import FunctionType
from typing import TYPE_CHECKING

from cosim.errors import InputError, Problem, RunError
from cosim.version import __version__

if TYPE_CHECKING:
    from cosim.api.building import build
    from cosim.api.comparing import ComparisonResult, compare
    from cosim.api.exporting import export
    from cosim.api.inspecting import inspect
    from cosim.api.loops import Hybrid, StabilityResult, stability, transparency
    from cosim.api.recordings import ClosureResult, DataSurvey, IdentificationResult, close_loop, data, identify, read
    from cosim.api.robots import RobotResult, robot
    from cosim.api.runs import RunResult, load, open_result, run
    from cosim.api.starting import new
    from cosim.api.sweeping import SweepTable, sweep
    from cosim.api.touching import live
    from cosim.api.verifying import VerifiedCertificate, verify
    from cosim.engine.outcome import Outcome
    from cosim.measured import Recording
    from cosim.scenario import Scenario

__all__ = [
    "ClosureResult",
    "ComparisonResult",
    "DataSurvey",
    "Hybrid",
    "IdentificationResult",
    "InputError",
    "Outcome",
    "Problem",
    "Recording",
    "RobotResult",
    "RunError",
    "RunResult",
    "Scenario",
    "StabilityResult",
    "SweepTable",
    "VerifiedCertificate",
    "__version__",
    "build",
    "close_loop",
    "compare",
    "data",
    "export",
    "identify",
    "inspect",
    "live",
    "load",
    "new",
    "open_result",
    "read",
    "robot",
    "run",
    "stability",
    "sweep",
    "transparency",
    "verify",
]

_HOMES = {
    "cosim.api.building": ("build",),
    "cosim.api.comparing": ("ComparisonResult", "compare"),
    "cosim.api.exporting": ("export",),
    "cosim.api.inspecting": ("inspect",),
    "cosim.api.loops": ("Hybrid", "StabilityResult", "stability", "transparency"),
    "cosim.api.recordings": (
        "ClosureResult",
        "DataSurvey",
        "IdentificationResult",
        "close_loop",
        "data",
        "identify",
        "read",
    ),
    "cosim.api.robots": ("RobotResult", "robot"),
    "cosim.api.runs": ("RunResult", "load", "open_result", "run"),
    "cosim.api.starting": ("new",),
    "cosim.api.sweeping": ("SweepTable", "sweep"),
    "cosim.api.touching": ("live",),
    "cosim.api.verifying": ("VerifiedCertificate", "verify"),
    "cosim.engine.outcome": ("Outcome",),
    "cosim.measured": ("Recording",),
    "cosim.scenario": ("Scenario",),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import what is asked for, once."""
    if name not in _HOME:
        raise AttributeError(f"module 'cosim' has no attribute {name!r}")
    from importlib import import_module

    found: object = getattr(import_module(_HOME[name]), name)
    if isinstance(found, FunctionType):
        from cosim.api.asked import asked

        found = asked(found)
        found.__module__ = __name__  # where it is found again, by pickle for one
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
