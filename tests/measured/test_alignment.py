"""Signals read at the stamps of another: lines between neighbours, nothing made up where there is nothing."""

import numpy as np

from cosim.measured.alignment import aligned


def test_a_line_is_reproduced_and_a_sine_to_second_order():
    stamps = 0.005 * np.arange(400) + np.random.default_rng(0).uniform(0, 0.004, 400)
    wanted = np.linspace(stamps[0], stamps[-1], 333)
    assert np.allclose(aligned(3 - 2 * stamps, stamps, wanted), 3 - 2 * wanted, atol=1e-12)
    even = np.arange(0, 2, 0.01)
    wanted = np.linspace(0, 1.99, 777)
    error = np.abs(aligned(np.sin(5 * even), even, wanted) - np.sin(5 * wanted)).max()
    assert error <= 0.01**2 * 25 / 8  # h^2 max|f''| / 8


def test_nothing_is_made_up_outside_or_in_long_gaps():
    stamps = np.r_[np.arange(0, 1, 0.01), np.arange(1.5, 2, 0.01)]
    found = aligned(stamps, stamps, np.array([-0.1, 0.0, 0.5, 1.2, 1.7, 3.0, np.nan]))
    assert np.array_equal(np.isnan(found), [True, False, False, True, False, True, True])


def test_an_angle_that_wraps_is_not_drawn_through_zero():
    stamps = np.arange(0, 2, 0.01)
    turned = 9 * stamps
    found = aligned(np.mod(turned + np.pi, 2 * np.pi) - np.pi, stamps, stamps[:-1] + 0.004)
    distance = np.mod(found - 9 * (stamps[:-1] + 0.004) + np.pi, 2 * np.pi) - np.pi
    assert np.abs(distance).max() < 9 * 0.006  # at most the way to the nearer sample


def test_words_are_held_and_stamps_out_of_order_or_twice_are_sorted():
    stamps = np.array([0.0, 0.2, 0.1, 0.2])
    assert aligned(np.array(["a", "c", "b", "x"]), stamps, np.array([0.05, 0.1, 0.15, 0.2])).tolist() == list("abbc")
