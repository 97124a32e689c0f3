"""Cuts the excerpts in this folder out of the shared measured data: python tests/data/excerpts.py SHARED_DATA_FOLDER.

Cable tool: means of ten rows, 50 Hz left. Pendulum gravity_comp: every tenth row. TX40: five digits. Nothing else is
changed; the licence beside each file names its source.
"""

import csv
import sys
from pathlib import Path

HERE = Path(__file__).parent
TX40 = ("t_s", "run", "split", "q", "dq", "ddq", "tau", "dq_other")
CABLE = ("Tool_4_Maryland_L_2_20", "Tool_4_Maryland_L_2_23", "Tool_4_Maryland_L_2_41", "Tool_4_Maryland_R_5_20")


def main(shared: Path) -> None:
    wrist(shared / "residual_ready/staubli_tx40_j6.csv", 7)
    for name in CABLE:
        cable(shared / f"mis_tool_cable/{name}.csv")
    for name, every in (("gravity_comp", 10), ("ddp", 1)):
        pendulum(shared / f"dfki_pendulum_1dof/{name}.csv", every)


def wrist(source: Path, regressors: int) -> None:
    """A ready TX40 file to five digits, without the given rigid torque."""
    rows = table(source)
    names = [*TX40, *(f"y{k}" for k in range(regressors))]
    write(HERE / "staubli_tx40" / source.name, names, [[_short(row[name]) for name in names] for row in rows])


def _short(text: str) -> str:
    return text if text[:1].isalpha() else f"{float(text):.5g}"


def cable(source: Path) -> None:
    """Means of ten rows of a cable run, without the columns that are not needed."""
    names, rows = ["t_s", "q_in_rad", "tau_in_Nm", "tau_jaw_Nm", "q_jaw_rad", "q_spindle_rad"], table(source)
    blocks = [rows[k : k + 10] for k in range(0, len(rows) - 9, 10)]
    means = [[f"{sum(float(row[name]) for row in block) / 10:.7g}" for name in names] for block in blocks]
    write(HERE / "mis_tool_cable" / source.name, names, means)


def pendulum(source: Path, every: int) -> None:
    """Every n-th row of a pendulum run."""
    rows = table(source)[::every]
    write(HERE / "dfki_pendulum_1dof" / source.name, list(rows[0]), [list(row.values()) for row in rows])


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def write(path: Path, names: list[str], rows: list[list[str]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
