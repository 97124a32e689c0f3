"""Tables of cosim/sweeps/CONTROLLERS.md: `python -m tests.benchmarks.controllers FOLDER`.

Stability from the sweep `controllers`, which goes on in FOLDER or is there already. What the hand feels from runs of
its own, 50 ms constant delay each way, segment arms: free motion of 15 mm at 0.5 Hz, and 30 mm into the hard wall.
"""

import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

import cosim

SWEEP = Path(cosim.__file__).parent / "sweeps" / "shipped" / "controllers.toml"
BANDS = (0.005, 0.05, 0.1, 0.2, 0.5, 1.0)
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
    distance of the tips [mm].
    """
    result = run(dict(values) | FREE, HELD)
    last = result.time > HELD - 2.0 / FREQUENCY
    x, v, force = (column(result, name)[last] for name in ("arm_l.x", "arm_l.dx", "operator.f"))
    spring, damping, _ = np.linalg.lstsq(np.column_stack([x, v, np.ones_like(x)]), force, rcond=None)[0]
    apart = 1e3 * np.sqrt(np.mean((x - column(result, "arm_r.x")[last]) ** 2))
    return float(damping), float(spring), float(apart)


def at_the_wall(values: Mapping[str, object]) -> tuple[float, float]:
    """Pressed against the hard wall: the hand's force over the wall's, and the stiffness that the hand feels [N/m]."""
    result = run(values, 8.0)
    last = result.time > 7.0
    hand, wall, x = (column(result, name)[last].mean() for name in ("operator.f", "arm_r.f_contact", "arm_l.x"))
    return (float(-hand / wall) if wall else float("nan")), float(hand / (x - WALL))


def stable(folder: str) -> pd.DataFrame:
    """The sweep's table, computed where it is not yet in `folder`, with `stable` and the band of the longest delay."""
    table = cosim.sweep("controllers", folder=folder, progress=print).to_dataframe()
    table["stable"] = table["outcome"].isin(["converged", "bounded"])
    table["band"] = pd.cut(table["delay"], BANDS, labels=[f"to {b:g} s" for b in BANDS[1:]])
    return table


def markdown(table: pd.DataFrame) -> str:
    """A table in Markdown, its index first."""
    heads = ["controller", *map(str, table.columns)]
    rows = [[str(index), *map(str, row)] for index, row in zip(table.index, table.to_numpy())]
    return "\n".join("| " + " | ".join(row) + " |" for row in (heads, ["---"] * len(heads), *rows))


def shares(table: pd.DataFrame, by: str) -> pd.DataFrame:
    """Stable points of all, for each controller and entry of `by`."""
    counted = table.groupby(["controller", by], observed=False)["stable"].agg(["sum", "count"])
    return counted.apply(lambda r: f"{r['sum']:.0f}/{r['count']:.0f}", axis=1).unstack(by)


def main(folder: str) -> None:
    """Print every table of the page."""
    table, known = stable(folder), controllers()
    for by in ("band", "surroundings", "law", "set"):
        print(markdown(shares(table, by).loc[list(known)]), "\n")
    felt = [[*in_the_hand(values), *at_the_wall(values)] for values in known.values()]
    figures = [[f"{d:.2f}", f"{k:.1f}", f"{apart:.1f}", f"{share:.2f}", f"{s:.0f}"] for d, k, apart, share, s in felt]
    print(markdown(pd.DataFrame(figures, list(known), list(HEADS))))


if __name__ == "__main__":
    main(sys.argv[1])
