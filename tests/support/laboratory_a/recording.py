"""What a laboratory has in hand: a table, its description, and apart from them the truth."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from tests.support.laboratory_a.experiment import DrawnExperiment
from tests.support.laboratory_a.judgement import described, given_torque, regressor_columns

JOINTS = ["j1", "j2", "j3", "j4", "j5", "j6"]


def run_of_rows(e: DrawnExperiment) -> np.ndarray:
    """The run (from 1) of each logged row."""
    rows = np.concatenate(e.pieces.logged())
    return 1 + np.searchsorted(e.runs[:, 1], rows, side="right")


def measured(e: DrawnExperiment, q, u, rng):
    """Encoder counts as angles, and commands with the noise of their measurement."""
    grain = e.logger.resolution[:, None]
    noise = rng.normal(size=u.shape) * e.logger.noise[:, None]
    c = e.logger.colour
    if c:
        noise = lfilter([np.sqrt(1 - c * c)], [1, -c], noise)
    return np.round(q / grain) * grain, u + noise


def derived(e: DrawnExperiment, q):
    """q, dq, ddq as one computes them from an encoder: zero-phase Butterworth filter, central differences by run."""
    runs, rate = run_of_rows(e), e.logger.rate
    filter_ = butter(4, e.logger.cutoff, fs=rate, output="sos")
    parts = []
    for run in np.unique(runs):
        smooth = sosfiltfilt(filter_, q[:, runs == run], axis=1)
        speed = np.gradient(smooth, 1 / rate, axis=1)
        parts.append(np.stack([smooth, speed, np.gradient(speed, 1 / rate, axis=1)]))
    return np.concatenate(parts, axis=2)


def inner_rows(e: DrawnExperiment):
    """Rows 0.3 s away from the ends of runs, where filters have settled; at most about 20000."""
    runs, edge = run_of_rows(e), int(0.3 * e.logger.rate)
    inner = [np.flatnonzero(runs == run)[edge:-edge] for run in np.unique(runs)]
    rows = np.concatenate(inner)
    return rows[:: max(1, len(rows) // 20000)]


@dataclass(frozen=True)
class LaboratoryRecording:
    """One recording with its noiseless signals (n, N) and its truth."""

    experiment: DrawnExperiment
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    u: np.ndarray
    measured_q: np.ndarray
    measured_u: np.ndarray
    speed_noise: np.ndarray
    signals: dict
    truth: dict

    def table(self) -> dict[str, np.ndarray]:
        e = self.experiment
        log, joints = e.logger, described(e)
        rows = np.concatenate(e.pieces.logged())
        runs = run_of_rows(e)
        starts = e.pieces.time[e.runs[:, 0]]
        time = e.pieces.time[rows] - (starts[runs - 1] if log.time_restarts else starts[0])
        out = {"t": time}
        angle = 180 / np.pi if log.degrees else 1.0
        single = len(joints) == 1
        for k, joint in enumerate(joints):
            mark = "" if single else str(k + 1)
            out["q" + mark] = self.measured_q[joint] * angle
            out["tau" + mark] = self.measured_u[joint]
            if log.writes_speed:
                out["dq" + mark] = self.v[joint] + self.speed_noise[k]
            if log.writes_reference:
                out["q_ref" + mark] = e.pieces.reference[joint, rows] * angle
        if e.machine.description in ("rigid", "columns"):
            out |= self.computed()
        if len(e.runs) > 1:
            out["run"] = runs
        if log.split:
            out["split"] = self.halves(runs)
        for name, (f, _) in self.signals.items():
            out[name] = np.round(f(e.pieces.time[rows]), 3)
        return out

    def halves(self, runs):
        """1 where a row is held out: late runs, or the second half."""
        if runs[-1] > 1:
            return runs > (runs[-1] + 1) // 2
        return np.arange(len(runs)) >= len(runs) // 2

    def computed(self) -> dict[str, np.ndarray]:
        e = self.experiment
        q, v, a = derived(e, self.measured_q)
        out = {}
        if e.machine.description == "rigid":
            out["tau_rigid"] = given_torque(e, q, v, a)
        else:
            out |= {f"y{k}": column for k, column in enumerate(regressor_columns(e, q, v, a))}
        if e.machine.arm.n > 1:
            out |= {"q_other": self.measured_q[e.loop.other], "dq_other": v[e.loop.other], "ddq_other": a[e.loop.other]}
        return out

    def description(self) -> str:
        """The TOML beside the table."""
        e, table = self.experiment, self.table()
        device = {"axis": "axis", "rigid": "regressor", "columns": "regressor"}.get(e.machine.description, "phantom")
        lines = [f'device = "{device}"']
        if device == "phantom":
            declared = "declared" in e.machine.description
            lines += ['configuration = "UR"', f'parameters = "{"declared" if declared else "fit"}"']
            if declared:
                lines.append(f"declared_pi = {[float(x) for x in e.machine.arm.parameters(e.machine.rotor)]}")
        else:
            lines.append(f'joint = "{JOINTS[e.loop.joint]}"')
        if device == "axis":
            lines.append(f"gravity = {str(e.machine.arm.hangs).lower()}")
        lines += ["", "[columns]", 'time = "t"']
        for key in ("q", "tau", "dq", "q_ref"):
            names = [name for name in table if name == key or (name[:-1] == key and name[-1] in "123")]
            lines += [f"{key} = {json.dumps(names)}"] if names else []
        names = [name for name in table if name[0] == "y"]
        lines += [f"regressor = {json.dumps(names)}"] if names else []
        lines += ['rigid = "tau_rigid"'] if "tau_rigid" in table else []
        lines += [f'{key} = "{key}"' for key in ("run", "split") if key in table]
        units = {"q_other": "rad", "dq_other": "rad/s", "ddq_other": "rad/s^2"}
        units = {name: unit for name, unit in units.items() if name in table}
        units |= {name: unit for name, (_, unit) in self.signals.items()}
        if units:
            lines.append("other = { " + ", ".join(f'{name} = "{unit}"' for name, unit in units.items()) + " }")
        if e.logger.degrees:
            lines += ["", "[units]", 'q = "deg"'] + (['q_ref = "deg"'] if e.logger.writes_reference else [])
        return "\n".join(lines) + "\n"

    def write(self, folder: Path | str) -> None:
        """data.csv, data.toml, truth.json."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        table = self.table()
        words = {"run": "%d", "split": "%s", "t": "%.5f"}
        formats = [words.get(name, "%.9g") for name in table]
        columns = [np.where(x, "test", "train") if name == "split" else x for name, x in table.items()]
        with (folder / "data.csv").open("w", encoding="utf-8") as file:
            file.write(",".join(table) + "\n")
            line = ",".join(formats) + "\n"
            file.writelines(line % row for row in zip(*columns))
        (folder / "data.toml").write_text(self.description(), encoding="utf-8")
        (folder / "truth.json").write_text(json.dumps(self.truth, indent=1), encoding="utf-8")
