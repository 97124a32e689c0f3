"""identification.json: the keys of CONTRACT.md and further ones."""

import math
from typing import Any

from cosim.identification.essential import essential
from cosim.identification.identification import Identification, unexcited
from cosim.identification.idim import Idim, IdimFit
from cosim.version import __version__


def document(found: Identification, paper: Identification, idim: Idim | None = None) -> dict[str, Any]:
    """The identification as a JSON table; NaN becomes null."""
    grouped = dict(found.model.grouped())
    return _clean(
        {
            "device": found.recording.device.word,
            "files": list(found.recording.files),
            "joints": list(found.recording.joints),
            "method": found.method.text(),
            "parameters": _parameters(found),
            "rms_percent": {
                "train": found.rms_train,
                "held_out": found.rms_held_out,
                "held_out_all_rows": found.rms_held_out_all,
                "rows": found.method.reversals.text(),
            },
            "condition_number": found.identifiability.condition,
            "rank": found.identifiability.rank,
            "grouped": grouped,
            "essential": [str(label) for label in essential(found)] if grouped else None,
            "unexcited": [str(label) for label in unexcited(found)],
            "mass_matrix_positive_definite": found.positive_definite,
            "intervals": {
                "level": 0.95,
                "method": "delete-one-block jackknife",
                "block_s": found.spread.block,
                "blocks": found.spread.blocks,
                "effective_samples": found.spread.effective,
                "equations": int(found.stack.fit.sum()),
            },
            "paper_estimator": {
                "method": paper.method.text(),
                "parameters": _parameters(paper),
                "rms_percent": {"train": paper.rms_train, "held_out": paper.rms_held_out},
            },
            "idim_ls": _idim(idim),
            "doubts": [doubt.to_dict() for doubt in found.doubts],
            "warnings": list(found.warnings),
            "versions": {"cosim": __version__},
        }
    )


def verdict(found: Identification) -> str:
    """The identification in one or two sentences."""
    errors = ", ".join(f"{value:.2g} %" for value in found.rms_held_out)
    loose = unexcited(found)
    joints = ", ".join(found.recording.joints)
    text = f"{len(found.parameters)} parameters; the held-out torque is predicted to {errors} (RMS, {joints})."
    text += (
        f" Not determined by this motion: {', '.join(map(str, loose))}."
        if loose
        else " The motion determines all of them."
    )
    if found.withheld:
        text += f" No interval for {', '.join(map(str, found.withheld))}: a doubt about the recording was not mended."
    return text + (
        "" if found.positive_definite else " The identified mass matrix is not positive definite everywhere."
    )


def _parameters(found: Identification) -> list[dict[str, Any]]:
    return [
        {
            "name": str(p.label),
            "value": p.value,
            "std": p.std,
            "std_white": p.std_white,
            "interval": list(p.interval),
            "unit": p.unit,
            "withheld": list(p.withheld),
        }
        for p in found.parameters
    ]


def _idim(idim: Idim | None) -> dict[str, Any] | None:
    if idim is None:
        return None
    return {
        "method": idim.text,
        **_fit(idim.published),
        "default_parameters_on_these_rows": _fit(idim.other),
        "torque_recentred_by_half_a_sample": None if idim.recentred is None else _fit(idim.recentred),
    }


def _fit(fit: IdimFit) -> dict[str, Any]:
    names = ("inertia", "viscous", "coulomb", "offset", "gravity_sin", "gravity_cos")
    return {
        "parameters": dict(zip(names, fit.params.tolist(), strict=False)),
        "relative_error_percent": {"train": fit.train, "held_out": fit.held_out},
    }


def _clean(value: Any) -> Any:
    """numpy to plain Python, NaN and infinity to null."""
    if isinstance(value, dict):
        return {key: _clean(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_clean(item) for item in value]
    if hasattr(value, "tolist"):
        return _clean(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
