"""The two-sided verdict for any delay law: `python -m tests.benchmarks.any_delay [NAME ...] [--out DIR]`.

The seven parameter sets with equal sides at q = 0, gravity compensated, no friction and no viscosity of the arm,
K = 0.25 N/m, B = 0.09 N s/m at 1 kHz; the same coupling with a soft hand on the local arm; and with a soft wall at the
remote arm as well. One row a loop: delay-sum condition, certificate (independent ways, equal ones are among them;
checked again from its file by the second command, with the scenario), destroying law of equal and of independent ways,
the rate at which the one of the smaller bound grows in the FMUs, boundary of constant delays, gap, processor seconds.
"""

import argparse
import tempfile
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
WALL = {"environment.stiffness": 0.03, "environment.damping": 0.01}
AWAY, INSIDE = -1.0, 0.012
"""Where the wall stands [m]: far away, or so that the remote tip starts this deep in it, and stays in."""
SOFT = {
    "controller_*.stiffness": 0.25,
    "controller_*.damping": 0.09,
    "arm_*.viscous": 0.0,
    "arm_*.coulomb": 0.0,
    "arm_*.q_start": 0.0,
    "channel_*.delay_mean": 0.3,
    "experiment.stop": 40.0,
}


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


def row(name: str, out: Path) -> str:
    """One row of the table; the files stay in `out`."""
    scenario, began = loop(name), time.process_time()
    found = cosim.stability(scenario, any_delay=True)
    folder = found.save(out / name.replace(" ", "-"), report=False)
    said = found.to_dict()
    verdict, sum_ = said["any_delay"], said["delay_sum"]
    checked = "-"
    if (folder / "certificate.json").is_file():
        checked = "yes" if cosim.verify(folder / "certificate.json", scenario).holds else "NO"
    seconds = time.process_time() - began
    linear, replay = verdict["linear"], verdict["replay"] or {}
    laws = [f"{(linear[kind] or {}).get('destroying') or float('nan'):.3f}" for kind in ("equal", "independent")]
    grown = f"{verdict['destroying'] or float('nan'):.3f} ({replay.get('growth_rate') or float('nan'):+.5f})"
    return (
        f"| {name} | {(sum_ or {}).get('max_delay') or 0.0:.3f} | {verdict['certificate'] or float('nan'):.3f} "
        f"| {checked} | {laws[0]} | {laws[1]} | {grown} | {verdict['constant_delay'] or float('nan'):.3f} "
        f"| {verdict['gap_percent'] or float('nan'):.1f} | {seconds:.0f} |"
        + "".join(f" {key}: {why}" for key, why in verdict["withheld"].items())
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=(*SETS, "hand", "hand and wall"))
    parser.add_argument("--out", type=Path, help="keep certificates and traces here")
    options = parser.parse_args()
    print(
        "| loop | delay sum [s] | certificate [s] | verified | destroys, equal ways [s] | independent [s] "
        "| grows in the FMUs [s] (1/s) | constant delay [s] | gap [%] | cpu [s] |\n" + "|---" * 10 + "|"
    )
    with tempfile.TemporaryDirectory() as scratch:
        for name in options.names:
            print(row(name, options.out or Path(scratch)), flush=True)


if __name__ == "__main__":
    main()
