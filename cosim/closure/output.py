"""What `cosim close-loop` leaves: closure.json, effects.toml, the FMU with the effect, report.html."""

import json
from pathlib import Path

import numpy as np
from attrs import evolve

from cosim.closure import effects_file
from cosim.closure.answer import answer
from cosim.closure.closure import Closure
from cosim.closure.dependence import Leftover
from cosim.closure.effects_file import stepped
from cosim.closure.verdict import Answer, Finding

USUAL_STEP = 1e-3  # s, communication step of the shipped scenarios


def write(closure: Closure, folder: Path | str) -> Closure:
    """Write all files, the FMUs last; the folder is made. Returns what was written: an FMU that cannot be built is one more warning."""
    from build_fmus import BuildError

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    closure = _runnable(closure)
    _write_texts(closure, folder)
    try:
        names = write_fmu(closure, folder)
    except BuildError as error:
        closure = evolve(closure, warnings=(*closure.warnings, f"no FMU of the model after: {'; '.join(error.problems)}"))
        _write_texts(closure, folder)
        return closure
    _write_answer(closure, folder, names)
    return closure


def _write_texts(closure: Closure, folder: Path) -> None:
    from cosim.closure.page import page
    from cosim.report import write_report

    _write_answer(closure, folder, [])
    source = ", ".join(closure.recording.files)
    text = effects_file.text(closure.verdict.findings, closure.recording.device, closure.effect_values, source)
    (folder / "effects.toml").write_text(text, encoding="utf-8")
    write_report(page(closure), folder / "report.html")


def _write_answer(closure: Closure, folder: Path, fmus: list[str]) -> None:
    text = json.dumps(answer(closure) | {"fmu": fmus}, indent=1, allow_nan=False)
    (folder / "closure.json").write_text(text, encoding="utf-8")


def _runnable(closure: Closure) -> Closure:
    """Start values that run as they stand, at the step of the recording and at that of a scenario."""
    step = max(USUAL_STEP, *(run.step for run in closure.recording.runs))
    kinds = ("values_before", "values_after", "effect_values")
    return evolve(closure, **{kind: stepped(getattr(closure, kind), step) for kind in kinds})


def write_fmu(closure: Closure, folder: Path) -> list[str]:
    """The drive's FMU (FMI 2 and 3) whose start values hold the fitted model with its effects; none for device "regressor".

    Raises BuildError where no FMU can have them; then there is none, not even that of an earlier call.
    """
    if not closure.values_after:
        return []
    from build_fmus import fmu_path, start_values

    model = "AxisDrive" if closure.recording.device == "axis" else "PhantomArm"
    files = {version: folder / f"fmi{version}" / f"{model}.fmu" for version in (2, 3)}
    for out in files.values():
        out.parent.mkdir(exist_ok=True)
        out.unlink(missing_ok=True)
    for version, out in files.items():
        start_values(fmu_path(model, version), closure.values_after, out)
    return [str(out.relative_to(folder)) for out in files.values()]


def sentence(closure: Closure) -> str:
    """The verdict in a sentence or two."""
    verdict = closure.verdict
    if verdict.answer is Answer.REFUSED:
        return f"refused: {'; '.join(verdict.warnings)}"
    error = closure.error
    pairs = zip(error.before, error.after, strict=True)
    change = ", ".join(f"{a:.2f} -> {b:.2f} %" if np.isfinite((a, b)).all() else "- (does not move)" for a, b in pairs)
    held = f"Held-out torque error per joint: {change}."
    new, earlier = (", ".join(_named(f) for f in verdict.findings if f.earlier is kind) for kind in (False, True))
    beside = f" beside those of the earlier pass ({earlier})" if earlier else ""
    if verdict.answer is Answer.COMPLETE:
        return f"model_complete: no effect is missing that this data can show{beside}. {held}"
    left = "; ".join(dict.fromkeys(map(_left, verdict.leftovers[:3])))
    if verdict.answer is Answer.UNEXPLAINED:
        left = left or next((f"{f.name} was withdrawn: {why}" for f, why in verdict.withdrawn), "")
        return f"unexplained: something is missing without a name{f' ({left})' if left else ''}{beside}. {held}"
    rest = f" Something else is left without a name ({left})." if left else ""
    return f"effect_found: {new}{beside}. {held}{rest}"


def _left(leftover: Leftover) -> str:
    signals = " and ".join(leftover.signals)
    if leftover.sure:
        words = leftover.choice.effect.words
        return f"the residual of joint {leftover.joint + 1} depends on {signals}{words and f': {words}'}"
    return f"joint {leftover.joint + 1} leaves more than its sensors' noise; no signal surely explains it, {signals} comes closest"


def _named(found: Finding) -> str:
    where = "" if len(found.joints) > 1 else f" on joint {found.joints[0]}"
    others = ["an effect without a name" if name == "unknown" else name for name in found.aliases]
    aliases = f" (not told from {' or '.join(others)})" if others else ""
    return f"{found.name}{where}{aliases}"
