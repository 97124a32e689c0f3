"""The small models against closed forms, through the FMI functions; FMI 2 against FMI 3 bit for bit."""

import json

import numpy as np
import pytest
from scipy.linalg import expm

from build_fmus import fmu_path
from tests.support.probe import Importer

EPS = np.finfo(float).eps


def vector(fmu: Importer, name: str) -> np.ndarray:
    return np.array([fmu.get(f"{name}[{i}]") for i in (1, 2, 3)])


def put(fmu: Importer, name: str, values) -> None:
    for i, value in enumerate(values):
        fmu.set(f"{name}[{i + 1}]", float(value))


def vectors(name: str, values) -> dict[str, float]:
    return {f"{name}[{i + 1}]": float(v) for i, v in enumerate(values)}


# ---- PLikeController ----


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("space", "reference", "position", "velocity", "output", "silent", "stiffness", "damping"),
    [
        (1, "x_ref", "x", "dx", "f", "tau", "stiffness", "damping"),
        (2, "q_ref", "q", "dq", "tau", "f", "joint_stiffness", "joint_damping"),
    ],
)
def test_p_like_law(version, space, reference, position, velocity, output, silent, stiffness, damping):
    """K (ref - x) - B dx in the chosen space, nothing in the other."""
    rng = np.random.default_rng(2)
    k, b, r, x, v = rng.normal(size=(5, 3))
    fmu = Importer(fmu_path("PLikeController", version), {"space": space} | vectors(stiffness, k) | vectors(damping, b))
    put(fmu, reference, r)
    put(fmu, position, x)
    put(fmu, velocity, v)
    expected = k * (r - x) - b * v
    assert vector(fmu, output) == pytest.approx(expected, abs=8 * EPS * 10)
    fmu.step(0.0, 1e-3)
    assert vector(fmu, output) == pytest.approx(expected, abs=8 * EPS * 10)
    assert (vector(fmu, silent) == 0).all()
    index = 1
    slope = fmu.directional([f"{output}[1]"], [f"{position}[1]", f"{velocity}[1]"], [1.0, 0.0])
    assert slope == pytest.approx([-k[index - 1]], rel=1e-9)


# ---- Operator ----


def test_the_sine_force_of_the_reference_scenario():
    """A (1, .8, .6) sin(2 pi 0.05 t) for 0 <= t < 20 s, then exactly zero (PHYSICS 3)."""
    amplitude = 0.004 * np.array([1.0, 0.8, 0.6])
    fmu = Importer(fmu_path("Operator"), vectors("amplitude", amplitude) | {"frequency": 0.05, "stop_time": 20.0})
    for n in range(2100):
        fmu.step(n * 0.01, 0.01)
        time = (n + 1) * 0.01
        expected = amplitude * np.sin(2 * np.pi * 0.05 * time) if n + 1 < 2000 else np.zeros(3)
        # 0.05 t is rounded to EPS of up to one turn, the phase to 2 pi EPS of it
        assert np.abs(vector(fmu, "f") - expected).max() <= 0.004 * 2 * np.pi * 4 * EPS
    assert (vector(fmu, "f") == 0).all()


def test_a_recorded_force_passes():
    fmu = Importer(fmu_path("Operator"))
    put(fmu, "f_recorded", (1.0, 2.0, 3.0))
    assert (vector(fmu, "f") == (1.0, 2.0, 3.0)).all()


def test_the_hand_is_a_mass_between_two_springs():
    """Tip held, reference apart: m x_h'' = k (ref - x_h) - b x_h' - kg (x_h - x) - bg x_h' by its matrix
    exponential.
    """
    m, k, b, kg, bg, tip, reference = 1.2, 40.0, 3.0, 200.0, 1.0, 0.02, 0.05
    start = {
        "hand_mass": m,
        "grip_stiffness": kg,
        "grip_damping": bg,
        "hand_stiffness[1]": k,
        "hand_damping[1]": b,
        "reference[1]": reference,
        "internal_steps": 4,
    }
    fmu = Importer(fmu_path("Operator"), start, initialize=False)
    fmu.set("x[1]", tip)
    fmu.initialize()
    system = np.array([[0.0, 1.0], [-(k + kg) / m, -(b + bg) / m]])
    rest = np.array([(k * reference + kg * tip) / (k + kg), 0.0])
    state = np.array([tip, 0.0]) - rest
    for n in range(500):
        fmu.step(n * 1e-3, 1e-3)
    expected = expm(system * 0.5) @ state + rest
    # RK4 at h = 0.25 ms: error below t (w h)^5 / (120 h) = 0.5 s (14.2/s 2.5e-4 s)^5 / (120 2.5e-4 s) = 1e-11 of 0.03 m
    assert fmu.get("hand_x[1]") == pytest.approx(expected[0], abs=1e-12)
    assert fmu.get("hand_dx[1]") == pytest.approx(expected[1], abs=1e-11)
    force = kg * (expected[0] - tip) + bg * expected[1]
    assert fmu.get("f[1]") == pytest.approx(force, abs=1e-9)


def test_no_hand_no_grip():
    fmu = Importer(fmu_path("Operator"), {"grip_stiffness": 100.0})
    put(fmu, "x", (1.0, 1.0, 1.0))
    fmu.step(0.0, 1e-3)
    assert (vector(fmu, "f") == 0).all()


def test_the_hand_follows_its_reference():
    """A soft tip far away matters not: the forced response k / (k - m w^2 + i b w), after the transient has gone."""
    m, k, b, turns = 0.5, 100.0, 20.0, 0.5
    start = {
        "hand_mass": m,
        "hand_stiffness[2]": k,
        "hand_damping[2]": b,
        "reference_amplitude[2]": 0.1,
        "reference_frequency": turns,
    }
    fmu = Importer(fmu_path("Operator"), start)
    w = 2 * np.pi * turns
    response = k / (k - m * w**2 + 1j * b * w)
    for n in range(4000):
        fmu.step(n * 1e-3, 1e-3)
    expected = 0.1 * np.imag(response * np.exp(1j * w * 4.0))
    assert fmu.get("hand_x[2]") == pytest.approx(expected, abs=1e-8)  # transient e^(-5.5 * 4) * 0.1 = 3e-11


# ---- Environment ----


@pytest.mark.parametrize("version", [2, 3])
def test_the_wall_pushes_and_never_pulls(version):
    normal = np.array([-2.0, 1.0, 0.5])
    n = normal / np.linalg.norm(normal)
    start = {"surface": 2, "offset": -0.01, "stiffness": 500.0, "damping": 4.0} | vectors("normal", normal)
    fmu = Importer(fmu_path("Environment", version), start)
    rng = np.random.default_rng(3)
    touched = 0
    for x, dx in zip(rng.normal(scale=0.02, size=(200, 3)), rng.normal(scale=0.5, size=(200, 3)), strict=True):
        put(fmu, "x", x)
        put(fmu, "dx", dx)
        depth = -0.01 - n @ x
        force = max(0.0, 500.0 * depth - 4.0 * (n @ dx)) * n if depth > 0 else np.zeros(3)
        assert fmu.get("depth") == pytest.approx(depth, abs=1e-15)
        assert vector(fmu, "f") == pytest.approx(force, abs=1e-12)  # 500 N/m times 1e-15 m
        assert vector(fmu, "f") @ n >= 0
        touched += depth > 0
    assert 20 < touched < 180


def test_free_space_is_free():
    fmu = Importer(fmu_path("Environment"))
    put(fmu, "x", (5.0, 5.0, 5.0))
    assert (vector(fmu, "f") == 0).all()


def test_a_wall_without_normal_is_refused():
    with pytest.raises(Exception, match="Error|error|status"):
        Importer(fmu_path("Environment"), {"surface": 2, "normal[1]": 0.0})


# ---- PDController ----


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(("n", "delay"), [(1, 0), (2, 0), (3, 2)])
def test_sampled_pd(version, n, delay):
    rng = np.random.default_rng(4)
    q_ref, q = np.cumsum(rng.normal(scale=1e-3, size=(2, 60)), axis=1)
    step, kp, kd, limit, scale = 1e-3, 30.0, 0.05, 0.2, 0.4
    start = {
        "kp[2]": kp,
        "kd[2]": kd,
        "torque_limit[2]": limit,
        "command_scale[2]": scale,
        "difference_samples": n,
        "delay_samples": delay,
    }
    fmu = Importer(fmu_path("PDController", version), start, initialize=False)
    fmu.set("q_ref[2]", q_ref[0])
    fmu.set("q[2]", q[0])
    fmu.initialize()
    got = [fmu.get("tau[2]")]
    for k in range(1, 60):
        fmu.set("q_ref[2]", q_ref[k])
        fmu.set("q[2]", q[k])
        assert fmu.get("tau[2]") == got[-1]  # held: no feedthrough
        fmu.step((k - 1) * step, step)
        got.append(fmu.get("tau[2]"))
    past = np.concatenate([np.full(n, q[0]), q])
    dq = (past[n:] - past[:-n]) / (n * step)
    if n > 1:  # the first samples: the intervals there have been so far
        dq[1:n] = [(q[k] - q[0]) / (k * step) for k in range(1, n)]
    command = np.clip(kp * (q_ref - q) - kd * dq, -limit, limit)
    expected = scale * np.concatenate([np.zeros(delay), command])[:60]
    assert np.abs(np.array(got) - expected).max() < 1e-12  # kd / (n H) = 50 times rounding of 0.05 rad
    assert (np.abs(command) == limit).any() and (np.abs(command) < limit).any()


def test_the_differenced_velocity_passes_a_low_pass():
    """A ramp of q at 1 rad/s: the velocity's step response 1 - exp(-2 pi f t) at the samples, kd = 1 N.m.s/rad."""
    start = {"kd[1]": 1.0, "velocity_cutoff": 30.0}
    fmu = Importer(fmu_path("PDController"), start)
    for k in range(1, 200):
        fmu.set("q[1]", k * 1e-3)
        fmu.step((k - 1) * 1e-3, 1e-3)
        # the difference over 1 ms carries the rounding of 0.2 rad, 3e-17 / 1e-3
        assert fmu.get("tau[1]") == pytest.approx(np.expm1(-2 * np.pi * 30.0 * k * 1e-3), abs=1e-12)


def test_the_controller_of_emps_gives_the_recorded_voltage(shared_data):
    """u = kv (kp (q_ref - q) - dq) limited to 10 V, fed with the recorded q: the recorded u, to the file's rounding."""
    folder = shared_data / "emps"
    law = json.loads((folder / "dataset.json").read_text())["controller"]
    data = np.genfromtxt(folder / "emps_train.csv", delimiter=",", names=True)[4000:8000]
    kp, kv = law["kp_1_per_s"], law["kv_V_per_mps"]
    start = {"kp[1]": kv * kp, "kd[1]": kv, "difference_samples": 2, "torque_limit[1]": 10.0}
    fmu = Importer(fmu_path("PDController"), start, initialize=False)
    fmu.set("q_ref[1]", data["q_ref_m"][0])
    fmu.set("q[1]", data["q_m"][0])
    fmu.initialize()
    got = [fmu.get("tau[1]")]
    for k in range(1, len(data)):
        fmu.set("q_ref[1]", data["q_ref_m"][k])
        fmu.set("q[1]", data["q_m"][k])
        fmu.step((k - 1) * 1e-3, 1e-3)
        got.append(fmu.get("tau[1]"))
    # q is written in steps of 5e-8 m; its difference over 2 ms times kv gives 5e-8 / sqrt(6) kv / 2 ms = 2.5 mV RMS
    error = np.array(got)[3:] - data["u_V"][3:]
    assert np.sqrt(np.mean(error**2)) < 2 * 2.5e-3


# ---- Excitation ----


@pytest.mark.parametrize("ramp", [0.0, 2.0])
def test_sums_of_sinusoids_and_their_derivatives(ramp):
    rng = np.random.default_rng(5)
    amplitude, phase = rng.normal(scale=0.1, size=(2, 30))
    frequency = rng.uniform(0.5, 12.0, size=30)
    start = {"ramp": ramp, "centre[2]": 0.3} | {
        f"{name}[{k + 1}]": float(values[k])
        for name, values in (("amplitude", amplitude), ("frequency", frequency), ("phase", phase))
        for k in range(30)
    }
    fmu = Importer(fmu_path("Excitation"), start)
    times, got = np.arange(1, 4001) * 1e-3, []
    for n in range(4000):
        fmu.step(n * 1e-3, 1e-3)
        got.append([fmu.get(f"{name}[2]") for name in ("q_ref", "dq_ref", "ddq_ref")])
    q, dq, ddq = np.array(got).T
    part = slice(10, 20)
    terms = amplitude[part] * np.sin(frequency[part] * times[:, None] + phase[part])
    s = np.clip(times / ramp, 0, 1) if ramp else np.ones_like(times)
    window = 10 * s**3 - 15 * s**4 + 6 * s**5
    assert np.abs(q - 0.3 - window * terms.sum(axis=1)).max() < 1e-13  # phases up to 48 rad carry 48 EPS = 1e-14
    # central differences of fourth order: error (w H)^4 / 30 w A, 12 rad/s, 1 rad in all
    slope = (8 * (q[3:-1] - q[1:-3]) - (q[4:] - q[:-4])) / 12e-3
    assert np.abs(dq[2:-2] - slope).max() < 1e-6
    slope = (8 * (dq[3:-1] - dq[1:-3]) - (dq[4:] - dq[:-4])) / 12e-3
    smooth = np.abs(times[2:-2] - ramp) > 5e-3  # the third derivative of the window jumps at its end
    assert np.abs(ddq[2:-2] - slope)[smooth].max() < 1e-5


def test_square_pulses():
    fmu = Importer(fmu_path("Excitation"), {"square_amplitude[1]": 0.2, "square_period": 0.1})
    got = []
    for n in range(20):
        got.append(fmu.get("q_ref[1]"))
        fmu.step(n * 0.01, 0.01)
    assert got == ([0.2] * 5 + [-0.2] * 5) * 2


# ---- both versions ----


@pytest.mark.parametrize("model", ["PLikeController", "Operator", "Environment", "PDController", "Excitation"])
def test_fmi_2_and_fmi_3_give_the_same_bits(model):
    """Random parameters, random inputs with slopes, uneven steps."""
    results = []
    for version in (2, 3):
        rng = np.random.default_rng(6)
        path = fmu_path(model, version)
        fmu = Importer(path, initialize=False)
        for name, variable in fmu.variables.items():
            if variable.causality == "parameter" and variable.type in ("Real", "Float64"):
                fmu.set(name, float(abs(rng.normal())))
        fmu.set("stop_time", 1e9) if model == "Operator" else None
        fmu.initialize()
        inputs = [n for n, v in fmu.variables.items() if v.causality == "input" and not n.startswith("der(")]
        point = 0.0
        for _ in range(100):
            for name in inputs:
                fmu.set(name, float(rng.normal()))
                fmu.slope(name, float(rng.normal()))
            size = float(rng.uniform(1e-3, 2e-3))
            fmu.step(point, size)
            point += size
        results.append(fmu.everything())
    assert results[0] == results[1]
