"""A torque over the position without a name in the FMU (cosim/closure/table.py): a drive with bumps in its force,
integrated in Python, and unseen motion.
"""

import tomllib
import zipfile
from functools import cache
from math import exp, hypot, pi, sin
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from attrs import evolve
from scipy.interpolate import CubicHermiteSpline

from cosim.closure.closure import Closure, close_loop
from cosim.closure.document import answer, sentence
from cosim.closure.drive import JointDrive
from cosim.closure.model.table import KNOTS, knot_weights
from cosim.closure.output import write
from cosim.closure.simulation import driven as opened
from cosim.closure.table import carried_table
from cosim.measured import Recording, Run, parse_description

STEP, FINE, SECONDS = 2e-3, 4, 40.0


def bumps(q: float) -> float:
    """A force over the position that no law of the library has [N]."""
    return 0.9 * exp(-(((q - 0.05) / 0.025) ** 2)) - 0.7 * exp(-(((q + 0.07) / 0.03) ** 2))


def tight(q: float) -> float:
    """Where the guide is tight: a further Coulomb level [N]."""
    return 0.6 * exp(-(((q - 0.01) / 0.03) ** 2))


def reference(t: float) -> float:
    """Of the fitted half and of the report: other amplitudes and speeds."""
    if t < SECONDS / 2:
        return 0.09 * sin(2 * pi * 0.31 * t) + 0.05 * sin(2 * pi * 0.83 * t)
    return 0.10 * sin(2 * pi * 0.23 * t + 1) + 0.03 * sin(2 * pi * 1.1 * t)


@cache
def driven(bumpy: bool, noise: float = 0.0) -> Recording:
    """A PD loop around inertia, friction and bumps, semi-implicit Euler; the second half held out."""
    n = round(SECONDS / STEP)
    q, tau, x, v = np.zeros(n), np.zeros(n), reference(0.0), 0.0
    for k in range(n):
        q[k] = x
        tau[k] = 900.0 * (reference(k * STEP) - x) - 40.0 * v
        for _ in range(FINE):
            s = v / hypot(v, 0.01)
            force = 3.0 * v + 1.5 * s + 0.3 + (bumps(x) + tight(x) * s if bumpy else 0.0)
            v += STEP / FINE * (tau[k] - force) / 1.2
            x += STEP / FINE * v
    rng = np.random.default_rng(3)
    time = np.arange(n) * STEP
    run = Run("run", time, q[:, None], (tau + noise * rng.standard_normal(n))[:, None], time >= SECONDS / 2)
    table = {"device": "axis", "columns": {"q": ["q"], "tau": ["tau"]}, "units": {"q": "m", "tau": "N"}}
    return Recording(parse_description(table, "test"), (run,))


@cache
def closed(bumpy: bool) -> Closure:
    return close_loop(driven(bumpy, 0.02))


def over_position(values, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque and Coulomb level over q of start values, laws and table together; only the shape counts."""
    weights = knot_weights(q, values["nameless_from"], values["nameless_to"])
    powers = ("position_torque", "position_torque_quadratic", "position_torque_cubic")
    law = sum(values.get(name, 0.0) * q ** (k + 1) for k, name in enumerate(powers))
    turns = values.get("ripple_order", 0.0) * q
    law = law + values.get("ripple_sin", 0.0) * np.sin(turns) + values.get("ripple_cos", 0.0) * np.cos(turns)
    return law + weights @ values["nameless_torque"], weights @ values["nameless_friction"]


def test_the_weights_are_those_of_the_cubic_through_the_knots():
    knots = np.linspace(-0.4, 0.5, KNOTS)
    values = np.random.default_rng(1).standard_normal(KNOTS)
    slopes = np.gradient(values, knots)
    slopes[[0, -1]] = 0.0
    q = np.concatenate([knots, np.linspace(-0.7, 0.9, 301)])
    exact = CubicHermiteSpline(knots, values, slopes)(np.clip(q, -0.4, 0.5))
    assert np.abs(knot_weights(q, -0.4, 0.5) @ values - exact).max() < 1e-13


def test_the_bumps_are_carried_and_unseen_motion_is_simulated_better():
    found = closed(True)
    assert found.table.taken and found.table.errors.shape == (4, 2)
    q = np.linspace(-0.12, 0.12, 49)
    for total, truth in zip(over_position(found.values_after, q), (bumps, tight), strict=True):
        exact = np.array([truth(x) for x in q])
        assert np.std(total - exact) < 0.25 * np.std(exact)  # but for a constant, which is offset or coulomb
    assert found.simulation.after[0] < 0.5 * found.simulation.before[0]
    assert found.simulation.levelled_after.rms < 0.5 * found.simulation.levelled_before.rms
    assert found.error.after[0] < 0.5 * found.error.before[0]


def test_the_answer_tells_it_as_something_without_a_name():
    found = closed(True)
    (rest,) = [e for e in answer(found)["effects"] if e["name"] == "unknown"]
    assert rest["parameters"]["nameless_torque[3]"] == found.values_after["nameless_torque"][2]
    assert rest["evidence"]["stretches_left_out"]["in_the_fmu"]
    assert set(found.values_after) >= set(found.effect_values)
    assert "carries a torque over the position without a name" in sentence(found)


def test_the_fmu_that_is_written_starts_with_the_table(tmp_path):
    """And the file of effects has the same numbers."""
    found = write(closed(True), tmp_path)
    tree = description(tmp_path / "fmi3" / "AxisDrive.fmu")
    (known,) = [v for v in tree.iter() if v.get("name") == "nameless_torque[3]"]
    assert float(known.get("start")) == found.values_after["nameless_torque"][2]
    told = tomllib.loads((tmp_path / "effects.toml").read_text())["parameters"]["nameless_friction"]
    assert told == pytest.approx(found.values_after["nameless_friction"], rel=1e-8)


def description(fmu: Path) -> ElementTree.Element:
    with zipfile.ZipFile(fmu) as archive:
        return ElementTree.fromstring(archive.read("modelDescription.xml"))


def test_a_complete_model_gets_no_table():
    found = closed(False)
    assert found.table is None and "nameless_torque" not in found.values_after


def test_a_table_that_helps_no_stretch_left_out_is_not_taken():
    """The leftover of the drive with bumps, claimed of the drive without them."""
    bare = closed(False)
    claimed = evolve(bare.verdict, leftovers=closed(True).verdict.leftovers)
    table = carried_table(bare.recording, claimed)
    assert not table.taken and "left out of the FMU" in table.why


def test_a_table_that_the_reported_rows_contradict_is_not_taken():
    """Bumps that are there in the fitted half only."""
    with_them, without = driven(True, 0.02).runs[0], driven(False, 0.02).runs[0]
    half = len(with_them) // 2
    parts = (with_them.part(slice(0, half)), without.part(slice(half, None)))
    found = close_loop(evolve(driven(True), runs=tuple(evolve(p, name=f"run {k}") for k, p in enumerate(parts))))
    assert not found.table.taken and "rows of the report are no better" in found.table.why
    assert (found.table.errors[:, 1] < found.table.errors[:, 0]).all()


@pytest.mark.parametrize(("offset", "coulomb"), [(0.0, 0.0), (-0.1, 0.25)])
def test_the_levels_of_a_run_are_found(offset, coulomb):
    run = driven(False).runs[0].part(slice(0, 5000))
    true = {"inertia": 1.2, "viscous": 3.0, "coulomb": 1.5, "coulomb_velocity": 0.01, "torque_offset": 0.3}
    wrong = {**true, "torque_offset": 0.3 - offset, "coulomb": 1.5 - coulomb}
    with opened(JointDrive(), run) as free:
        found = free.levelled(wrong)
        exact = free.error(true)
    assert found.levels == pytest.approx((offset, coulomb), abs=5e-3)
    assert np.sqrt(np.mean(found.error**2)) <= 1.02 * np.sqrt(np.mean(exact**2))
