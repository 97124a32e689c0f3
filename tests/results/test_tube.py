"""The tube around a reference: its border to the bit, and against Funnel of LBNL."""

import csv

import numpy as np
import pytest

from cosim.results.pairs import Tolerance, pair, ranges
from cosim.results.traces import Traces
from cosim.results.tube import Tube, departure

TIME = np.arange(9) * 0.25
RAMP = 2.0 * TIME
STEP = np.where(TIME < 1.0, 0.0, 1.0)


def test_the_border_in_value_belongs_to_the_tube():
    tube = Tube(0.0, 0.125)
    on, beyond = (
        departure(TIME, RAMP + 0.125, TIME, RAMP, tube),
        departure(TIME, RAMP + 0.125 * (1 + 1e-15), TIME, RAMP, tube),
    )
    assert on.within and on.outside == 0.0 and on.greatest == 0.125
    assert not beyond.within and beyond.first_outside == 0.0  # one unit in the last place further, where that shows


def test_the_border_in_time_belongs_to_the_tube():
    late = np.where(TIME < 1.5, 0.0, 1.0)  # the jump two samples later
    assert departure(TIME, late, TIME, STEP, Tube(0.5, 0.0)).within
    found = departure(TIME, late, TIME, STEP, Tube(0.5 - 1e-12, 0.0))
    assert not found.within and found.first_outside == 1.25


def test_a_jump_that_repeats_its_time_allows_both_values():
    time, values = np.array([0.0, 1.0, 1.0, 2.0]), np.array([0.0, 0.0, 1.0, 1.0])
    low, high = Tube(0.0, 0.0).bounds(np.array([0.5, 1.0, 1.5]), time, values)
    assert (low.tolist(), high.tolist()) == ([0.0, 0.0, 1.0], [0.0, 1.0, 1.0])


def test_what_is_no_number_agrees_with_nothing():
    found = departure(TIME, np.where(TIME == 1.0, np.nan, RAMP), TIME, RAMP, Tube(1.0, 10.0))
    assert found.outside == pytest.approx(1 / 9) and found.first_outside == 1.0 and found.greatest == np.inf


@pytest.mark.needs("pyfunnel")
@pytest.mark.parametrize("seed", range(4))
def test_as_funnel_says(seed, tmp_path):
    """Outside by the same amount at every sample; Funnel computes its borders as corners of rectangles."""
    from pyfunnel import compareAndReport

    rng = np.random.default_rng(seed)
    time, moments = (np.sort([0.0, 5.0, *rng.uniform(0.0, 5.0, count - 2)]) for count in (30, 200))
    values = np.cumsum(rng.normal(size=30))
    other = np.interp(moments, time, values) + rng.normal(0.0, 0.6, 200)
    width, height = 0.15, 0.5
    lists = [array.tolist() for array in (time, values, moments, other)]
    compareAndReport(*lists, outputDirectory=str(tmp_path), atolx=width, atoly=height)
    with (tmp_path / "errors.csv").open() as file:
        theirs = np.array([float(row["y"]) for row in csv.DictReader(file)])
    low, high = Tube(width, height).bounds(moments, time, values)
    ours = np.maximum(np.maximum(other - high, low - other), 0.0)
    assert 5 < (ours > 0).sum() < 195
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_the_elements_of_a_vector_share_their_scale():
    signals = {"a.x[1]": RAMP, "a.x[2]": np.full(9, 3.0), "a.c": np.full(9, -7.0), "a.zero": np.zeros(9)}
    assert ranges(signals) == {"a.x": 4.0, "a.c": 7.0, "a.zero": 0.0}


def traces(name: str, time: np.ndarray, **signals: np.ndarray) -> Traces:
    return Traces(name, time, {f"a.{key}": values for key, values in signals.items()}, {})


def test_samples_elsewhere_leave_one_interval_open():
    """Curves of other samples may shift an event by what lies between two samples of the coarser; equal samples not."""
    fine = np.linspace(0.0, 2.0, 81)
    coarse = traces("coarse", TIME, y=STEP)
    early = traces("fine", fine, y=np.where(fine < 0.9, 0.0, 1.0))
    assert pair(coarse, early, Tolerance(0.0)).agrees
    assert not pair(coarse, early, Tolerance(0.0, time=0.0)).agrees
    late = traces("late", TIME, y=np.where(TIME < 1.25, 0.0, 1.0))
    assert not pair(coarse, late, Tolerance(0.5)).agrees


def test_a_curve_that_ends_early_does_not_agree():
    whole = traces("whole", TIME, y=RAMP)
    assert not pair(whole, traces("short", TIME[:6], y=RAMP[:6]), Tolerance(0.1)).agrees
    assert pair(whole, traces("whole again", TIME, y=RAMP), Tolerance(0.0)).same


def test_a_value_that_is_none_agrees_with_none_and_with_nothing_else():
    holes = np.where(TIME > 0.55, np.nan, RAMP)
    found = pair(traces("a", TIME, y=holes), traces("b", TIME, y=holes), Tolerance(0.0))
    assert found.same and found.agrees
    assert not pair(traces("a", TIME, y=RAMP), traces("b", TIME, y=holes), Tolerance(0.5)).agrees
