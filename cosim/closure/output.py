"""What `cosim close-loop` writes beside its report: closure.json, effects.toml, the FMU with the effect."""

import json
from pathlib import Path

from attrs import evolve

from cosim.closure import effects_file
from cosim.closure.closure import Closure
from cosim.closure.document import answer
from cosim.closure.drive import drive_of, effects_drive, stepped
from cosim.results.saving import write_text

USUAL_STEP = 1e-3  # s, communication step of the shipped scenarios


def write(closure: Closure, folder: Path | str) -> Closure:
    """Write all files, the FMUs last; the folder is made. Returns the closure as written: an FMU that cannot be built
    is one more warning.
    """
    from build_fmus import BuildError

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("report.html", "closure.json", "effects.toml"):  # of an earlier recording: never beside this one's
        (folder / name).unlink(missing_ok=True)
    closure = _runnable(closure)
    _write_texts(closure, folder)
    try:
        names = write_fmu(closure, folder)
    except BuildError as error:
        closure = evolve(
            closure, warnings=(*closure.warnings, f"no FMU of the model after: {'; '.join(error.problems)}")
        )
        _write_texts(closure, folder)
        return closure
    _write_answer(closure, folder, names)
    return closure


def _write_texts(closure: Closure, folder: Path) -> None:
    _write_answer(closure, folder, [])
    source = ", ".join(closure.recording.files)
    model = effects_drive(closure.recording.device).model
    text = effects_file.text(closure.verdict.findings, model, closure.effect_values, source)
    write_text(text, folder / "effects.toml")


def _write_answer(closure: Closure, folder: Path, fmus: list[str]) -> None:
    text = json.dumps(answer(closure) | {"fmu": fmus}, indent=1, allow_nan=False)
    write_text(text, folder / "closure.json")


def _runnable(closure: Closure) -> Closure:
    """With internal steps that are stable at the step of the recording and at that of a scenario."""
    step = max(USUAL_STEP, *(run.step for run in closure.recording.runs))
    return evolve(
        closure,
        values_before=stepped(closure.values_before, step),
        values_after=stepped(closure.values_after, step),
        effect_values=stepped(closure.effect_values, step),
    )


def write_fmu(closure: Closure, folder: Path) -> list[str]:
    """The device's FMU (FMI 2 and 3) with the fitted model and its effects as start values; none where it has no FMU.

    Raises BuildError where no FMU can have them; then there is none, not even that of an earlier call.
    """
    drive = drive_of(closure.recording.device)
    if drive is None or not closure.values_after:
        return []
    from build_fmus import fitted_fmu, start_values

    files = {version: folder / f"fmi{version}" / f"{drive.model}.fmu" for version in (2, 3)}
    for out in files.values():
        out.parent.mkdir(exist_ok=True)
        out.unlink(missing_ok=True)
    for version, out in files.items():
        start_values(fitted_fmu(drive.model, drive.joints, version), closure.values_after, out)
    return [str(out.relative_to(folder)) for out in files.values()]
