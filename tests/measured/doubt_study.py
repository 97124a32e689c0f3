"""Each doubt put into clean recordings at three strengths: share found, share repaired, coverage of the intervals; and
the doubts that clean recordings raise.   python -m tests.measured.doubt_study [SEEDS] [CLEAN]

Prints the table of cosim/measured/README.md. `found`: recordings with a doubt of a kind that is right for the fault, a
message that refuses them, or a warning that tells it. `repaired`: inertia within 2 % of the truth without a refusal.
`covered`: true values inside their 95 % intervals, of all parameters of the recordings that were not refused.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from attrs import frozen

from cosim.errors import InputError
from cosim.identification.identification import identify
from cosim.measured import read
from tests.support.axis_rig import FAULTS, STRENGTHS, TRUTH, AxisLog, recorded

EXPECTED = {
    "dropout": ("jump", "hole"),
    "spike": ("jump",),
    "overflow": ("overflow", "wrap"),
    "sentinel": ("sentinel",),
    "clipped": ("clipped",),
    "held samples": ("held samples",),
    "arrival": ("stamps of arrival",),
    "bursts": ("stamps of arrival",),
    "clock set back": ("clock set back",),
    "repeated block": ("repeated block",),
    "degrees": ("unit",),
    "swapped": ("swapped",),
    "filter": ("filtered",),
}
HARMLESS = {"outside"}
"""Kinds that say something of the split into fitted and held-out rows, not of the recording."""
TOLD = {"filter": "tau is late", "degrees": "degrees", "swapped": "swapped"}


@frozen
class Trial:
    """One recording: whether it was refused, its doubts, whether a fault was told, the inertia, the covered values."""

    refused: bool
    doubts: tuple[str, ...] = ()
    warnings: str = ""
    inertia: float = np.nan
    covered: tuple[bool, ...] = ()


def trial(table: AxisLog, folder: Path) -> Trial:
    """Write, read and identify one recording."""
    try:
        data = read([table.write(folder / "x.csv")])
        found = identify(data)
    except InputError as error:
        return Trial(True, warnings=str(error))
    intervals = {str(p.label): p for p in found.parameters}
    covered = tuple(
        bool(intervals[name].interval[0] <= value <= intervals[name].interval[1]) for name, value in TRUTH.items()
    )
    kinds = tuple(doubt.kind for doubt in data.doubts if doubt.kind not in HARMLESS)
    return Trial(False, kinds, " ".join(found.warnings), intervals["inertia"].value, covered)


def found(fault: str, result: Trial) -> bool:
    """Whether the fault was noticed."""
    told = fault in TOLD and TOLD[fault] in result.warnings
    return result.refused or told or any(kind in EXPECTED[fault] for kind in result.doubts)


def row(fault: str, strength: float, seeds: int, folder: Path) -> str:
    """One line of the table."""
    results = [trial(FAULTS[fault](recorded(seed), strength), folder) for seed in range(seeds)]
    used = [r for r in results if not r.refused]
    share = [
        sum(found(fault, r) for r in results) / seeds,
        sum(abs(r.inertia / TRUTH["inertia"] - 1) < 0.02 for r in used) / seeds,
        sum(r.refused for r in results) / seeds,
    ]
    covered = [c for r in used for c in r.covered]
    last = f"{100 * np.mean(covered):.0f} %" if covered else "none used"
    return f"| {fault} | {strength:g} | " + " | ".join(f"{100 * s:.0f} %" for s in share) + f" | {last} |"


def clean(count: int, folder: Path) -> str:
    """How many clean recordings raise a doubt, and which."""
    results = [trial(recorded(10_000 + seed), folder) for seed in range(count)]
    alarms = [kind for r in results for kind in set(r.doubts)]
    raised = sum(bool(r.doubts) or r.refused for r in results)
    covered = np.mean([c for r in results for c in r.covered])
    kinds = ", ".join(f"{k} {alarms.count(k)}" for k in dict.fromkeys(alarms)) or "none"
    return f"clean: {raised} of {count} raise a doubt ({kinds}); coverage {100 * covered:.1f} %"


def main(seeds: int = 20, count: int = 100) -> None:
    print("| fault | strength | found | inertia within 2 % | refused | covered |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        for fault in FAULTS:
            for strength in STRENGTHS:
                print(row(fault, strength, seeds, Path(name)), flush=True)
        print("\n" + clean(count, Path(name)))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
