"""The two-sided verdict for any delay law: `python -m tests.benchmarks.any_delay [NAME ...] [--out DIR]`.

The seven parameter sets with equal sides at q = 0, gravity compensated, no friction and no viscosity of the arm,
K = 0.25 N/m, B = 0.09 N s/m at 1 kHz; the same coupling with a soft hand on the local arm; and with a soft wall at the
remote arm as well. One row a loop: delay-sum condition, certificate (independent ways, equal ones are among them;
checked again from its file by the second command, with the scenario), destroying law of equal and of independent ways,
the one of the smaller bound that was seen to grow in the FMUs and its rate there, boundary of constant delays, gap,
processor seconds of the verdict and of the check. Each row stays in DIR (results/any-delay) with its files, and is not
made again where it is there.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

import cosim
from cosim.arm.kinematics import forward
from cosim.scenario import Scenario

SETS = ("segment", "piecewise", "UR", "GCW", "FS", "USD", "USD+GCW")
HAND = {
    "operator.hand_mass": 0.1,
    "operator.hand_stiffness": 0.1,
    "operator.hand_damping": 0.05,
    "operator.grip_stiffness": 20.0,
    "operator.grip_damping": 0.5,
    "operator.reference_amplitude": 0.0,
}
WALL = {"environment.stiffness": 0.03, "environment.damping": 0.01, "environment.parameters.normal": [0.0, 0.0, -1.0]}
AWAY, INSIDE = -1.0, 0.012
"""Where the wall stands [m]: far away, or so that the remote tip (at z = 0) starts this deep in it, and stays in."""
SOFT = {
    "controller_*.stiffness": 0.25,
    "controller_*.damping": 0.09,
    "arm_*.viscous": 0.0,
    "arm_*.coulomb": 0.0,
    "arm_*.q_start": 0.0,
    "channel_*.delay_mean": 0.3,
    "experiment.stop": 40.0,
}


HEAD = (
    "| loop | delay sum [s] | certificate [s] | verified | destroys, equal ways [s] | independent [s] "
    "| grows in the FMUs [s] | at [1/s] | constant delay [s] | gap [%] | cpu [s] | check [s] |"
)
CELLS = {
    "delay sum": ".3f", "certificate": ".3f", "verified": "", "equal": ".3f", "independent": ".3f",
    "destroying": ".3f", "growth": "+.5f", "constant": ".3f", "gap": ".1f", "cpu": ".0f", "cpu of verify": ".0f",
}  # fmt: skip


def paper_loop(name: str) -> Scenario:
    """The loop of the paper with both arms of one set, without hand and wall."""
    scenario = cosim.load("eq10-counterexample").with_values({"arm_*.parameter_set": name})
    return scenario.with_values({"channel_*.delay_mean": 0.3, "experiment.stop": 40.0})


def held_loop(offset: float) -> Scenario:
    """A soft hand leads the local arm of the set `segment`; the remote arm's wall stands at an offset."""
    rest = {"environment.offset": offset, "operator.reference": forward(np.zeros(3)).tolist()}
    return cosim.load("contact").with_values(HAND | WALL | SOFT | rest)


def loop(name: str) -> Scenario:
    """The scenario of a row."""
    if name == "hand":
        return held_loop(AWAY)
    return held_loop(INSIDE) if name == "hand and wall" else paper_loop(name)


def row(name: str, folder: Path) -> dict[str, object]:
    """One row of the table; certificate, trace and the scenario that plays it stay in the folder."""
    scenario, began = loop(name), time.process_time()
    found = cosim.stability(scenario, any_delay=True)
    found.save(folder, report=False)
    said, seconds = found.to_dict(), time.process_time() - began
    verdict, began = said["any_delay"], time.process_time()
    checked = None
    if (folder / "certificate.json").is_file():
        checked = cosim.verify(folder / "certificate.json", scenario).holds
    linear, replay = verdict["linear"], verdict["replay"] or {}
    return {
        "delay sum": (said["delay_sum"] or {}).get("max_delay"),
        "certificate": verdict["certificate"],
        "verified": checked,
        "equal": (linear["equal"] or {}).get("destroying"),
        "independent": (linear["independent"] or {}).get("destroying"),
        "destroying": verdict["destroying"],
        "growth": replay.get("growth_rate"),
        "constant": verdict["constant_delay"],
        "gap": verdict["gap_percent"],
        "cpu": seconds,
        "cpu of verify": time.process_time() - began,
        "withheld": verdict["withheld"],
    }


def kept(name: str, out: Path) -> dict[str, object]:
    """The row of a loop, read where an earlier run left it."""
    folder = out / name.replace(" ", "-")
    path = folder / "row.json"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(row(name, folder), indent=1), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def table(rows: dict[str, dict[str, object]]) -> str:
    """The rows in Markdown, and what was withheld below."""
    lines = [HEAD, "|---" * HEAD.count(" |") + "|"]
    for name, found in rows.items():
        cells = (f"{name} |", *(_cell(found[key], form) for key, form in CELLS.items()))
        lines.append("| " + " ".join(cells))
    notes = [f"{n}, {key}: {why}" for n, found in rows.items() for key, why in dict(found["withheld"]).items()]  # type: ignore[call-overload]
    return "\n".join([*lines, *notes])


def _cell(value: object, form: str) -> str:
    words = {None: "-", True: "yes", False: "NO"}
    return f"{words[value] if value is None or isinstance(value, bool) else format(value, form)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=(*SETS, "hand", "hand and wall"))
    parser.add_argument("--out", type=Path, default=Path("results/any-delay"), help="certificates, traces and rows")
    options = parser.parse_args()
    rows = {}
    for name in options.names:
        rows[name] = kept(name, options.out)
        print(name, json.dumps(rows[name]), flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
