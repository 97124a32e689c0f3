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


def holds(entry, value):
    """Whether a parameter is within four of its standard deviations (6e-5) of what it should be, and known to 3 %."""
    return abs(entry["value"] - value) <= 4 * entry["std"] and entry["std"] <= 0.03 * abs(value)


def head(extra=""):
    return f'device = "axis"\n{extra}[columns]\ntime = "t"\nq = ["q"]\ntau = ["u"]\n'


def test_a_current_of_unknown_constant_gives_parameters_in_ampere(tmp_path):
    t, q, _, torque = swing(0, 0.0, 0.0)
    np.savetxt(tmp_path / "a.csv", np.c_[t, q, 1e3 * torque / KT], "%.9g", ",", header="t,q,u", comments="")
    found, warnings = parameters(tmp_path / "a.csv", head() + '[units]\ntau = "mA"\n')
    assert found["inertia"]["unit"] == "A.s2/rad" and found["coulomb"]["unit"] == "A"
    assert holds(found["inertia"], J / KT)
    assert any("parameters carry A" in text for text in warnings)
    known, _ = parameters(tmp_path / "a.csv", head() + f'[units]\ntau = "mA"\n[scale]\ntau = {KT / 1e3}\n')
    assert known["inertia"]["unit"] == "kg.m2" and holds(known["inertia"], J)


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
    assert holds(found["inertia"], J)
    assert abs(found["gravity_sin"]["value"]) < 0.005 and "load" not in found  # heavy: m g l = 0.98 N m


GAIN, BAND = 6.0, 0.012  # N m/rad, rad


def servo_set(path, extra=""):
    """A set of the loads on a position servo: tau = GAIN (e - BAND sgn(e)), so that e = tau / GAIN + BAND sgn(tau)."""
    rows = []
    for k, (name, (mass, length)) in enumerate(LOADS.items()):
        t, q, _, torque = swing(k, mass, length)
        count = 2 * np.pi / 16384
        measured = np.round(q / count) * count
        goal = measured + torque / GAIN + BAND * np.sign(torque)
        rows += [f"{name},{a:.6f},{b:.9g},{c:.9g}" for a, b, c in zip(t, measured, goal, strict=True)]
    path.write_text("\n".join(["run,t,q,goal", *rows]))
    mounted = "".join(f"[mounted.{name}]\nmass = {m}\nlength = {length}\n" for name, (m, length) in LOADS.items())
    columns = '[columns]\ntime = "t"\nq = ["q"]\nq_ref = ["goal"]\nrun = "run"\n'
    return f'device = "axis"\ngravity = true\n{columns}[servo]\n{extra}{mounted}'


def test_a_position_servo_of_unknown_gain_and_dead_band_gives_both(tmp_path):
    found, warnings = parameters(tmp_path / "servo.csv", servo_set(tmp_path / "servo.csv"))
    assert found["load"]["unit"] == "rad/(N.m)" and 1 / found["load"]["value"] == pytest.approx(GAIN, rel=0.01)
    assert found["dead_band"]["unit"] == "rad" and found["dead_band"]["value"] == pytest.approx(BAND, rel=0.1)
    for name, value in (("inertia", J), ("viscous", B), ("coulomb", C)):
        low, high = (GAIN * edge for edge in found[name]["interval"])
        assert low - 0.03 * value <= value <= high + 0.03 * value, name
    assert any("the servo's gain is not known" in text for text in warnings)


def test_a_position_servo_with_its_gain_and_dead_band_gives_si(tmp_path):
    text = servo_set(tmp_path / "servo.csv", f"gain = {GAIN}\ndead_band = {BAND}\n")
    found, _ = parameters(tmp_path / "servo.csv", text)
    assert "load" not in found and "dead_band" not in found and found["inertia"]["unit"] == "kg.m2"
    assert holds(found["inertia"], J)
    assert holds(found["coulomb"], C)


def test_errors_beyond_the_limit_of_a_servo_are_left_out(tmp_path):
    text = servo_set(tmp_path / "servo.csv", f"gain = {GAIN}\ndead_band = {BAND}\nlimit = 0.1\n")
    (tmp_path / "servo.toml").write_text(text)
    data = cosim.read(tmp_path / "servo.csv")
    heavy = data.runs[-1]
    assert np.array_equal(heavy.clipped, np.abs(heavy.q_ref - heavy.q) >= 0.1) and heavy.clipped.any()


def test_signals_of_the_motors_side_of_a_gear_give_the_joint(tmp_path):
    """An encoder and a torque sensor before a gear that turns the other way."""
    ratio = -50.0
    t, q, _, torque = swing(0, 0.0, 0.0)
    path = tmp_path / "a.csv"
    np.savetxt(path, np.c_[t, ratio * q, torque / ratio], "%.9g", ",", header="t,q,u", comments="")
    found, _ = parameters(path, head() + f'[gear]\nratio = {ratio}\nencoder = "motor"\ntorque = "motor"\n')
    assert holds(found["inertia"], J) and found["inertia"]["unit"] == "kg.m2"
    assert holds(found["coulomb"], C)


def test_the_back_emf_of_a_motor_before_a_gear(tmp_path):
    """U = R/kt tau/ratio + ke ratio dq with the motor's own constants; [scale] tau = kt/R makes N m of volts."""
    ratio, kt = 50.0, KT / 50
    t, q, dq, torque = swing(0, 0.0, 0.0)
    path = tmp_path / "a.csv"
    volts = R / kt * torque / ratio + kt * ratio * dq
    np.savetxt(path, np.c_[t, q, volts], "%.9g", ",", header="t,q,u", comments="")
    text = f'[units]\ntau = "V"\n[scale]\ntau = {kt / R}\n[motor]\nback_emf = {kt}\n'
    found, _ = parameters(path, head() + text + f'[gear]\nratio = {ratio}\ntorque = "motor"\n')
    assert holds(found["inertia"], J)
    assert holds(found["viscous"], B)


def test_inertia_and_mounting_as_columns_and_temperature_as_a_key(tmp_path):
    """A wheel without an arm, a bar that hangs to the side; viscous friction falls by 1 % per kelvin."""
    runs = {"wheel": (0.004, 0.0, 0.0, 20.0), "side": (0.01, 0.3, 0.7, 45.0)}  # kg m^2, kg m, rad, degC
    rows, keys = [], ""
    for k, (name, (inertia, moment, angle, warm)) in enumerate(runs.items()):
        t, q, dq, torque = swing(k, 0.0, 0.0)
        ddq = np.gradient(dq, t)
        friction = -0.01 * (warm - 32.5) * B * dq
        tau = torque + friction + (inertia + moment * 0.1) * ddq + moment * G * np.sin(q - angle)
        rows += [
            f"{name},{a:.6f},{b:.9g},{c:.9g},{moment / 0.1},0.1,{inertia},{angle}"
            for a, b, c in zip(t, q, tau, strict=True)
        ]
        keys += f"[mounted.{name}]\ntemperature = {warm}\n"
    (tmp_path / "set.csv").write_text("\n".join(["run,t,q,u,m,l,i,a", *rows]))
    columns = 'run = "run"\nmass = "m"\nlength = "l"\ninertia = "i"\nangle = "a"\n'
    (tmp_path / "set.toml").write_text(head("gravity = true\n") + columns + keys)
    result = cosim.identify(tmp_path / "set.csv").to_dict()
    found = {p["name"]: p for p in result["parameters"]}
    assert holds(found["inertia"], J)
    assert abs(found["gravity_sin"]["value"]) < 0.01 and abs(found["gravity_cos"]["value"]) < 0.01
    assert ["temperature", "in the interval"] in [[d["kind"], d["done"]] for d in result["doubts"]]
    low, high = found["viscous"]["interval"]
    assert low < B * (1 - 0.01 * 12.5) and high > B * (1 + 0.01 * 12.5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[mounted]\nmas = 1.0\n", "did you mean 'mass'"),
        ("[mounted.a]\nmass = -1.0\n", "0 or more"),
        ("[motor]\nback_emf = true\n", "0 or more"),
        ("[motor]\nke = 1.0\n", "known: back_emf"),
        ("[gear]\nratio = 0\n", "a number other than 0"),
        ('[gear]\nencoder = "output"\n', "joint or motor"),
        ("[servo]\ngain = 2.0\n", "none beside [servo]"),
        ("[servo]\nkp = 2.0\n", "known: gain"),
    ],
)
def test_bad_keys_are_named(tmp_path, text, words):
    (tmp_path / "a.csv").write_text("t,q,u\n" + "\n".join(f"{k / 100},{k % 7},{k % 5}" for k in range(200)))
    (tmp_path / "a.toml").write_text(head() + text)
    with pytest.raises(cosim.InputError) as caught:
        cosim.read(tmp_path / "a.csv")
    assert words in str(caught.value)
