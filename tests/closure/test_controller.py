"""The recorded controller found in the run itself (cosim/closure/controller.py)."""

import numpy as np
import pytest

from cosim.closure.controller import find_laws, injected
from cosim.measured import Recording, Run, parse_description, read

STEP, KP, KD = 1e-3, 900.0, 40.0


def plant(samples: int, pulse: float = 0.0, limit: float = np.inf, seconds: float = 6.0, cutoff: float = 0.0) -> Run:
    """A mass of 1.2 kg with friction behind an encoder of 1e-6 m, tau = KP e - KD L D q + pulse, by Euler."""
    n = int(seconds / STEP)
    time = np.arange(n) * STEP
    q_ref = 0.1 * np.sin(2 * np.pi * 0.7 * time) + 0.03 * np.sin(2 * np.pi * 2.3 * time)
    q, tau, x, v, seen = np.zeros(n), np.zeros(n), 0.0, 0.0, 0.0
    share = 1 - np.exp(-2 * np.pi * cutoff * STEP) if cutoff else 1.0
    for k in range(n):
        q[k] = np.round(x / 1e-6) * 1e-6
        speed = (q[k] - q[max(k - samples, 0)]) / (samples * STEP) if k >= samples else 0.0
        seen += share * (speed - seen)
        push = pulse * (int(time[k]) % 2)
        tau[k] = np.clip(KP * (q_ref[k] - q[k]) - KD * seen + push, -limit, limit)
        v += STEP * (tau[k] - 3.0 * v - 1.5 * np.tanh(v / 1e-3)) / 1.2
        x += STEP * v
    return Run("a", time, q[:, None], tau[:, None], np.zeros(n, bool), q_ref=q_ref[:, None])


def recording(*runs: Run) -> Recording:
    table = {"device": "axis", "columns": {"q": ["q"], "tau": ["tau"], "q_ref": ["r"]}}
    return Recording(parse_description(table, "test"), runs)


@pytest.mark.parametrize("samples", [1, 2])
def test_gains_and_differentiation_are_found(samples):
    law = find_laws(recording(plant(samples)))[0]
    # The law is an exact linear relation of recorded numbers: only rounding is left.
    assert (law.kp, law.kd, law.samples) == (pytest.approx(KP, rel=1e-6), pytest.approx(KD, rel=1e-6), samples)
    assert law.kd_ref == law.offset == law.weight_cos == law.cutoff == law.limit == 0.0


def test_a_low_pass_of_the_velocity_is_found():
    law = find_laws(recording(plant(1, cutoff=60.0)))[0]
    assert (law.samples, law.cutoff) == (1, 60.0)
    assert (law.kp, law.kd) == (pytest.approx(KP, rel=1e-6), pytest.approx(KD, rel=1e-6))


def test_saturated_rows_are_left_out_and_give_the_limit():
    law = find_laws(recording(plant(2, limit=12.0)))[0]
    assert law.limit == pytest.approx(12.0)
    assert law.kp == pytest.approx(KP, rel=1e-6)


def test_pulses_on_the_command_are_left_over_as_they_were():
    law = find_laws(recording(plant(2)))[0]
    rest = injected(law, plant(2, pulse=5.0), 0)
    expected = 5.0 * (np.floor(np.arange(len(rest)) * STEP).astype(int) % 2)
    assert np.abs(rest[10:] - expected[10:]).max() < 1e-6
    assert not injected(law, plant(2), 0).any()


def test_a_torque_that_no_law_of_the_reference_gives_has_none():
    run = plant(2)
    rng = np.random.default_rng(1)
    other = Run("a", run.time, run.q, np.cumsum(rng.normal(size=run.tau.shape), axis=0), run.test, q_ref=run.q_ref)
    assert find_laws(recording(other)) is None


def test_emps_law_is_that_of_its_authors(shared_data):
    folder = shared_data / "emps"
    data = read([folder / "emps_train.csv"], [folder / "emps_test_pulses.csv"], description=folder / "emps.toml")
    law = find_laws(data)[0]
    # dataset.json: u = 243.45 (160.18 (q_ref - q) - dq) V at 35.15 N/V, dq of two-row means; 5e-8 m of q leave 0.2 %.
    assert law.samples == 2
    assert law.kp == pytest.approx(160.18 * 243.45 * 35.15065188, rel=1e-3)
    assert law.kd == pytest.approx(243.45 * 35.15065188, rel=1e-3)
    train, pulses = (injected(law, run, 0) for run in data.runs)
    assert not train.any()
    flag = np.genfromtxt(folder / "emps_test_pulses.csv", delimiter=",", names=True)["pulse_flag"] > 0
    assert np.median(pulses[flag]) == pytest.approx(178.2, rel=0.01)  # 5.07 V, nowhere stated by the authors
    assert abs(np.median(pulses[~flag])) < 0.5
