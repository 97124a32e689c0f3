"""Filters: no delay where none is claimed, total derivatives on both sides, a reach that is finite where it is said
to be."""

import numpy as np
import pytest

from cosim.arm import dynamics
from cosim.identification.regressor import axis, gravity_columns, kinetic_slope, momentum, phantom
from cosim.measured.filtering import FilteredMotion, FirstOrder, Window, ZeroPhase, derivative, near_reversal
from cosim.measured.recording import Run

STEP = 1e-3
FILTERS = [FirstOrder(10.0), ZeroPhase(30.0), Window(30.0)]


def sweep(rows=20000):
    """A motion with exact derivatives, (rows, 3) each."""
    t = np.arange(rows)[:, None] * STEP
    k = np.arange(3)
    q = 0.3 * np.sin(1.3 * t + k) + 0.2 * np.sin(4.1 * t + 2 * k) + 0.3
    dq = 0.39 * np.cos(1.3 * t + k) + 0.82 * np.cos(4.1 * t + 2 * k)
    ddq = -0.507 * np.sin(1.3 * t + k) - 3.362 * np.sin(4.1 * t + 2 * k)
    return q, dq, ddq


def inner(array, low_pass):
    head, tail = low_pass.settle(STEP)
    return array[max(head, 10) : len(array) - max(tail, 10)]


def test_momentum_form_is_the_regressor():
    # d/dt P - R + N = Y: Lagrange; the difference quotient of fourth order leaves (4.1 h)^4 / 30 of 14, below 1e-9
    q, dq, ddq = sweep()
    form = derivative(momentum(q, dq), STEP) - kinetic_slope(q, dq) + gravity_columns(q)
    assert np.abs(form - dynamics.regressor(q, dq, ddq))[5:-5].max() < 2e-9


@pytest.mark.parametrize("low_pass", FILTERS, ids=str)
def test_filtered_regressor_needs_no_acceleration(low_pass):
    """Taati Eq. 13 by total derivatives equals the filtered Eq. 4 with exact accelerations (PHYSICS.md 4)."""
    q, dq, ddq = sweep()
    run = Run("r", np.arange(len(q)) * STEP, q, np.zeros_like(q), np.zeros(len(q), bool))
    ours = phantom(FilteredMotion(run, q, dq, run.tau), low_pass).y[:, :, :8]
    exact = low_pass.low(dynamics.regressor(q, dq, ddq), STEP)
    # what is left is each filter's start-up: e^-12 of 4 rad/s^2 for L(s), ringing of the Butterworth at its settle time
    assert np.abs(inner(ours - exact, low_pass)).max() < 2e-4


def test_the_printed_shortcut_is_not_enough():
    """w (dq - dq_L) cos 2q2 for L{ddq cos 2q2}, as ddq_L alone suggests, is off by more than a percent."""
    q, dq, ddq = sweep()
    low_pass = FirstOrder(10.0)
    exact = low_pass.low(ddq[:, 0] * np.cos(2 * q[:, 1]), STEP)
    shortcut = low_pass.rate(dq[:, 0], STEP) * np.cos(2 * q[:, 1])
    assert np.abs(inner(shortcut - exact, low_pass)).max() > 0.05 * np.abs(exact).max()


def test_first_order_filter_is_exact_for_a_sine_but_for_the_sampling():
    # linear between samples: error below (w h)^2 / 8 of the amplitude
    time, w = np.arange(20000) * STEP, 5.0
    y = FirstOrder(10.0).low(np.sin(w * time), STEP)
    gain, phase = 10 / np.hypot(10, w), np.arctan2(w, 10)
    assert np.abs(y - gain * np.sin(w * time - phase))[2000:].max() < (w * STEP) ** 2 / 8


@pytest.mark.parametrize("low_pass", FILTERS[1:], ids=str)
def test_zero_phase_filters_have_half_amplitude_at_the_cutoff_and_no_delay(low_pass):
    time = np.arange(20000) * STEP
    for frequency, wanted in ((0.5, 1.0), (30.0, 0.5)):
        y = low_pass.low(np.sin(2 * np.pi * frequency * time), STEP)[5000:15000]
        part = np.exp(2j * np.pi * frequency * time[5000:15000])
        response = 2 * (y * part.conj()).mean() * 1j
        assert abs(response - wanted) < 0.02  # the window's length is rounded to whole rows: 1/33 of it


def test_a_window_has_finite_reach():
    signal = np.zeros(1001)
    signal[500] = 1.0
    low_pass = Window(20.0)
    before, after = low_pass.spread(STEP)
    reached = np.flatnonzero(np.abs(low_pass.rate(signal, STEP)) > 1e-12)
    assert 500 - after <= reached.min() and reached.max() <= 500 + before


def test_rows_near_reversals_are_found():
    time = np.arange(4000) * STEP
    dq = np.cos(2 * np.pi * time)  # turns at 0.25, 0.75, ... s
    near = near_reversal(dq, STEP, (30, 30), 0.05)
    assert near[250] and near[230] and near[275] and not near[0] and not near[500]


def test_axis_columns_recover_an_exact_axis():
    q, dq, ddq = (part[:, :1] for part in sweep())
    tau = 2.0 * ddq + 0.7 * dq + 0.3 * np.sign(dq) + 0.1 + 1.5 * np.sin(q) - 0.4 * np.cos(q)
    run = Run("r", np.arange(len(q)) * STEP, q, tau, np.zeros(len(q), bool))
    model = axis(FilteredMotion(run, q, dq, tau), Window(30.0), gravity=True)
    params = np.linalg.lstsq(model.y[50:-50, 0], model.tau[50:-50, 0], rcond=None)[0]
    assert params == pytest.approx([2.0, 0.7, 0.3, 0.1, 1.5, -0.4], abs=1e-5)
