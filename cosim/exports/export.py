"""Everything that another tool needs, in one folder: FMUs of both versions, the wired system as SSP and as one FMU."""

from collections.abc import Callable, Sequence
from pathlib import Path

from attrs import frozen

from cosim.errors import InputError, Problem, RunError
from cosim.exports.container import write_container
from cosim.exports.enumerations import whole_numbers
from cosim.exports.structure import write_ssp
from cosim.wiring import Wiring

Progress = Callable[[str], None]


@frozen
class Exported:
    """What was written: FMUs of models, the SSP archive, container FMUs."""

    fmus: tuple[Path, ...]
    ssp: Path
    containers: tuple[Path, ...]


def export(
    wiring: Wiring,
    folder: Path,
    platforms: Sequence[str] | None = None,
    progress: Progress | None = None,
    enumerations: bool = True,
) -> Exported:
    """Write fmi2/MODEL.fmu and fmi3/MODEL.fmu for every model, SCENARIO.ssp, and the containers fmi2|fmi3/SCENARIO.fmu.

    platforms: of the binaries inside (default: this machine); enumerations: False puts whole numbers in their place,
    for importers that know none. Raises InputError for an unknown platform, RunError where
    an FMU cannot be built or a file not be written.
    """
    if problems := _untold(wiring):
        raise InputError(problems)
    fmus = tuple(path for fmi in (2, 3) for path in _models(fmi, folder / f"fmi{fmi}", platforms, progress))
    for path in () if enumerations else fmus:
        path.write_bytes(whole_numbers(path).read_bytes())
    name = wiring.scenario.name
    say = progress or (lambda text: None)
    say(f"writing {name}.ssp")
    ssp = write_ssp(wiring, folder / f"{name}.ssp", platforms, enumerations)
    say(f"writing {name}.fmu, the whole system as one FMU")
    places = {fmi: folder / f"fmi{fmi}" / f"{name}.fmu" for fmi in (2, 3)}
    containers = tuple(write_container(wiring, path, fmi, enumerations) for fmi, path in places.items())
    return Exported(fmus, ssp, containers)


def _untold(wiring: Wiring) -> list[Problem]:
    """Connections whose values change on their way, or that are texts: the container would pass them on as they are."""
    odd = [link for link in wiring.links if link.scaled or link.conversion or link.text]
    expected, advice = "a value that arrives as it left", "give both ends the same unit and type, or leave it out"
    got = {link: "a text" if link.text else "one that is converted" for link in odd}
    return [Problem(f"export: {link.source} -> {link.target}", expected, got[link], advice) for link in odd]


def _models(fmi: int, folder: Path, platforms: Sequence[str] | None, progress: Progress | None) -> list[Path]:
    from build_fmus import BuildError, fmu_path, models
    from build_fmus.compiler import PLATFORMS

    for platform in platforms or ():
        if platform not in PLATFORMS:
            raise InputError(Problem("--platform", " or ".join(PLATFORMS), repr(platform)))
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for model in models():
        try:
            built = fmu_path(model, fmi, platforms, progress=progress)
        except BuildError as error:
            raise RunError(model, None, f"cannot be built: {error}") from None
        written.append(folder / f"{model}.fmu")
        written[-1].write_bytes(built.read_bytes())
    return written
