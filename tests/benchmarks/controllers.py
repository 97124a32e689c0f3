"""Tables of cosim/sweeps/CONTROLLERS.md: `python -m tests.benchmarks.controllers FOLDER`.

Stability from the sweep `controllers`, which goes on in FOLDER or is there already. What the hand feels from runs of
its own, 50 ms constant delay each way, segment arms: free motion of 15 mm at 0.5 Hz, and 30 mm into the hard wall.
"""

import sys
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

import cosim

SWEEP = Path(cosim.__file__).parent / "sweeps" / "shipped" / "controllers.toml"
BANDS = (0.05, 0.1, 0.2, 0.5, 1.0)
FREQUENCY, HELD = 0.5, 12.0  # Hz; s of free motion, of which the last two periods are looked at
FREE = {
    "arm_r.contact_stiffness": 0.0,
    "arm_r.contact_damping": 0.0,
    "operator.reference": [0.0, 0.076956, 0.056598],
    "operator.reference_amplitude": [0.015, 0.0, 0.0],
    "operator.reference_frequency": FREQUENCY,
    "operator.hand_stiffness": 2000.0,
}
WALL = 0.015  # m
HEADS = (
    "damping felt, N s/m",
    "spring (+) or inertia (-) felt at 0.5 Hz, N/m",
    "tips apart, mm RMS",
    "hand's force / wall's",
    "stiffness felt, N/m",
)


def controllers() -> dict[str, Mapping[str, object]]:
    """Values of each choice of the sweep's first axis, by its label."""
    axes = tomllib.loads(SWEEP.read_text(encoding="utf-8"))["axes"]
    return {choice["label"]: choice["set"] for choice in axes[0]["choices"]}


def column(result: cosim.RunResult, name: str) -> np.ndarray:
    """The x axis of a signal, (n,)."""
    return np.asarray(result[name])[:, 0]


def run(values: Mapping[str, object], stop: float) -> cosim.RunResult:
    """The scenario with a controller at 50 ms each way."""
    given = {"channel_*.delay_mean": 0.05, "arm_*.viscous": 0.0, "arm_*.coulomb": 0.0, "experiment.stop": stop}
    return cosim.run(cosim.load("controllers").with_values(given | {"experiment.record_every": 1} | dict(values)))


def in_the_hand(values: Mapping[str, object]) -> tuple[float, float, float]:
    """Free motion along x: the grip's force in phase with velocity [N s/m] and with position [N/m], and the RMS
    distance of the tips [mm]; NaN where the last two periods differ by more than a twentieth.
    """
    result = run(dict(values) | FREE, HELD)
    last = result.time > HELD - 2.0 / FREQUENCY
    x, v, force = (column(result, name)[last] for name in ("arm_l.x", "arm_l.dx", "operator.f"))
    one, two = np.array_split(x[: len(x) // 2 * 2], 2)
    if np.abs(one - two).max() > 0.05 * np.abs(x).max():
        return np.nan, np.nan, np.nan
    spring, damping, _ = np.linalg.lstsq(np.column_stack([x, v, np.ones_like(x)]), force, rcond=None)[0]
    apart = 1e3 * np.sqrt(np.mean((x - column(result, "arm_r.x")[last]) ** 2))
    return float(damping), float(spring), float(apart)


def at_the_wall(values: Mapping[str, object]) -> tuple[float, float]:
    """Pressed against the hard wall: the hand's force over the wall's, and the stiffness that the hand feels [N/m]; NaN
    where the force has not come to rest within a twentieth.
    """
    result = run(values, 8.0)
    last = result.time > 7.0
    force = column(result, "operator.f")[last]
    if np.ptp(force) > 0.05 * np.abs(force).max():
        return np.nan, np.nan
    wall, x = (column(result, name)[last].mean() for name in ("arm_r.f_contact", "arm_l.x"))
    return float(-force.mean() / wall), float(force.mean() / (x - WALL))


Table = dict[str, list[str]]
"""Cells by the label of their row."""


def judged(folder: str) -> list[dict[str, str]]:
    """The sweep's points, computed where they are not yet in `folder`: their choices, the band of the longest delay,
    the verdict.
    """
    rows = cosim.sweep("controllers", folder=folder, progress=print).to_dataframe().to_dict("records")
    said = {"converged": "stable", "bounded": "stable", "inconclusive": "open", "failed": "open"}
    return [
        {str(k): str(v) for k, v in row.items()}
        | {"verdict": said.get(row["outcome"], "unstable"), "band": band(float(row["delay"]))}
        for row in rows
    ]


def band(delay: float) -> str:
    """The band of a delay, by its upper end."""
    return f"to {next(b for b in BANDS if delay <= b):g} s"


def markdown(heads: Sequence[str], table: Table) -> str:
    """A table in Markdown."""
    rows = [["controller", *heads], ["---"] * (len(heads) + 1), *([label, *cells] for label, cells in table.items())]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def shares(points: Sequence[Mapping[str, str]], by: str) -> str:
    """Stable points of those decided, and those left open, for each controller and entry of `by`: `7/8 +2`."""
    heads = [f"to {b:g} s" for b in BANDS] if by == "band" else sorted({p[by] for p in points})
    count = Counter((p["controller"], p[by], p["verdict"]) for p in points)

    def cell(label: str, entry: str) -> str:
        stable, unstable, left = (count[label, entry, verdict] for verdict in ("stable", "unstable", "open"))
        return f"{stable}/{stable + unstable}{f' +{left}' if left else ''}"

    return markdown(heads, {label: [cell(label, entry) for entry in heads] for label in controllers()})


def figures(values: Mapping[str, object]) -> list[str]:
    """What the hand feels of a controller, as text."""
    formats = (".2f", ".1f", ".1f", ".2f", ".0f")
    found = (*in_the_hand(values), *at_the_wall(values))
    return [format(v, f) if np.isfinite(v) else "no rest" for v, f in zip(found, formats)]


def main(folder: str) -> None:
    """Print every table of the page."""
    points = judged(folder)
    for by in ("band", "surroundings", "law", "set"):
        print(shares(points, by), "\n")
    print(markdown(HEADS, {label: figures(values) for label, values in controllers().items()}))


if __name__ == "__main__":
    main(sys.argv[1])
