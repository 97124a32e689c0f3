"""Start values of the device's FMU for a fitted model: rigid body, friction, effects."""

import numpy as np
from attrs import evolve

from cosim.closure.drive import StartValues, drive_of, effects_drive
from cosim.closure.model.friction import FORMS
from cosim.closure.model.model import Model
from cosim.measured import Label, Recording


def start_values(recording: Recording, model: Model) -> StartValues:
    """All of them; empty where the device has no FMU. A sign is a very narrow algebraic law."""
    drive = drive_of(recording.device)
    if drive is None:
        return {}
    values = dict(zip(model.labels, map(float, model.fit.beta), strict=False))
    if (declared := model.setting.body.declared) is not None:
        values |= {Label("pi", k + 1): float(v) for k, v in enumerate(declared)}
    for j, law in enumerate(model.laws):
        values[Label.of_joint("coulomb_velocity", j)] = max(law.width, 1e-3 * _top(model, j))
        values[Label.of_joint("coulomb_form", j)] = float(FORMS.index(law.form) if law.form in FORMS else 0)
    for label, value in _of_effects(model).items():
        values[label] = values.get(label, 0.0) + value
    return drive.start_values(values)


def effect_values(recording: Recording, model: Model) -> StartValues:
    """Those of the effects alone, of the FMU in whose parameters they are written."""
    return effects_drive(recording.device).start_values(_of_effects(model))


def _of_effects(model: Model) -> dict[Label, float]:
    """Parameters of a model's effects; two that give the same one (an offset within a position torque) are added."""
    out: dict[Label, float] = {}
    for number, choice in enumerate(model.choices):
        for label, value in choice.effect.parameters(model.estimate(number)).items():
            out[label] = out.get(label, 0.0) + float(value)
    return out


def without(model: Model, blocks: np.ndarray) -> Model:
    """The model with the coefficients that it would have without some of the fitted blocks (T,) marked true."""
    fit, t = model.fit, len(blocks)
    weight = fit.weight[:t] * ~blocks[:, None]
    g = np.einsum("bjpq,bj->pq", model.gram.g[:t], weight)
    h = np.einsum("bjp,bj->p", model.gram.h[:t], weight)
    scale = 1 / np.sqrt(np.maximum(np.diag(g), 1e-300))
    extra = np.diag(fit.penalty + model.precision * scale**2)
    beta = np.linalg.solve(g * scale[:, None] * scale + extra, h * scale) * scale
    new = evolve(model)
    new.fit = evolve(fit, beta=beta)
    return new


def _top(model: Model, joint: int) -> float:
    return float(np.percentile(np.abs(model.setting.motion.dq[:, joint]), 95))
