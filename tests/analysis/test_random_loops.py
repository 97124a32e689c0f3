"""Loops with controllers at random: no printed guarantee, and no spectrum, is contradicted by the simulation.

`python -m tests.analysis.test_random_loops COUNT SEED` runs more of them.
"""

import sys

import numpy as np
import pytest

import cosim
from cosim.analysis.evidence import UNSTABLE
from cosim.scenario import Scenario
from tests.support.own_fmus import own_loop, remembering_controller, static_controller

NORMAL = 50
CLEAR = 0.02
"""Growth [1/s] from which a run of 12 s tells its sign."""


def random_loop(seed: int) -> Scenario:
    """Both sides at random: integrator, filter, lead, dead time, negative viscosity of the plant, delays, age."""
    rng = np.random.default_rng(seed)
    remembers = bool(rng.integers(4))
    values: dict[str, object] = {
        "experiment.stop": 12.0,
        "experiment.algorithm": str(rng.choice(["jacobi", "gauss-seidel"])),
        "channel_lr.delay_mean": round(float(rng.uniform(0.0, 0.4)), 3),
        "channel_rl.delay_mean": round(float(rng.uniform(0.0, 0.4)), 3),
        "arm_*.viscous": float(rng.choice([0.0, rng.uniform(-1e-3, 2e-3)])),
    }
    for side in ("controller_l", "controller_r"):
        values |= {f"{side}.stiffness": float(rng.uniform(0.1, 0.4)), f"{side}.damping": float(rng.uniform(0.03, 0.2))}
        if remembers:
            values |= {
                f"{side}.integral": float(rng.choice([0.0, rng.uniform(0.0, 0.2)])),
                f"{side}.keep": float(rng.choice([0.0, rng.uniform(0.0, 0.98)])),
                f"{side}.lead": float(rng.choice([0.0, rng.uniform(0.0, 3.0)])),
                f"{side}.late": int(rng.integers(1, 32)) * int(rng.integers(2)),
            }
    return own_loop(remembering_controller() if remembers else static_controller(), values)


def contradiction(seed: int) -> str:
    """What contradicts what in the loop of a seed; empty where nothing does."""
    found = cosim.stability(random_loop(seed)).comparison
    theory, grown = found.theory, found.judged.growth_rate
    grows = found.judged.outcome in UNSTABLE and (grown or 1.0) > CLEAR
    given = [name for name, holds in (("delay_sum", theory.any_mass), ("known_mass", theory.known_mass)) if holds]
    if theory.abscissa is not None and theory.abscissa < -CLEAR:
        given.append(f"spectrum {theory.abscissa:+.3f} 1/s")
    return f"seed {seed}: {given} and growth {grown}" if grows and given else ""


@pytest.mark.parametrize("seed", range(NORMAL))
def test_no_guarantee_is_contradicted(seed):
    assert contradiction(seed) == ""


if __name__ == "__main__":
    count, first = int(sys.argv[1]), int(sys.argv[2])
    wrong = 0
    for done, seed in enumerate(range(first, first + count), 1):
        words = contradiction(seed)
        wrong += bool(words)
        print(words or f"{wrong} contradictions in {done} loops", flush=True)
