"""The two-sided verdict for any delay law: `python -m tests.benchmarks.any_delay [SET ...] [--out DIR]`.

Equal sides at q = 0, gravity compensated, no friction and no viscosity of the arm, K = 0.25 N/m, B = 0.09 N s/m, forces
held over 1 ms. One row a set: delay-sum condition, certificate (independent laws; proven), destroying law (the same
law both ways), boundary of constant delays, gap, processor seconds of law and certificates together.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from cosim.analysis.any_delay import symmetric_verdict
from cosim.analysis.certificate import save
from cosim.analysis.criteria import closed_form
from cosim.analysis.sampled_loop import TipSide
from cosim.arm.dynamics import tip_inertia
from cosim.arm.parameters import parameter_set

SETS = ("segment", "piecewise", "UR", "GCW", "FS", "USD", "USD+GCW")
STIFFNESS, DAMPING, STEP, LIMIT = 0.25, 0.09, 0.001, 0.6


def masses(name: str) -> np.ndarray:
    """Tip masses [kg] along the principal axes of J M^-1 J^T at q = 0, heaviest first; isotropic gains decouple."""
    return 1.0 / np.linalg.eigvalsh(tip_inertia(parameter_set(name).pi, np.zeros(3)))


def row(name: str, out: Path | None) -> str:
    tips = masses(name)
    began = time.process_time()
    verdict = symmetric_verdict([TipSide(m, STIFFNESS, DAMPING) for m in tips], STEP, LIMIT)
    seconds = time.process_time() - began
    constant = min(closed_form(m, STIFFNESS, DAMPING) for m in tips)
    if out is not None and verdict.destroying is not None:
        out.mkdir(parents=True, exist_ok=True)
        save(verdict.certificates, out / f"{name}-certificate.json")
        trace = verdict.destroying.trace(20.0)
        np.savetxt(out / f"{name}-destroying.csv", trace, "%.3f", ",", header="time,delay_lr,delay_rl", comments="")
    rate = verdict.destroying.growth_rate if verdict.destroying is not None else np.nan
    weights = "/".join(f"{1e3 * m:.0f}" for m in tips)
    return (
        f"| {name} | {weights} | {DAMPING / STIFFNESS:.3f} | {verdict.certified:.3f} | {verdict.destroyed_at:.3f} "
        f"({rate:+.4f}) | {constant:.3f} | {verdict.gap_percent:.1f} | {seconds:.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sets", nargs="*", default=SETS)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    print("| set | masses [g] | delay sum [s] | certificate | destroying (rate [1/s]) | constant | gap [%] | cpu [s] |")
    print("|---|---|---|---|---|---|---|---|")
    for name in options.sets:
        print(row(name, options.out), flush=True)


if __name__ == "__main__":
    main()
