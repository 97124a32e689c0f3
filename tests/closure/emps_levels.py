"""What the free simulation of EMPS's test pulses tells:  python -m tests.closure.emps_levels [--refine]

1. The two levels of friction (offset, Coulomb) of each quarter of both files, with the FMU that `close-loop` wrote:
   within the training file they wander by tenths of a newton, on the test file Coulomb friction is a newton higher.
2. The free simulation of the test pulses with the Coulomb level moved by so much: what any fit to the training file
   gets there is decided by how its level errs.
3. --refine (two minutes): coefficients refined by simulation, starting from the torque fit: free simulations of
   stretches of the training file that are left out, by the weight of a simulated sample beside a row of torque, and
   what each would give on the test file, which chooses nothing.
"""

import argparse
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path

import numpy as np
from attrs import evolve

from cosim.closure.closure import Closure
from cosim.closure.drive import JointDrive, StartValues
from cosim.closure.fitted import start_values, without
from cosim.closure.model.model import Model
from cosim.closure.replay import without_hold
from cosim.closure.score.errors import torque_error
from cosim.closure.simulation import DrivenRun, driven, shifted
from cosim.closure.table import _blocks, _stretches
from tests.closure.real_data import emps
from tests.support.paths import SHARED

WEIGHTS = (0.0, 0.1, 1.0, 10.0)
THIN = 20  # simulated samples of which one counts
STEPS = 2  # Gauss-Newton
MOVED = (-0.5, 0.0, 0.25, 0.5, 0.75, 1.0, 1.5)  # N


def rms(error: np.ndarray | None) -> float:
    """In millimetres; nan for a model that ran away."""
    return float("nan") if error is None else 1e3 * float(np.sqrt(np.mean(error**2)))


def levels(found: Closure) -> None:
    """Of each quarter; then the test file with levels moved."""
    values = without_hold(found.values_after, 1e-3)
    for run in found.recording.runs:
        for a, b in pairwise(np.linspace(0, len(run), 5).astype(int)):
            with driven(JointDrive(), run.part(slice(a, b))) as free:
                x = free.levelled(values)
            assert x is not None
            told = f"offset {x.levels[0]:+.2f} N  Coulomb {x.levels[1]:+.2f} N  left {rms(x.error):.2f} mm"
            print(f"{run.name:18s} {a / 1e3:6.1f} s  {told}")
    with driven(JointDrive(), found.recording.runs[-1]) as free:
        for side, start in (("before", found.values_before), ("after", found.values_after)):
            values = without_hold(start, 1e-3)
            moved = {d: rms(free.error(shifted(values, 0.0, d))) for d in MOVED}
            told = ", ".join(f"{d:+g} N {e:.2f} mm" for d, e in moved.items())
            print(f"test pulses, {side}, Coulomb moved by: {told}")


def with_coefficients(model: Model, beta: np.ndarray) -> Model:
    """The model with other coefficients (p,) than its fit gave."""
    new = evolve(model)
    new.fit = evolve(model.fit, beta=beta)
    return new


def refined(
    model: Model,
    blocks: np.ndarray,
    values: Callable[[Model], StartValues],
    runs: Sequence[DrivenRun],
    weight: float,
) -> Model:
    """Torque rows but for some blocks (T,) as a quadratic about their fit, and simulated samples beside them, each run
    with its own levels.
    """
    model = without(model, blocks)
    start, seen = model.fit.beta, model.fit.weight[: len(blocks)] * ~blocks[:, None]
    g = np.einsum("bjpq,bj->pq", model.gram.g[: len(seen)], seen)
    scale = 1 / np.sqrt(np.diag(g) * (1 + model.fit.penalty))
    h = g * scale[:, None] * scale + np.diag(model.fit.penalty)

    def errors(x: np.ndarray) -> list[np.ndarray]:
        found = [run.error(values(with_coefficients(model, start + scale * x))) for run in runs]
        return [np.full(len(run.run), np.nan) if e is None else e[:, 0] for e, run in zip(found, runs, strict=True)]

    own = [k for k, label in enumerate(model.labels) if label.name in ("torque_offset", "coulomb")]
    x, size = np.zeros(len(start)), None
    for _ in range(STEPS if weight else 0):
        base = errors(x)
        moved = [errors(x + 0.2 * unit) for unit in np.eye(len(x))]
        normal, slope = h.copy(), -h @ x
        for k, e in enumerate(base):
            slopes = np.stack([(m[k] - e) / 0.2 for m in moved], axis=1)
            plane = np.linalg.qr(slopes[:, own])[0]
            rest, turned = e - plane @ (plane.T @ e), slopes - plane @ (plane.T @ slopes)
            size = size or float(np.sqrt(np.mean(rest**2)))
            normal += weight / size**2 * turned[::THIN].T @ turned[::THIN]
            slope -= weight / size**2 * turned[::THIN].T @ rest[::THIN]
        x = x + np.linalg.solve(normal, slope)
    return with_coefficients(model, start + scale * x)


def refinement(found: Closure) -> None:
    assert found.table is not None and found.before is not None
    model, recording = found.table.model, found.recording

    def values(changed: Model) -> StartValues:
        return without_hold(start_values(recording, changed), 1e-3)

    with ExitStack() as stack:
        parts = _stretches(recording)
        runs = [stack.enter_context(driven(JointDrive(), recording.runs[k].part(slice(a, b)))) for k, a, b in parts]
        test = stack.enter_context(driven(JointDrive(), recording.runs[-1]))
        for weight in WEIGHTS:
            left, plain = [], []
            for number, (part, run) in enumerate(zip(parts, runs, strict=True)):
                others = [other for k, other in enumerate(runs) if k != number]
                fitted = refined(model, _blocks(model, *part), values, others, weight)
                x = run.levelled(values(fitted))
                left.append(rms(None if x is None else x.error))
                plain.append(rms(run.error(values(fitted))))
            whole = refined(model, np.zeros(model.setting.rows.train_blocks, bool), values, runs, weight)
            error = torque_error(found.before, whole)
            both = " ".join(f"{a:.2f}/{b:.2f}" for a, b in zip(left, plain, strict=True))
            print(f"weight {weight:g}: left out, own levels/as they are [mm] {both}; torque", end=" ")
            print(f"fitted {error.fitted_after[0]:.2f} %, report {error.after[0]:.2f} %;", end=" ")
            print(f"test pulses {rms(test.error(values(whole))):.2f} mm", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--refine", action="store_true")
    parser.add_argument("--data", type=Path, default=SHARED)
    options = parser.parse_args()
    found = emps(options.data)
    levels(found)
    if options.refine:
        refinement(found)


if __name__ == "__main__":
    main()
