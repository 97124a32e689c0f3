"""Torques given as a current or a duty cycle, and known loads: a servo with equations of its own, entered whole."""

import numpy as np
import pytest

import cosim

KT, R, KE = 0.9, 4.0, 0.9  # N m/A, ohm, V s/rad, at the joint
J, B, C = 0.012, 0.03, 0.08  # kg m^2, N m s/rad, N m
G = 9.81  # m/s^2
LOADS = {"bare": (0.0, 0.0), "light": (0.5, 0.1), "heavy": (0.5, 0.2)}  # kg, m


def swing(seed, mass, length, seconds=16.0, rate=250.0):
    """Time, angle and torque (n,) of a pendulum with a mass that hangs down at q = 0."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    w = 2 * np.pi * np.array([0.31, 0.74, 1.3]) * rng.uniform(0.9, 1.1, 3)
    a, phase = 0.5 * np.array([1, 0.6, 0.3]), rng.uniform(0, 2 * np.pi, 3)
    q, dq, ddq = (
        (scale * f(w * t[:, None] + phase)).sum(1) for scale, f in ((a, np.sin), (a * w, np.cos), (-a * w**2, np.sin))
    )
    load = mass * length**2 * ddq + mass * length * G * np.sin(q)
    torque = J * ddq + B * dq + C * np.sign(dq) + load + 0.003 * rng.normal(size=len(t))
    return t, q, dq, torque


def parameters(path, description):
    path.with_suffix(".toml").write_text(description)
    result = cosim.identify(path).to_dict()
    return {p["name"]: p for p in result["parameters"]}, result["warnings"]


def head(extra=""):
    return f'device = "axis"\n{extra}[columns]\ntime = "t"\nq = ["q"]\ntau = ["u"]\n'


def test_a_current_of_unknown_constant_gives_parameters_in_ampere(tmp_path):
    t, q, _, torque = swing(0, 0.0, 0.0)
    np.savetxt(tmp_path / "a.csv", np.c_[t, q, 1e3 * torque / KT], "%.9g", ",", header="t,q,u", comments="")
    found, warnings = parameters(tmp_path / "a.csv", head() + '[units]\ntau = "mA"\n')
    assert found["inertia"]["unit"] == "A.s2/rad" and found["coulomb"]["unit"] == "A"
    assert found["inertia"]["value"] == pytest.approx(J / KT, rel=0.02)
    assert any("parameters carry A" in text for text in warnings)
    known, _ = parameters(tmp_path / "a.csv", head() + f'[units]\ntau = "mA"\n[scale]\ntau = {KT / 1e3}\n')
    assert known["inertia"]["unit"] == "kg.m2" and known["inertia"]["value"] == pytest.approx(J, rel=0.02)


def test_a_servo_set_of_several_loads_in_duty_cycle_is_entered_whole(tmp_path):
    """U = R/kt tau + ke dq; the masses are known, so that R/kt comes back, and with it all parameters in SI."""
    rows = []
    for k, (name, (mass, length)) in enumerate(LOADS.items()):
        t, q, dq, torque = swing(k, mass, length)
        supply = 12.0 - 0.4 * t / t[-1]
        duty = (R / KT * torque + KE * dq) / supply
        rows += [f"{name},{a:.6f},{b:.9g},{c:.9g},{d:.6g}" for a, b, c, d in zip(t, q, duty, supply, strict=True)]
    (tmp_path / "servo.csv").write_text("\n".join(["run,t,q,u,volt", *rows]))
    mounted = "".join(f"[mounted.{name}]\nmass = {m}\nlength = {length}\n" for name, (m, length) in LOADS.items())
    text = head("gravity = true\n") + 'run = "run"\nsupply = "volt"\n[units]\ntau = "duty"\n'
    found, warnings = parameters(tmp_path / "servo.csv", text + f"[motor]\nback_emf = {KE}\n{mounted}")
    constant = 1 / found["load"]["value"]  # kt / R
    assert found["load"]["unit"] == "V/(N.m)" and constant == pytest.approx(KT / R, rel=0.005)
    for name, value in (("inertia", J), ("viscous", B), ("coulomb", C)):
        low, high = (constant * edge for edge in found[name]["interval"])
        assert low - 0.02 * value <= value <= high + 0.02 * value, name
    assert not any("back-EMF" in text for text in warnings)


def test_known_masses_leave_the_parameters_of_the_bare_joint(tmp_path):
    rows = []
    for k, (name, (mass, length)) in enumerate(LOADS.items()):
        t, q, _, torque = swing(k, mass, length)
        rows += [f"{name},{a:.6f},{b:.9g},{c:.9g},{mass},{length}" for a, b, c in zip(t, q, torque, strict=True)]
    (tmp_path / "set.csv").write_text("\n".join(["run,t,q,u,m,l", *rows]))
    text = head("gravity = true\n") + 'run = "run"\nmass = "m"\nlength = "l"\n'
    found, _ = parameters(tmp_path / "set.csv", text)
    assert found["inertia"]["value"] == pytest.approx(J, rel=0.02)
    assert abs(found["gravity_sin"]["value"]) < 0.005 and "load" not in found  # heavy: m g l = 0.98 N m


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[mounted]\nmas = 1.0\n", "did you mean 'mass'"),
        ("[mounted.a]\nmass = -1.0\n", "0 or more"),
        ("[motor]\nback_emf = true\n", "0 or more"),
        ("[motor]\nke = 1.0\n", "known: back_emf"),
    ],
)
def test_bad_keys_are_named(tmp_path, text, words):
    (tmp_path / "a.csv").write_text("t,q,u\n" + "\n".join(f"{k / 100},{k % 7},{k % 5}" for k in range(200)))
    (tmp_path / "a.toml").write_text(head() + text)
    with pytest.raises(cosim.InputError) as caught:
        cosim.read(tmp_path / "a.csv")
    assert words in str(caught.value)
