"""What is in an FMU."""

from __future__ import annotations

from pathlib import Path

from cosim.fmu.contents import FmuContents, contents


def inspect(file: str | Path) -> FmuContents:
    """What an FMU holds and needs: variables, capabilities, platforms, and a scenario to begin with.

    Raises InputError where the file is none or is not there.
    """
    return contents(file)
