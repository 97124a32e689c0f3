"""Where a result comes from: versions, command line, scenario, FMUs with their SHA-256."""

import platform
import shlex
import sys
from pathlib import Path

from cosim.engine.master import Result
from cosim.scenario import to_toml
from cosim.version import __version__


def versions() -> dict[str, str]:
    """Versions of what computed a result."""
    system = {"python": platform.python_version(), "platform": platform.platform()}
    return system | {"haptic-cosim": __version__} | {package: _version(package) for package in ("fmpy", "numpy")}


def _version(package: str) -> str:
    """What is loaded knows its version; for what is not, the installed files are parsed, which takes longer."""
    loaded = getattr(sys.modules.get(package), "__version__", None)
    if loaded is not None:
        return loaded
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def command_line() -> str:
    """The command that this process was started with."""
    words = [Path(sys.argv[0]).name if sys.argv and sys.argv[0] else "python", *sys.argv[1:]]
    return shlex.join("cosim" if word == "__main__.py" else word for word in words)


def provenance(result: Result) -> dict[str, object]:
    """Where a result comes from, as plain values: scenario text, FMUs, versions, seed, command, effects."""
    return {
        "scenario": to_toml(result.scenario),
        "seed": result.scenario.experiment.seed,
        "effects": list(result.scenario.effects),
        "changes": dict(result.scenario.changes),
        "fmus": [{"component": f.component, "name": f.model, "fmi": f.fmi, "sha256": f.sha256} for f in result.fmus],
        "versions": versions(),
        "command": command_line(),
    }
