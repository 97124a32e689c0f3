"""The Staubli TX40 entered whole as device "robot": all six joints identified together, beside published figures.

    python -m tests.identification.tx40 [FOLDER] [--close-loop]

With --close-loop also what the six joints together lack (half a minute). FOLDER holds the full recording (default:
shared/data beside the checkout).

Its arm is a table of published lengths: Craig's Denavit-Hartenberg rows of the TX40, as the joints' origins in
tx40_mdh_modified.urdf of FIGAROH have them (github.com/thanhndv212/figaroh-plus; its authors published this recording),
and but for the zeros of two joints as `CATALOGUE`, another author's, has them. No masses are taken; those of the table
only make M positive definite, and the fit does not look at them.

The wrist's motors stay out of what a chain of joints can be: motor 6 turns with q5 + q6, and nearly all of its friction
follows that sum (published: fvm6, fsm6), which no friction of joint 5 or joint 6 alone does. Their errors say so.
"""

import argparse
import csv
import json
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

import cosim
from cosim.arm.serial import JointKind, SerialModel, turn
from tests.support.paths import SHARED
from tests.support.urdf_text import urdf_text

_RIGHT = 0.5 * np.pi
LENGTHS = (
    (0.0, 0.0, 0.0),
    (0.0, -_RIGHT, 0.0),
    (0.225, 0.0, 0.035),
    (0.0, _RIGHT, 0.225),
    (0.0, -_RIGHT, 0.0),
    (0.0, _RIGHT, 0.0),
)
"""a [m], alpha [rad], d [m] of the six joints."""
CATALOGUE = (
    (0.0, 0.0, 0.0, 0.0),
    (0.0, -_RIGHT, 0.035, -_RIGHT),
    (0.225, 0.0, 0.0, -_RIGHT),
    (0.0, -_RIGHT, 0.225, 0.0),
    (0.0, _RIGHT, 0.0, 0.0),
    (0.0, -_RIGHT, 0.065, 2 * _RIGHT),
)
"""a [m], alpha [rad], d [m], theta at q = 0 [rad] of Staubli_TX40 in the package robotkinematicscatalogue 1.1.2 (PyPI),
from the shoulder on; q2 and q3 count from where the arm stands upright.
"""
PUBLISHED = {"viscous": "fv", "coulomb": "fs", "offset": "offset", "rotor": "Ia"}
"""Our parameters of a joint, and what dataset.json calls them."""
EVERY = 10  # samples of 5 kHz, behind a low-pass
EDGE = 25  # rows at either end that the low-pass reaches beyond
JOINTS = 6


def arm() -> SerialModel:
    """The lengths, and bodies of 1 kg."""
    none, wide = np.zeros(JOINTS), np.full(JOINTS, 10.0)
    a, alpha, d = np.array(LENGTHS).T
    return SerialModel(
        name="tx40",
        joints=[f"j{k + 1}" for k in range(JOINTS)],
        kinds=[JointKind.REVOLUTE] * JOINTS,
        rotation=[turn((angle, 0.0, 0.0)) for angle in alpha],
        origin=np.stack([a, -np.sin(alpha) * d, np.cos(alpha) * d], axis=1),
        axis=np.tile((0.0, 0.0, 1.0), (JOINTS, 1)),
        mass=none + 1.0,
        centre=np.zeros((JOINTS, 3)),
        inertia=np.tile(0.01 * np.eye(3), (JOINTS, 1, 1)),
        lower=-wide,
        upper=wide,
        effort=100 * wide,
        speed=wide,
        viscous=none,
        coulomb=none,
        armature=none,
        tip=(0.0, 0.0, 0.065),
    )


def at_the_joints(folder: Path, kinematics: Mapping[str, list[float]]) -> dict[str, np.ndarray]:
    """Columns time, q1.., tau1.. of the joints, of what motors showed: ratios, the wrist's coupling, the zeros.

    q_m6 = 32 (q6 + q5), so that motor 6 works on joint 5 too.
    """
    from scipy.signal import decimate

    table = np.loadtxt(folder / "tx40_5khz.csv", delimiter=",", skiprows=1)
    table = np.column_stack([table[::EVERY, 0], decimate(table[:, 1:], EVERY, ftype="fir", axis=0)])[EDGE:-EDGE]
    ratio = np.array(kinematics["reduction"])
    q, tau = table[:, 1:7] / ratio, table[:, 7:] * ratio
    q[:, 5] -= q[:, 4]
    tau[:, 4] += tau[:, 5]
    q[:, 1] -= _RIGHT
    q[:, 2] += _RIGHT
    names = [f"{role}{k + 1}" for role in ("q", "tau") for k in range(JOINTS)]
    return {"time": table[:, 0], **dict(zip(names, np.hstack([q, tau]).T, strict=True))}


def entered(source: Path, folder: Path) -> Path:
    """tx40.urdf, tx40.csv and tx40.toml in a folder, of the recording in `source`; the path of tx40.csv."""
    (folder / "tx40.urdf").write_text(urdf_text(arm()), encoding="utf-8")
    columns = at_the_joints(source, json.loads((source / "dataset.json").read_text(encoding="utf-8"))["kinematics"])
    with (folder / "tx40.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(np.column_stack(list(columns.values())).tolist())
    lists = "\n".join(f"{role} = {[f'{role}{k + 1}' for k in range(JOINTS)]}" for role in ("q", "tau"))
    text = f'device = "robot"\nurdf = "tx40.urdf"\n[columns]\ntime = "time"\n{lists}\n'
    (folder / "tx40.toml").write_text(text.replace("'", '"'), encoding="utf-8")
    return folder / "tx40.csv"


def main() -> None:
    """Identify, print beside the published figures, close the loop where that is asked."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("folder", type=Path, nargs="?", default=SHARED)
    words.add_argument("--close-loop", action="store_true")
    options = words.parse_args()
    source = options.folder / "staubli_tx40"
    published = json.loads((source / "dataset.json").read_text(encoding="utf-8"))["published"]
    with tempfile.TemporaryDirectory() as name:
        file = entered(source, Path(name))
        found = cosim.identify(file)
        closed = cosim.close_loop(file) if options.close_loop else ""
    told = found.to_dict()
    print(found)
    print("held out, RMS% by joint:", ", ".join(f"{value:.3g}" for value in told["rms_percent"]["held_out"]))
    values = {p["name"]: p for p in told["parameters"]}
    print("| joint | viscous | published | Coulomb | published | offset | published | rotor | published |")
    print("|---|---|---|---|---|---|---|---|---|")
    for k in range(JOINTS):
        cells = []
        for ours, theirs in PUBLISHED.items():
            p = values.get(f"{ours}[{k + 1}]")
            ranged = p and f"{p['value']:.3g} ({p['interval'][0]:.3g} to {p['interval'][1]:.3g})"
            cells += [ranged or "grouped", f"{published[theirs][k]:.3g}"]
        print(f"| {k + 1} | {' | '.join(cells)} |")
    print(closed)


if __name__ == "__main__":
    main()
