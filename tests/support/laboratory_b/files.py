"""Writes a recording: the table, its description, and what is true of it."""

import json
from pathlib import Path

import numpy as np

from tests.support.laboratory_b.generation import GeneratedRecording
from tests.support.laboratory_b.plant import Pendulum

Array = np.ndarray


def write(recording: GeneratedRecording, folder) -> None:
    """`data.csv`, `data.toml` and `truth.json` in the folder."""
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    table = columns(recording)
    formats = ["%.6f" if name == "time" else "%d" if name == "run" else "%.9g" for name in table]
    np.savetxt(
        place / "data.csv",
        np.column_stack(list(table.values())),
        fmt=formats,
        delimiter=",",
        header=",".join(table),
        comments="",
    )
    (place / "data.toml").write_text(description(recording, list(table)), encoding="utf-8")
    (place / "truth.json").write_text(json.dumps(truth(recording), indent=1) + "\n", encoding="utf-8")


def columns(recording: GeneratedRecording) -> dict[str, Array]:
    """Named columns of the table; the described joint is `q`, `dq`, `tau`, the others have their numbers."""
    data, experiment = recording.data, recording.setup.experiment
    j, single = experiment.joint, isinstance(experiment.body, Pendulum)
    table: dict[str, Array] = {"time": data.t}
    if len(experiment.references) > 1:
        table["run"] = data.run
    table["q"] = data.q[:, j]
    if not single or recording.seed % 3 == 0:
        table["dq"] = data.dq[:, j]
    table["tau"] = data.tau
    if single and recording.seed % 2:
        reference = np.concatenate(experiment.references)[:: recording.setup.logger.every, 0]
        table["q_ref"] = reference[: len(data.t)]
    if not single:
        table |= rigid_columns(recording)
    for n in range(experiment.joints):
        if n != j:
            table |= {f"q_j{n + 1}": data.q[:, n], f"dq_j{n + 1}": data.dq[:, n]}
    return table | signals(recording)


def rigid_columns(recording: GeneratedRecording) -> dict[str, Array]:
    data, model = recording.data, recording.model
    told, beside = model.parts(data.smooth, data.dq, data.ddq)
    table = {"tau_rigid": told} if model.given else {}
    return table | {f"y{n}": column for n, column in enumerate(beside.T)}


def signals(recording: GeneratedRecording) -> dict[str, Array]:
    """What else was logged: a supply voltage, read back from the torque that follows it."""
    kept = [one for one in recording.happened if one.occurrence.signal]
    if not kept:
        return {}
    thin = recording.trace.thinned(recording.setup.logger.every)
    volts = 48 + 0.5 * thin.extra / np.abs(thin.extra).max()
    return {"supply": np.round(volts, 3)}


def description(recording: GeneratedRecording, names: list[str]) -> str:
    experiment = recording.setup.experiment
    single = isinstance(experiment.body, Pendulum)
    lines = [f'device = "{"axis" if single else "regressor"}"', f'joint = "j{experiment.joint + 1}"']
    if single:
        lines.append(f"gravity = {'true' if experiment.body.weight else 'false'}")
    lines += ["", "[columns]", 'time = "time"', 'q = ["q"]', 'tau = ["tau"]']
    lines += [f'{name} = ["{name}"]' for name in ("dq", "q_ref") if name in names]
    if "run" in names:
        lines.append('run = "run"')
    if "tau_rigid" in names:
        lines.append('rigid = "tau_rigid"')
    beside = [name for name in names if name[0] == "y"]
    if beside:
        lines.append(f"regressor = {json.dumps(beside)}")
    units = {"dq": "rad/s", "q_": "rad", "su": "V"}
    others = [name for name in names if name[:3] == "dq_" or name[:3] == "q_j" or name == "supply"]
    if others:
        lines.append("other = { " + ", ".join(f'{name} = "{units[name[:2]]}"' for name in others) + " }")
    return "\n".join(lines) + "\n"


def truth(recording: GeneratedRecording) -> dict:
    happened, experiment = recording.happened, recording.setup.experiment
    names = [one.name.partition(":")[0] for one in happened]
    return {
        "phenomena": names,
        "joints": [1] * len(names),
        "depends_on": sorted({word for one in happened for word in one.occurrence.depends_on}),
        "parameters": {
            f"{one.name}: {name}" if len(happened) > 1 else name: value
            for one in happened
            for name, value in one.occurrence.parameters(one.size).items()
        },
        "form": "; ".join(one.occurrence.form for one in happened) or "nothing special",
        "shows": round(recording.shows, 4),
        "shows_each": {one.name: round(one.added / recording.floor, 4) for one in happened},
        "alike": sorted({name for one in happened for name in one.occurrence.alike}),
        "floor": f"{recording.floor:.6g} N m",
        "kind": recording.kind,
        "seed": recording.seed,
        "arm_joints": experiment.joints,
        "described_joint": experiment.joint + 1,
        "nominal": {
            "dry friction": f"{experiment.dry[experiment.joint]:.6g} N m",
            "viscous": f"{experiment.viscous[experiment.joint]:.6g} N m s/rad",
        },
        "motions": list(recording.setup.motions),
        "rate": f"{recording.setup.logger.rate:.6g} Hz",
    }
