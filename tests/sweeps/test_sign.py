"""Runs that end once the sign of their growth rate is decided: against the exact spectrum, against runs to the end."""

import numpy as np
import pytest
from attrs import evolve
from scipy.special import stdtrit

from cosim.errors import InputError
from cosim.sweeps.campaign import fingerprint
from cosim.sweeps.evaluate import EVALUATORS, simulation, spectrum
from cosim.sweeps.kernel import student
from cosim.sweeps.points import Point
from cosim.sweeps.pool import Task
from cosim.sweeps.spec import parse_sweep
from tests.benchmarks.sweeps import PAPER
from tests.support.paths import ROOT

UNSTABLE = {"growing", "limit_cycle"}


def task(evaluator="simulation", level=None, **values):
    return Task(EVALUATORS[evaluator], "sallam-nodelay", PAPER | values, None, level)


def grid(gains, delays):
    return [
        Point((), (("controller_*.stiffness", float(k)), ("channel_*.delay_mean", float(d))))
        for k in gains
        for d in delays
    ]


def test_signs_are_those_of_the_exact_spectrum_and_runs_end_early():
    points = grid(np.linspace(0.4, 1.0, 3), np.linspace(0.05, 0.8, 6))
    exact = [finding.growth_rate for finding in spectrum(task("spectrum"), points)]
    found = simulation(task(level=0.95), points)
    assert sum(rate > 0 for rate in exact) in range(5, 15)
    decided = [(f, rate) for f, rate in zip(found, exact) if f.numbers["simulated_time"] < 20.0]
    assert len(decided) == len(points)
    assert all((f.outcome == "growing") == (rate > 0) and f.low <= f.growth_rate <= f.high for f, rate in decided)
    assert all(f.low > 0.0 or f.high < 0.0 for f, _ in decided)
    assert np.mean([f.numbers["simulated_time"] for f in found]) < 10.0


def test_where_the_sign_is_not_decided_the_verdict_is_that_of_the_whole_run():
    """At the boundary, which 0.4 N/m has at about 0.25 s."""
    points = grid([0.4], [0.246, 0.25, 0.254])
    whole, early = simulation(task(), points), simulation(task(level=0.999), points)
    late = [k for k, f in enumerate(early) if f.numbers["simulated_time"] == 20.0 and abs(f.growth_rate) < 0.01]
    assert late
    assert all((early[k].outcome, early[k].growth_rate) == (whole[k].outcome, whole[k].growth_rate) for k in late)


def test_a_sweep_that_decides_signs_has_a_journal_of_its_own():
    assert fingerprint(task()) != fingerprint(task(level=0.95)) != fingerprint(task(level=0.99))
    assert fingerprint(task(level=0.95)) != fingerprint(evolve(task(level=0.95), traced=True))


@pytest.mark.parametrize("level", [0.5, 1.0, 95.0, "high"])
def test_levels_are_shares(level):
    table = {"scenario": "sallam-nodelay", "sign_level": level, "grid": {}, "axes": [{"name": "a", "paths": ["a.b"]}]}
    with pytest.raises(InputError, match="sign_level: expected a number between 0.5 and 1"):
        parse_sweep(table, ROOT / "own.toml")


def test_where_a_boundary_is_traced_a_run_ends_only_when_its_rate_is_known():
    """To a fifth of itself, so that near the boundary, where the rate is small, every run goes on to its end."""
    points = grid([0.4], [0.05, 0.22, 0.25, 0.28, 0.8])
    signs, rates = (simulation(evolve(task(level=0.95), traced=traced), points) for traced in (False, True))
    ended = [f for f in rates if f.numbers["simulated_time"] < 20.0]
    assert 1 <= len(ended) < sum(f.numbers["simulated_time"] < 20.0 for f in signs)
    assert all(f.high - f.low <= 0.4 * abs(f.growth_rate) for f in ended)
    assert all(a.numbers["simulated_time"] <= b.numbers["simulated_time"] for a, b in zip(signs, rates))


def test_quantiles_are_those_of_scipy():
    for level in (0.5, 0.8, 0.95, 0.99):
        assert student(level) == pytest.approx(stdtrit(5, 0.5 + 0.5 * level), rel=1e-14)
