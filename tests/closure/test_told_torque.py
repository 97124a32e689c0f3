"""Springs and dead bands of one joint, beside a rigid torque that was told and beside one of its own."""

import numpy as np
import pytest

import cosim

DESCRIPTION = """
device = "regressor"
joint = "a"
[columns]
time = "t"
q = ["q"]
tau = ["tau"]
rigid = "told"
"""
AXIS = (
    DESCRIPTION.replace("regressor", "axis")
    .replace("[columns]", "gravity = false\n[columns]")
    .replace('rigid = "told"', "")
)
STEP, SECONDS = 1e-3, 24.0
ROTOR, LINK = 0.03, 0.07  # kg m^2
W, Z = 45.0, 0.1  # resonance [rad/s] and damping ratio of the link


@pytest.fixture(scope="module")
def motion():
    """Time and a sum of sines (n,) with its two derivatives."""
    t = np.arange(0.0, SECONDS, STEP)
    random = np.random.default_rng(4)
    w = 2 * np.pi * np.array([0.21, 0.47, 0.83, 1.31, 2.3, 3.7])
    size, phase = random.uniform(0.5, 1.0, 6) / w, random.uniform(0, 6, 6)
    angle = np.outer(t, w) + phase
    return t, np.sin(angle) @ size, np.cos(angle) @ (size * w), -np.sin(angle) @ (size * w**2)


def closed(tmp_path, columns, description=DESCRIPTION):
    """The answer to a recording of columns (n,) with friction, noise of the torque and of the encoder."""
    random, n = np.random.default_rng(7), len(columns["t"])
    speed = np.gradient(columns["q"], STEP)
    columns["tau"] = columns["tau"] + 0.4 * np.tanh(speed / 0.02) + 0.1 * speed + 0.003 * random.normal(size=n)
    columns["q"] = columns["q"] + 2e-6 * random.normal(size=n)
    np.savez(tmp_path / "r.npz", **columns)
    (tmp_path / "r.toml").write_text(description)
    return cosim.close_loop([tmp_path / "r.npz"], description=tmp_path / "r.toml", replay=False).to_dict()


@pytest.fixture(scope="module")
def spring(motion):
    """Columns of a link of resonance W and damping Z behind its motor; the twist is integrated exactly for each step
    of the acceleration, two seconds before the recording starts.
    """
    from scipy.signal import lsim

    t, q, _, ddq = motion
    twist = lsim(([1.0], [1.0, 2 * Z * W, W * W]), ddq, t)[1]
    through = LINK * (W * W * twist + 2 * Z * W * np.gradient(twist, STEP))
    columns = {"t": t, "q": q, "tau": ROTOR * ddq + through, "told": (ROTOR + LINK) * ddq}
    return {name: x[2000:] for name, x in columns.items()}


def test_a_told_torque_is_not_called_complete_before_a_spring(spring, tmp_path):
    """Nor is one named there: the filter with which a torque was computed looks the same."""
    found = closed(tmp_path, dict(spring))
    assert found["verdict"] == "unexplained"
    assert {u["name"] for u in found["untestable"]} >= {"joint_elasticity", "backlash"}


def test_a_spring_behind_an_axis_comes_back_with_its_parameters(spring, tmp_path):
    """Far from where the search starts: 45 rad/s with a tenth of damping, the motor has 0.3 of the inertia."""
    columns = {name: x for name, x in spring.items() if name != "told"}
    (effect,) = closed(tmp_path, columns, AXIS)["effects"]
    true = {"joint_compliance": 1 / (LINK * W * W), "motor_inertia": ROTOR, "joint_damping": 2 * Z * W * LINK}
    assert effect["name"] == "joint_elasticity"
    for name, value in true.items():
        low, high = effect["interval"][f"{name}[1]"]
        assert low < value < high and effect["parameters"][f"{name}[1]"] == pytest.approx(value, rel=0.05)


def test_a_dead_band_that_fills_the_residual(motion, tmp_path):
    """Replicates made of a residual that is the effect itself hide it; those of what it leaves do not."""
    t, q, _, ddq = motion
    told = 0.1 * ddq + 0.5 * np.sin(q)
    speed = np.gradient(q, STEP)
    wanted = told + 0.4 * np.tanh(speed / 0.02) + 0.1 * speed
    found = closed(tmp_path, {"t": t, "q": q, "tau": told + 0.15 * np.sign(wanted), "told": told})
    assert "torque_deadband" in [e["name"] for e in found["effects"]]


def test_an_offset_is_no_dead_band_where_all_commands_are_larger(motion, tmp_path):
    """Gravity of 5 N m on one side: a dead band of the offset's size would erase nothing."""
    t, q, _, ddq = motion
    told = 5.0 + 0.1 * ddq + 0.5 * np.sin(q)
    (effect,) = closed(tmp_path, {"t": t, "q": q, "tau": told + 0.15, "told": told})["effects"]
    names = {effect["name"], *effect["indistinguishable_from"]}
    assert "torque_offset" in names and "torque_deadband" not in names
