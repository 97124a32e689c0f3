"""What `cosim close-loop` leaves: closure.json, effects.toml, the FMU with the effect, report.html."""

import json
from pathlib import Path

from attrs import evolve

from cosim.closure.answer import answer
from cosim.closure.closure import Closure
from cosim.closure.effects_file import stepped
from cosim.closure.verdict import Answer, Finding

USUAL_STEP = 1e-3  # s, communication step of the shipped scenarios


def write(closure: Closure, folder: Path | str) -> Path:
    """Write all files; the folder is made. Returns the folder."""
    from cosim.closure import effects_file
    from cosim.closure.page import page
    from cosim.report import write_report

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    closure = _runnable(closure)
    result = answer(closure)
    result["fmu"] = write_fmu(closure, folder)
    (folder / "closure.json").write_text(json.dumps(result, indent=1, allow_nan=False), encoding="utf-8")
    source = ", ".join(closure.recording.files)
    text = effects_file.text(closure.verdict.findings, closure.recording.device, closure.effect_values, source)
    (folder / "effects.toml").write_text(text, encoding="utf-8")
    write_report(page(closure), folder / "report.html")
    return folder


def _runnable(closure: Closure) -> Closure:
    """Start values that run as they stand, at the step of the recording and at that of a scenario."""
    step = max(USUAL_STEP, *(run.step for run in closure.recording.runs))
    kinds = ("values_before", "values_after", "effect_values")
    return evolve(closure, **{kind: stepped(getattr(closure, kind), step) for kind in kinds})


def write_fmu(closure: Closure, folder: Path) -> list[str]:
    """The drive's FMU (FMI 2 and 3) whose start values hold the fitted model with its effects; none for device "regressor"."""
    if not closure.values_after:
        return []
    from build_fmus import fmu_path, start_values

    model = "AxisDrive" if closure.recording.device == "axis" else "PhantomArm"
    names = []
    for version in (2, 3):
        out = folder / f"fmi{version}" / f"{model}.fmu"
        out.parent.mkdir(exist_ok=True)
        start_values(fmu_path(model, version), closure.values_after, out)
        names.append(str(out.relative_to(folder)))
    return names


def sentence(closure: Closure) -> str:
    """The verdict in a sentence or two."""
    verdict = closure.verdict
    if verdict.answer is Answer.REFUSED:
        return f"refused: {'; '.join(verdict.warnings)}"
    error = closure.error
    change = ", ".join(f"{a:.2f} -> {b:.2f} %" for a, b in zip(error.before, error.after, strict=True))
    held = f"Held-out torque error per joint: {change}."
    if verdict.answer is Answer.COMPLETE:
        return f"model_complete: no effect is missing that this data can show. {held}"
    left = "; ".join(dict.fromkeys(f"joint {x.joint + 1}: {' and '.join(x.signals)}" for x in verdict.leftovers[:3]))
    if verdict.answer is Answer.UNEXPLAINED:
        return f"unexplained: something is missing without a name{f' (the residual depends on {left})' if left else ''}. {held}"
    names = ", ".join(map(_named, verdict.findings))
    rest = f" Something else is left without a name ({left})." if left else ""
    return f"effect_found: {names}. {held}{rest}"


def _named(found: Finding) -> str:
    where = "" if len(found.joints) > 1 else f" on joint {found.joints[0]}"
    aliases = f" (not told from {' or '.join(found.aliases)})" if found.aliases else ""
    return f"{found.name}{where}{aliases}"
