"""The three files of a recording: data.csv, data.toml (and arm.urdf), truth.json."""

from pathlib import Path

import numpy as np

from tests.support.laboratory_c.arrays import Array
from tests.support.laboratory_c.judgement import joint_columns, told_torque
from tests.support.laboratory_c.logger import Logged, Logger, student
from tests.support.laboratory_c.setup import ExperimentPlan

Extra = dict[str, tuple[str, Array]]
"""Further logged columns: name, then unit and values."""


def write_table(path: Path, columns: dict[str, Array]) -> None:
    """Nine digits a value."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")


def stamps(experiment: ExperimentPlan, runs: list[Logged]) -> dict[str, Array]:
    columns = {"t": np.concatenate([r.t for r in runs])}
    if len(runs) > 1:
        columns["run"] = np.concatenate([np.full(len(r.t), k + 1.0) for k, r in enumerate(runs)])
    return columns


def header(experiment: ExperimentPlan, runs: list[Logged], **words: str) -> list[str]:
    lines = [f"{key} = {value}" for key, value in words.items()]
    return [*lines, "", "[columns]", 'time = "t"', *(['run = "run"'] if len(runs) > 1 else [])]


def axis(experiment: ExperimentPlan, logger: Logger, runs: list[Logged], extra: Extra) -> tuple[dict[str, Array], str]:
    """One joint in the words of its workshop: a lift in mm and N, a gear in degrees or A of its motor, or SI."""
    lift = experiment.body.word == "lift"
    way = logger.seed % 3
    turn, push, tail = 1.0, 1.0, list[str]()
    if lift and way:
        turn, tail = 1e3, ["", "[units]", 'q = "mm"', 'dq = "mm/s"', 'tau = "N"']
    elif lift:
        tail = ["", "[units]", 'q = "m"', 'dq = "m/s"', 'tau = "N"']
    elif way == 1:
        turn, tail = 180 / np.pi, ["", "[units]", 'q = "deg"', 'dq = "deg/s"']
    elif way == 2:
        ratio, constant = 20 + logger.seed % 60, 0.05
        turn, push = ratio, 1 / (ratio * constant)
        tail = ["", "[units]", 'tau = "A"', "", "[scale]", f"tau = {constant}"]
        tail += ["", "[gear]", f"ratio = {ratio}", 'encoder = "motor"', 'torque = "motor"']
    columns = stamps(experiment, runs)
    columns["position"] = np.concatenate([r.q[:, 0] for r in runs]) * turn
    if logger.with_speed:
        columns["speed"] = np.concatenate([r.speed[:, 0] for r in runs]) * turn
    columns["drive"] = np.concatenate([r.torque[:, 0] for r in runs]) * push
    if not logger.with_speed:
        tail = [line for line in tail if not line.startswith("dq")]
    lines = header(
        experiment, runs, device='"axis"', joint=f'"{experiment.body.word}"', gravity="false" if lift else "true"
    )
    lines += [
        'q = ["position"]',
        'tau = ["drive"]',
        *(['dq = ["speed"]'] if logger.with_speed else []),
        *others_line(units(extra)),
    ]
    columns |= values(extra)
    return columns, "\n".join([*lines, *tail]) + "\n"


def units(extra: Extra) -> list[tuple[str, str]]:
    return [(name, unit) for name, (unit, _) in extra.items()]


def values(extra: Extra) -> dict[str, Array]:
    return {name: column for name, (_, column) in extra.items()}


def others_line(names: list[tuple[str, str]]) -> list[str]:
    return ["other = { " + ", ".join(f'{n} = "{u}"' for n, u in names) + " }"] if names else []


def regressor(
    experiment: ExperimentPlan, logger: Logger, runs: list[Logged], extra: Extra
) -> tuple[dict[str, Array], str]:
    """Base columns, or a told torque; computed by the student from the logged places."""
    j, columns = experiment.joint, stamps(experiment, runs)
    corner = min(40.0 + logger.seed % 20, 0.42 * experiment.rate)
    seen = [student(experiment, r.t, r.q, r.torque, corner) for r in runs]
    columns["q"] = np.concatenate([r.q[:, j] for r in runs])
    columns["dq"] = np.concatenate([s.v[:, j] for s in seen])
    columns["tau"] = np.concatenate([r.torque[:, j] for r in runs])
    table = np.concatenate([joint_columns(experiment, j, s) for s in seen])
    names = [f"y{k}" for k in range(table.shape[1])]
    columns |= dict(zip(names, table.T, strict=True))
    quoted = ", ".join(f'"{name}"' for name in names)
    lines = ['q = ["q"]', 'dq = ["dq"]', 'tau = ["tau"]', *([f"regressor = [{quoted}]"] if names else [])]
    if experiment.told == "rigid":
        columns["tau_model"] = np.concatenate([told_torque(experiment, j, s) for s in seen])
        lines.append('rigid = "tau_model"')
    others = units(extra)
    columns |= values(extra)
    for k in range(len(experiment.body.rooms)):
        if k != j:
            unit = "m" if experiment.body.linear[k] else "rad"
            columns[f"q_{k + 1}"] = np.concatenate([r.q[:, k] for r in runs])
            columns[f"dq_{k + 1}"] = np.concatenate([s.v[:, k] for s in seen])
            others += [(f"q_{k + 1}", unit), (f"dq_{k + 1}", f"{unit}/s")]
    tail = ["", "[units]", 'q = "m"', 'dq = "m/s"', 'tau = "N"'] if experiment.body.linear[j] else []
    told = header(experiment, runs, device='"regressor"', joint=f'"{experiment.body.word} {j + 1}"')
    return columns, "\n".join([*told, *lines, *others_line(others), *tail]) + "\n"


def robot(experiment: ExperimentPlan, logger: Logger, runs: list[Logged], extra: Extra) -> tuple[dict[str, Array], str]:
    """All joints, the arm by its URDF."""
    columns, n = stamps(experiment, runs), len(experiment.body.rooms)
    for j in range(n):
        columns[f"pos{j + 1}"] = np.concatenate([r.q[:, j] for r in runs])
    for j in range(n):
        columns[f"eff{j + 1}"] = np.concatenate([r.torque[:, j] for r in runs])
    if logger.with_speed:
        for j in range(n):
            columns[f"vel{j + 1}"] = np.concatenate([r.speed[:, j] for r in runs])
    names = {"q": "pos", "tau": "eff"} | ({"dq": "vel"} if logger.with_speed else {})
    joints = ", ".join(f'"a{j + 1}"' for j in range(n))
    lines = header(experiment, runs, device='"robot"', urdf='"arm.urdf"', joints=f"[{joints}]")
    for key, word in names.items():
        quoted = ", ".join(f'"{word}{j + 1}"' for j in range(n))
        lines.append(f"{key} = [{quoted}]")
    columns |= values(extra)
    lines += others_line(units(extra))
    return columns, "\n".join(lines) + "\n"


def urdf(experiment: ExperimentPlan) -> str:
    """The planar arm: axes against y, so that a positive angle lifts; links along x."""
    machine, links = experiment.body.machine, experiment.body.links
    lengths = getattr(machine, "lengths", ())
    parts = ['<robot name="planar_arm">', '<link name="base"/>']
    for j, (mass, centre, inertia) in enumerate(links):
        parts.append(
            f'<link name="l{j + 1}"><inertial><origin xyz="{centre:.6f} 0 0"/><mass value="{mass:.6f}"/><inertia '
            f'ixx="{inertia / 4:.8f}" iyy="{inertia:.8f}" izz="{inertia:.8f}" ixy="0" ixz="0" iyz="0"/></inertial>'
            "</link>"
        )
        parent, along = (f"l{j}", lengths[j - 1]) if j else ("base", 0.0)
        parts.append(
            f'<joint name="a{j + 1}" type="revolute"><parent link="{parent}"/><child link="l{j + 1}"/>'
            f'<origin xyz="{along:.6f} 0 0"/><axis xyz="0 -1 0"/>'
            '<limit lower="-3.1" upper="3.1" effort="500" velocity="20"/></joint>'
        )
    return "\n".join([*parts, "</robot>"]) + "\n"
