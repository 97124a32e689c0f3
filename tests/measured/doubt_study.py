"""Each doubt put into clean recordings at three strengths, in two kinds of forms: share found, share repaired, share of
intervals that are withheld, coverage of the others; and the doubts that clean recordings raise.

    python -m tests.measured.doubt_study [SEEDS] [CLEAN] [--trials FILE]      (200 1000: the whole study, 25 minutes)

Prints the tables of cosim/measured/README.md. With a file of trials it may be stopped and goes on where it was: all
faults of one seed come before those of the next, so that what is there is a smaller study. `found`: recordings with a
doubt of a kind that is right for the fault, or a message that refuses them. `no interval`: share of the parameters,
those of refused recordings included. The recordings are NPZ files, which are read faster than text.
"""

import argparse
import json
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from attrs import asdict, field, frozen
from scipy.stats import beta

from cosim.errors import InputError
from cosim.identification.identification import Parameter, identify
from cosim.measured import read
from tests.support.axis_rig import DESCRIPTION, FAULTS, OTHER_FORMS, STRENGTHS, TRUTH, AxisLog, recorded

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
    "degrees": ("unit", "degrees"),
    "swapped": ("swapped", "exchanged"),
    "filter": ("filtered", "lag", "smeared"),
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


def trial(log: AxisLog, folder: Path) -> Trial:
    """Write, read and identify one recording."""
    path = folder / "x.npz"
    np.savez(path, t=log.t, q=log.q, tau=log.tau)
    path.with_suffix(".toml").write_text(DESCRIPTION)
    try:
        found = identify(read([path]))
    except InputError:
        return Trial(True)
    parameters = {str(p.label): p for p in found.parameters}
    kinds = tuple(doubt.kind for doubt in found.doubts if doubt.kind not in HARMLESS)
    covered = tuple(_inside(parameters[name], value) for name, value in TRUTH.items())
    return Trial(False, kinds, parameters["inertia"].value, covered)


def _inside(parameter: Parameter, value: float) -> bool | None:
    low, high = parameter.interval
    return bool(low <= value <= high) if np.isfinite([low, high]).all() else None


Kept = dict[tuple[str, str, float, int], Trial]


@frozen
class Trials:
    """Trials that were made, by form, fault, strength and seed; of clean recordings the fault is ""."""

    folder: Path
    file: Path | None = None
    made: Kept = field(factory=dict)

    def known(self) -> "Trials":
        """With those that the file holds."""
        for line in self.file.read_text().splitlines() if self.file and self.file.is_file() else ():
            key, values = json.loads(line)
            self.made[tuple(key)] = Trial(values["refused"], values["doubts"], values["inertia"], values["covered"])
        return self

    def of(
        self, form: str, fault: str, strength: float, seed: int, change: Callable[[AxisLog, float], AxisLog]
    ) -> Trial:
        """The trial, made where it is not known."""
        key = (form, fault, strength, seed)
        if key not in self.made:
            self.made[key] = trial(change(recorded(seed), strength), self.folder)
            if self.file is not None:
                with self.file.open("a") as file:
                    file.write(json.dumps([key, asdict(self.made[key])]) + "\n")
        return self.made[key]


def row(fault: str, strength: float, results: Sequence[Trial]) -> str:
    """One line of the table."""
    used = [r for r in results if not r.refused]
    values = [c for r in used for c in r.covered]
    told = [c for c in values if c is not None]
    found = sum(r.refused or any(kind in EXPECTED[fault] for kind in r.doubts) for r in results)
    shares = [
        found / len(results),
        sum(abs(r.inertia / TRUTH["inertia"] - 1) < TOLERANCE for r in used) / len(results),
        1 - len(told) / (len(TRUTH) * len(results)),
    ]
    last = f"{100 * np.mean(told):.1f} % of {len(told)}" if told else "none given"
    return f"| {fault} | {strength:g} | " + " | ".join(f"{100 * s:.0f} %" for s in shares) + f" | {last} |"


def clean(results: Sequence[Trial]) -> str:
    """How many clean recordings raise a doubt, and which."""
    alarms = [kind for r in results for kind in set(r.doubts)]
    raised = sum(bool(r.doubts) or r.refused for r in results)
    most = beta.ppf(0.95, raised + 1, len(results) - raised) if raised < len(results) else 1.0
    covered = np.mean([c for r in results for c in r.covered if c is not None])
    kinds = ", ".join(f"{k} {alarms.count(k)}" for k in dict.fromkeys(alarms)) or "none"
    return (
        f"clean: {raised} of {len(results)} raise a doubt ({kinds}), at most {100 * most:.2g} % with 95 %; "
        f"coverage {100 * covered:.1f} %"
    )


HEADER = "| fault | strength | found | inertia within 2 % | no interval | true values in the others |"
FORMS = {"the forms of the tests": FAULTS, "other forms": OTHER_FORMS}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("seeds", type=int, nargs="?", default=20)
    parser.add_argument("clean", type=int, nargs="?", default=100)
    parser.add_argument("--trials", type=Path, help="file of trials that were made, to go on from")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        trials = Trials(Path(name), options.trials).known()
        rows = [(form, *fault, strength) for form in FORMS for fault in FORMS[form].items() for strength in STRENGTHS]
        for seed in range(options.seeds):
            for form, fault, change, strength in rows:
                trials.of(form, fault, strength, seed, change)
        for form in FORMS:
            print(f"\n{form}, {options.seeds} seeds\n\n{HEADER}\n|---|---|---|---|---|---|")
            for _, fault, change, strength in (line for line in rows if line[0] == form):
                found = [trials.of(form, fault, strength, seed, change) for seed in range(options.seeds)]
                print(row(fault, strength, found), flush=True)
        seeds = range(10_000, 10_000 + options.clean)
        print("\n" + clean([trials.of("", "", 0.0, seed, lambda log, _: log) for seed in seeds]))


if __name__ == "__main__":
    main()
