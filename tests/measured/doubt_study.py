"""Each doubt put into clean recordings at three strengths, in two kinds of forms: share found, share repaired, share of
intervals that are withheld, coverage of the others; and the doubts that clean recordings raise.

    python -m tests.measured.doubt_study [SEEDS] [CLEAN]      (200 1000: the whole study, hours)

Prints the tables of cosim/measured/README.md. `found`: recordings with a doubt of a kind that is right for the fault,
or a message that refuses them. `no interval`: share of the parameters, those of refused recordings included.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from attrs import frozen

import cosim
from cosim.errors import InputError
from tests.support.axis_rig import FAULTS, OTHER_FORMS, STRENGTHS, TRUTH, AxisLog, recorded

EXPECTED = {
    "dropout": ("jump", "hole", "missing", "frozen", "sentinel", "gap"),
    "spike": ("jump",),
    "overflow": ("overflow", "wrap"),
    "sentinel": ("sentinel",),
    "clipped": ("clipped",),
    "soft limit": ("clipped", "bent"),
    "held samples": ("held samples",),
    "arrival": ("stamps of arrival",),
    "bursts": ("stamps of arrival",),
    "clock set back": ("clock set back",),
    "clock": ("clock set back", "clock set forward", "stamps of arrival", "gap"),
    "repeated block": ("repeated block",),
    "degrees": ("unit",),
    "swapped": ("swapped",),
    "filter": ("filtered", "lag"),
}
HARMLESS = {"outside"}
"""Kinds that say something of the split into fitted and held-out rows, not of the recording."""
TOLERANCE = 0.02  # of the inertia: "repaired"


@frozen
class Trial:
    """One recording: whether it was refused, kinds of its doubts, the inertia; whether each true value lies in its
    interval, None where that was withheld.
    """

    refused: bool
    doubts: tuple[str, ...] = ()
    inertia: float = np.nan
    covered: tuple[bool | None, ...] = ()


def trial(table: AxisLog, folder: Path) -> Trial:
    """Write, read and identify one recording."""
    try:
        result = cosim.identify(table.write(folder / "x.csv")).to_dict()
    except InputError:
        return Trial(True)
    found = {p["name"]: p for p in result["parameters"]}
    kinds = tuple(doubt["kind"] for doubt in result["doubts"] if doubt["kind"] not in HARMLESS)
    covered = tuple(_inside(found[name]["interval"], value) for name, value in TRUTH.items())
    return Trial(False, kinds, found["inertia"]["value"], covered)


def _inside(interval: list[float | None], value: float) -> bool | None:
    low, high = interval
    return None if low is None or high is None else bool(low <= value <= high)


def row(fault: str, change: Callable[[AxisLog, float], AxisLog], strength: float, seeds: int, folder: Path) -> str:
    """One line of the table."""
    results = [trial(change(recorded(seed), strength), folder) for seed in range(seeds)]
    used = [r for r in results if not r.refused]
    values = [c for r in used for c in r.covered]
    told = [c for c in values if c is not None]
    found = sum(r.refused or any(kind in EXPECTED[fault] for kind in r.doubts) for r in results)
    shares = [
        found / seeds,
        sum(abs(r.inertia / TRUTH["inertia"] - 1) < TOLERANCE for r in used) / seeds,
        1 - len(told) / (len(TRUTH) * seeds),
    ]
    last = f"{100 * np.mean(told):.0f} %" if told else "none given"
    return f"| {fault} | {strength:g} | " + " | ".join(f"{100 * s:.0f} %" for s in shares) + f" | {last} |"


def clean(count: int, folder: Path) -> str:
    """How many clean recordings raise a doubt, and which."""
    results = [trial(recorded(10_000 + seed), folder) for seed in range(count)]
    alarms = [kind for r in results for kind in set(r.doubts)]
    raised = sum(bool(r.doubts) or r.refused for r in results)
    covered = np.mean([c for r in results for c in r.covered if c is not None])
    kinds = ", ".join(f"{k} {alarms.count(k)}" for k in dict.fromkeys(alarms)) or "none"
    return f"clean: {raised} of {count} raise a doubt ({kinds}); coverage {100 * covered:.1f} %"


HEADER = "| fault | strength | found | inertia within 2 % | no interval | true values in the others |"


def main(seeds: int = 20, count: int = 100) -> None:
    with tempfile.TemporaryDirectory() as name:
        for title, faults in (("the forms of the tests", FAULTS), ("other forms", OTHER_FORMS)):
            print(f"\n{title}, {seeds} seeds\n\n{HEADER}\n|---|---|---|---|---|---|")
            for fault, change in faults.items():
                for strength in STRENGTHS:
                    print(row(fault, change, strength, seeds, Path(name)), flush=True)
        print("\n" + clean(count, Path(name)))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
