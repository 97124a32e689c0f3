"""What the reader must say of measured sets that others prepared: one-sided filters, rows that are not independent."""

import numpy as np
import pytest

from cosim.measured import read
from cosim.measured.doubts import emptied
from tests.support.paths import DATA


def text(*arguments, **options) -> str:
    return " | ".join(read(*arguments, **options).warnings)


def test_emps_pulse_file_is_not_raw_though_its_training_file_is(shared_data):
    folder = shared_data / "emps"
    data = read([folder / "emps_train.csv"], [folder / "emps_test_pulses.csv"], description=folder / "emps.toml")
    note = next(w for w in data.warnings if "holds next to nothing" in w)
    assert "in emps_test_pulses q" in note and "emps_train" not in note


def test_ready_emps_has_its_position_filtered_and_its_force_raw(shared_data):
    assert "holds next to nothing above" in text([shared_data / "residual_ready/emps_j1.csv"])


@pytest.mark.parametrize("joint", range(1, 7))
def test_ready_tx40_was_filtered_on_both_sides_and_alternates(shared_data, joint):
    notes = text([shared_data / f"residual_ready/staubli_tx40_j{joint}.csv"])
    assert "not independent" in notes
    assert "low-pass" not in notes and "holds next to nothing" not in notes


def test_cable_tool_and_pendulum_raise_no_filter_alarm(shared_data):
    tool, pendulum = shared_data / "mis_tool_cable", shared_data / "dfki_pendulum_1dof"
    notes = text(sorted(tool.glob("*.csv")), description=tool / "mis_tool_cable.toml")
    notes += text([pendulum / "ddp.csv"], description=pendulum / "dfki_pendulum_1dof.toml")
    assert "low-pass" not in notes and "holds next to nothing" not in notes


def test_excerpts_read_and_alternate_too():
    assert "not independent" in text([DATA / "staubli_tx40/staubli_tx40_j6.csv"])


def test_an_emptied_acceleration_is_told_from_a_noisy_one():
    """Inertia 2, white disturbance; a 60 Hz low-pass on the acceleration alone empties it above about 130 Hz."""
    from scipy.signal import butter, sosfiltfilt

    rng, step = np.random.default_rng(3), 1e-3
    acceleration = rng.normal(size=8000)
    torque = 2 * acceleration + 0.2 * rng.normal(size=8000)

    def low_pass(x):
        return sosfiltfilt(butter(4, 60, fs=1 / step, output="sos"), x)

    assert emptied(acceleration + 3 * np.diff(rng.normal(size=8002), 2), torque, step) is None
    assert emptied(low_pass(acceleration), low_pass(torque), step) is None
    # |H|^2 of the forward-backward filter is 1/20 where (f/60)^8 = 20, at 87 Hz; bands are 31 Hz wide.
    assert 60 < emptied(low_pass(acceleration), torque, step) < 140
