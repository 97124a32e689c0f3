"""FMUs and the wired system for other tools."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from cosim.api.runs import loaded
from cosim.exports.export import Exported
from cosim.exports.export import export as write_export
from cosim.fmu import open_system
from cosim.scenario import Scenario


def export(
    scenario: Scenario | str | Path,
    folder: str | Path,
    *,
    platforms: Iterable[str] | None = None,
    progress: Callable[[str], None] | None = None,
    enumerations: bool = True,
) -> Exported:
    """Write fmi2/MODEL.fmu and fmi3/MODEL.fmu of every model, SCENARIO.ssp, and the system as one FMU.

    platforms: FMI 3 names of the binaries' platforms, or "all" (default: this machine); progress: called with what is
    being done; enumerations: False puts whole numbers in their place, for importers that know none. Raises InputError
    for an unknown platform, RunError where an FMU cannot be built or a file not written.
    """
    from build_fmus.compiler import PLATFORMS

    chosen = loaded(scenario)
    wanted = None if platforms is None else list(platforms)
    if wanted == ["all"]:
        wanted = list(PLATFORMS)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with open_system(chosen, progress) as system:
        return write_export(system.wiring(chosen), folder, wanted, progress, enumerations)
