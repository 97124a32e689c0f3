"""The noise floor from repeats (closure/floor.py) and the penalty on too many given columns (closure/gram.py)."""

from types import SimpleNamespace

import numpy as np
import pytest
from attrs import evolve

from cosim.closure.model.gram import accumulate, fit
from cosim.closure.model.smoothing import Widths
from cosim.closure.score.floor import floor, period

STEP = 2e-3


def motion(q, tau):
    """Just what the floor looks at."""
    return SimpleNamespace(q=q, tau=tau, step=STEP, bounds=((0, len(q)),), joints=q.shape[1], widths=Widths(3e-3, 5e-3))


def repeated(cycles: int, noise: float, seed: int = 0):
    time = np.arange(int(cycles * 2.0 / STEP)) * STEP
    q = np.column_stack([np.sin(np.pi * time) + 0.4 * np.cos(3 * np.pi * time), 0.3 * np.cos(2 * np.pi * time)])
    clean = np.column_stack([2 * np.sin(np.pi * time + 0.4), np.sign(np.sin(2 * np.pi * time))])
    return q, clean + noise * np.random.default_rng(seed).normal(size=clean.shape), clean


def test_the_period_is_that_of_all_joints_together():
    q, _, _ = repeated(4, 0.0)
    assert period(q, STEP) == pytest.approx(2.0 / STEP, abs=1)  # joint 2 alone repeats after 1 s


def test_a_motion_that_never_returns_has_no_period():
    time = np.arange(4000) * STEP
    q = (np.sin(1.3 * time) + np.sin(0.41 * np.sqrt(2) * time))[:, None]
    assert period(q, STEP) is None


def test_floor_is_the_noise_that_the_filter_leaves():
    q, tau, clean = repeated(6, 0.1)
    found = floor(SimpleNamespace(setting=SimpleNamespace(motion=motion(q, tau))))
    # White noise s through a Gaussian of w samples keeps s / sqrt(2 sqrt(pi) w); w = 2.5: 0.336 s.
    left = 0.1 / np.sqrt(2 * np.sqrt(np.pi) * 2.5)
    expected = 100 * left / np.sqrt(np.mean(clean**2, axis=0))
    # 1000 rows a cycle hold about 110 independent values: 7 % a pair.
    assert found == pytest.approx(tuple(expected), rel=0.12)


def problem(useful: int, seed: int):
    """Two columns of friction and 14 given ones, `useful` of them; 12 fitted, 6 held-out blocks of 30 rows, 6 runs."""
    rng = np.random.default_rng(seed)
    drift = np.repeat(rng.normal(size=(18, 14)), 30, axis=0)  # given columns hardly move within a block
    given = drift + 0.1 * rng.normal(size=(540, 14))
    own = rng.normal(size=(540, 2))
    y = own @ (3.0, 1.0) + given[:, :useful].sum(axis=1) + 0.3 * rng.normal(size=540)
    x = np.concatenate([given, own], axis=1)
    return accumulate(x[None], y[None], np.repeat(np.arange(18), 30), 18, 12), np.repeat(np.arange(6), 2)


def test_needless_columns_are_shrunk_and_held_out_errors_fall():
    gains = []
    for seed in range(10):
        gram, group = problem(0, seed)
        plain, shrunk = fit(gram), fit(evolve(gram, shrunk=14, group=group))
        gains.append(shrunk.sse[12:].sum() / plain.sse[12:].sum())
        assert shrunk.penalty[0] > 1e-3 and shrunk.penalty[-1] < 1e-9
    assert np.mean(gains) < 0.9


def test_columns_that_matter_are_kept():
    gram, group = problem(14, 1)
    found = fit(evolve(gram, shrunk=14, group=group))
    assert np.abs(found.beta[:14] - 1).max() < 0.35
    assert found.beta[14:] == pytest.approx((3.0, 1.0), abs=0.15)
